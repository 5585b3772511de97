//! The files of a recording: their names, the rows that each one gets, and their rotation.

use super::open::{FileError, OpenFile};
use super::pieces;
use super::ros::RosTable;
use isotherm_recording::columns::Layout;
use isotherm_recording::rows::RecordedRow;
use isotherm_shared::content::WRITE_PARQUET;
use isotherm_shared::names::{ImuId, StreamKind};
use isotherm_support::failure::shown;
use isotherm_support::storage::Storage;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Format of a recording.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Format {
    /// Text, one file per stream
    Csv,
    /// MCAP, which Foxglove and PlotJuggler open: all streams in one file
    Mcap,
    /// MCAP with ROS messages, `sensor_msgs/msg/Imu`: the increments of all IMUs in one file
    Ros,
}

impl Format {
    /// Every format with its name.
    pub const NAMES: [(Self, &'static str); 3] = [(Self::Csv, "csv"), (Self::Mcap, "mcap"), (Self::Ros, "ros")];

    /// The format that the ending of a file's name says.
    #[must_use]
    pub fn of_path(path: &Path) -> Option<Self> {
        let ending = path.extension()?.to_str()?.to_ascii_lowercase();
        Self::NAMES.into_iter().find(|(format, name)| *format != Self::Ros && *name == ending).map(|(format, _)| format)
    }

    /// The same, of a recording.
    ///
    /// # Errors
    /// If the ending says none, with those that do.
    pub fn named(path: &Path) -> Result<Self, String> {
        Self::of_path(path).ok_or_else(|| {
            let is_parquet = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("parquet"));
            let other = if is_parquet { format!("; {WRITE_PARQUET}") } else { String::new() };
            format!("{}: name the recording .csv or .mcap{other}", shown(path))
        })
    }

    /// Whether one file has all streams, whatever columns they have.
    #[must_use]
    pub const fn is_joint(self) -> bool {
        matches!(self, Self::Mcap | Self::Ros)
    }
}

/// Placeholder for the IMU's name in a file name.
pub const IMU_PLACEHOLDER: &str = "{imu}";
/// A flush is due after this number of rows, so that memory is bounded.
const MAX_UNFLUSHED: u64 = 100_000;

/// When the recorder goes on in the next file, and what it leaves of the disk.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rotation {
    /// At this size of the current file \[bytes\].
    pub size: Option<u64>,
    /// At this age of the current file.
    pub time: Option<Duration>,
    /// So much of the disk stays free \[bytes\]: with less it counts as full.
    pub keep_free: Option<u64>,
    /// Whether the oldest files of this name are removed for that: those with the lowest numbers, which recorders of
    /// this user have written and none is writing.
    pub delete_oldest: bool,
}

impl Rotation {
    /// Whether files are numbered from the first one on.
    #[must_use]
    pub const fn is_enabled(self) -> bool {
        self.size.is_some() || self.time.is_some()
    }
}

/// Files that begin and end together: one or two of an IMU, or one MCAP file.
pub struct Files {
    storage: &'static dyn Storage,
    name: PathBuf,
    format: Format,
    rotation: Rotation,
    imus: Vec<ImuId>,
    tables: Vec<RosTable>,
    streams: Vec<(usize, StreamKind)>,
    number: u32,
    /// When the current files were begun, by the clock of the storage.
    begun: Duration,
    /// One for each of `streams`, or one MCAP file for all.
    open: Vec<OpenFile>,
    /// Rows of each of `streams` that are not in its file yet.
    unwritten: Vec<u64>,
    /// Which columns the samples of each IMU need, as far as they have come.
    layouts: Vec<Layout>,
    /// The rows before the first flush of the current files. They decide which columns the files have.
    held: Vec<RecordedRow>,
    /// Whether the current files have rows.
    has_rows: bool,
    /// Files that were removed to make room, until they are asked for.
    removed: Vec<PathBuf>,
}

/// What became of the columns that a row needs and the current files do not have.
pub enum MoreColumns {
    /// The rows go on in these files.
    In(Vec<PathBuf>),
    /// They are left out: the standard output has one header.
    LeftOut,
}

