//! Writing results: a regular file appears whole or not at all; pipes, devices and stdout are written directly. Rows of
//! a live stream are kept if the command ends early ([`Output::create_live`]).

#[cfg(not(target_os = "wasi"))]
use crate::live::{LiveFile, Partial};
use crate::place::{canonical, output_place};
use crate::signals::hold_signals;
use crate::staged::{Aside, StagedFile};
use crate::stdout::check_stdout;
use isotherm_support::failure::{Exit, Failure, printable, shown};
use std::fs::{self, Metadata, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Where a command writes its data.
pub enum Output {
    /// A file with a temporary name in the target's folder, which is renamed when it is complete.
    Staged(StagedFile),
    /// A file of rows that is kept if the command ends early.
    #[cfg(not(target_os = "wasi"))]
    Live(LiveFile),
    /// Stdout, a pipe or a device.
    Direct(BufWriter<Box<dyn Write>>),
}

impl Output {
    /// Opens the output of data that the command can make again; `None` or `-` is stdout.
    ///
    /// # Errors
    /// If the file cannot be created, or stdout is closed.
    pub fn create(path: Option<&Path>) -> io::Result<Self> {
        Self::open(path, |target, existing| StagedFile::create(&target, existing).map(Self::Staged))
    }

    /// Opens the output of rows that come from a live stream and cannot be had again; `None` or `-` is stdout. The
    /// first line is the header.
    ///
    /// # Errors
    /// As [`create`](Self::create), and if an earlier run has left its rows.
    #[cfg(not(target_os = "wasi"))]
    pub fn create_live(path: Option<&Path>) -> io::Result<Self> {
        Self::open(path, |target, existing| LiveFile::create(target, existing).map(Self::Live))
    }

    fn open(
        path: Option<&Path>,
        regular: impl FnOnce(PathBuf, Option<&Metadata>) -> io::Result<Self>,
    ) -> io::Result<Self> {
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
            existing => regular(place, existing.ok().as_ref()),
        }
    }

    /// Where the rows are until the output is complete, if it keeps them.
    #[cfg(not(target_os = "wasi"))]
    #[must_use]
    pub fn partial(&self) -> Option<Partial> {
        match self {
            Self::Live(file) => Some(file.partial().clone()),
            Self::Staged(_) | Self::Direct(_) => None,
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

    /// Gives the file that is about to be replaced, if there is one, a hidden name, and waits until that is durable.
    fn set_aside(&self) -> io::Result<Option<Aside>> {
        if let Self::Staged(file) = self { file.set_aside() } else { Ok(None) }
    }

    /// Gives the file, which [`complete`](Self::complete) has made durable, its name, and makes that durable, too.
    fn rename(self) -> io::Result<()> {
        match self {
            Self::Staged(file) => file.rename(),
            #[cfg(not(target_os = "wasi"))]
            Self::Live(file) => file.finish(),
            Self::Direct(_) => Ok(()),
        }
    }
}

impl Write for Output {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        match self {
            Self::Staged(file) => file.write(buffer),
            #[cfg(not(target_os = "wasi"))]
            Self::Live(file) => file.write(buffer),
            Self::Direct(writer) => writer.write(buffer),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Staged(file) => file.flush(),
            #[cfg(not(target_os = "wasi"))]
            Self::Live(file) => file.flush(),
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

    /// Makes several texts visible that belong together: all or none. The first is the one that matters, as the table
    /// before its report.
    ///
    /// No signal of [`end_signals`](crate::end_signals) ends the command in between. Because several files cannot be
    /// renamed at once, SIGKILL or a power failure may leave fewer of them, but never an old one together with a new
    /// one: the old files that come after the first get hidden names before the first is renamed. If the first cannot
    /// be renamed, they get their names again.
    ///
    /// # Errors
    /// As [`Output::finish`].
    pub fn finish_together(mut texts: Vec<Self>) -> Result<(), Failure> {
        for text in &mut texts {
            let result = text.output.complete();
            check_written(text.path.as_deref(), result)?;
        }
        let _held = hold_signals();
        let mut texts = texts.into_iter();
        let Some(first) = texts.next() else { return Ok(()) };
        let rest: Vec<_> = texts.collect();
        let mut old = Vec::new();
        let begun = rest.iter().try_for_each(|text| {
            let aside = text.output.set_aside().map(|aside| old.extend(aside));
            check_written(text.path.as_deref(), aside)
        });
        if let Err(failure) = begun.and_then(|()| first.rename()) {
            return Err(old.into_iter().fold(failure, Aside::put_back));
        }
        rest.into_iter().try_for_each(Self::rename)
    }

    fn rename(self) -> Result<(), Failure> {
        check_written(self.path.as_deref(), self.output.rename())
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
