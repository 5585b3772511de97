//! Bytes that are read at any place.

use isotherm_support::source::ReadSeek;
use std::io::{self, SeekFrom};
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes that are read at any place. Its clones read the same bytes.
#[derive(Clone)]
pub(crate) struct RandomAccess {
    source: Arc<Mutex<Box<dyn ReadSeek>>>,
    size: u64,
}

impl RandomAccess {
    /// All bytes of a source.
    ///
    /// # Errors
    /// If it cannot be sought.
    pub(crate) fn new(mut source: Box<dyn ReadSeek>) -> io::Result<Self> {
        let size = source.seek(SeekFrom::End(0))?;
        Ok(Self { source: Arc::new(Mutex::new(source)), size })
    }

    /// Number of the bytes.
    pub(crate) const fn size(&self) -> u64 {
        self.size
    }

    /// Reads so many bytes at a place.
    ///
    /// # Errors
    /// Those of the source, and if there are fewer.
    pub(crate) fn read_exact_at(&self, buffer: &mut [u8], at: u64) -> io::Result<()> {
        let mut source = self.source.lock().unwrap_or_else(PoisonError::into_inner);
        source.seek(SeekFrom::Start(at))?;
        source.read_exact(buffer)
    }
}
