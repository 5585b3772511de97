//! A file of rows that come from a live stream and cannot be had again.
//!
//! Until it is complete its name ends in `.partial`. It holds whole rows at every moment, apart from a SIGKILL or a
//! power failure in the middle of a write, which may cut the last row. If the command ends early the file stays under
//! that name.

use crate::place::{kind_of, output_place, rename};
use crate::signals::{UnfinishedFile, hold_signals};
use isotherm_support::failure::{Failure, shown};
use rustix::fs::OFlags;
use rustix::process::geteuid;
use std::fs::{self, File, Metadata, OpenOptions, Permissions, TryLockError};
use std::io::{self, Seek as _, SeekFrom, Write};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _, fchown};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The rows are written when they are this long, or at a flush \[bytes\].
const BLOCK: usize = 1 << 16;
/// How often creating the file is tried while other processes make and remove files of its name.
const TRIES: usize = 100;

/// Where the rows of an output are until it is complete.
#[derive(Clone, Debug)]
pub struct Partial {
    path: PathBuf,
    /// Lines in the file; the first one is the header.
    lines: Arc<AtomicU64>,
}

impl Partial {
    fn rows(&self) -> u64 {
        self.lines.load(Ordering::Relaxed).saturating_sub(1)
    }

    /// Says in the message where the rows are, if there are any.
    #[must_use]
    pub fn explain(&self, failure: Failure) -> Failure {
        match (self.rows(), shown(&self.path)) {
            (0, _) => failure,
            (1, path) => Failure::new(failure.exit, format!("1 row is in {path}: {failure}")),
            (rows, path) => Failure::new(failure.exit, format!("{rows} rows are in {path}: {failure}")),
        }
    }
}

/// A CSV file that grows by whole rows.
pub struct LiveFile {
    file: File,
    target: PathBuf,
    partial: Partial,
    /// Permissions of the complete file. Until then nobody else may open it: who may read it could lock it for ever.
    mode: u32,
    /// Bytes that have not been written.
    pending: Vec<u8>,
    length: u64,
    complete: bool,
    /// Until there is a row.
    unfinished: Option<UnfinishedFile>,
}

impl LiveFile {
    /// Creates the file `target` under its temporary name, with the owner of the `existing` one; the complete file gets
    /// its permissions, too.
    ///
    /// # Errors
    /// If it cannot be created, if another process writes it, if there are rows in it from an earlier run, or if
    /// something else has its name.
    pub fn create(target: PathBuf, existing: Option<&Metadata>) -> io::Result<Self> {
        let path = partial_of(&target);
        let tries = (0..TRIES).find_map(|_| {
            // Until the file is listed: a signal between creating and listing removes it too.
            let _held = hold_signals();
            let claimed = claim(&path, existing).transpose()?;
            Some(claimed.map(|file| (file, UnfinishedFile::list(&path))))
        });
        let busy = || refusal(&path, "is made and removed by other processes all the time; name another file");
        let (file, unfinished) = tries.unwrap_or_else(|| Err(busy())).map_err(|error| match error.raw_os_error() {
            // The user knows the name of the target only.
            Some(_) => io::Error::new(error.kind(), format!("{}: {error}", shown(&path))),
            None => error,
        })?;
        give_owner(&file, existing);
        let mode = existing.map_or_else(|| 0o666 & !umask(), |existing| mode_of(Some(existing)));
        let partial = Partial { path, lines: Arc::default() };
        let unfinished = Some(unfinished);
        Ok(Self { file, target, partial, mode, pending: Vec::new(), length: 0, complete: false, unfinished })
    }

    /// Where the rows are.
    pub const fn partial(&self) -> &Partial {
        &self.partial
    }

    /// Gives the complete file its name.
    ///
    /// # Errors
    /// If the last rows cannot be written or the file cannot be renamed.
    pub fn finish(mut self) -> io::Result<()> {
        self.flush()?;
        self.file.sync_all()?;
        // Some file systems have no permissions.
        let _ = self.file.set_permissions(Permissions::from_mode(self.mode));
        rename(&self.partial.path, &self.target)?;
        self.complete = true;
        Ok(())
    }

    /// Writes the pending rows. If not all fit, those that fit stay, and the rest remains pending.
    fn write_rows(&mut self) -> io::Result<()> {
        let mut written = 0;
        let result = loop {
            match self.file.write(&self.pending[written..]) {
                Ok(0) if written == self.pending.len() => break Ok(()),
                Ok(0) => break Err(io::Error::from(io::ErrorKind::WriteZero)),
                Ok(count) => written += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => break Err(error),
            }
        };
        let whole = self.pending[..written].iter().rposition(|&byte| byte == b'\n').map_or(0, |last| last + 1);
        let lines = self.pending[..whole].iter().filter(|&&byte| byte == b'\n').count() as u64;
        self.pending.drain(..whole);
        self.length += whole as u64;
        if written > whole {
            self.file.set_len(self.length)?;
            self.file.seek(SeekFrom::Start(self.length))?;
        }
        self.partial.lines.fetch_add(lines, Ordering::Relaxed);
        if self.partial.rows() > 0 {
            self.unfinished = None;
        }
        result
    }
}

