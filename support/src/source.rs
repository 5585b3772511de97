//! Bytes that have a name, wherever they lie: a file, a stream, a text in memory. A reader of formats takes a
//! [`DataSource`] and opens nothing by itself; `isotherm-files` makes one of a path.

use std::fmt;
use std::io::{self, Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What reads and seeks. A stream returns an error where it is sought.
pub trait ReadSeek: Read + Seek + Send {}

impl<T: Read + Seek + Send> ReadSeek for T {}

/// Opens the bytes of a source.
pub trait Opener: Send + Sync {
    /// Opens them at their beginning. A stream goes on where it is.
    ///
    /// # Errors
    /// Those of the operating system.
    fn open(&self) -> io::Result<Box<dyn ReadSeek>>;

    /// Whether all bytes are there, so that they can be sought, and opened again.
    ///
    /// # Errors
    /// Those of the operating system, where there is nothing.
    fn is_file(&self) -> io::Result<bool>;

    /// Which file it is: two names of a file have one identity.
    ///
    /// # Errors
    /// Those of the operating system.
    fn identity(&self) -> io::Result<PathBuf>;
}

/// Bytes with a name.
///
/// ```
/// use isotherm_support::source::DataSource;
/// use std::io::Read as _;
///
/// # fn main() -> std::io::Result<()> {
/// let source = DataSource::of_bytes("a.csv", b"x,y\n".to_vec());
/// let mut text = String::new();
/// source.open()?.read_to_string(&mut text)?;
/// assert!(source.is_file() && text == "x,y\n");
/// # Ok(())
/// # }
/// ```
#[derive(Clone)]
pub struct DataSource {
    name: PathBuf,
    opener: Arc<dyn Opener>,
}

impl DataSource {
    /// A source that messages call `name`.
    pub fn new(name: impl Into<PathBuf>, opener: impl Opener + 'static) -> Self {
        Self { name: name.into(), opener: Arc::new(opener) }
    }

    /// Bytes in memory.
    pub fn of_bytes(name: impl Into<PathBuf>, bytes: Vec<u8>) -> Self {
        let name = name.into();
        Self::new(name.clone(), Memory(bytes.into(), name))
    }

    /// The name of a stream that somebody else reads.
    pub fn of_stream(name: impl Into<PathBuf>) -> Self {
        Self::new(name, ReadElsewhere)
    }

    /// What messages call it.
    #[must_use]
    pub fn name(&self) -> &Path {
        &self.name
    }

    /// Opens it at its beginning. A stream goes on where it is.
    ///
    /// # Errors
    /// Those of the operating system.
    pub fn open(&self) -> io::Result<Box<dyn ReadSeek>> {
        self.opener.open()
    }

    /// Whether all bytes are there, so that they can be sought, and opened again.
    #[must_use]
    pub fn is_file(&self) -> bool {
        self.opener.is_file().unwrap_or(false)
    }

    /// Which file it is: two names of a file have one identity. `None` of a stream.
    ///
    /// # Errors
    /// Those of the operating system, where there is nothing.
    pub fn identity(&self) -> io::Result<Option<PathBuf>> {
        if self.opener.is_file()? { self.opener.identity().map(Some) } else { Ok(None) }
    }

    /// As [`is_file`](Self::is_file), with the reason why nobody knows.
    ///
    /// # Errors
    /// Those of the operating system, where there is nothing.
    pub fn check_file(&self) -> io::Result<bool> {
        self.opener.is_file()
    }
}

impl fmt::Debug for DataSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&self.name, f)
    }
}

struct Memory(Arc<[u8]>, PathBuf);

impl Opener for Memory {
    fn open(&self) -> io::Result<Box<dyn ReadSeek>> {
        Ok(Box::new(Cursor::new(Arc::clone(&self.0))))
    }

    fn is_file(&self) -> io::Result<bool> {
        Ok(true)
    }

    fn identity(&self) -> io::Result<PathBuf> {
        Ok(self.1.clone())
    }
}

struct ReadElsewhere;

impl Opener for ReadElsewhere {
    fn open(&self) -> io::Result<Box<dyn ReadSeek>> {
        Err(io::Error::from(io::ErrorKind::NotSeekable))
    }

    fn is_file(&self) -> io::Result<bool> {
        Ok(false)
    }

    fn identity(&self) -> io::Result<PathBuf> {
        Err(io::Error::from(io::ErrorKind::NotSeekable))
    }
}

/// Bytes that come once, and cannot be sought.
pub struct ByteStream<R>(pub R);

impl<R: Read> Read for ByteStream<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.read(buffer)
    }
}

impl<R> Seek for ByteStream<R> {
    fn seek(&mut self, _: SeekFrom) -> io::Result<u64> {
        Err(io::Error::from(io::ErrorKind::NotSeekable))
    }
}
