//! Installing a coefficient table with a way back: the predecessor stays next to it, and a rollback exchanges the two.
//!
//! One process at a time has the [`Installation`] of a file. Next to TABLE it uses these names:
//!
//! | name | what |
//! |---|---|
//! | `TABLE.previous` | the predecessor |
//! | `TABLE.replaced` | a copy of the table in force while another one takes its place |
//! | `.isotherm-TABLE.new` | a file that is being written |
//! | `.isotherm-TABLE.lock` | locked by the process that has the installation |
//!
//! An installation copies the table in force to `TABLE.replaced`, writes the new table, and exchanges it with TABLE.
//! What came out still has its owner and permissions; it is renamed over the copy, and then over `TABLE.previous`. So
//! SIGKILL loses nothing: the next process that finds a `TABLE.replaced` completes the installation, or removes the
//! copy if it equals TABLE, which then was not replaced.

use crate::identity::Identity;
use crate::place::{exchange, output_place, rename, sync_folder};
use crate::staged::{HIDDEN, give_mode_and_owner, mode_of};
use isotherm_support::failure::{Exit, Failure, shown};
use rustix::fs::OFlags;
use std::ffi::OsString;
use std::fs::{self, File, Metadata, OpenOptions, TryLockError};
use std::io::{self, Write as _};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

/// How long to wait for another process that installs or rolls back; that takes milliseconds.
const LOCK_PATIENCE: Duration = Duration::from_secs(30);
const RETRY_PAUSE: Duration = Duration::from_millis(10);

/// The sole right to replace an installed table.
pub struct Installation {
    /// The file, not a link to it.
    file: PathBuf,
    previous: PathBuf,
    replaced: PathBuf,
    new: PathBuf,
    _lock: FileLock,
}

impl Installation {
    /// Waits until no other process installs a table as `target` or brings its predecessor back. If such a process was
    /// killed, its step is completed, or taken back if the table in force was not replaced yet.
    ///
    /// If `target` is a link, this is about the file that it names, so that the predecessor is the same by every name.
    ///
    /// # Errors
    /// If another process keeps the lock, if no file can be written there, or if something else has one of the names.
    pub fn lock(target: &Path) -> Result<Self, Failure> {
        Self::try_lock(target).map_err(|error| Failure::io("locking", target, &error))
    }

    fn try_lock(target: &Path) -> io::Result<Self> {
        // A link is not replaced, but what it leads to.
        let file = output_place(target)?;
        let name = |before: &str, after: &str| {
            let mut name = OsString::from(before);
            name.push(file.file_name().unwrap_or_default());
            name.push(after);
            file.with_file_name(name)
        };
        let [previous, replaced] = [name("", ".previous"), name("", ".replaced")];
        let [new, lock] = [name(HIDDEN, ".new"), name(HIDDEN, ".lock")];
        for path in [&file, &previous, &replaced, &new, &lock] {
            regular(path)?;
        }
        let installation = Self { _lock: FileLock::take(lock)?, file, previous, replaced, new };
        installation.settle()?;
        Ok(installation)
    }

    /// Where the predecessor is kept.
    #[must_use]
    pub fn previous(&self) -> &Path {
        &self.previous
    }

    /// Checks that the file is in the state with which the new table was compared; `None` if there was no file.
    ///
    /// # Errors
    /// If it is not.
    pub fn check_unchanged(&self, compared: Option<Identity>) -> Result<(), Failure> {
        if Identity::of(&self.file) == compared {
            return Ok(());
        }
        let place = shown(&self.file);
        let message = format!("{place} has changed meanwhile; run it again, to compare with what it is now");
        Err(Failure::new(Exit::Failed, message))
    }

    /// Installs `text`. An existing file becomes the predecessor; the new one gets its permissions and owner. Returns
    /// whether there is a new predecessor. If `text` is installed already, nothing is changed.
    ///
    /// # Errors
    /// The operating system's; the installed file and its predecessor are then unchanged, or the message says what has
    /// become of them.
    pub fn install(&self, text: &str) -> Result<bool, Failure> {
        self.put(text.as_bytes()).map_err(|error| self.failed("installing", &error))
    }

    fn put(&self, text: &[u8]) -> io::Result<bool> {
        let Some(present) = regular(&self.file)? else {
            self.write_new(text, None)?;
            rename(&self.new, &self.file)?;
            return Ok(false);
        };
        if fs::read(&self.file)? == text {
            return Ok(false);
        }
        self.keep_copy(&present)?;
        self.write_new(text, Some(&present))?;
        let came_out = exchange(&self.new, &self.file)?;
        if !came_out {
            rename(&self.new, &self.file)?;
        }
        let kept = if came_out { rename(&self.new, &self.replaced) } else { Ok(()) };
        kept.and_then(|()| self.settle()).map_err(|error| self.put_back(error))?;
        Ok(true)
    }

