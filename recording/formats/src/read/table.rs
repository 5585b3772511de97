//! What the readers of binary formats have in common: the wanted columns, and their values row by row.

use isotherm_recording::RecordingError;
use isotherm_recording::columns::{CAMPAIGN, Column, ColumnKind, ColumnSet, INCOMPLETE_HINT, RAW, incomplete};
use isotherm_recording::csv::missing_columns;
use isotherm_shared::names::ImuId;
use isotherm_support::finding::Finding;

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
pub(super) enum ValueKind {
    /// Unsigned integers of up to 64 bits.
    U64,
    /// Unsigned integers of up to 32 bits.
    U32,
    /// Any numbers, as doubles.
    Number,
    /// Texts of 16 hexadecimal digits, or empty ones for 0.
    Hex,
}

impl ValueKind {
    /// What a value must be, for messages.
    pub(super) const fn expected(self) -> &'static str {
        match self {
            Self::U64 => "a whole number from 0 to 2^64-1",
            Self::U32 => "a whole number from 0 to 4294967295",
            Self::Number => "a number",
            Self::Hex => "a text of 16 hexadecimal digits",
        }
    }
}

/// How a missing value in a row is handled.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Absence {
    /// It is an error. But a missing floating-point value is NaN, since many programs store NaN that way, and a missing
    /// text is 0.
    Refused,
    /// The value is `None`.
    Kept,
}

/// A column that is to be read.
#[derive(Clone, Debug)]
pub(super) struct WantedColumn {
    pub name: String,
    pub kind: ValueKind,
    /// Which files have the column.
    pub set: ColumnSet,
    pub absence: Absence,
}

impl WantedColumn {
    /// A column of any numbers.
    pub(super) fn number(name: &str) -> Self {
        Self { name: name.to_owned(), kind: ValueKind::Number, set: ColumnSet::Always, absence: Absence::Refused }
    }
}

impl From<&Column> for WantedColumn {
    fn from(column: &Column) -> Self {
        let kind = match column.kind {
            ColumnKind::U64 => ValueKind::U64,
            ColumnKind::U32 => ValueKind::U32,
            ColumnKind::F64 => ValueKind::Number,
            ColumnKind::Hex | ColumnKind::Flags => ValueKind::Hex,
        };
        Self { name: column.name.to_owned(), kind, set: column.set, absence: Absence::Refused }
    }
}

/// The columns of raw samples, in the order of [`RAW`]; with `campaign`, set point and position follow.
pub(super) fn sample_columns(campaign: bool) -> Vec<WantedColumn> {
    let [set_point, position] = CAMPAIGN.map(|column| WantedColumn::number(column.name));
    let campaign_columns = [set_point, WantedColumn { absence: Absence::Kept, ..position }];
    RAW.iter().map(WantedColumn::from).chain(campaign_columns.into_iter().filter(|_| campaign)).collect()
}

/// The message about wanted columns that a file lacks, if any. `names` are the columns that it has; `hint` ends the
/// message about columns that every file has.
pub(super) fn refuse_missing(wanted: &[WantedColumn], names: &[String], hint: &str) -> Result<(), String> {
    let found = |name: &str| names.iter().any(|other| other == name);
    let required = wanted.iter().filter(|column| column.set == ColumnSet::Always);
    let missing: Vec<_> = required.map(|column| column.name.as_str()).filter(|name| !found(name)).collect();
    let (missing, hint) = match missing[..] {
        [] => (incomplete(wanted.iter().map(|column| (column.name.as_str(), column.set)), found), INCOMPLETE_HINT),
        _ => (missing, hint),
    };
    if missing.is_empty() { Ok(()) } else { Err(missing_columns(&missing, names.iter().cloned(), hint)) }
}

/// Reads the wanted columns of one file, row by row.
pub(super) trait TableReader {
    /// Reads a row into `values`, one for each wanted column: an integer, the bits of a double, or `None` if the file
    /// does not have the column. Returns false at the end.
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

    /// What is damaged and left out. Valid after the last row.
    fn damage(&self) -> Option<Finding> {
        None
    }

    /// A warning if the end of the file is missing. Valid after the last row.
    fn truncation(&self) -> Option<String> {
        None
    }
}
