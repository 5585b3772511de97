//! Installing a coefficient table with a way back: the predecessor stays next to it.
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
//! What came out still has its owner and permissions; it is renamed over the copy. There it waits until it is known
//! whether the new table is good: then [`complete`](Installation::complete) makes it the predecessor, otherwise
//! [`put_back`](Installation::put_back) puts it in force again. So SIGKILL loses nothing: the next process finds either
//! a `TABLE.replaced` to decide about, or a copy that equals TABLE, which then was not replaced.

use crate::identity::Identity;
use crate::place::{exchange, is_trusted, output_place, rename, sync_folder};
use crate::staged::{HIDDEN, give_mode_and_owner, mode_of};
use isotherm_support::failure::{Exit, Failure, shown};
use rustix::fs::OFlags;
use std::ffi::OsString;
use std::fs::{self, File, Metadata, OpenOptions, Permissions, TryLockError};
use std::io::{self, Write as _};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

/// How long to wait for another process that installs or rolls back; that takes milliseconds.
const LOCK_PATIENCE: Duration = Duration::from_secs(30);
const RETRY_PAUSE: Duration = Duration::from_millis(10);
/// Permissions of a file that replaces none.
const NEW_MODE: u32 = 0o644;

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
    /// Waits until no other process installs a table as `target`. If such a process was killed before it has replaced
    /// the table in force, what it has left is removed.
    ///
    /// If `target` is a link, this is about the file that it names, so that the predecessor is the same by every name.
    /// A link is followed if it and the file belong to this user or root.
    ///
    /// # Errors
    /// [`Exit::Temporary`] if another process keeps the lock for 30 s, and [`Exit::Io`] if no file can be written
    /// there, if a link leads to nothing, or if something else has one of the names.
    pub fn lock(target: &Path) -> Result<Self, Failure> {
        Self::lock_within(LOCK_PATIENCE, target)
    }

    fn lock_within(patience: Duration, target: &Path) -> Result<Self, Failure> {
        Self::try_lock(patience, target).map_err(|error| {
            let failure = Failure::io("replacing", target, &error);
            let is_busy = error.kind() == io::ErrorKind::ResourceBusy;
            let (exit, remedy) =
                if is_busy { (Exit::Temporary, "; run the same command again") } else { (Exit::Io, "") };
            Failure { exit, message: format!("{failure}; nothing is changed{remedy}"), ..failure }
        })
    }

    fn try_lock(patience: Duration, target: &Path) -> io::Result<Self> {
        // A link is not replaced, but what it leads to.
        let file = output_place(target)?;
        check_links(target, &file)?;
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
        let installation = Self { _lock: FileLock::take(lock, patience)?, file, previous, replaced, new };
        installation.tidy()?;
        Ok(installation)
    }

    /// Where the predecessor is kept.
    #[must_use]
    pub fn previous(&self) -> &Path {
        &self.previous
    }

    /// The state of the file; `None` if there is none.
    #[must_use]
    pub fn state(&self) -> Option<Identity> {
        Identity::of(&self.file)
    }

    /// Whether the table in force has replaced another one that is not the predecessor yet.
    #[must_use]
    pub fn is_pending(&self) -> bool {
        self.replaced.exists()
    }

    /// Installs `text`. A new file has the permissions 0644, one that replaces another has its permissions and owner.
    /// The old file waits to become the predecessor; one that waits already stays.
    ///
    /// # Errors
    /// The operating system's; the installed file and its predecessor are then unchanged, or the message says what has
    /// become of them.
    pub fn install(&self, text: &str) -> Result<(), Failure> {
        self.put(text.as_bytes()).map_err(|error| self.failed("installing", &error))
    }

    fn put(&self, text: &[u8]) -> io::Result<()> {
        let Some(present) = regular(&self.file)? else {
            self.write_new(text, None)?;
            return rename(&self.new, &self.file);
        };
        let waits = self.is_pending();
        if !waits {
            self.keep_copy(&present)?;
        }
        self.write_new(text, Some(&present))?;
        match exchange(&self.new, &self.file)? {
            false => rename(&self.new, &self.file),
            true if waits => remove(&self.new).and_then(|()| sync_folder(&self.file)),
            true => rename(&self.new, &self.replaced).map_err(|error| self.undo(error)),
        }
    }

    /// Puts the old table in force again, because of this error.
    fn undo(&self, error: io::Error) -> io::Error {
        let Err(second) = rename(&self.replaced, &self.file) else { return error };
        let replaced = shown(&self.replaced);
        let message = format!("{error}; the new table is in force anyway, {replaced} is the old one: {second}");
        io::Error::new(error.kind(), message)
    }

    /// Makes the table that was replaced the predecessor, if one waits for that.
    ///
    /// # Errors
    /// The operating system's; it waits on.
    pub fn complete(&self) -> Result<(), Failure> {
        if !self.is_pending() {
            return Ok(());
        }
        rename(&self.replaced, &self.previous).map_err(|error| {
            let (place, replaced) = (shown(&self.file), shown(&self.replaced));
            let failure = Failure::io("keeping the predecessor as", &self.previous, &error);
            Failure {
                message: format!("{failure}; {place} is the new table, and its predecessor is {replaced}"),
                ..failure
            }
        })
    }

    /// Puts the table that was replaced in force again, or removes the file if it has replaced none.
    ///
    /// # Errors
    /// The operating system's; the file is then unchanged.
    pub fn put_back(&self) -> Result<(), Failure> {
        let put_back = if self.is_pending() {
            rename(&self.replaced, &self.file)
        } else {
            remove(&self.file).and_then(|()| sync_folder(&self.file))
        };
        put_back.map_err(|error| Failure::io("putting back", &self.file, &error))
    }

    /// Removes the table that was replaced, if one waits: it was no good one. The predecessor stays.
    ///
    /// # Errors
    /// The operating system's.
    pub fn discard(&self) -> Result<(), Failure> {
        remove(&self.replaced).map_err(|error| Failure::io("removing", &self.replaced, &error))
    }

    /// Removes what a step has left that did not succeed.
    fn failed(&self, phase: &str, error: &io::Error) -> Failure {
        let _ = self.tidy();
        Failure::io(phase, &self.file, error)
    }

    /// Removes a file that was being written, and the copy of a table that was not replaced.
    fn tidy(&self) -> io::Result<()> {
        remove(&self.new)?;
        let Some(replaced) = regular(&self.replaced)? else { return Ok(()) };
        let is_copy = regular(&self.file)?.is_some_and(|present| present.len() == replaced.len())
            && fs::read(&self.file)? == fs::read(&self.replaced)?;
        if is_copy { remove(&self.replaced) } else { Ok(()) }
    }

    /// Copies the file, which is `present`, to the name that says that it is being replaced.
    fn keep_copy(&self, present: &Metadata) -> io::Result<()> {
        self.write_new(&fs::read(&self.file)?, Some(present))?;
        rename(&self.new, &self.replaced)
    }

    /// Writes a new file with the permissions and owner of the `existing` one, and waits until it is on the disk.
    /// Everybody may read one that replaces none, so that the service can read what root installs.
    fn write_new(&self, content: &[u8], existing: Option<&Metadata>) -> io::Result<()> {
        remove(&self.new)?;
        // Nobody has another file of this name: nothing is written into what somebody has put there.
        let mut file = OpenOptions::new().write(true).create_new(true).mode(mode_of(existing)).open(&self.new)?;
        match existing {
            Some(_) => give_mode_and_owner(&file, existing),
            None => file.set_permissions(Permissions::from_mode(NEW_MODE))?,
        }
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
    fn take(path: PathBuf, patience: Duration) -> io::Result<Self> {
        let mut options = OpenOptions::new();
        options.write(true).create(true).truncate(false).mode(0o600);
        options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits().cast_signed());
        let begun = Instant::now();
        loop {
            let file = options.open(&path).map_err(|error| about(&path, &error))?;
            match file.try_lock() {
                Err(TryLockError::WouldBlock) if begun.elapsed() < patience => thread::sleep(RETRY_PAUSE),
                Err(TryLockError::WouldBlock) => {
                    let message = format!("another process has locked {} for {patience:?}", shown(&path));
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

/// Checks that nobody but this user and root has made the links that lead from `target` to `file`, or the file.
fn check_links(target: &Path, file: &Path) -> io::Result<()> {
    let mut path = target.to_owned();
    while path != file {
        check_maker(&path)?;
        path = path.parent().unwrap_or(Path::new("")).join(fs::read_link(&path)?);
    }
    if target == file { Ok(()) } else { check_maker(file) }
}

/// Checks that this user or root has made what is at `path`.
fn check_maker(path: &Path) -> io::Result<()> {
    let found = fs::symlink_metadata(path).map_err(|error| about(path, &error))?;
    let (place, owner) = (shown(path), found.uid());
    if is_trusted(owner) {
        return Ok(());
    }
    Err(io::Error::other(format!(
        "{place} belongs to user {owner}, and a link is followed only among files of one user; name the file itself"
    )))
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
