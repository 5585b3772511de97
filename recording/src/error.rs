//! The error of readers of recordings.

use isotherm_support::failure::{Exit, Failure, one_line, shown};
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
    /// The source could not be read. Only an error of the operating system has a code of it; any other is in the data,
    /// such as an end too early or a page that cannot be decompressed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The next piece of the recording could not be opened.
    #[error(transparent)]
    Piece(Failure),
}

impl RecordingError {
    /// The failure of a program that reads the file `path`.
    #[must_use]
    pub fn failure(&self, path: &Path) -> Failure {
        let data = |place: &str, message: &str, line| {
            Failure::new(Exit::Data, format!("{}{place}: {message}", shown(path))).at(path, line)
        };
        match self {
            Self::Data { line, message } => data(&format!(":{line}"), message, Some(*line)),
            // Libraries quote what is in the file.
            Self::Place { .. } => data("", &one_line(&self.to_string()), None),
            Self::Io(error) if error.raw_os_error().is_none() => data("", &one_line(&error.to_string()), None),
            Self::Io(error) => Failure::io("reading", path, error),
            Self::Piece(failure) => {
                Failure { place: failure.place.clone(), ..Failure::new(failure.exit, failure.message.as_str()) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_errors_of_the_operating_system_are_errors_of_reading() {
        let path = Path::new("r");
        let exit = |error: io::Error| RecordingError::from(error).failure(path).exit;
        for code in [5, 28, 116] {
            assert_eq!(exit(io::Error::from_raw_os_error(code)), Exit::Io);
        }
        for error in
            [io::ErrorKind::UnexpectedEof.into(), io::Error::other("no page"), io::ErrorKind::InvalidData.into()]
        {
            assert_eq!(exit(error), Exit::Data);
        }
        let piece = RecordingError::Piece(Failure::new(Exit::Usage, "p: cause"));
        assert_eq!((piece.failure(path).exit, piece.failure(path).message.as_str()), (Exit::Usage, "p: cause"));
    }
}
