//! Writing results: a regular file appears whole or not at all; pipes, devices and stdout are written directly.

use crate::place::{canonical, output_place};
use crate::staged::StagedFile;
use crate::stdout::check_stdout;
use isotherm_support::failure::{Exit, Failure, printable, shown};
use std::fs::{self, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Where a command writes its data.
pub enum Output {
    /// A file with a temporary name in the target's folder, which is renamed when it is complete.
    Staged(StagedFile),
    /// Stdout, a pipe or a device.
    Direct(BufWriter<Box<dyn Write>>),
}

impl Output {
    /// Opens the output; `None` or `-` is stdout.
    ///
    /// # Errors
    /// If the file cannot be created, or stdout is closed.
    pub fn create(path: Option<&Path>) -> io::Result<Self> {
        let Some(path) = path.filter(|path| *path != Path::new("-")) else {
            check_stdout()?;
            return Ok(Self::Direct(BufWriter::new(Box::new(io::stdout()))));
        };
        // If the path is a symbolic link, its target is replaced, not the link.
        let place = output_place(path)?;
        match fs::metadata(&place) {
            Ok(metadata) if metadata.is_dir() => Err(io::Error::from(io::ErrorKind::IsADirectory)),
            Ok(metadata) if !metadata.is_file() => {
                let direct = OpenOptions::new().write(true).open(place)?;
                Ok(Self::Direct(BufWriter::new(Box::new(direct))))
            }
            existing => StagedFile::create(&place, existing.ok().as_ref()).map(Self::Staged),
        }
    }

    /// Makes the data visible and durable.
    ///
    /// # Errors
    /// If the last bytes cannot be written or the file cannot be renamed; the old file is then unchanged. If the disk
    /// fails after that, the new file has its name, but may lose it.
    pub fn finish(mut self) -> io::Result<()> {
        self.complete()?;
        self.rename()
    }

    /// Makes the data durable. A staged file still has its temporary name.
    fn complete(&mut self) -> io::Result<()> {
        self.flush()?;
        match self {
            Self::Staged(file) => file.sync(),
            _ => Ok(()),
        }
    }

    /// Gives the file, which [`complete`](Self::complete) has made durable, its name, and makes that durable, too.
    fn rename(self) -> io::Result<()> {
        match self {
            Self::Staged(file) => file.rename(),
            Self::Direct(_) => Ok(()),
        }
    }
}

impl Write for Output {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        match self {
            Self::Staged(file) => file.write(buffer),
            Self::Direct(writer) => writer.write(buffer),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Staged(file) => file.flush(),
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
        let path = path.filter(|path| *path != Path::new("-"));
        let output = Output::create(path);
        let output = output.map_err(|error| Failure::io("writing", path.unwrap_or(Path::new("stdout")), &error))?;
        Ok(Self { path: path.map(Path::to_owned), output })
    }

    /// Writes the whole text.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(self, text: &str) -> Result<Self, Failure> {
        self.write_with(|output| output.write_all(text.as_bytes()))
    }

    /// Writes the text with this function.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write_with(mut self, write: impl FnOnce(&mut Output) -> io::Result<()>) -> Result<Self, Failure> {
        let result = write(&mut self.output).and_then(|()| self.output.complete());
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

    /// Makes several texts visible, one after the other. What names another of them, as a report does, is to have its
    /// digest.
    ///
    /// # Errors
    /// As [`Output::finish`]. Those before are visible then.
    pub fn finish_all(texts: Vec<Self>) -> Result<(), Failure> {
        texts.into_iter().try_for_each(Self::finish)
    }
}

/// Replaces the file `path` by one with this `text`.
///
/// # Errors
/// As [`Output::create`] and [`Output::finish`].
pub fn replace(path: &Path, text: &str) -> io::Result<()> {
    let mut output = Output::create(Some(path))?;
    output.write_all(text.as_bytes())?;
    output.finish()
}

/// Prints words for people to stdout, as [`printable`] text.
///
/// # Errors
/// As [`check_written`].
pub fn print(text: &str) -> Result<(), Failure> {
    print_data(&printable(text))
}

/// Prints a document for programs to stdout, such as JSON, unchanged.
///
/// # Errors
/// As [`check_written`].
pub fn print_data(text: &str) -> Result<(), Failure> {
    let mut stdout = io::stdout();
    check_written(None, stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()))
}

/// Converts an error of writing results to `path`, or to stdout, into a failure.
///
/// # Errors
/// The error of `result`, or that stdout is closed. A broken pipe is no failure: the reader may end early, as in
/// `isotherm replay .. | head`.
pub fn check_written(path: Option<&Path>, result: io::Result<()>) -> Result<(), Failure> {
    let path = path.filter(|path| *path != Path::new("-"));
    match if path.is_none() { result.and_then(|()| check_stdout()) } else { result } {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        Err(error) => Err(Failure::io("writing", path.unwrap_or(Path::new("stdout")), &error)),
        Ok(()) => Ok(()),
    }
}

/// Refuses to overwrite a file that a command reads, and to write two results to one file. Each input has its name for
/// the message, as in "the campaign file".
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_files::refuse_overlap;
/// use std::path::Path;
///
/// let samples = [(Path::new("samples.csv"), "the samples")];
/// assert!(refuse_overlap(&samples, &[Some(Path::new("imu.toml")), None]).is_ok());
/// assert!(refuse_overlap(&samples, &[Some(Path::new("samples.csv"))]).is_err());
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// [`Exit::Usage`], with the name of the file.
pub fn refuse_overlap(inputs: &[(&Path, &str)], outputs: &[Option<&Path>]) -> Result<(), Failure> {
    let regular = |path: &Path| canonical(path).ok().filter(|path| path.is_file());
    let usage = |message: String| Err(Failure::new(Exit::Usage, message));
    for (index, output) in outputs.iter().enumerate() {
        let Some(output) = output else { continue };
        let same = |other: &Path| *output == other || regular(output).is_some_and(|path| regular(other) == Some(path));
        if let Some((_, role)) = inputs.iter().find(|(input, _)| *input != Path::new("-") && same(input)) {
            return usage(format!("{} is {role}; write to another file", shown(output)));
        }
        if outputs[..index].iter().flatten().any(|other| same(other)) {
            return usage(format!("{} is named for two outputs; give each a file of its own", shown(output)));
        }
    }
    Ok(())
}