/// Takes lines of text. Only whole lines are written to the file.
impl Write for LiveFile {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.pending.extend_from_slice(buffer);
        if self.pending.len() >= BLOCK && buffer.ends_with(b"\n") {
            self.write_rows()?;
        }
        Ok(buffer.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.write_rows()
    }
}

impl Drop for LiveFile {
    fn drop(&mut self) {
        // The lock is still held: nobody else has this file.
        if !self.complete && self.partial.rows() == 0 {
            let _ = fs::remove_file(&self.partial.path);
        }
    }
}

/// Creates the file at `path` and locks it; `None` if what was in its place has gone. Nothing is ever written into a
/// file that was there before: anybody who may write the folder can have made it, with any permissions.
fn claim(path: &Path, existing: Option<&Metadata>) -> io::Result<Option<File>> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true).mode(0o600);
    options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits().cast_signed());
    let (file, new) = match options.open(path) {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
            let opened = check_leftover(path, existing).and_then(|()| options.create_new(false).open(path));
            match opened {
                Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
                opened => (opened?, false),
            }
        }
        created => (created?, true),
    };
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => {
            let message = format!("another process is writing {}; name another file", shown(path));
            return Err(io::Error::new(io::ErrorKind::ResourceBusy, message));
        }
        // Some network file systems have no locks.
        Err(TryLockError::Error(error)) if error.kind() != io::ErrorKind::Unsupported => return Err(error),
        Ok(()) | Err(TryLockError::Error(_)) => {}
    }
    let opened = file.metadata()?;
    let id = |metadata: &Metadata| (metadata.dev(), metadata.ino());
    // Another run may have renamed or removed the file between opening and locking.
    if !fs::symlink_metadata(path).is_ok_and(|named| id(&named) == id(&opened)) {
        return Ok(None);
    }
    if new {
        return Ok(Some(file));
    }
    if opened.len() > 0 {
        return Err(refusal(path, "has what an earlier run received; move or remove it"));
    }
    fs::remove_file(path)?;
    Ok(None)
}

/// Checks that an earlier run of this user can have left what is at `path`. A run of root gives its file to the owner
/// of the `existing` one.
fn check_leftover(path: &Path, existing: Option<&Metadata>) -> io::Result<()> {
    let found = fs::symlink_metadata(path)?;
    let own = found.uid() == geteuid().as_raw() || existing.is_some_and(|existing| existing.uid() == found.uid());
    if found.is_file() && own {
        return Ok(());
    }
    let object = kind_of(&found);
    Err(refusal(path, &format!("is a {object} of user {}; have it removed, or name another file", found.uid())))
}

fn refusal(path: &Path, why: &str) -> io::Error {
    io::Error::new(io::ErrorKind::AlreadyExists, format!("{} {why}", shown(path)))
}

/// The permissions to create a file with that replaces the `existing` one. The umask applies to them.
pub(crate) fn mode_of(existing: Option<&Metadata>) -> u32 {
    existing.map_or(0o666, |existing| existing.mode() & 0o777)
}

/// The permissions that new files of this process do not get.
fn umask() -> u32 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let umask = status.lines().find_map(|line| u32::from_str_radix(line.strip_prefix("Umask:")?.trim(), 8).ok());
    umask.unwrap_or(0o077)
}

/// Gives a new file the owner of the `existing` one that it replaces, as far as this user and the file system allow.
fn give_owner(file: &File, existing: Option<&Metadata>) {
    if let Some(existing) = existing {
        let _ = fchown(file, Some(existing.uid()), Some(existing.gid()));
    }
}

/// Gives a new file owner and permissions of the `existing` one that it replaces, as far as this user and the file
/// system allow.
pub(crate) fn give_mode_and_owner(file: &File, existing: Option<&Metadata>) {
    give_owner(file, existing);
    if let Some(existing) = existing {
        // The umask does not apply here.
        let _ = file.set_permissions(Permissions::from_mode(mode_of(Some(existing))));
    }
}

/// Where the rows of the output `path` are until it is complete.
pub fn partial_path(path: &Path) -> PathBuf {
    partial_of(&target_of(path))
}

fn partial_of(target: &Path) -> PathBuf {
    let mut name = target.as_os_str().to_owned();
    name.push(".partial");
    PathBuf::from(name)
}

/// Where `path` leads, for a message: through symbolic links to their target, which need not exist. The path itself
/// where nothing would be written.
#[must_use]
pub fn target_of(path: &Path) -> PathBuf {
    output_place(path).unwrap_or_else(|_| path.to_owned())
}
