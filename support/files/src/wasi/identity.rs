//! Which state of a file was read, where one program alone writes files.

use std::fs::{self, Metadata};
use std::path::Path;
use std::time::SystemTime;

/// Identifies one state of a file: it changes when the file is written.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Identity {
    size: u64,
    modified: Option<SystemTime>,
}

impl Identity {
    /// The state of the file at `path`; `None` if there is no file.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        fs::metadata(path).ok().map(|metadata| Self::from(&metadata))
    }
}

impl From<&Metadata> for Identity {
    fn from(metadata: &Metadata) -> Self {
        Self { size: metadata.len(), modified: metadata.modified().ok() }
    }
}
