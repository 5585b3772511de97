//! What readers of all formats but CSV have in common: the columns that are wanted, and their values row by row.

use isotherm_recording::RecordingError;
use isotherm_recording::columns::{CAMPAIGN, Column, ColumnKind, OPTIONAL, RAW};
use isotherm_shared::stream::ImuId;

/// Which IMU's rows are read, of a recording that may have several.
#[derive(Clone, Debug)]
pub enum ImuChoice {
    /// Those of this one.
    Only(ImuId),
    /// Those of the only IMU; among several, those of this one.
    Prefer(ImuId),
    /// Those of the only stream that has the columns.
    Any,
}

/// What the values of a wanted column must be.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum ValueKind {
    /// Whole numbers of up to 64 bits without a sign.
    U64,
    /// Whole numbers of up to 32 bits without a sign.
    U32,
    /// Any number, as a double.
    Number,
}

/// What becomes of a row in which a column has no value.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Absence {
    /// It is an error; but a double without a value is NaN, as many programs write it.
    Refused,
    /// The value is `None`.
    Kept,
}

/// A column that is wanted.
#[derive(Clone, Debug)]
pub struct WantedColumn {
    pub name: String,
    pub kind: ValueKind,
    /// Whether a file may do without the column.
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

/// The columns of raw samples, in the order of [`RAW`]; with `campaign`, set point and position behind them.
pub fn sample_columns(campaign: bool) -> Vec<WantedColumn> {
    let [set_point, position] = CAMPAIGN.map(|column| WantedColumn::number(column.name));
    let campaign_columns = [set_point, WantedColumn { absence: Absence::Kept, ..position }];
    RAW.iter().map(WantedColumn::from).chain(campaign_columns.into_iter().filter(|_| campaign)).collect()
}

/// Reads the wanted columns of one file, row by row.
pub trait TableReader {
    /// Fills `values`, one for each wanted column: a whole number, or the bits of a double. False at the end.
    ///
    /// # Errors
    /// What is wrong with the file, and where.
    fn read(&mut self, values: &mut Vec<Option<u64>>) -> Result<bool, RecordingError>;

    /// Number of the last row or message, from 1.
    fn row(&self) -> u64;

    /// What [`row`](Self::row) counts, for messages.
    fn unit(&self) -> &'static str;

    /// An error about the last row.
    fn error(&self, message: String) -> RecordingError;

    /// A warning about the end of the file, if there is one. To be asked at the end.
    fn cut(&self) -> Option<String> {
        None
    }
}
