//! Bytes that are read at any place, as a Parquet file is.

use bytes::Bytes;
use isotherm_support::source::ReadSeek;
use parquet::errors::ParquetError;
use parquet::file::reader::{ChunkReader, Length};
use std::io::{self, BufReader, Read, SeekFrom};
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

    /// Reads some bytes at a place.
    ///
    /// # Errors
    /// Those of the source.
    pub(crate) fn read_at(&self, buffer: &mut [u8], at: u64) -> io::Result<usize> {
        let mut source = self.source.lock().unwrap_or_else(PoisonError::into_inner);
        source.seek(SeekFrom::Start(at))?;
        source.read(buffer)
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

/// The bytes from a place on.
pub(crate) struct ReadFrom {
    all: RandomAccess,
    at: u64,
}

impl Read for ReadFrom {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.all.read_at(buffer, self.at)?;
        self.at += read as u64;
        Ok(read)
    }
}

impl Length for RandomAccess {
    fn len(&self) -> u64 {
        self.size
    }
}

impl ChunkReader for RandomAccess {
    type T = BufReader<ReadFrom>;

    fn get_read(&self, start: u64) -> Result<Self::T, ParquetError> {
        Ok(BufReader::new(ReadFrom { all: self.clone(), at: start }))
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes, ParquetError> {
        let mut bytes = Vec::with_capacity(length);
        let read = ReadFrom { all: self.clone(), at: start }.take(length as u64).read_to_end(&mut bytes)?;
        if read != length {
            let message = format!("Expected to read {length} bytes, read only {read}");
            return Err(ParquetError::EOF(message));
        }
        Ok(bytes.into())
    }
}
