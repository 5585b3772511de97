//! What the readers of binary formats have in common: the wanted columns, and their values row by row.

use isotherm_recording::RecordingError;
use isotherm_recording::columns::{CAMPAIGN, Column, ColumnKind, OPTIONAL, RAW};
use isotherm_shared::stream::ImuId;

/// The IMU whose rows are read, if a recording has several.
#[derive(Clone, Debug)]
pub enum ImuChoice {
    /// Only this IMU; an error if the recording is of other IMUs.
    Only(ImuId),
    /// If the recording has one IMU, that IMU; if it has several, this one.
    Prefer(ImuId),
    /// The only stream that has the wanted columns; an error if there are several.
    Any,
}

/// The values that a wanted column may have.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum ValueKind {
    /// Unsigned integers of up to 64 bits.
    U64,
    /// Unsigned integers of up to 32 bits.
    U32,
    /// Any numbers, as doubles.
    Number,
}

/// How a missing value in a row is handled.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Absence {
    /// It is an error. But a missing floating-point value is NaN, since many programs store NaN that way.
    Refused,
    /// The value is `None`.
    Kept,
}

/// A column that is to be read.
#[derive(Clone, Debug)]
pub struct WantedColumn {
    pub name: String,
    pub kind: ValueKind,
    /// Whether the column may be missing in a file.
    pub optional: bool,
    pub absence: Absence,
}

impl WantedColumn {
    /// A column of any numbers.
    pub fn number(name: &str) -> Self {
        Self { name: name.to_owned(), kind: ValueKind::Number, optional: false, absence: Absence::Refused }
    }
}

impl From<&Column> for WantedColumn {
    fn from(column: &Column) -> Self {
        let kind = match column.kind {
            ColumnKind::U64 => ValueKind::U64,
            ColumnKind::U32 => ValueKind::U32,
            ColumnKind::F64 | ColumnKind::Text => ValueKind::Number,
        };
        let optional = OPTIONAL.contains(&column.name);
        Self { name: column.name.to_owned(), kind, optional, absence: Absence::Refused }
    }
}

/// The columns of raw samples, in the order of [`RAW`]; with `campaign`, set point and position follow.
pub fn sample_columns(campaign: bool) -> Vec<WantedColumn> {
    let [set_point, position] = CAMPAIGN.map(|column| WantedColumn::number(column.name));
    let campaign_columns = [set_point, WantedColumn { absence: Absence::Kept, ..position }];
    RAW.iter().map(WantedColumn::from).chain(campaign_columns.into_iter().filter(|_| campaign)).collect()
}

/// Reads the wanted columns of one file, row by row.
pub trait TableReader {
    /// Reads a row into `values`, one for each wanted column: an integer, or the bits of a double. Returns false at the end.
    ///
    /// # Errors
    /// If the file is invalid, with the place.
    fn read(&mut self, values: &mut Vec<Option<u64>>) -> Result<bool, RecordingError>;

    /// Number of the last row or message, from 1.
    fn row(&self) -> u64;

    /// The unit that [`row`](Self::row) counts, for messages.
    fn unit(&self) -> &'static str;

    /// An error about the last row.
    fn error(&self, message: String) -> RecordingError;

    /// The IMU of the rows, where the file names it. Valid after the first row.
    fn imu(&self) -> Option<&str>;

    /// A warning if the end of the file is missing. Valid after the last row.
    fn truncation(&self) -> Option<String> {
        None
    }
}
