//! A file of rows that come from a live stream and cannot be had again.
//!
//! Until it is complete its name ends in `.partial`. It holds whole rows at every moment, apart from a SIGKILL or a power failure
//! in the middle of a write, which may cut the last row. If the command ends early the file stays under that name.

use super::signals::unfinished;
use isotherm_failure::Failure;
use rustix::fs::OFlags;
use std::fs::{self, File, Metadata, OpenOptions, TryLockError};
use std::io::{self, Seek as _, SeekFrom, Write};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _, fchown};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The rows are written when they are this long, or at a flush \[bytes\].
const BLOCK: usize = 1 << 16;

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
        match (self.rows(), self.path.display()) {
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
    /// Bytes that have not been written.
    pending: Vec<u8>,
    length: u64,
    complete: bool,
}

impl LiveFile {
    /// Creates the file `target` under its temporary name, with the permissions and owner of the `existing` one.
    ///
    /// # Errors
    /// If it cannot be created, if another process writes it, or if there are rows in it from an earlier run.
    pub fn create(target: PathBuf, existing: Option<&Metadata>) -> io::Result<Self> {
        let mut name = target.clone().into_os_string();
        name.push(".partial");
        let path = PathBuf::from(name);
        let mode = existing.map_or(0o666, |existing| existing.permissions().mode() & 0o777);
        let mut options = OpenOptions::new();
        options.write(true).create(true).truncate(false).mode(mode);
        options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits().cast_signed());
        let file = loop {
            // Hold the lock until the file is listed, so that a signal between creating and listing removes it too.
            let mut unfinished = unfinished();
            let file = options.open(&path)?;
            match file.try_lock() {
                Err(TryLockError::WouldBlock) => {
                    let message = format!("another process is writing {}; name another file", path.display());
                    return Err(io::Error::new(io::ErrorKind::ResourceBusy, message));
                }
                // Some network file systems have no locks.
                Err(TryLockError::Error(error)) if error.kind() != io::ErrorKind::Unsupported => return Err(error),
                Ok(()) | Err(TryLockError::Error(_)) => {}
            }
            let opened = file.metadata()?;
            let id = |metadata: &Metadata| (metadata.dev(), metadata.ino());
            // Its owner may have renamed or removed the file between opening and locking.
            if fs::symlink_metadata(&path).is_ok_and(|named| id(&named) == id(&opened)) {
                if !opened.is_file() || opened.len() > 0 {
                    let message = format!("{} has what an earlier run received; move or remove it", path.display());
                    return Err(io::Error::new(io::ErrorKind::AlreadyExists, message));
                }
                unfinished.add(&path);
                break file;
            }
        };
        if let Some(existing) = existing {
            // The new file gets the owner of the old one, if this user may set it.
            let _ = fchown(&file, Some(existing.uid()), Some(existing.gid()));
        }
        let partial = Partial { path, lines: Arc::default() };
        Ok(Self { file, target, partial, pending: Vec::new(), length: 0, complete: false })
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
        fs::rename(&self.partial.path, &self.target)?;
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
        let had_rows = self.partial.rows() > 0;
        self.partial.lines.fetch_add(lines, Ordering::Relaxed);
        if !had_rows && self.partial.rows() > 0 {
            unfinished().keep(&self.partial.path);
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

/// Where `path` leads: through a symbolic link to its target, which need not exist.
pub fn target_of(path: &Path) -> PathBuf {
    let target = fs::canonicalize(path)
        .or_else(|_| fs::read_link(path).map(|link| path.parent().unwrap_or(Path::new("")).join(link)));
    target.unwrap_or_else(|_| path.to_owned())
}
