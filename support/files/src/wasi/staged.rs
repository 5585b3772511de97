//! Files with a temporary name, which get their own when they are complete, where nobody else writes files.

use std::ffi::OsString;
use std::fs::{self, File, Metadata};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

pub(crate) use UnsharedFile as StagedFile;

/// A file with a temporary name. Dropping it removes the file.
pub struct UnsharedFile {
    writer: BufWriter<File>,
    temporary: PathBuf,
    target: PathBuf,
}

impl UnsharedFile {
    pub(crate) fn create(target: &Path, _: Option<&Metadata>) -> io::Result<Self> {
        let mut name = OsString::from(".isotherm-new-");
        name.push(target.file_name().unwrap_or_default());
        let temporary = target.with_file_name(name);
        let writer = BufWriter::new(File::create(&temporary)?);
        Ok(Self { writer, temporary, target: target.to_owned() })
    }

    /// Gives the file its name.
    pub(crate) fn rename(self) -> io::Result<()> {
        fs::rename(&self.temporary, &self.target)
    }

    /// What was written is durable as it is.
    #[allow(clippy::unused_self, clippy::unnecessary_wraps, reason = "a file of a disk does more")]
    pub(crate) const fn sync(&self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for UnsharedFile {
    fn drop(&mut self) {
        // Fails where it has its own name.
        let _ = fs::remove_file(&self.temporary);
    }
}

impl Write for UnsharedFile {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.writer.write(buffer)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }
}
