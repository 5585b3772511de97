//! A file that grows only by complete flushes.

use super::pieces::folder_of;
use super::vacant::{lock, vacant};
use isotherm_files::sync_folder;
use std::fs::File;
use std::io::{self, Seek as _, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Creates `path` with these bytes. The file appears with its full content, and never replaces an existing one, except
/// a recording without rows.
///
/// # Errors
/// If it exists or cannot be written.
pub(super) fn create(path: &Path, bytes: &[u8]) -> io::Result<File> {
    let mut file = staged_file(path)?;
    file.write_all(bytes)?;
    file.as_file().sync_data()?;
    let refused = match file.persist_noclobber(path) {
        Ok(file) => return sync_folder(path).map(|()| file),
        Err(refused) => refused,
    };
    if refused.error.kind() != io::ErrorKind::AlreadyExists {
        return Err(refused.error);
    }
    // Locked until it is replaced.
    let Some(_vacant) = vacant(path)? else { return Err(refused.error) };
    let file = refused.file.persist(path).map_err(|error| error.error)?;
    sync_folder(path).map(|()| file)
}

/// A staged file in the folder of `path`, with a temporary name. It is locked before it has its name: no other recorder
/// takes it for one that nobody writes.
pub(super) fn staged_file(path: &Path) -> io::Result<tempfile::NamedTempFile> {
    use std::os::unix::fs::PermissionsExt as _;
    let mut builder = tempfile::Builder::new();
    // The umask still applies.
    builder.prefix(".isotherm-").permissions(std::fs::Permissions::from_mode(0o666));
    let file = builder.tempfile_in(folder_of(path)).map_err(|error| io::Error::from(error.kind()))?;
    lock(file.as_file());
    Ok(file)
}

/// Collects bytes and appends them to a file, or the standard output, at a flush. A flush that fails leaves the file as
/// it was.
pub(super) struct GrowingFile {
    sink: GrowingSink,
    length: u64,
    /// Bytes that are written at the next flush.
    pub pending: Vec<u8>,
    /// Where the file is replaced at the next flush.
    restarted: Option<PathBuf>,
}

enum GrowingSink {
    File(File),
    Stdout(io::Stdout),
}

impl GrowingFile {
    /// A new file that begins with these bytes.
    ///
    /// # Errors
    /// If it exists or cannot be written.
    pub(super) fn create(path: &Path, bytes: &[u8]) -> io::Result<Self> {
        let mut file = create(path, bytes)?;
        file.seek(SeekFrom::End(0))?;
        Ok(Self { sink: GrowingSink::File(file), length: bytes.len() as u64, pending: Vec::new(), restarted: None })
    }

    /// The standard output; `bytes` are written first.
    pub(super) fn stdout(bytes: Vec<u8>) -> Self {
        Self { sink: GrowingSink::Stdout(io::stdout()), length: 0, pending: bytes, restarted: None }
    }

    /// Begins anew with these bytes: the next flush replaces the file `path`, in one step. For a file without rows.
    pub(super) fn restart(&mut self, path: &Path, bytes: Vec<u8>) {
        self.pending = bytes;
        if matches!(self.sink, GrowingSink::File(_)) {
            self.restarted = Some(path.to_owned());
            self.length = 0;
        }
    }

    /// Appends the pending bytes. After an error they stay pending, and the file has its previous length.
    ///
    /// # Errors
    /// If the operating system cannot write all of them.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        match &mut self.sink {
            GrowingSink::File(file) if let Some(path) = &self.restarted => {
                let mut staged = staged_file(path)?;
                staged.write_all(&self.pending)?;
                staged.as_file().sync_data()?;
                *file = staged.persist(path).map_err(|error| error.error)?;
                sync_folder(path)?;
                self.restarted = None;
            }
            GrowingSink::File(file) => {
                if let Err(error) = file.write_all(&self.pending).and_then(|()| file.sync_data()) {
                    file.set_len(self.length)?;
                    file.seek(SeekFrom::Start(self.length))?;
                    return Err(error);
                }
            }
            GrowingSink::Stdout(stdout) => stdout.write_all(&self.pending).and_then(|()| stdout.flush())?,
        }
        self.length += self.pending.len() as u64;
        self.pending.clear();
        Ok(())
    }

    /// Size including the pending bytes \[bytes\].
    pub(super) fn size(&self) -> u64 {
        self.length + self.pending.len() as u64
    }
}
