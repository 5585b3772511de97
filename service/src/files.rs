//! Files: tables and configurations in, results out.

use isotherm_shared::document::{Fault, Faults, MAX_BYTES};
use isotherm_shared::stream::ImuId;
use isotherm_shared::table::CoefficientTable;
use std::fmt;
use std::fs::{self, Metadata, OpenOptions};
use std::io::{self, BufWriter, Read as _, Write};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, fchown};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use tempfile::NamedTempFile;

/// Tells one state of a file from the next.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Identity {
    device: u64,
    inode: u64,
    size: u64,
    modified: (i64, i64),
    changed: (i64, i64),
}

impl Identity {
    /// Of the file that `path` leads to, symbolic links followed; `None` if there is none.
    pub fn of(path: &Path) -> Option<Self> {
        fs::metadata(path).ok().map(|metadata| Self::from(&metadata))
    }

    /// When its content was changed, in seconds of Unix time.
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
pub enum TableFileError {
    /// It could not be read.
    Io {
        /// The file.
        path: PathBuf,
        /// What the operating system says.
        cause: String,
    },
    /// It is not a valid file of its kind.
    Refused {
        /// The file.
        path: PathBuf,
        /// All that is wrong with it.
        faults: Faults,
    },
}

/// One line a fault: `file:line: key: message`.
impl fmt::Display for TableFileError {
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

/// Whether a file that everybody may write is refused.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Guard {
    /// Refused: what the service follows is in the hands of every user of the machine.
    Strict,
    /// Taken: one who runs a command names its files.
    Lax,
}

impl Guard {
    /// As `--allow-world-writable` says.
    pub const fn allowing(world_writable: bool) -> Self {
        if world_writable { Self::Lax } else { Self::Strict }
    }
}

/// The text of a table or configuration with the state of the file that it was read from.
///
/// # Errors
/// If it cannot be read, may be written by everybody though guarded, is no regular file, over 1 MiB, not UTF-8, or changes while it is read.
pub fn read_text(path: &Path, guard: Guard) -> Result<(String, Identity), TableFileError> {
    let io = |error: io::Error| TableFileError::Io { path: path.to_owned(), cause: error.to_string() };
    let refused = |line, message: String| TableFileError::Refused {
        path: path.to_owned(),
        faults: Faults(vec![Fault { line, key: String::new(), message }]),
    };
    // Not blocking, so that a pipe in a table's place cannot hold anybody up.
    let mut file = OpenOptions::new().read(true).custom_flags(libc::O_NONBLOCK).open(path).map_err(io)?;
    let before = file.metadata().map_err(io)?;
    if !before.is_file() {
        return Err(refused(1, "not a regular file".to_owned()));
    }
    if guard == Guard::Strict && before.mode() & 0o002 != 0 {
        let path = path.display();
        return Err(refused(1, format!("everybody may write it; chmod o-w {path}, or give --allow-world-writable")));
    }
    let mut bytes = Vec::new();
    (&mut file).take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(refused(1, format!("over {MAX_BYTES} bytes; no table or configuration is that large")));
    }
    let identity = Identity::from(&before);
    if identity != Identity::from(&file.metadata().map_err(io)?) {
        return Err(refused(1, "changed while it was read; write it aside and rename it".to_owned()));
    }
    match String::from_utf8(bytes) {
        Ok(text) => Ok((text, identity)),
        Err(error) => {
            let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
            let line = 1 + valid.iter().filter(|&&byte| byte == b'\n').count();
            Err(refused(line, "not UTF-8; save it as UTF-8 text".to_owned()))
        }
    }
}

/// Loads a coefficient table; with `expected`, one for another IMU is refused.
///
/// # Errors
/// Everything that is wrong with the file.
pub fn load_table(
    path: &Path,
    expected: Option<&ImuId>,
    guard: Guard,
) -> Result<(CoefficientTable, Identity), TableFileError> {
    let (text, identity) = read_text(path, guard)?;
    let table = CoefficientTable::from_toml(&text, expected);
    let table = table.map_err(|faults| TableFileError::Refused { path: path.to_owned(), faults })?;
    Ok((table, identity))
}

/// Where a command writes its data: aside and renamed for regular files, straight for stdout, pipes and devices.
pub enum Output {
    /// Becomes `path` when it is complete.
    Aside(BufWriter<NamedTempFile>, PathBuf),
    /// As it is.
    Straight(BufWriter<Box<dyn Write>>),
}

