//! The first rows of a table of numbers in a text, split into columns as they are when they are read: for the mapping
//! of a text, and for proposed campaign files.

use super::calendar;
use super::opening::{Table, TextOpening, rows_of};
use isotherm_recording::RecordingError;
use isotherm_recording::csv::{Separator, looks_like_number};
use isotherm_support::failure::Failure;
use isotherm_support::source::DataSource;
use std::io::Read;

/// Rows that are looked at.
const ROWS: usize = 1000;

/// A table in a text.
#[derive(Clone, Debug, Default)]
pub struct LookedTable {
    /// Whether the columns have names.
    pub header: bool,
    /// Lines above the header, or above the first row without one.
    pub skip: u64,
    /// Whether numbers have decimal commas.
    pub comma: bool,
    /// The columns.
    pub columns: Vec<LookedColumn>,
}

/// A column of a table.
#[derive(Clone, Debug)]
pub struct LookedColumn {
    /// Its name, or its number from 1.
    pub name: String,
    /// Its first values; NaN where there is no number.
    pub values: Vec<f64>,
    /// Most decimals of a value; 0 if all are whole.
    pub decimals: usize,
    /// Whether all fields are dates with a time, only dates, or times of the day: that one.
    pub calendar: Option<Calendar>,
    /// The times of a calendar \[s\].
    pub times_s: Vec<f64>,
    /// Whether all fields have an exponent.
    pub(super) is_exponential: bool,
}

/// How fields state a time.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Calendar {
    /// Date and time.
    Both,
    /// Only the date.
    Date,
    /// Only the time of the day.
    OfDay,
}

impl LookedTable {
    /// Looks at the first rows of a text.
    ///
    /// # Errors
    /// If it cannot be read, or is no table of numbers.
    pub fn of(source: &DataSource) -> Result<Self, Failure> {
        let path = source.name();
        let source = source.open().map_err(|error| Failure::io("opening", path, &error))?;
        let read = || {
            let (opening, source) = TextOpening::read(Box::new(source), 0)?;
            Self::read(source, &opening.table_of_numbers()?, 0)
        };
        read().map_err(|error: RecordingError| error.failure(path))
    }

    /// Looks at the first rows of a table, of which none has been read, behind `skip` lines of its text.
    ///
    /// # Errors
    /// If they cannot be read.
    pub(super) fn read(source: Box<dyn Read>, table: &Table, skip: u64) -> Result<Self, RecordingError> {
        let mut rows = rows_of(source, table, skip)?;
        let name = |column: usize| match &table.header {
            Some(header) => header.names[column].clone(),
            None => (column + 1).to_string(),
        };
        let mut looked = Self {
            header: table.header.is_some(),
            skip: table.line() - 1,
            comma: false,
            columns: (0..table.width).map(|column| LookedColumn::new(name(column))).collect(),
        };
        let mut count = 0;
        while count < ROWS && rows.next_row()? {
            if !rows.fits(table.width) {
                continue;
            }
            for (column, field) in looked.columns.iter_mut().zip(rows.names()) {
                looked.comma |= table.separator != Separator::Comma && looks_like_number(&field) && field.contains(',');
                column.take(&field, count == 0);
            }
            count += 1;
        }
        Ok(looked)
    }
}

impl LookedColumn {
    fn new(name: String) -> Self {
        Self { name, values: Vec::new(), decimals: 0, calendar: None, times_s: Vec::new(), is_exponential: true }
    }

    fn take(&mut self, field: &str, is_first: bool) {
        let number = field.replacen(',', ".", 1);
        self.values.push(number.parse().ok().filter(|value: &f64| value.is_finite()).unwrap_or(f64::NAN));
        self.decimals = self.decimals.max(number.split_once('.').map_or(0, |(_, decimals)| decimals.len()));
        self.is_exponential &= number.contains(['e', 'E']);
        let (calendar, time_s) = match (calendar::time_ns(field), calendar::is_date(field)) {
            (Some((ns, false)), _) => (Some(Calendar::Both), ns as f64 / 1e9),
            (Some((ns, true)), _) => (Some(Calendar::OfDay), ns as f64 / 1e9),
            (None, true) => (Some(Calendar::Date), 0.0),
            (None, false) => (None, 0.0),
        };
        self.calendar = if is_first { calendar } else { self.calendar.filter(|of| Some(*of) == calendar) };
        self.times_s.push(time_s);
    }

    /// Whether nearly all of its fields are numbers.
    #[must_use]
    pub fn is_numeric(&self) -> bool {
        let finite = self.finite().count();
        self.calendar.is_none() && finite > 0 && finite * 10 >= self.values.len() * 9
    }

    /// The mean of its numbers.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.finite().sum::<f64>() / self.finite().count() as f64
    }

    /// Whether its fields are times, with or without the date.
    pub(super) fn has_times(&self) -> bool {
        matches!(self.calendar, Some(Calendar::Both | Calendar::OfDay))
    }

    /// Whether all of its numbers are whole ones, without a decimal mark.
    pub(super) fn is_whole(&self) -> bool {
        self.decimals == 0 && self.finite().count() == self.values.len()
    }

    /// The median of its numbers.
    pub(super) fn median(&self) -> Option<f64> {
        median(self.finite().collect())
    }

    /// Whether its numbers are those of unsigned counts of 16 bits, whose digital zero is 32768.
    pub(super) fn is_around_32768(&self) -> bool {
        let is_in_range = self.values.iter().all(|value| (0.0..=65535.0).contains(value));
        is_in_range && self.median().is_some_and(|median| (8192.0..57344.0).contains(&median))
    }

    fn finite(&self) -> impl Iterator<Item = f64> {
        self.values.iter().copied().filter(|value| value.is_finite())
    }
}

/// The median length of three columns.
pub(super) fn length([x, y, z]: [&LookedColumn; 3]) -> Option<f64> {
    let rows = x.values.iter().zip(&y.values).zip(&z.values);
    let lengths = rows.map(|((x, y), z)| (x * x + y * y + z * z).sqrt());
    median(lengths.filter(|length| length.is_finite()).collect())
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}
