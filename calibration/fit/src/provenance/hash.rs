//! SHA-256 of files.

use sha2::{Digest as _, Sha256};
use std::io::{self, Read, Write};

/// SHA-256 in hexadecimal.
///
/// ```
/// use isotherm_fit::sha256;
///
/// assert_eq!(sha256(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
/// ```
#[must_use]
pub fn sha256(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |text, byte| format!("{text}{byte:02x}"))
}

/// Computes the SHA-256 of all bytes that are read or written through it.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_fit::{HashingStream, sha256};
/// use std::io::Write as _;
///
/// let mut file = HashingStream::new(Vec::new());
/// file.write_all(b"abc")?;
/// assert_eq!(file.finish(), (b"abc".to_vec(), sha256(b"abc")));
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct HashingStream<T> {
    inner: T,
    hash: Sha256,
}

impl<T> HashingStream<T> {
    /// Wraps `inner`, from which nothing has been read or written yet.
    pub fn new(inner: T) -> Self {
        Self { inner, hash: Sha256::new() }
    }

    /// The inner value, and the SHA-256 of the bytes in hexadecimal.
    #[must_use]
    pub fn finish(self) -> (T, String) {
        (self.inner, hexadecimal(&self.hash.finalize()))
    }
}

impl<R: Read> Read for HashingStream<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(buffer)?;
        self.hash.update(buffer.get(..count).unwrap_or_default());
        Ok(count)
    }
}

impl<W: Write> Write for HashingStream<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.inner.write(bytes)?;
        self.hash.update(bytes.get(..count).unwrap_or_default());
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}