impl Output {
    /// `None` or `-` is stdout.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(path: Option<&Path>) -> io::Result<Self> {
        let Some(path) = path.filter(|path| *path != Path::new("-")) else {
            return Ok(Self::Straight(BufWriter::new(Box::new(io::stdout()))));
        };
        match fs::metadata(path) {
            Ok(metadata) if metadata.is_dir() => Err(io::Error::from(io::ErrorKind::IsADirectory)),
            Ok(metadata) if !metadata.is_file() => {
                let direct = OpenOptions::new().write(true).open(path)?;
                Ok(Self::Straight(BufWriter::new(Box::new(direct))))
            }
            existing => {
                // Through a symbolic link it is the link's target that is replaced.
                let target = fs::canonicalize(path)
                    .or_else(|_| fs::read_link(path).map(|link| path.parent().unwrap_or(Path::new("")).join(link)));
                let target = target.unwrap_or_else(|_| path.to_owned());
                let existing = existing.ok();
                let folder = target.parent().filter(|folder| !folder.as_os_str().is_empty());
                let mut aside = tempfile::Builder::new();
                aside.prefix(".isotherm-").permissions(permissions(existing.as_ref()));
                // The name of the file aside is none of the user's business.
                // Listed before a signal can ask for it.
                let mut unfinished = unfinished();
                let aside = aside
                    .tempfile_in(folder.unwrap_or(Path::new(".")))
                    .map_err(|error| io::Error::from(error.kind()))?;
                unfinished.push(aside.path().to_owned());
                if let Some(existing) = &existing {
                    // The new file belongs to whom the old one did, where that is allowed.
                    let _ = fchown(aside.as_file(), Some(existing.uid()), Some(existing.gid()));
                }
                Ok(Self::Aside(BufWriter::new(aside), target))
            }
        }
    }

    /// Makes the data visible and lasting.
    ///
    /// # Errors
    /// If the last bytes cannot be written or the file not renamed; the old file is then whole.
    pub fn finish(self) -> io::Result<()> {
        match self {
            Self::Aside(writer, path) => {
                let file = writer.into_inner().map_err(io::IntoInnerError::into_error)?;
                file.as_file().sync_all()?;
                file.persist(&path).map_err(|error| error.error)?;
                Ok(())
            }
            Self::Straight(mut writer) => writer.flush(),
        }
    }
}

impl Write for Output {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        match self {
            Self::Aside(writer, _) => writer.write(buffer),
            Self::Straight(writer) => writer.write(buffer),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Aside(writer, _) => writer.flush(),
            Self::Straight(writer) => writer.flush(),
        }
    }
}

/// Files aside that have been begun. One that has been renamed is not there under this name any more.
fn unfinished() -> MutexGuard<'static, Vec<PathBuf>> {
    static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// From now on SIGINT, SIGTERM and SIGHUP remove the files aside before they end the process. For commands that do not handle these
/// signals themselves.
///
/// # Errors
/// If the operating system refuses the handlers.
pub fn remove_unfinished_on_signals() -> io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM, SIGHUP])?;
    thread::Builder::new().name("signals".to_owned()).spawn(move || {
        for signal in signals.forever() {
            for path in unfinished().drain(..) {
                // It may have been finished, which is as well.
                let _ = fs::remove_file(path);
            }
            // Ends the process as the signal would have.
            let _ = signal_hook::low_level::emulate_default_handler(signal);
        }
    })?;
    Ok(())
}

/// Those of the file that is replaced, else the usual ones; the process's umask still applies.
fn permissions(existing: Option<&Metadata>) -> fs::Permissions {
    use std::os::unix::fs::PermissionsExt as _;
    existing.map_or_else(|| fs::Permissions::from_mode(0o666), Metadata::permissions)
}

/// A recording to read; `-` is stdin.
///
/// # Errors
/// If it cannot be opened.
#[cfg(feature = "tools")]
pub fn open_recording(path: &Path) -> io::Result<Box<dyn io::Read>> {
    if path == Path::new("-") {
        return Ok(Box::new(io::stdin()));
    }
    let file = fs::File::open(path)?;
    if file.metadata()?.is_dir() {
        return Err(io::Error::from(io::ErrorKind::IsADirectory));
    }
    Ok(Box::new(file))
}
