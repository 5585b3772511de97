//! The files of a recording: their names, the rows that each one gets, and their rotation.

use super::growing::GrowingFile;
use super::mcap::McapFile;
use super::parquet::ParquetFile;
use isotherm_recording::rows::{self, RecordedRow, columns};
use isotherm_shared::stream::{ImuId, StreamKind};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Format of a recording.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Format {
    /// Text, one file per stream
    Csv,
    /// Apache Parquet, one file per stream
    Parquet,
    /// MCAP, which Foxglove and PlotJuggler open: all streams in one file
    Mcap,
}

impl Format {
    /// Every format with its name.
    pub const NAMES: [(Self, &'static str); 3] = [(Self::Csv, "csv"), (Self::Parquet, "parquet"), (Self::Mcap, "mcap")];
}

/// Placeholder for the IMU's name in a file name.
pub const IMU_PLACEHOLDER: &str = "{imu}";
/// A flush is due after this number of rows, so that memory is bounded.
const MAX_UNFLUSHED: u64 = 100_000;

/// When the recorder goes on in the next file.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rotation {
    /// At this size of the current file \[bytes\].
    pub size: Option<u64>,
    /// At this age of the current file.
    pub time: Option<Duration>,
}

impl Rotation {
    const fn is_enabled(self) -> bool {
        self.size.is_some() || self.time.is_some()
    }
}

/// Files that begin and end together: one or two of an IMU, or one MCAP file.
pub struct Files {
    name: PathBuf,
    format: Format,
    rotation: Rotation,
    imus: Vec<ImuId>,
    streams: Vec<(usize, StreamKind)>,
    number: u32,
    opened: Instant,
    writers: Vec<(PathBuf, FormatWriter)>,
    unflushed: u64,
    /// Whether the current files have a row.
    has_rows: bool,
}

enum FormatWriter {
    Csv(GrowingFile),
    Mcap(Box<McapFile>),
    Parquet(Box<ParquetFile>),
}

/// An error of the operating system, and the file.
pub struct FileError(pub PathBuf, pub io::Error);

impl Files {
    /// Creates the files for the rows of `streams`: index in the list `imus`, and kind of the stream. `-` is the standard output.
    ///
    /// # Errors
    /// If a file exists or cannot be written.
    pub fn create(
        name: &Path,
        format: Format,
        rotation: Rotation,
        imus: &[ImuId],
        streams: &[(usize, StreamKind)],
    ) -> Result<Self, FileError> {
        let mut files = Self {
            name: name.to_owned(),
            format,
            rotation,
            imus: imus.to_vec(),
            streams: streams.to_vec(),
            number: 0,
            opened: Instant::now(),
            writers: Vec::new(),
            unflushed: 0,
            has_rows: false,
        };
        files.open_next()?;
        Ok(files)
    }

    /// Adds a row to its file.
    ///
    /// # Errors
    /// If it cannot be encoded.
    pub fn write(&mut self, row: &RecordedRow) -> Result<(), FileError> {
        let index = match self.format {
            Format::Mcap => 0,
            _ => self.streams.iter().position(|(_, stream)| *stream == row.stream()).unwrap_or(0),
        };
        self.unflushed += 1;
        self.has_rows = true;
        let (path, writer) = &mut self.writers[index];
        let result = match writer {
            FormatWriter::Csv(file) => {
                rows::append(row, &mut file.pending);
                Ok(())
            }
            FormatWriter::Mcap(file) => file.write(row),
            FormatWriter::Parquet(file) => file.write(row),
        };
        result.map_err(|error| FileError(path.clone(), error))
    }

    /// Whether the number of unflushed rows requires a flush now.
    pub const fn is_flush_due(&self) -> bool {
        self.unflushed >= MAX_UNFLUSHED
    }

    /// Makes all rows so far visible and durable. If the files are full, opens the next ones and returns their names.
    ///
    /// # Errors
    /// If the disk is full, for example. Rows that were visible stay so, and the call can be repeated.
    pub fn flush(&mut self) -> Result<Option<Vec<PathBuf>>, FileError> {
        if self.unflushed > 0 {
            for (path, writer) in &mut self.writers {
                let result = match writer {
                    FormatWriter::Csv(file) => file.flush(),
                    FormatWriter::Mcap(file) => file.flush(),
                    FormatWriter::Parquet(file) => file.flush(),
                };
                result.map_err(|error| FileError(path.clone(), error))?;
            }
            self.unflushed = 0;
        }
        if !self.is_full() {
            return Ok(None);
        }
        // Opens the next files before it ends these: if that fails, these continue.
        let mut full = self.open_next()?;
        finish(&mut full)?;
        Ok(Some(self.current_paths()))
    }

