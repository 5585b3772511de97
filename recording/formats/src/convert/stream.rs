//! Readings of accelerometers or of gyroscopes, which are joined with those of the others.

use super::settings::TimeSource;
use super::stamped::StampedRows;
use isotherm_recording::RecordingError;
use isotherm_recording::foreign::{ForeignRow, ForeignRows};
use isotherm_shared::wire::AXES;
use isotherm_support::failure::Failure;
use std::path::{Path, PathBuf};

/// The readings of three sensors, or of six of which three are wanted.
pub(super) struct RowStream {
    pub(super) rows: StampedRows,
    /// Whether they are the gyroscopes.
    pub(super) are_gyroscopes: bool,
    pub(super) interval_ns: f64,
    /// What messages call the data.
    pub(super) name: String,
    /// Their file, if it is not that of the rows.
    pub(super) file: Option<PathBuf>,
    pub(super) next: Option<ForeignRow>,
}

impl RowStream {
    /// Reads the first rows. `file` is that of the data, if it is not that of the other sensors.
    ///
    /// # Errors
    /// Of the rows; if they have no times that rise, or count over the time since the row before.
    pub(super) fn new(
        source: Box<dyn ForeignRows>,
        time: TimeSource,
        are_gyroscopes: bool,
        name: String,
        file: Option<&Path>,
    ) -> Result<Self, RecordingError> {
        let located = |error: RecordingError| located(error, file);
        let mut rows = StampedRows::new(source, time).map_err(located)?;
        let refused = |rows: &StampedRows, message: &str| located(rows.source.error(rows.first(), message.to_owned()));
        if rows.source.counts_since_the_row_before() {
            return Err(refused(
                &rows,
                "increments of accelerometers and gyroscopes must be in one row; they cannot be joined by time",
            ));
        }
        let Some((interval_ns, _)) = rows.nominal().map_err(located)?.filter(|_| rows.has_times()) else {
            return Err(refused(
                &rows,
                "accelerometers and gyroscopes are joined by time, but no time rises from row to row here",
            ));
        };
        let file = file.map(Path::to_owned);
        Ok(Self { rows, are_gyroscopes, interval_ns: interval_ns as f64, name, file, next: None })
    }

    /// Reads ahead; false at the end.
    pub(super) fn load(&mut self) -> Result<bool, RecordingError> {
        if self.next.is_none() {
            self.next = self.rows.next().map_err(|error| located(error, self.file.as_deref()))?;
            if let Some(row) = self.next.as_ref().filter(|row| row.begins_session) {
                let message = format!(
                    "the clock of {} starts again, and the others cannot be joined with it; cut the data there",
                    self.name
                );
                return Err(located(self.rows.source.error(row.place, message), self.file.as_deref()));
            }
        }
        Ok(self.next.is_some())
    }

    pub(super) fn pulses(&self, reading: &ForeignRow) -> [i64; AXES] {
        let first = if self.are_gyroscopes { AXES } else { 0 };
        [0, 1, 2].map(|axis| reading.pulses[first + axis])
    }

    /// What messages call them.
    pub(super) const fn sensors(&self) -> &'static str {
        if self.are_gyroscopes { "gyroscopes" } else { "accelerometers" }
    }
}

/// The error with its file, if it is not that of the rows.
pub(super) fn located(error: RecordingError, file: Option<&Path>) -> RecordingError {
    let failure = file.map(|file| -> Failure { error.failure(file) });
    failure.map_or(error, RecordingError::Piece)
}