impl Files {
    /// Creates the files for the rows of `streams`: index in the list `imus`, and kind of the stream. `-` is the
    /// standard output.
    ///
    /// # Errors
    /// If a file exists or cannot be written.
    pub fn create(
        storage: &'static dyn Storage,
        name: &Path,
        format: Format,
        rotation: Rotation,
        imus: &[ImuId],
        streams: &[(usize, StreamKind)],
    ) -> Result<Self, FileError> {
        Self::create_with_tables(storage, name, format, rotation, imus, streams, &[])
    }

    /// As [`create`](Self::create), with the tables that a file of ROS messages names.
    ///
    /// # Errors
    /// As [`create`](Self::create).
    pub fn create_with_tables(
        storage: &'static dyn Storage,
        name: &Path,
        format: Format,
        rotation: Rotation,
        imus: &[ImuId],
        streams: &[(usize, StreamKind)],
        tables: &[RosTable],
    ) -> Result<Self, FileError> {
        let mut files = Self {
            storage,
            name: name.to_owned(),
            format,
            rotation,
            imus: imus.to_vec(),
            tables: tables.to_vec(),
            streams: streams.to_vec(),
            number: 0,
            begun: storage.now(),
            open: Vec::new(),
            unwritten: vec![0; streams.len()],
            layouts: vec![Layout::default(); imus.len()],
            held: Vec::new(),
            has_rows: false,
            removed: Vec::new(),
        };
        if rotation.is_enabled() {
            // What recorders before have written, of which the oldest may have been removed.
            files.number = pieces::numbers(storage, &files.unnumbered()).last().copied().unwrap_or(0);
        }
        files.make_room()?;
        files.open_next()?;
        Ok(files)
    }

    /// Adds a row to its file. The rows before the first flush decide which columns the files have. If a later row
    /// needs more, goes on in the next files; an MCAP file gets a channel more, and the standard output goes on without
    /// these columns.
    ///
    /// # Errors
    /// If the row cannot be encoded, or the next files cannot be written. The row has not been added then; if the disk
    /// is full, the call can be repeated.
    pub fn write(&mut self, row: &RecordedRow) -> Result<Option<MoreColumns>, FileError> {
        let known = self.layouts[row.imu];
        let layout = known.with(row.layout());
        let has_columns = |(_, stream): &(_, StreamKind)| known.of_stream(*stream) == layout.of_stream(*stream);
        let fits = !self.has_rows || self.format.is_joint() || self.streams.iter().all(has_columns);
        self.layouts[row.imu] = layout;
        let more = match fits {
            true => None,
            false if self.name == Path::new("-") => Some(MoreColumns::LeftOut),
            false => {
                let next = self.go_on_in_next().inspect_err(|_| self.layouts[row.imu] = known)?;
                Some(MoreColumns::In(next))
            }
        };
        if self.has_rows {
            self.encode(row)?;
        } else {
            self.held.push(*row);
        }
        if let Some(stream) = self.streams.iter().position(|of| *of == (row.imu, row.stream())) {
            self.unwritten[stream] += 1;
        }
        Ok(more)
    }

    /// Encodes the rows before the first flush.
    fn encode_held(&mut self) -> Result<(), FileError> {
        if self.held.is_empty() {
            return Ok(());
        }
        for (index, file) in self.open.iter_mut().enumerate() {
            let (imu, stream) = self.streams[index];
            let layout = self.layouts[imu].of_stream(stream);
            file.change_layout(stream, layout, &self.layouts)?;
        }
        self.has_rows = true;
        std::mem::take(&mut self.held).iter().try_for_each(|row| self.encode(row))
    }

    fn encode(&mut self, row: &RecordedRow) -> Result<(), FileError> {
        let index = match self.format {
            format if format.is_joint() => 0,
            _ => self.streams.iter().position(|(_, stream)| *stream == row.stream()).unwrap_or(0),
        };
        self.open[index].write(row, self.layouts[row.imu])
    }

