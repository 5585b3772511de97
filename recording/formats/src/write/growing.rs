//! Bytes that are collected, and added to a file at a flush.

use super::vacant::has_no_rows;
use isotherm_support::storage::{GrowingFile, Storage};
use std::io::{self, Write};
use std::path::Path;

/// Collects bytes and adds them to a file, or the standard output, at a flush. A flush that fails leaves the file as it
/// was.
pub(super) struct Appender {
    file: Box<dyn GrowingFile>,
    length: u64,
    /// Bytes that are written at the next flush.
    pub pending: Vec<u8>,
    /// Whether they replace the file.
    is_restarted: bool,
}

impl Appender {
    /// A new file that begins with these bytes.
    ///
    /// # Errors
    /// If it exists or cannot be written.
    pub(super) fn create(storage: &dyn Storage, path: &Path, bytes: &[u8]) -> io::Result<Self> {
        let file = storage.create(path, bytes, has_no_rows)?;
        Ok(Self { file, length: bytes.len() as u64, pending: Vec::new(), is_restarted: false })
    }

    /// Begins anew with these bytes: the next flush replaces the file, in one step. For a file without rows.
    pub(super) fn restart(&mut self, bytes: Vec<u8>) {
        (self.pending, self.length, self.is_restarted) = (bytes, 0, true);
    }

    /// Adds the pending bytes. After an error they stay pending, and the file has its previous length.
    ///
    /// # Errors
    /// If the operating system cannot write all of them.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        match self.is_restarted {
            true => self.file.restart(&self.pending)?,
            false => self.file.grow(&self.pending)?,
        }
        self.is_restarted = false;
        self.length += self.pending.len() as u64;
        self.pending.clear();
        Ok(())
    }

    /// Size including the pending bytes \[bytes\].
    pub(super) fn size(&self) -> u64 {
        self.length + self.pending.len() as u64
    }
}

/// Bytes are collected: no write fails before the flush.
impl Write for Appender {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.pending.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Self::flush(self)
    }
}
