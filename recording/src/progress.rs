//! How far reading has come, and what is to be said at once.

use std::fmt;
use std::io::{self, Read};
use std::sync::Arc;

/// Watches the reading of data.
pub trait Observer: Send + Sync {
    /// So many bytes more were read.
    fn advance(&self, _bytes: u64) {}

    /// Reading begins anew: some formats are read twice.
    fn restart(&self) {}

    /// All was read.
    fn finish(&self) {}

    /// The operator should know this now.
    fn warn(&self, _message: &str) {}
}

/// Informs an [`Observer`] of the reading; by default nobody.
#[derive(Clone, Default)]
pub struct Progress(Option<Arc<dyn Observer>>);

impl Progress {
    /// Informs this observer.
    pub fn new(observer: impl Observer + 'static) -> Self {
        Self(Some(Arc::new(observer)))
    }

    /// So many bytes more were read.
    pub fn advance(&self, bytes: u64) {
        self.0.iter().for_each(|observer| observer.advance(bytes));
    }

    /// Reading begins anew.
    pub fn restart(&self) {
        self.0.iter().for_each(|observer| observer.restart());
    }

    /// All was read.
    pub fn finish(&self) {
        self.0.iter().for_each(|observer| observer.finish());
    }

    /// The operator should know this now.
    pub fn warn(&self, message: &str) {
        self.0.iter().for_each(|observer| observer.warn(message));
    }

    /// Begins anew, and counts the bytes that are read from a source.
    pub fn restarted(&self, source: impl Read + 'static) -> Box<dyn Read> {
        self.restart();
        Box::new(self.wrap(source))
    }

    /// Counts the bytes that are read from a source.
    pub fn wrap<R: Read>(&self, source: R) -> WatchedReader<R> {
        WatchedReader { source, progress: self.clone() }
    }
}

impl fmt::Debug for Progress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Progress").field(&self.0.is_some()).finish()
    }
}

/// A source whose bytes are counted.
pub struct WatchedReader<R> {
    source: R,
    progress: Progress,
}

impl<R: Read> Read for WatchedReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.source.read(buffer)?;
        self.progress.advance(read as u64);
        Ok(read)
    }
}