    /// Puts the old table in force again, because of this error.
    fn put_back(&self, error: io::Error) -> io::Error {
        let Err(second) = rename(&self.replaced, &self.file) else { return error };
        let replaced = shown(&self.replaced);
        let message = format!("{error}; the new table is in force anyway, {replaced} is the old one: {second}");
        io::Error::new(error.kind(), message)
    }

    /// Exchanges the file and its predecessor; a second call takes the first one back.
    ///
    /// # Errors
    /// The operating system's; nothing is changed then.
    pub fn roll_back(&self) -> Result<(), Failure> {
        let exchanged = match exchange(&self.file, &self.previous) {
            Ok(false) => self.swap(),
            exchanged => exchanged.and_then(|_| sync_folder(&self.file)),
        };
        exchanged.map_err(|error| self.failed("exchanging with its predecessor", &error))
    }

    /// Exchanges the file and its predecessor where the file system cannot do that in one step.
    fn swap(&self) -> io::Result<()> {
        if let Some(present) = regular(&self.file)? {
            self.keep_copy(&present)?;
        }
        rename(&self.previous, &self.file)?;
        self.settle()
    }

    /// Removes what a step has left that did not succeed.
    fn failed(&self, phase: &str, error: &io::Error) -> Failure {
        let _ = self.settle();
        Failure::io(phase, &self.file, error)
    }

    /// Completes what a process has begun: what was replaced becomes the predecessor.
    fn settle(&self) -> io::Result<()> {
        remove(&self.new)?;
        let Some(replaced) = regular(&self.replaced)? else { return Ok(()) };
        let same = regular(&self.file)?.is_some_and(|present| present.len() == replaced.len())
            && fs::read(&self.file)? == fs::read(&self.replaced)?;
        if same {
            return remove(&self.replaced);
        }
        rename(&self.replaced, &self.previous)
    }

    /// Copies the file, which is `present`, to the name that says that it is being replaced.
    fn keep_copy(&self, present: &Metadata) -> io::Result<()> {
        self.write_new(&fs::read(&self.file)?, Some(present))?;
        rename(&self.new, &self.replaced)
    }

    /// Writes a new file with the permissions and owner of the `existing` one, and waits until it is on the disk.
    fn write_new(&self, content: &[u8], existing: Option<&Metadata>) -> io::Result<()> {
        remove(&self.new)?;
        // Nobody has another file of this name: nothing is written into what somebody has put there.
        let mut file = OpenOptions::new().write(true).create_new(true).mode(mode_of(existing)).open(&self.new)?;
        give_mode_and_owner(&file, existing);
        file.write_all(content)?;
        file.sync_all()
    }
}

/// A locked file, which is removed at the end. It has no permissions for others, so that they cannot lock it for ever.
struct FileLock {
    _file: File,
    path: PathBuf,
}

impl FileLock {
    fn take(path: PathBuf) -> io::Result<Self> {
        let mut options = OpenOptions::new();
        options.write(true).create(true).truncate(false).mode(0o600);
        options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits().cast_signed());
        let begun = Instant::now();
        loop {
            let file = options.open(&path).map_err(|error| about(&path, &error))?;
            match file.try_lock() {
                Err(TryLockError::WouldBlock) if begun.elapsed() < LOCK_PATIENCE => thread::sleep(RETRY_PAUSE),
                Err(TryLockError::WouldBlock) => {
                    let message = format!("another process has locked {} for {LOCK_PATIENCE:?}", shown(&path));
                    return Err(io::Error::new(io::ErrorKind::ResourceBusy, message));
                }
                // Some network file systems have no locks.
                Err(TryLockError::Error(error)) if error.kind() != io::ErrorKind::Unsupported => {
                    return Err(about(&path, &error));
                }
                Ok(()) | Err(TryLockError::Error(_)) => {
                    let (opened, named) = (file.metadata()?, fs::symlink_metadata(&path));
                    // The process that had the lock may have removed the file between opening and locking.
                    if named.is_ok_and(|named| (named.dev(), named.ino()) == (opened.dev(), opened.ino())) {
                        return Ok(Self { _file: file, path });
                    }
                }
            }
        }
    }
}

impl Drop for FileLock {
    fn drop(&mut self) {
        // Still locked: it is this process's file.
        let _ = fs::remove_file(&self.path);
    }
}

fn remove(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(about(path, &error)),
        _ => Ok(()),
    }
}

/// What is known of the regular file `path`; `None` if there is nothing.
fn regular(path: &Path) -> io::Result<Option<Metadata>> {
    output_place(path).map_err(|error| about(path, &error))?;
    match fs::symlink_metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
        Ok(metadata) if metadata.is_file() => Ok(Some(metadata)),
        Ok(_) => {
            let message = format!("{} is not a regular file; move it away", shown(path));
            Err(io::Error::new(io::ErrorKind::InvalidInput, message))
        }
    }
}

/// The user knows the name of the target only.
fn about(path: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{}: {error}", shown(path)))
}

#[cfg(test)]
mod tests;
