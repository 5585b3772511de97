//! Why a recording cannot be read.

use isotherm_failure::{Exit, Failure};
use std::io;
use std::path::Path;

/// Why a recording cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// Something in the data is wrong.
    #[error("line {line}: {message}")]
    Data {
        /// Line, from 1.
        line: u64,
        /// What is wrong and what would be right.
        message: String,
    },
    /// Something is wrong in a format that has no lines.
    #[error("{place}: {message}")]
    Place {
        /// Row, message or byte.
        place: String,
        /// What is wrong and what would be right.
        message: String,
    },
    /// The source could not be read.
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl RecordingError {
    /// The failure of a program that reads the recording `path`.
    #[must_use]
    pub fn failure(&self, path: &Path) -> Failure {
        match self {
            Self::Data { line, message } => Failure::new(Exit::Data, format!("{}:{line}: {message}", path.display())),
            Self::Place { .. } => Failure::new(Exit::Data, format!("{}: {self}", path.display())),
            Self::Io(error) => Failure::io("reading", path, error),
        }
    }
}
