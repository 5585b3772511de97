//! Where files are written that grow, as those of a recording: what a writer needs of a file system, and no more.
//! `isotherm-files` has the one of the operating system, `Disk`.

use crate::source::ReadSeek;
use std::io;
use std::path::Path;
use std::time::Duration;

/// A place for files that grow. A file that is written is locked: no other process replaces or removes it.
pub trait Storage {
    /// Creates a file with these bytes. It appears with all of them, and never replaces an existing one, except one
    /// without rows, which `is_vacant` recognises by its bytes. `-` is the standard output.
    ///
    /// # Errors
    /// If it exists or cannot be written.
    fn create(&self, path: &Path, bytes: &[u8], is_vacant: fn(&[u8]) -> bool) -> io::Result<Box<dyn GrowingFile>>;

    /// Whether there is something of this name.
    fn exists(&self, path: &Path) -> bool;

    /// Whether [`create`](Self::create) would create a file of this name.
    fn is_vacant(&self, path: &Path, is_vacant: fn(&[u8]) -> bool) -> bool;

    /// The names of all files in the folder of this one.
    fn names_beside(&self, path: &Path) -> Vec<String>;

    /// Bytes that can still be written next to this file; `None` if that is not known.
    fn free_beside(&self, path: &Path) -> Option<u64>;

    /// Removes a file.
    ///
    /// # Errors
    /// Those of the operating system.
    fn remove(&self, path: &Path) -> io::Result<()>;

    /// Whether it is a file of this user that no process writes, and of which `is_own` says so.
    fn is_own(&self, path: &Path, is_own: fn(&mut dyn ReadSeek) -> io::Result<bool>) -> bool;

    /// The time since some instant.
    fn now(&self) -> Duration;
}

/// A file that grows by whole steps only, each of which is durable.
pub trait GrowingFile {
    /// Puts `more` behind what was kept so far. After an error the file is as it was.
    ///
    /// # Errors
    /// If the operating system cannot write all of them.
    fn grow(&mut self, more: &[u8]) -> io::Result<()>;

    /// Replaces the whole file by these bytes, in one step.
    ///
    /// # Errors
    /// As [`grow`](Self::grow).
    fn restart(&mut self, bytes: &[u8]) -> io::Result<()>;
}
