//! Which rows go into which file, under what name, and when the next one begins.

use isotherm_recording::rows::{self, RecordedRow, columns};

use super::growing::Growing;
use super::mcap::McapFile;
use super::parquet::ParquetFile;
use isotherm_shared::stream::{ImuId, StreamKind};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// In what form.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Format {
    /// Text, one file a stream
    Csv,
    /// Apache Parquet, one file a stream
    Parquet,
    /// MCAP, which Foxglove and PlotJuggler open: all streams in one file
    Mcap,
}

impl Format {
    /// Every format with its name.
    pub const NAMES: [(Self, &'static str); 3] = [(Self::Csv, "csv"), (Self::Parquet, "parquet"), (Self::Mcap, "mcap")];
}

/// Stands for the IMU in a file's name.
pub const IMU: &str = "{imu}";
/// Rows after which is flushed whatever the clock says: memory has a bound.
const UNFLUSHED: u64 = 100_000;

/// When a file is full.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rotation {
    /// At this size \[bytes\].
    pub size: Option<u64>,
    /// At this age.
    pub time: Option<Duration>,
}

impl Rotation {
    const fn is_asked_for(self) -> bool {
        self.size.is_some() || self.time.is_some()
    }
}

/// Files that begin and end together: the two of an IMU, or one MCAP file.
pub struct Files {
    name: PathBuf,
    format: Format,
    rotation: Rotation,
    imus: Vec<ImuId>,
    streams: Vec<(usize, StreamKind)>,
    number: u32,
    opened: Instant,
    writers: Vec<(PathBuf, Writer)>,
    unflushed: u64,
    /// Whether there is a row in them.
    used: bool,
}

enum Writer {
    Csv(Growing),
    Mcap(Box<McapFile>),
    Parquet(Box<ParquetFile>),
}

/// Where, and what the operating system says.
pub struct FileError(pub PathBuf, pub io::Error);

impl Files {
    /// New files with the rows of `streams`: places in the list `imus`, and which of their streams. `-` is the standard output.
    ///
    /// # Errors
    /// If one exists or cannot be written.
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
            used: false,
        };
        files.next()?;
        Ok(files)
    }

    /// Takes a row.
    ///
    /// # Errors
    /// If it cannot be encoded.
    pub fn write(&mut self, row: &RecordedRow) -> Result<(), FileError> {
        let place = match self.format {
            Format::Mcap => 0,
            _ => self.streams.iter().position(|(_, stream)| *stream == row.stream()).unwrap_or(0),
        };
        self.unflushed += 1;
        self.used = true;
        let (path, writer) = &mut self.writers[place];
        let result = match writer {
            Writer::Csv(file) => {
                rows::append(row, &mut file.pending);
                Ok(())
            }
            Writer::Mcap(file) => file.write(row),
            Writer::Parquet(file) => file.write(row),
        };
        result.map_err(|error| FileError(path.clone(), error))
    }

    /// Whether so much waits that it should be flushed before its time.
    pub const fn is_flush_due(&self) -> bool {
        self.unflushed >= UNFLUSHED
    }

    /// Makes everything so far visible and lasting, and begins the next files if these are full: then their names.
    ///
    /// # Errors
    /// If there is no room; what was visible stays, and it can be tried again.
    pub fn flush(&mut self) -> Result<Option<Vec<PathBuf>>, FileError> {
        if self.unflushed > 0 {
            for (path, writer) in &mut self.writers {
                let result = match writer {
                    Writer::Csv(file) => file.flush(),
                    Writer::Mcap(file) => file.flush(),
                    Writer::Parquet(file) => file.flush(),
                };
                result.map_err(|error| FileError(path.clone(), error))?;
            }
            self.unflushed = 0;
        }
        if !self.is_full() {
            return Ok(None);
        }
        // The next ones first: if there is no room for them these go on.
        let mut full = self.next()?;
        finish(&mut full)?;
        Ok(Some(self.paths_now()))
    }

    /// Rows that have not been flushed.
    pub const fn unflushed(&self) -> u64 {
        self.unflushed
    }

    /// The names of the files that are being written.
    pub fn paths_now(&self) -> Vec<PathBuf> {
        self.writers.iter().map(|(path, _)| path.clone()).collect()
    }

    /// Ends the files.
    ///
    /// # Errors
    /// As [`flush`](Self::flush).
    pub fn finish(&mut self) -> Result<(), FileError> {
        finish(&mut self.writers)?;
        self.unflushed = 0;
        Ok(())
    }

    fn is_full(&self) -> bool {
        let size = |writer: &Writer| match writer {
            Writer::Csv(file) => file.size(),
            Writer::Mcap(file) => file.size(),
            Writer::Parquet(file) => file.size(),
        };
        let old = self.rotation.time.is_some_and(|time| self.opened.elapsed() >= time);
        let large = self.rotation.size.is_some_and(|most| self.writers.iter().any(|(_, writer)| size(writer) >= most));
        self.used && (old || large)
    }

    /// Opens the next files, in place of those that it gives back.
    fn next(&mut self) -> Result<Vec<(PathBuf, Writer)>, FileError> {
        let mut number = self.number;
        let paths = loop {
            number += 1;
            let paths = self.paths(number);
            // A recorder that is started again goes on behind its predecessor's files.
            if !self.rotation.is_asked_for() || !paths.iter().any(|path| fs::symlink_metadata(path).is_ok()) {
                break paths;
            }
        };
        let mut writers = Vec::new();
        for (index, path) in paths.into_iter().enumerate() {
            match self.open(&path, index) {
                Ok(writer) => writers.push((path, writer)),
                Err(error) => {
                    // All or none.
                    writers.iter().for_each(|(made, _)| drop(fs::remove_file(made)));
                    return Err(FileError(path, error));
                }
            }
        }
        self.number = number;
        self.opened = Instant::now();
        self.used = false;
        Ok(std::mem::replace(&mut self.writers, writers))
    }

    fn open(&self, path: &Path, index: usize) -> io::Result<Writer> {
        let (imu, stream) = self.streams[index];
        Ok(match self.format {
            Format::Csv if path == Path::new("-") => Writer::Csv(Growing::stdout(rows::header(columns(stream)))),
            Format::Csv => Writer::Csv(Growing::create(path, &rows::header(columns(stream)))?),
            Format::Mcap => Writer::Mcap(Box::new(McapFile::create(path, &self.imus, &self.streams)?)),
            Format::Parquet => Writer::Parquet(Box::new(ParquetFile::create(path, &self.imus[imu], stream)?)),
        })
    }

    /// The names of the files with this number, one a stream but for MCAP.
    fn paths(&self, number: u32) -> Vec<PathBuf> {
        let (first, _) = self.streams[0];
        let number = if self.rotation.is_asked_for() { format!("-{number:04}") } else { String::new() };
        match self.format {
            Format::Mcap => vec![file_name(&self.name, &self.imus[first], &number)],
            _ if self.streams.len() == 1 => vec![file_name(&self.name, &self.imus[first], &number)],
            _ => ["", ".increments"]
                .map(|end| file_name(&self.name, &self.imus[first], &format!("{number}{end}")))
                .to_vec(),
        }
    }
}

fn finish(writers: &mut [(PathBuf, Writer)]) -> Result<(), FileError> {
    for (path, writer) in writers {
        let result = match writer {
            Writer::Csv(file) => file.flush(),
            Writer::Mcap(file) => file.finish(),
            Writer::Parquet(file) => file.flush(),
        };
        result.map_err(|error| FileError(path.clone(), error))?;
    }
    Ok(())
}

/// `name` with the IMU in place of `{imu}`, and `end` before the extension.
fn file_name(name: &Path, imu: &ImuId, end: &str) -> PathBuf {
    let text = name.to_string_lossy().replace(IMU, imu.as_str());
    let path = Path::new(&text);
    let (Some(stem), false) = (path.file_stem(), end.is_empty()) else { return PathBuf::from(text) };
    let extension = path.extension().map(|extension| format!(".{}", extension.to_string_lossy()));
    path.with_file_name(format!("{}{end}{}", stem.to_string_lossy(), extension.unwrap_or_default()))
}