    /// Opens the next files before it ends these: if that fails, these continue.
    fn go_on_in_next(&mut self) -> Result<Vec<PathBuf>, FileError> {
        self.flush_open()?;
        let mut full = self.open_next()?;
        full.iter_mut().try_for_each(OpenFile::finish)?;
        Ok(self.current_paths())
    }

    /// Whether the number of unflushed rows requires a flush now.
    pub fn is_flush_due(&self) -> bool {
        self.unwritten.iter().sum::<u64>() >= MAX_UNFLUSHED
    }

    /// Makes all rows so far visible and durable. If the files are full, opens the next ones and returns their names.
    ///
    /// # Errors
    /// If the disk is full, for example. Rows that were visible stay so, and the call can be repeated.
    pub fn flush(&mut self) -> Result<Option<Vec<PathBuf>>, FileError> {
        self.flush_open()?;
        if self.is_full() { self.go_on_in_next().map(Some) } else { Ok(None) }
    }

    fn flush_open(&mut self) -> Result<(), FileError> {
        self.encode_held()?;
        if self.unwritten.iter().all(|rows| *rows == 0) {
            return Ok(());
        }
        self.make_room()?;
        self.each_open(OpenFile::flush)
    }

    /// Removes the oldest files, if that is wanted, until what is not written fits into the rest.
    fn make_room(&mut self) -> Result<(), FileError> {
        let Some(keep_free) = self.rotation.keep_free else { return Ok(()) };
        let path = self.open.first().map_or_else(|| self.unnumbered(), |file| file.path.clone());
        let rows = self.unwritten.iter().sum();
        let needed = self.open.iter().map(|file| file.needs(rows)).fold(keep_free, u64::saturating_add);
        // A file system that does not report it shows it when it is written to.
        while self.storage.free_beside(&path).is_some_and(|free| free < needed) {
            if !self.rotation.delete_oldest || !self.remove_oldest() {
                let cause = format!("fewer than {keep_free} bytes would stay free");
                return Err(FileError(path, io::Error::new(io::ErrorKind::StorageFull, cause)));
            }
        }
        Ok(())
    }

    /// Removes the oldest files before the current ones. Returns whether there were some that could be removed.
    fn remove_oldest(&mut self) -> bool {
        let current = self.current_paths();
        for number in pieces::numbers(self.storage, &self.unnumbered()) {
            let paths = self
                .paths(number)
                .into_iter()
                .filter(|path| !current.contains(path) && pieces::is_own(self.storage, path));
            let removed: Vec<_> = paths.filter(|path| self.storage.remove(path).is_ok()).collect();
            if !removed.is_empty() {
                self.removed.extend(removed);
                return true;
            }
        }
        false
    }

    /// The files that were removed to make room since this was asked last.
    pub fn take_removed(&mut self) -> Vec<PathBuf> {
        std::mem::take(&mut self.removed)
    }

    /// Writes what has been encoded for each file, until one fails.
    fn each_open(&mut self, write: fn(&mut OpenFile) -> Result<(), FileError>) -> Result<(), FileError> {
        for (index, file) in self.open.iter_mut().enumerate() {
            write(file)?;
            match self.format.is_joint() {
                true => self.unwritten.fill(0),
                false => self.unwritten[index] = 0,
            }
        }
        Ok(())
    }

    /// The rows of each stream that are not in its file: since the last flush, or because that failed.
    pub fn unwritten(&self) -> impl Iterator<Item = ((usize, StreamKind), u64)> {
        self.streams.iter().copied().zip(self.unwritten.iter().copied())
    }

    /// Removes the current files if they have no rows: nothing was recorded into them.
    pub fn remove_without_rows(&self) {
        if !self.has_rows {
            self.open.iter().for_each(|file| drop(self.storage.remove(&file.path)));
        }
    }

    /// The time by the clock of the storage.
    pub(super) fn now(&self) -> Duration {
        self.storage.now()
    }

