//! How a program of Isotherm fails: its exit code, and a message with phase, cause and remedy.
//!
//! Each crate converts its own errors into a [`Failure`] where it declares them, so that an error has the same exit code in every
//! program.

mod printable;

pub use printable::{printable, tell};

use std::io;
use std::path::{Path, PathBuf};

/// Exit codes; those from 64 on are as in sysexits.h.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Exit {
    /// The command failed for another reason.
    Failed = 1,
    /// The command line is wrong.
    Usage = 64,
    /// A recording or samples are wrong.
    Data = 65,
    /// There is no service, stream or instrument.
    Unavailable = 69,
    /// A file could not be read or written.
    Io = 74,
    /// A configuration, table, campaign file or plan is wrong.
    Config = 78,
}

/// Why a command failed: the message for the operator and the exit code.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct Failure {
    /// Exit code of the process.
    pub exit: Exit,
    /// Phase, cause and remedy; may have several lines.
    pub message: String,
    /// File, and line or row in it, of the cause, if it is in one; the message names them too.
    pub place: Option<(PathBuf, Option<u64>)>,
}

impl Failure {
    /// A failure with this exit code and message, as [`printable`] text.
    pub fn new(exit: Exit, message: impl Into<String>) -> Self {
        let message = message.into();
        Self { exit, message: printable(&message).into_owned(), place: None }
    }

    /// The failure with the file, and the line or row in it, of its cause.
    #[must_use]
    pub fn at(self, file: &Path, line: Option<u64>) -> Self {
        Self { place: Some((file.to_owned(), line)), ..self }
    }

    /// A file that could not be read or written; `phase` says what was being done, as in "writing".
    #[must_use]
    pub fn io(phase: &str, path: &Path, error: &io::Error) -> Self {
        let folder = path.parent().filter(|folder| error.kind() == io::ErrorKind::NotFound && is_absent(folder));
        let name = path.display();
        let message = match folder {
            Some(folder) => {
                format!("{phase} {name}: there is no folder {}; make it, or name another", folder.display())
            }
            None => format!("{phase} {name}: {error}"),
        };
        Self::new(Exit::Io, message).at(path, None)
    }

    /// Joins failures into one, with all messages and the highest exit code; `None` if there are none.
    #[must_use]
    pub fn all(failures: Vec<Self>) -> Option<Self> {
        let exit = failures.iter().map(|failure| failure.exit).max_by_key(|exit| *exit as u8)?;
        let messages: Vec<_> = failures.into_iter().map(|failure| failure.message).collect();
        Some(Self::new(exit, messages.join("\n")))
    }
}

fn is_absent(folder: &Path) -> bool {
    !folder.as_os_str().is_empty() && !folder.is_dir()
}
