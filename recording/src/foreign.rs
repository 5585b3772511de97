//! What data of other programs give: the rows of a log or a text, in pulses, and what is known of them. Readers of a
//! format implement [`ForeignRows`]; `isotherm-recording-formats` makes samples of their rows.

mod vehicle;

pub use vehicle::{VehicleState, union};

use crate::{LogImu, Progress, RecordingError};
use isotherm_shared::readings::Resolution;
use isotherm_shared::wire::AXES;
use isotherm_support::failure::Failure;
use isotherm_support::finding::{Finding, name};
use isotherm_support::source::DataSource;
use std::io::Read;
use std::path::Path;

/// Temperature of data that have none, unless it is given. A placeholder.
pub const PLACEHOLDER: f64 = 25.0;

/// A leap is longer than this \[ns\], an hour: rows have to be worth it, at the beginning and the end of all rows.
pub const LEAP_NS: u64 = 3_600_000_000_000;

/// Data that have been opened: all of their bytes, and where they can be opened again.
pub struct OpenData<'a> {
    /// Where they can be opened again.
    pub source: &'a DataSource,
    /// Their bytes, from the beginning on.
    pub bytes: Box<dyn Read>,
}

impl OpenData<'_> {
    /// What messages call them.
    #[must_use]
    pub fn name(&self) -> &Path {
        self.source.name()
    }

    /// Takes the bytes, for the first time that they are read.
    pub fn take(&mut self) -> Box<dyn Read> {
        std::mem::replace(&mut self.bytes, Box::new(std::io::empty()))
    }

    /// Reads them once more, from their beginning.
    ///
    /// # Errors
    /// If they cannot be opened.
    pub fn again(&self, progress: &Progress) -> Result<Box<dyn Read>, Failure> {
        let bytes = self.source.open().map_err(|error| Failure::io("opening", self.name(), &error))?;
        Ok(progress.restarted(bytes))
    }
}

/// What a source knows of its numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Units {
    /// What a pulse stands for.
    pub resolution: Resolution,
    /// Largest readings of an accelerometer \[m/s2\] and of a gyroscope \[rad/s\], as their type has them.
    pub largest: [Option<f64>; 2],
    /// Numbers of accelerometer and gyroscope, as an autopilot has them.
    pub devices: [Option<u32>; 2],
}

/// What a column of the time can roll over at, in addition to 2^32 us and 2^32 ms.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum Counter {
    /// Nothing else.
    #[default]
    None,
    /// Whole numbers of this unit \[ns\]: counters of 16, 24 and 32 bits.
    Whole(u64),
    /// Times of a day.
    Day,
}

/// A row of a [`ForeignRows`].
#[derive(Clone, Copy, Debug, Default)]
pub struct ForeignRow {
    /// Line of a text, number of a message, byte of a binary log.
    pub place: u64,
    /// Number of the row in a text, from 1, with those that are left out: its time where there is no column of it.
    pub row: u64,
    /// `None` in a text without a column of the time.
    pub timestamp_ns: Option<u64>,
    /// Pulses with their sign: A1, A2, A3, G1, G2, G3.
    pub pulses: [i64; 2 * AXES],
    /// What rounding has left of them, of readings \[pulse\].
    pub rest: [f64; 2 * AXES],
    /// Pulses of the negative channels, where both channels are there; `pulses` are those of the positive ones then.
    pub negative: [i64; 2 * AXES],
    /// Temperatures of the sensor heads, in the same order.
    pub head: [f64; 2 * AXES],
    /// Temperatures of the converter boards.
    pub board: [f64; 2 * AXES],
    /// Whether the clock of the stamps starts again with this row.
    pub begins_session: bool,
}

/// Rows that are left out, since their stamps cannot be right. Repeated rows are not among them.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct LeftOutRows {
    /// How many there are.
    pub rows: u64,
    /// Of how many rows.
    pub of: u64,
}

impl LeftOutRows {
    /// Their part of all rows, from 0 to 1.
    #[must_use]
    pub fn share(self) -> f64 {
        self.rows as f64 / self.of.max(1) as f64
    }

