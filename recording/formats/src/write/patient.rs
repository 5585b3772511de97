//! Files that wait for room while their disk is full.

use super::files::{Files, MoreColumns};
use super::open::FileError;
use isotherm_recording::rows::RecordedRow;
use isotherm_shared::names::{ImuId, StreamKind};
use isotherm_support::failure::shown;
use std::path::PathBuf;
use std::time::Duration;

/// A full disk is reported this often at most.
const TOLD: Duration = Duration::from_secs(60);

/// The files of a recording. While the disk is full they wait for room, and say so; nothing that was given is lost
/// then.
pub struct PatientFiles {
    imus: Vec<ImuId>,
    files: Vec<Files>,
    /// The disk is full, and this has been reported or not.
    stalled: Option<bool>,
    told: Option<Duration>,
    tell: Box<dyn Fn(String)>,
    /// A row that needs the next files, for which the disk has no room.
    waiting: Option<RecordedRow>,
    names: Vec<PathBuf>,
    rotations: u64,
}

impl PatientFiles {
    /// Files with rows of `imus`: one for each IMU, or one for all. `tell` prints what the operator should
    /// know.
    #[must_use]
    pub fn new(imus: Vec<ImuId>, files: Vec<Files>, tell: impl Fn(String) + 'static) -> Self {
        let names = files.iter().flat_map(Files::current_paths).collect();
        Self { imus, files, stalled: None, told: None, tell: Box::new(tell), waiting: None, names, rotations: 0 }
    }

    /// Whether the disk is full. Give it no row then: call [`flush`](Self::flush) from time to time.
    #[must_use]
    pub const fn is_stalled(&self) -> bool {
        self.stalled.is_some()
    }

    /// Whether the number of unflushed rows requires a flush now.
    #[must_use]
    pub fn is_flush_due(&self) -> bool {
        !self.is_stalled() && self.files.iter().any(Files::is_flush_due)
    }

    /// Adds a row. If the disk has no room for the files that it needs, the row waits.
    ///
    /// # Errors
    /// As [`Files::write`], but for a full disk.
    pub fn write(&mut self, row: RecordedRow) -> Result<(), FileError> {
        let files = if self.files.len() == 1 { 0 } else { row.imu };
        let imu = &self.imus[row.imu];
        match self.files[files].write(&row) {
            Ok(None) => {}
            Ok(Some(MoreColumns::In(next))) => {
                let name = next.first().map(|path| shown(path).to_string()).unwrap_or_default();
                (self.tell)(format!("{imu} now has more columns; they begin in {name}"));
                self.names.extend(next);
            }
            Ok(Some(MoreColumns::LeftOut)) => (self.tell)(format!(
                "warning: {imu} now has more columns than the header on stdout; they are left out until the recorder \
                 is restarted"
            )),
            Err(error) => {
                self.waiting = Some(row);
                self.stall(error)?;
            }
        }
        Ok(())
    }

    /// Makes all rows so far visible and lasting. A full disk is waited for: the call can be repeated.
    ///
    /// # Errors
    /// As [`Files::flush`], but for a full disk.
    pub fn flush(&mut self) -> Result<(), FileError> {
        for place in 0..self.files.len() {
            let flushed = self.files[place].flush();
            for path in self.files[place].take_removed() {
                (self.tell)(format!("removed {}, the oldest, to keep the disk free", shown(&path)));
            }
            match flushed {
                Ok(None) => {}
                Ok(Some(next)) => {
                    self.rotations += 1;
                    self.names.extend(next);
                }
                Err(error) => return self.stall(error),
            }
        }
        let stalled = self.stalled.take();
        if let Some(row) = self.waiting.take() {
            self.stalled = stalled;
            self.write(row)?;
            if self.waiting.is_some() {
                return Ok(());
            }
            self.stalled = None;
        }
        if stalled == Some(true) {
            (self.tell)("there is room again, recording continues".to_owned());
        }
        Ok(())
    }

    /// Waits for room if the disk is full; returns every other error.
    fn stall(&mut self, error: FileError) -> Result<(), FileError> {
        if !error.is_full() {
            return Err(error);
        }
        if self.stalled.is_none() {
            let now = self.files.first().map_or(Duration::ZERO, Files::now);
            let is_told = self.told.is_none_or(|told| now.saturating_sub(told) >= TOLD);
            self.stalled = Some(is_told);
            if is_told {
                self.told = Some(now);
                let FileError(path, cause) = error;
                let path = shown(&path);
                (self.tell)(format!("writing {path}: {cause}; what is written stays, the rest waits for room"));
            }
        }
        Ok(())
    }

    /// Writes what waits, and finishes the files.
    ///
    /// # Errors
    /// As [`Files::finish`]; also if the disk is full.
    pub fn finish(&mut self) -> Result<(), FileError> {
        if let Some(row) = self.waiting.take() {
            let files = if self.files.len() == 1 { 0 } else { row.imu };
            // There is no room at the end either, unless this succeeds.
            self.files[files].write(&row).inspect_err(|_| self.waiting = Some(row))?;
        }
        self.files.iter_mut().try_for_each(Files::finish)
    }

    /// The rows of each stream that were given and are not in its file.
    pub fn unwritten(&self) -> impl Iterator<Item = ((usize, StreamKind), u64)> {
        let waiting = self.waiting.iter().map(|row| ((row.imu, row.stream()), 1));
        self.files.iter().flat_map(Files::unwritten).chain(waiting)
    }

    /// Removes the current files if they have no rows: nothing was recorded into them.
    pub fn remove_without_rows(&self) {
        self.files.iter().for_each(Files::remove_without_rows);
    }

    /// The names of all files so far, and how often the next ones were begun because these were full.
    #[must_use]
    pub fn names(&self) -> (&[PathBuf], u64) {
        (&self.names, self.rotations)
    }
}
