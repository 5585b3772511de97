//! A file that grows by whole flushes.

use std::fs::File;
use std::io::{self, Seek as _, SeekFrom, Write};
use std::path::Path;

/// Creates `path` with these bytes in it: at no moment is there a file with less. Never replaces one that is there.
///
/// # Errors
/// If it exists or cannot be written.
pub fn create(path: &Path, bytes: &[u8]) -> io::Result<File> {
    let mut file = aside(path)?;
    file.write_all(bytes)?;
    file.as_file().sync_data()?;
    file.persist_noclobber(path).map_err(|error| error.error)
}

/// A file beside `path` without a name of its own.
pub fn aside(path: &Path) -> io::Result<tempfile::NamedTempFile> {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut aside = tempfile::Builder::new();
    // The umask still applies.
    aside.prefix(".isotherm-").permissions(std::fs::Permissions::from_mode(0o666));
    aside.tempfile_in(folder).map_err(|error| io::Error::from(error.kind()))
}

/// Takes bytes and appends them to its file when asked, all or none as far as the operating system allows.
pub struct Growing {
    sink: Sink,
    length: u64,
    /// What has not been written yet.
    pub pending: Vec<u8>,
}

enum Sink {
    File(File),
    Stdout(io::Stdout),
}

impl Growing {
    /// A new file that begins with these bytes.
    ///
    /// # Errors
    /// If it exists or cannot be written.
    pub fn create(path: &Path, bytes: &[u8]) -> io::Result<Self> {
        let mut file = create(path, bytes)?;
        file.seek(SeekFrom::End(0))?;
        Ok(Self { sink: Sink::File(file), length: bytes.len() as u64, pending: Vec::new() })
    }

    /// The standard output.
    pub fn stdout(bytes: Vec<u8>) -> Self {
        Self { sink: Sink::Stdout(io::stdout()), length: 0, pending: bytes }
    }

    /// Appends what is pending. After an error it is pending still, and the file as long as before.
    ///
    /// # Errors
    /// If the operating system refuses some of it.
    pub fn flush(&mut self) -> io::Result<()> {
        match &mut self.sink {
            Sink::File(file) => {
                if let Err(error) = file.write_all(&self.pending).and_then(|()| file.sync_data()) {
                    file.set_len(self.length)?;
                    file.seek(SeekFrom::Start(self.length))?;
                    return Err(error);
                }
            }
            Sink::Stdout(stdout) => stdout.write_all(&self.pending).and_then(|()| stdout.flush())?,
        }
        self.length += self.pending.len() as u64;
        self.pending.clear();
        Ok(())
    }

    /// Bytes, the pending ones included.
    pub fn size(&self) -> u64 {
        self.length + self.pending.len() as u64
    }
}
