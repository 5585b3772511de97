//! Reads a table or configuration. Checks the kind of file, its size and who may write it, and returns which state of
//! the file was read.

use isotherm_failure::{Exit, Failure};
use isotherm_shared::document::{Fault, Faults, MAX_BYTES};
use isotherm_shared::stream::ImuId;
use isotherm_shared::table::{CoefficientTable, MAX_TABLE_BYTES};
use std::fmt;
use std::fs::{self, Metadata, OpenOptions};
use std::io::{self, Read as _};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

/// Identifies one state of a file: it changes when the file is replaced or written.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Identity {
    device: u64,
    inode: u64,
    size: u64,
    modified: (i64, i64),
    changed: (i64, i64),
}

impl Identity {
    /// The state of the file at `path`, through symbolic links; `None` if there is no file.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        fs::metadata(path).ok().map(|metadata| Self::from(&metadata))
    }

    /// When its content was last changed, Unix time \[s\].
    #[must_use]
    pub fn modified_unix_s(&self) -> f64 {
        self.modified.0 as f64 + self.modified.1 as f64 * 1e-9
    }
}

impl From<&Metadata> for Identity {
    fn from(metadata: &Metadata) -> Self {
        Self {
            device: metadata.dev(),
            inode: metadata.ino(),
            size: metadata.size(),
            modified: (metadata.mtime(), metadata.mtime_nsec()),
            changed: (metadata.ctime(), metadata.ctime_nsec()),
        }
    }
}

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
            Self::Io { path, cause } => write!(f, "reading {}: {cause}", path.display()),
            Self::Refused { path, faults } => {
                for (index, Fault { line, key, message }) in faults.0.iter().enumerate() {
                    let (newline, colon) = (if index > 0 { "\n" } else { "" }, if key.is_empty() { "" } else { ": " });
                    write!(f, "{newline}{}:{line}: {key}{colon}{message}", path.display())?;
                }
                Ok(())
            }
        }
    }
}

/// Whether to read a file that every user of the machine may write.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum WorldWritable {
    /// For the service: it reloads the file, so every user of the machine could change what it does.
    Refuse,
    /// For a command that reads the file once: its user has chosen the file.
    Allow,
}

impl WorldWritable {
    /// [`Allow`](Self::Allow) if the option `--allow-world-writable` is given.
    #[must_use]
    pub const fn allow_if(given: bool) -> Self {
        if given { Self::Allow } else { Self::Refuse }
    }
}

/// Reads the text of a table or configuration. Returns also the state of the file from which it was read.
///
/// # Errors
/// If the file cannot be read, may be written by everybody ([`WorldWritable::Refuse`]), is no regular file, is over 1
/// MiB, is not UTF-8, or changes while it is read.
pub fn read_text(path: &Path, world_writable: WorldWritable) -> Result<(String, Identity), LoadError> {
    read(path, world_writable, MAX_BYTES, "table or configuration")
}

/// As [`read_text`]; `limit` is the most bytes that such a file, of this `kind`, has.
fn read(path: &Path, world_writable: WorldWritable, limit: u64, kind: &str) -> Result<(String, Identity), LoadError> {
    let io = |error: io::Error| LoadError::Io { path: path.to_owned(), cause: error.to_string() };
    let refused = |line, message: String| LoadError::Refused {
        path: path.to_owned(),
        faults: Faults(vec![Fault { line, key: String::new(), message }]),
    };
    // Non-blocking: if the path is a pipe, opening it would wait for a writer.
    let mut file = OpenOptions::new().read(true).custom_flags(libc::O_NONBLOCK).open(path).map_err(io)?;
    let before = file.metadata().map_err(io)?;
    if !before.is_file() {
        return Err(refused(1, "not a regular file".to_owned()));
    }
    if world_writable == WorldWritable::Refuse && before.mode() & 0o002 != 0 {
        let path = path.display();
        return Err(refused(1, format!("everybody may write it; chmod o-w {path}, or give --allow-world-writable")));
    }
    let mut bytes = Vec::new();
    (&mut file).take(limit + 1).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > limit {
        return Err(refused(1, format!("over {limit} bytes; no {kind} is that large")));
    }
    let identity = Identity::from(&before);
    if identity != Identity::from(&file.metadata().map_err(io)?) {
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
    world_writable: WorldWritable,
) -> Result<(CoefficientTable, Identity), LoadError> {
    let (text, identity) = read(path, world_writable, MAX_TABLE_BYTES, "coefficient table")?;
    let table = CoefficientTable::from_toml(&text, expected);
    let table = table.map_err(|faults| LoadError::Refused { path: path.to_owned(), faults })?;
    Ok((table, identity))
}

impl From<LoadError> for Failure {
    fn from(error: LoadError) -> Self {
        let (exit, path, line) = match &error {
            LoadError::Io { path, .. } => (Exit::Io, path, None),
            // Of several faults the first is as good as any.
            LoadError::Refused { path, faults } => {
                (Exit::Config, path, faults.0.first().map(|fault| fault.line as u64))
            }
        };
        Self::new(exit, error.to_string()).at(path, line)
    }
}