    /// The names of the current files.
    pub fn current_paths(&self) -> Vec<PathBuf> {
        self.open.iter().map(|file| file.path.clone()).collect()
    }

    /// Finishes the files.
    ///
    /// # Errors
    /// As [`flush`](Self::flush).
    pub fn finish(&mut self) -> Result<(), FileError> {
        self.encode_held()?;
        if self.unwritten.iter().any(|rows| *rows > 0) {
            self.make_room()?;
        }
        self.each_open(OpenFile::finish)
    }

    fn is_full(&self) -> bool {
        let old = self.rotation.time.is_some_and(|time| self.storage.now().saturating_sub(self.begun) >= time);
        let large = self.rotation.size.is_some_and(|most| self.open.iter().any(|file| file.size() >= most));
        self.has_rows && (old || large)
    }

    /// Opens the next files and returns the previous ones.
    fn open_next(&mut self) -> Result<Vec<OpenFile>, FileError> {
        let mut number = self.number;
        let paths = loop {
            number += 1;
            let paths = self.paths(number);
            // Only the first file without a number is not allowed to exist. A restarted recorder with rotation
            // continues the numbers of existing files.
            let is_named = number == 1 && !self.rotation.is_enabled();
            if is_named || !paths.iter().any(|path| self.storage.exists(path)) {
                break paths;
            }
        };
        let mut opened: Vec<OpenFile> = Vec::new();
        for (index, path) in paths.into_iter().enumerate() {
            match self.open(&path, index) {
                Ok(file) => opened.push(file),
                Err(error) => {
                    // All files are created, or none.
                    opened.iter().for_each(|made| drop(self.storage.remove(&made.path)));
                    return Err(FileError(path, error));
                }
            }
        }
        self.number = number;
        self.begun = self.storage.now();
        self.has_rows = false;
        Ok(std::mem::replace(&mut self.open, opened))
    }

    fn open(&self, path: &Path, index: usize) -> io::Result<OpenFile> {
        let (imu, stream) = self.streams[index];
        let layout = self.layouts[imu].of_stream(stream);
        match self.format {
            Format::Csv => OpenFile::csv(self.storage, path, stream, layout),
            Format::Mcap => OpenFile::mcap(self.storage, path, &self.imus, &self.streams, &self.layouts),
            Format::Ros => {
                let increments = self.streams.iter().filter(|(_, stream)| *stream == StreamKind::Increment);
                let imus: Vec<_> = increments.map(|(imu, _)| (*imu, &self.imus[*imu])).collect();
                OpenFile::ros(self.storage, path, &imus, &self.tables)
            }
        }
    }

    /// The name of which all pieces have a number more.
    fn unnumbered(&self) -> PathBuf {
        file_name(&self.name, &self.imus[self.streams[0].0], "")
    }

    /// The names of the files with this number: one per stream, for MCAP one for all.
    fn paths(&self, number: u32) -> Vec<PathBuf> {
        let (first, _) = self.streams[0];
        let is_named = number == 1 && !self.rotation.is_enabled();
        let number = if is_named { String::new() } else { format!("-{number:04}") };
        match self.format {
            format if format.is_joint() => vec![file_name(&self.name, &self.imus[first], &number)],
            _ if self.streams.len() == 1 => vec![file_name(&self.name, &self.imus[first], &number)],
            _ => ["", ".increments"]
                .map(|end| file_name(&self.name, &self.imus[first], &format!("{number}{end}")))
                .to_vec(),
        }
    }
}

/// `name` with the IMU's name for `{imu}`, and `end` before the extension.
fn file_name(name: &Path, imu: &ImuId, end: &str) -> PathBuf {
    let text = name.to_string_lossy().replace(IMU_PLACEHOLDER, imu.as_str());
    let path = Path::new(&text);
    let (Some(stem), false) = (path.file_stem(), end.is_empty()) else { return PathBuf::from(text) };
    let extension = path.extension().map(|extension| format!(".{}", extension.to_string_lossy()));
    path.with_file_name(format!("{}{end}{}", stem.to_string_lossy(), extension.unwrap_or_default()))
}