    /// These or others, whichever has the larger share.
    #[must_use]
    pub fn or_more(self, others: Self) -> Self {
        if others.share() > self.share() { others } else { self }
    }
}

/// What the foreign formats have in common.
pub trait ForeignRows {
    /// The next row.
    ///
    /// # Errors
    /// If the data are invalid, with the place.
    fn read(&mut self) -> Result<Option<ForeignRow>, RecordingError>;

    /// An error about the row at this place.
    fn error(&self, place: u64, message: String) -> RecordingError;

    /// What places count; `None` for lines.
    fn unit(&self) -> Option<&'static str>;

    /// What messages call a place.
    fn name(&self, place: u64) -> String {
        format!("{} {place}", self.unit().unwrap_or("line"))
    }

    /// What the numbers stand for. `Err` says why it is not known, with a remedy. Valid after the last row.
    ///
    /// # Errors
    /// The reason why it is not known.
    fn units(&self) -> Result<Units, String>;

    /// Whether the rows have gyroscopes.
    fn has_gyroscopes(&self) -> bool;

    /// Whether the numbers of accelerometers and gyroscopes are readings: means over the interval, whose pulses can be
    /// made for any interval. Counts and increments cannot. Valid after the first row.
    fn are_readings(&self) -> [bool; 2] {
        [false; 2]
    }

    /// Whether they are counts of a fixed scale, which hold for one interval only. Valid after the last row.
    fn are_counts(&self) -> bool {
        false
    }

    /// Whether the temperature of the rows was measured: it is neither given nor a placeholder. Valid after the last
    /// row.
    fn has_temperature(&self) -> bool;

    /// Why there are no rows, if all have been read.
    fn no_rows(&self) -> String {
        "there are no rows".to_owned()
    }

    /// The unit, as samples have it; 0 if the data do not say it.
    fn device(&self) -> u64 {
        0
    }

    /// The IMU, as the log of an autopilot names it.
    fn log_imu(&self) -> Option<LogImu> {
        None
    }

    /// Whether the numbers count over the time since the row before, not over the nominal interval.
    fn counts_since_the_row_before(&self) -> bool {
        false
    }

    /// What the stamps read so far can roll over at.
    fn counter(&self) -> Counter {
        Counter::None
    }

    /// Whether the data also say when each row was recorded.
    fn has_log_time(&self) -> bool {
        false
    }

    /// The rows that the format itself leaves out by their stamps. Valid after the last row.
    fn left_out_by_stamps(&self) -> LeftOutRows {
        LeftOutRows::default()
    }

    /// When the vehicle was armed and when it flew.
    fn vehicle_state(&self) -> VehicleState {
        VehicleState::default()
    }

    /// What the operator should know. Valid after the last row.
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }

    /// What concerns the data's worth. Valid after the last row.
    fn findings(&self) -> Vec<Finding> {
        Vec::new()
    }
}

/// The pulses of a value, and what rounding leaves of it \[pulse\].
///
/// # Errors
/// What is wrong with it.
pub fn pulses(value: f64, offset: f64, resolution: f64, sign: f64) -> Result<(i64, f64), String> {
    let whole = sign * ((value - offset) / resolution);
    let pulses = whole.round();
    if pulses.abs() <= f64::from(u32::MAX) {
        return Ok((pulses as i64, whole - pulses));
    }
    Err(format!(
        "{value} is {pulses} pulses of {resolution}, over {}; give a larger resolution, or the offset",
        u32::MAX
    ))
}

/// Reports that the temperature is a placeholder, if it is not given.
#[must_use]
pub fn placeholder(temperature: Option<f64>) -> Option<Finding> {
    let warning = || {
        let message = format!(
            "the data have no temperature; {PLACEHOLDER} is in all rows as a placeholder; give --temperature, or \
             temperature.constant in a mapping"
        );
        Finding::warning(name::NO_TEMPERATURE, message)
    };
    temperature.is_none().then(warning)
}
