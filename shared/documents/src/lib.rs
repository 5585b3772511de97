//! Reads a table or configuration. Checks the kind of file, its size and who may write it, and returns which state of
//! the file was read.

use isotherm_files::{Identity, Trust, open_without_waiting, uninterrupted};
use isotherm_shared::content::FileContent;
use isotherm_shared::document::{Fault, Faults, MAX_BYTES, too_large};
use isotherm_shared::names::ImuId;
use isotherm_shared::table::{CoefficientTable, MAX_TABLE_BYTES};
use isotherm_support::failure::{Exit, Failure, shown};
use std::fmt;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

/// Why a table or configuration could not be loaded.
#[derive(Clone, Debug, Eq, PartialEq)]
pub enum LoadError {
    /// It could not be read.
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        cause: String,
    },
    /// It is not a valid file of its kind.
    Refused {
        /// The file.
        path: PathBuf,
        /// All its faults.
        faults: Faults,
    },
}

/// One line for each fault: `file:line: key: message`.
impl fmt::Display for LoadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io { path, cause } => write!(f, "reading {}: {cause}", shown(path)),
            Self::Refused { path, faults } => f.write_str(&faults.of(path)),
        }
    }
}

/// Reads the text of a table or configuration. Returns also the state of the file from which it was read.
///
/// # Errors
/// If the file cannot be read, is not to be trusted, is no regular file, is a log, a recording or parameters, is over
/// 1 MiB, is not UTF-8, or changes while it is read.
pub fn read_text(path: &Path, trust: Trust) -> Result<(String, Identity), LoadError> {
    read(path, trust, MAX_BYTES, "table or configuration", None)
}

/// Reads the text of a file of parameters.
///
/// # Errors
/// As [`read_text`], but for parameters.
pub fn read_parameters(path: &Path) -> Result<String, LoadError> {
    Ok(read(path, Trust::Any, MAX_BYTES, "file of parameters", Some(FileContent::Parameters))?.0)
}

/// As [`read_text`]; `limit` is the most bytes that such a file, of this `kind` and `content`, has. A TOML file has no
/// [`FileContent`].
fn read(
    path: &Path,
    trust: Trust,
    limit: u64,
    kind: &str,
    content: Option<FileContent>,
) -> Result<(String, Identity), LoadError> {
    let io = |error: io::Error| LoadError::Io { path: path.to_owned(), cause: error.to_string() };
    let refused = |line, message: String| LoadError::Refused {
        path: path.to_owned(),
        faults: Faults(vec![Fault { line, key: String::new(), message }]),
    };
    let mut file = open_without_waiting(path).map_err(io)?;
    let before = uninterrupted(|| file.metadata()).map_err(io)?;
    if !before.is_file() {
        return Err(refused(1, "not a regular file".to_owned()));
    }
    if let Some(refusal) = trust.refusal(path, &before) {
        return Err(refused(1, refusal));
    }
    let mut bytes = Vec::new();
    (&mut file).take(limit + 1).read_to_end(&mut bytes).map_err(io)?;
    // A text that is no TOML is named by who reads it and knows what he wants.
    let other = FileContent::of(&bytes).filter(|found| Some(*found) != content);
    if let Some(other) = other.filter(|_| content.is_some() || str::from_utf8(&bytes).is_err()) {
        let readers = other.readers(&shown(path).to_string());
        return Err(refused(1, format!("this is {}; give the {kind}; {readers}", other.name())));
    }
    if bytes.len() as u64 > limit {
        return Err(LoadError::Refused { path: path.to_owned(), faults: too_large(&bytes, limit, kind) });
    }
    let identity = Identity::from(&before);
    if identity != Identity::from(&uninterrupted(|| file.metadata()).map_err(io)?) {
        return Err(refused(1, "changed while it was read; write it under another name and rename it".to_owned()));
    }
    match String::from_utf8(bytes) {
        Ok(text) => Ok((text, identity)),
        Err(error) => {
            let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
            let line = 1 + valid.iter().filter(|&&byte| byte == b'\n').count();
            Err(refused(
                line,
                "not UTF-8; save it as UTF-8 text, or give the TOML file if this is a recording".to_owned(),
            ))
        }
    }
}

/// Loads a coefficient table, of at most 128 KiB; with `expected`, one for another IMU is refused.
///
/// # Errors
/// Everything that is wrong with the file.
pub fn load_table(
    path: &Path,
    expected: Option<&ImuId>,
    trust: Trust,
) -> Result<(CoefficientTable, Identity), LoadError> {
    load_table_text(path, expected, trust).map(|(table, _, identity)| (table, identity))
}

/// The same, with the text that it was read from: all that is taken of a file is of the same bytes.
///
/// # Errors
/// As [`load_table`].
pub fn load_table_text(
    path: &Path,
    expected: Option<&ImuId>,
    trust: Trust,
) -> Result<(CoefficientTable, String, Identity), LoadError> {
    let (text, identity) = read(path, trust, MAX_TABLE_BYTES, "coefficient table", None)?;
    let table = CoefficientTable::from_toml(&text, expected);
    let table = table.map_err(|faults| LoadError::Refused { path: path.to_owned(), faults })?;
    Ok((table, text, identity))
}

impl From<LoadError> for Failure {
    fn from(error: LoadError) -> Self {
        let (exit, path, line) = match &error {
            LoadError::Io { path, .. } => (Exit::Io, path, None),
            // If there are several faults, the first is as good as any.
            LoadError::Refused { path, faults } => {
                (Exit::Config, path, faults.0.first().map(|fault| fault.line as u64))
            }
        };
        Self::new(exit, error.to_string()).at(path, line)
    }
}
