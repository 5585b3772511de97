//! A table of numbers in a text as it looks, for proposals: its columns, and their first values.

use super::calendar;
use super::opening::{TextOpening, rows_of};
use isotherm_recording::RecordingError;
use isotherm_recording::csv::{Separator, looks_like_number};
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::source::DataSource;

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
        let failed = |error: RecordingError| error.failure(path);
        let (opening, source) = TextOpening::read(Box::new(source), 0).map_err(failed)?;
        let Some(table) = opening.table() else {
            return Err(
                Failure::new(Exit::Data, format!("{}: this is not a table of numbers", shown(path))).at(path, None)
            );
        };
        let mut rows = rows_of(source, &table, 0).map_err(failed)?;
        let name = |column: usize| match &table.header {
            Some(header) => header.names[column].clone(),
            None => (column + 1).to_string(),
        };
        let column = |index: usize| LookedColumn {
            name: name(index),
            values: Vec::new(),
            decimals: 0,
            calendar: None,
            times_s: Vec::new(),
        };
        let mut looked = Self {
            header: table.header.is_some(),
            skip: table.line() - 1,
            comma: false,
            columns: (0..table.width).map(column).collect(),
        };
        let mut count = 0;
        while count < ROWS && rows.next_row().map_err(failed)? {
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
    fn take(&mut self, field: &str, is_first: bool) {
        let number = field.replacen(',', ".", 1);
        self.values.push(number.parse().ok().filter(|value: &f64| value.is_finite()).unwrap_or(f64::NAN));
        self.decimals = self.decimals.max(number.split_once('.').map_or(0, |(_, decimals)| decimals.len()));
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
        let finite = self.values.iter().filter(|value| value.is_finite()).count();
        self.calendar.is_none() && finite > 0 && finite * 10 >= self.values.len() * 9
    }

    /// The mean of its numbers.
    #[must_use]
    pub fn mean(&self) -> f64 {
        let finite: Vec<f64> = self.values.iter().copied().filter(|value| value.is_finite()).collect();
        finite.iter().sum::<f64>() / finite.len() as f64
    }
}