    /// Number of rows that have not been flushed.
    pub const fn unflushed(&self) -> u64 {
        self.unflushed
    }

    /// The names of the current files.
    pub fn current_paths(&self) -> Vec<PathBuf> {
        self.writers.iter().map(|(path, _)| path.clone()).collect()
    }

    /// Finishes the files.
    ///
    /// # Errors
    /// As [`flush`](Self::flush).
    pub fn finish(&mut self) -> Result<(), FileError> {
        finish(&mut self.writers)?;
        self.unflushed = 0;
        Ok(())
    }

    fn is_full(&self) -> bool {
        let size = |writer: &FormatWriter| match writer {
            FormatWriter::Csv(file) => file.size(),
            FormatWriter::Mcap(file) => file.size(),
            FormatWriter::Parquet(file) => file.size(),
        };
        let old = self.rotation.time.is_some_and(|time| self.opened.elapsed() >= time);
        let large = self.rotation.size.is_some_and(|most| self.writers.iter().any(|(_, writer)| size(writer) >= most));
        self.has_rows && (old || large)
    }

    /// Opens the next files and returns the previous ones.
    fn open_next(&mut self) -> Result<Vec<(PathBuf, FormatWriter)>, FileError> {
        let mut number = self.number;
        let paths = loop {
            number += 1;
            let paths = self.paths(number);
            // With rotation, a restarted recorder continues the numbers of existing files.
            if !self.rotation.is_enabled() || !paths.iter().any(|path| fs::symlink_metadata(path).is_ok()) {
                break paths;
            }
        };
        let mut writers = Vec::new();
        for (index, path) in paths.into_iter().enumerate() {
            match self.open(&path, index) {
                Ok(writer) => writers.push((path, writer)),
                Err(error) => {
                    // All files are created, or none.
                    writers.iter().for_each(|(made, _)| drop(fs::remove_file(made)));
                    return Err(FileError(path, error));
                }
            }
        }
        self.number = number;
        self.opened = Instant::now();
        self.has_rows = false;
        Ok(std::mem::replace(&mut self.writers, writers))
    }

    fn open(&self, path: &Path, index: usize) -> io::Result<FormatWriter> {
        let (imu, stream) = self.streams[index];
        Ok(match self.format {
            Format::Csv if path == Path::new("-") => {
                FormatWriter::Csv(GrowingFile::stdout(rows::header(columns(stream))))
            }
            Format::Csv => FormatWriter::Csv(GrowingFile::create(path, &rows::header(columns(stream)))?),
            Format::Mcap => FormatWriter::Mcap(Box::new(McapFile::create(path, &self.imus, &self.streams)?)),
            Format::Parquet => FormatWriter::Parquet(Box::new(ParquetFile::create(path, &self.imus[imu], stream)?)),
        })
    }

    /// The names of the files with this number: one per stream, for MCAP one for all.
    fn paths(&self, number: u32) -> Vec<PathBuf> {
        let (first, _) = self.streams[0];
        let number = if self.rotation.is_enabled() { format!("-{number:04}") } else { String::new() };
        match self.format {
            Format::Mcap => vec![file_name(&self.name, &self.imus[first], &number)],
            _ if self.streams.len() == 1 => vec![file_name(&self.name, &self.imus[first], &number)],
            _ => ["", ".increments"]
                .map(|end| file_name(&self.name, &self.imus[first], &format!("{number}{end}")))
                .to_vec(),
        }
    }
}

fn finish(writers: &mut [(PathBuf, FormatWriter)]) -> Result<(), FileError> {
    for (path, writer) in writers {
        let result = match writer {
            FormatWriter::Csv(file) => file.flush(),
            FormatWriter::Mcap(file) => file.finish(),
            FormatWriter::Parquet(file) => file.flush(),
        };
        result.map_err(|error| FileError(path.clone(), error))?;
    }
    Ok(())
}

/// `name` with the IMU's name for `{imu}`, and `end` before the extension.
fn file_name(name: &Path, imu: &ImuId, end: &str) -> PathBuf {
    let text = name.to_string_lossy().replace(IMU_PLACEHOLDER, imu.as_str());
    let path = Path::new(&text);
    let (Some(stem), false) = (path.file_stem(), end.is_empty()) else { return PathBuf::from(text) };
    let extension = path.extension().map(|extension| format!(".{}", extension.to_string_lossy()));
    path.with_file_name(format!("{}{end}{}", stem.to_string_lossy(), extension.unwrap_or_default()))
}
