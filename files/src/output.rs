//! Writing results: a regular file appears whole or not at all; pipes, devices and stdout are written directly.

use isotherm_failure::{Exit, Failure};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::fs::{self, Metadata, OpenOptions, Permissions};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, fchown};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use tempfile::NamedTempFile;

/// Where a command writes its data.
pub enum Output {
    /// A file with a temporary name in the target's folder; it is renamed when it is complete.
    Staged(BufWriter<NamedTempFile>, PathBuf),
    /// Stdout, a pipe or a device.
    Direct(BufWriter<Box<dyn Write>>),
}

impl Output {
    /// Opens the output; `None` or `-` is stdout.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(path: Option<&Path>) -> io::Result<Self> {
        let Some(path) = path.filter(|path| *path != Path::new("-")) else {
            return Ok(Self::Direct(BufWriter::new(Box::new(io::stdout()))));
        };
        match fs::metadata(path) {
            Ok(metadata) if metadata.is_dir() => Err(io::Error::from(io::ErrorKind::IsADirectory)),
            Ok(metadata) if !metadata.is_file() => {
                let direct = OpenOptions::new().write(true).open(path)?;
                Ok(Self::Direct(BufWriter::new(Box::new(direct))))
            }
            existing => Self::stage(path, existing.ok().as_ref()),
        }
    }

    fn stage(path: &Path, existing: Option<&Metadata>) -> io::Result<Self> {
        // If the path is a symbolic link, its target is replaced, not the link.
        let target = fs::canonicalize(path)
            .or_else(|_| fs::read_link(path).map(|link| path.parent().unwrap_or(Path::new("")).join(link)));
        let target = target.unwrap_or_else(|_| path.to_owned());
        let folder = target.parent().filter(|folder| !folder.as_os_str().is_empty());
        // The permissions of the file that is replaced, else 0666. The umask still applies.
        let permissions = existing.map_or_else(|| Permissions::from_mode(0o666), Metadata::permissions);
        let mut builder = tempfile::Builder::new();
        builder.prefix(".isotherm-").permissions(permissions);
        // Hold the lock until the file is listed, so that a signal between creating and listing removes it too.
        let mut unfinished = unfinished();
        // Keep only the kind of the error: its text names the temporary file, which the user does not know.
        let staged = builder.tempfile_in(folder.unwrap_or(Path::new(".")));
        let staged = staged.map_err(|error| io::Error::from(error.kind()))?;
        unfinished.push(staged.path().to_owned());
        if let Some(existing) = existing {
            // The new file gets the owner of the old one, if this user may set it.
            let _ = fchown(staged.as_file(), Some(existing.uid()), Some(existing.gid()));
        }
        Ok(Self::Staged(BufWriter::new(staged), target))
    }

    /// Makes the data visible and durable.
    ///
    /// # Errors
    /// If the last bytes cannot be written or the file cannot be renamed; the old file is then unchanged.
    pub fn finish(self) -> io::Result<()> {
        match self {
            Self::Staged(writer, path) => {
                let file = writer.into_inner().map_err(io::IntoInnerError::into_error)?;
                file.as_file().sync_all()?;
                file.persist(&path).map_err(|error| error.error)?;
                Ok(())
            }
            Self::Direct(mut writer) => writer.flush(),
        }
    }
}

impl Write for Output {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        match self {
            Self::Staged(writer, _) => writer.write(buffer),
            Self::Direct(writer) => writer.write(buffer),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Staged(writer, _) => writer.flush(),
            Self::Direct(writer) => writer.flush(),
        }
    }
}

/// A text that is written first and becomes visible later, when everything else has succeeded.
pub struct StagedText {
    path: Option<PathBuf>,
    output: Output,
}

impl StagedText {
    /// Opens the output; `None` or `-` is stdout.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(path: Option<&Path>) -> Result<Self, Failure> {
        let output = Output::create(path);
        let output = output.map_err(|error| Failure::io("writing", path.unwrap_or(Path::new("stdout")), &error))?;
        Ok(Self { path: path.map(Path::to_owned), output })
    }

    /// Writes the whole text.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(mut self, text: &str) -> Result<Self, Failure> {
        let result = self.output.write_all(text.as_bytes()).and_then(|()| self.output.flush());
        check_written(self.path.as_deref(), result)?;
        Ok(self)
    }

    /// Makes the text visible.
    ///
    /// # Errors
    /// As [`Output::finish`].
    pub fn finish(self) -> Result<(), Failure> {
        check_written(self.path.as_deref(), self.output.finish())
    }
}

/// Replaces the file `path` by one with this `text`.
///
/// # Errors
/// The operating system's error; the old file is then unchanged.
pub fn replace(path: &Path, text: &str) -> io::Result<()> {
    let mut output = Output::create(Some(path))?;
    output.write_all(text.as_bytes())?;
    output.finish()
}

/// Prints `text` to stdout.
///
/// # Errors
/// As [`check_written`].
pub fn print(text: &str) -> Result<(), Failure> {
    let mut stdout = io::stdout();
    check_written(None, stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()))
}

/// Converts an error of writing results to `path`, or to stdout, into a failure.
///
/// # Errors
/// The error of `result`. A broken pipe is no failure: the reader may end early, as in `isotherm replay .. | head`.
pub fn check_written(path: Option<&Path>, result: io::Result<()>) -> Result<(), Failure> {
    match result {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        Err(error) => Err(Failure::io("writing", path.unwrap_or(Path::new("stdout")), &error)),
        Ok(()) => Ok(()),
    }
}

/// Refuses to overwrite a file that a command reads, and to write two results to one file. Each input has its name for the
/// message, as in "the campaign file".
///
/// # Errors
/// [`Exit::Usage`], with the name of the file.
pub fn refuse_overlap(inputs: &[(&Path, &str)], outputs: &[Option<&Path>]) -> Result<(), Failure> {
    let regular = |path: &Path| fs::canonicalize(path).ok().filter(|path| path.is_file());
    let usage = |message: String| Err(Failure::new(Exit::Usage, message));
    for (index, output) in outputs.iter().enumerate() {
        let Some(output) = output else { continue };
        let same = |other: &Path| *output == other || regular(output).is_some_and(|path| regular(other) == Some(path));
        if let Some((_, role)) = inputs.iter().find(|(input, _)| *input != Path::new("-") && same(input)) {
            return usage(format!("{} is {role}; write to another file", output.display()));
        }
        if outputs[..index].iter().flatten().any(|other| same(other)) {
            return usage(format!("{} is named for two outputs; give each a file of its own", output.display()));
        }
    }
    Ok(())
}

/// The temporary names of all staged files so far. A file that has been renamed no longer has its temporary name.
fn unfinished() -> MutexGuard<'static, Vec<PathBuf>> {
    static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Makes SIGINT, SIGTERM and SIGHUP remove the staged files before they end the process. For commands that do not handle these
/// signals themselves.
///
/// # Errors
/// If the operating system refuses the handlers.
pub fn remove_unfinished_on_signals() -> Result<(), Failure> {
    let failed = |error: io::Error| Failure::new(Exit::Failed, format!("handling signals: {error}"));
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM, SIGHUP]).map_err(failed)?;
    let body = move || {
        for signal in signals.forever() {
            for path in unfinished().drain(..) {
                // Fails if the file was already renamed; then nothing must be removed.
                let _ = fs::remove_file(path);
            }
            // Ends the process as the signal would have.
            let _ = signal_hook::low_level::emulate_default_handler(signal);
        }
    };
    thread::Builder::new().name("signals".to_owned()).spawn(body).map(drop).map_err(failed)
}
