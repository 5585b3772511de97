//! The error of readers of recordings.

use isotherm_failure::{Exit, Failure};
use std::io;
use std::path::Path;

/// Why a recording cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The data are wrong, in a format with lines.
    #[error("line {line}: {message}")]
    Data {
        /// Line, from 1.
        line: u64,
        /// What is wrong, and what is expected.
        message: String,
    },
    /// The data are wrong, in a format without lines.
    #[error("{place}: {message}")]
    Place {
        /// Number of the row, message or byte.
        place: String,
        /// What is wrong, and what is expected.
        message: String,
    },
    /// The source could not be read.
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl RecordingError {
    /// The failure of a program that reads the file `path`.
    #[must_use]
    pub fn failure(&self, path: &Path) -> Failure {
        match self {
            Self::Data { line, message } => Failure::new(Exit::Data, format!("{}:{line}: {message}", path.display())),
            Self::Place { .. } => Failure::new(Exit::Data, format!("{}: {self}", path.display())),
            Self::Io(error) => Failure::io("reading", path, error),
        }
    }
}
