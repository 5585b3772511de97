//! How a command fails: one mapping from what went wrong to the exit code.

use crate::files::TableFileError;
use isotherm_client::{ConnectError, TransportError};
use isotherm_shared::recording::RecordingError;
use std::io;
use std::path::Path;

/// Exit codes, as in sysexits.h.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Exit {
    /// The work could not be done.
    Failed = 1,
    /// The command line is wrong.
    Usage = 64,
    /// A recording is wrong.
    Data = 65,
    /// No service, or the stream is not there.
    Unavailable = 69,
    /// A file could not be read or written.
    Io = 74,
    /// A configuration or table is wrong.
    Config = 78,
}

/// What the operator is told, with the exit code: phase, cause and remedy.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct Failure {
    /// The process's exit code.
    pub exit: Exit,
    /// Phase, cause, remedy; may have several lines.
    pub message: String,
}

impl Failure {
    /// Any failure.
    pub fn new(exit: Exit, message: impl Into<String>) -> Self {
        Self { exit, message: message.into() }
    }

    /// A file that could not be read or written.
    pub fn io(phase: &str, path: &Path, error: &io::Error) -> Self {
        Self::new(Exit::Io, format!("{phase} {}: {error}", path.display()))
    }

    /// A recording that could not be read.
    pub fn recording(path: &Path, error: &RecordingError) -> Self {
        match error {
            RecordingError::Data { line, message } => {
                Self::new(Exit::Data, format!("{}:{line}: {message}", path.display()))
            }
            RecordingError::Place { .. } => Self::new(Exit::Data, format!("{}: {error}", path.display())),
            RecordingError::Io(error) => Self::io("reading", path, error),
        }
    }
}

impl From<ConnectError> for Failure {
    fn from(error: ConnectError) -> Self {
        let exit = match error {
            ConnectError::NoService(_) | ConnectError::NoSuchImu { .. } => Exit::Unavailable,
            ConnectError::Domain(_) => Exit::Usage,
            ConnectError::Exhausted(_) => Exit::Io,
            _ => Exit::Failed,
        };
        Self::new(exit, error.to_string())
    }
}

impl From<TransportError> for Failure {
    fn from(error: TransportError) -> Self {
        Self::new(Exit::Failed, error.to_string())
    }
}

impl From<TableFileError> for Failure {
    fn from(error: TableFileError) -> Self {
        let exit = match error {
            TableFileError::Io { .. } => Exit::Io,
            TableFileError::Refused { .. } => Exit::Config,
        };
        Self::new(exit, error.to_string())
    }
}
