//! Increments of recordings in every format.

use super::mcap::McapReader;
use super::open::{SourceContent, open_source};
use super::table::{ImuChoice, TableReader, WantedColumn};
use isotherm_recording::columns::{ColumnKind, INCREMENT, store_increment};
use isotherm_recording::csv::{CsvColumn, Rows};
use isotherm_recording::{
    ANGLE_CSV_COLUMNS, DamagedPlaces, INCREMENT_CSV_COLUMNS, Progress, RecordingError, RowsBefore,
};
use isotherm_shared::wire::{CompensatedIncrement, Flags};
use isotherm_support::failure::{Failure, shown};
use isotherm_support::finding::{Finding, Location, name};
use isotherm_support::source::DataSource;
use std::io::Read;

/// Passes the increments of a file to `take`: of text as `replay` and `feed` write it, whose session and latency are 0,
/// or of what `record` writes in any format. Returns what is damaged and left out, and whether the end is missing.
///
/// # Errors
/// If it cannot be read, or is no recording of increments.
pub fn read_increments(
    of: &DataSource,
    choice: &ImuChoice,
    bar: &Progress,
    take: impl FnMut(CompensatedIncrement),
) -> Result<Vec<Finding>, Failure> {
    let found = match open_source(of, bar, None)? {
        SourceContent::Csv(source) => read_text(source, take),
        SourceContent::Mcap(source) => read_table(McapReader::new(of, source, wanted(), choice.clone(), false), take),
    };
    let file = Location::Recording(shown(of.name()).to_string());
    let found = found.map_err(|error| error.failure(of.name()))?;
    Ok(found.into_iter().map(|finding| finding.at(file.clone())).collect())
}

/// The columns by which increments are read: all flags are one number.
fn read_columns() -> impl Iterator<Item = usize> {
    (0..INCREMENT.len()).filter(|index| INCREMENT[*index].kind != ColumnKind::Flags)
}

fn wanted() -> Vec<WantedColumn> {
    read_columns().map(|index| WantedColumn::from(&INCREMENT[index])).collect()
}

/// The rows of a binary format.
fn read_table(
    mut reader: impl TableReader,
    mut take: impl FnMut(CompensatedIncrement),
) -> Result<Vec<Finding>, RecordingError> {
    let mut values = Vec::new();
    while reader.read(&mut values)? {
        let mut increment = CompensatedIncrement { angle_increment: [f64::NAN; 3], ..CompensatedIncrement::default() };
        for (index, value) in read_columns().zip(&values) {
            value.iter().for_each(|value| store_increment(&mut increment, index, *value));
        }
        take(increment);
    }
    let truncation = reader.truncation().map(|text| Finding::warning(name::TRUNCATED, text));
    Ok(reader.damage().into_iter().chain(truncation).collect())
}

/// The rows of a text.
fn read_text(source: impl Read, mut take: impl FnMut(CompensatedIncrement)) -> Result<Vec<Finding>, RecordingError> {
    let mut rows = Rows::new(source);
    rows.next_row()?;
    let columns = IncrementColumns::find(&rows)?;
    let (mut before, mut damaged, mut unread) = (RowsBefore::default(), DamagedPlaces::default(), None);
    loop {
        match columns.next_row(&mut rows) {
            Ok(Some(increment)) => {
                before.take(increment.timestamp_ns);
                take(increment);
            }
            Ok(None) => break,
            Err(RecordingError::Data { line, message }) => {
                damaged.take(format!("line {line}"), before, message.clone());
                unread.get_or_insert(RecordingError::Data { line, message });
            }
            Err(error) => return Err(error),
        }
    }
    match unread {
        Some(error) if before.is_empty() => Err(error),
        _ => Ok(damaged.finding(before).into_iter().collect()),
    }
}

/// The columns of increments in a CSV text.
struct IncrementColumns {
    count: usize,
    always: Vec<CsvColumn>,
    delivery: Option<CsvColumn>,
    session: Option<CsvColumn>,
    latency_ns: Option<CsvColumn>,
    angles: Option<Vec<CsvColumn>>,
}

impl IncrementColumns {
    fn find(header: &Rows<impl Read>) -> Result<Self, RecordingError> {
        let hint = "is this a comma-separated recording of increments with a header row?";
        let angles = match header.optional_column(ANGLE_CSV_COLUMNS[0])? {
            Some(_) => {
                Some(header.columns(&ANGLE_CSV_COLUMNS, "the angle increments of all gyroscopes belong together")?)
            }
            None => None,
        };
        Ok(Self {
            count: header.len(),
            always: header.columns(&INCREMENT_CSV_COLUMNS, hint)?,
            delivery: header.optional_column("delivery")?,
            session: header.optional_column("session")?,
            latency_ns: header.optional_column("latency_ns")?,
            angles,
        })
    }

    fn next_row(&self, rows: &mut Rows<impl Read>) -> Result<Option<CompensatedIncrement>, RecordingError> {
        if !rows.next_row()? {
            return Ok(None);
        }
        rows.verify(self.count)?;
        let hexadecimal = |text: &str| u64::from_str_radix(text, 16).ok().filter(|_| text.len() == 16);
        let names = |column| rows.parse(column, "- or names of flags joined by |", flags);
        let whole = |column: &Option<CsvColumn>| column.as_ref().map_or(Ok(0), |column| rows.integer(column));
        let floats = |columns: &[CsvColumn]| -> Result<[f64; 3], RecordingError> {
            Ok([rows.float(&columns[0])?, rows.float(&columns[1])?, rows.float(&columns[2])?])
        };
        let columns = &self.always;
        Ok(Some(CompensatedIncrement {
            session: whole(&self.session)?,
            sequence: rows.integer(&columns[0])?,
            timestamp_ns: rows.integer(&columns[1])?,
            interval_ns: rows.integer(&columns[2])?,
            velocity_increment: floats(&columns[3..6])?,
            angle_increment: self.angles.as_deref().map_or(Ok([f64::NAN; 3]), floats)?,
            table: rows.parse(&columns[6], "16 hexadecimal digits", hexadecimal)?,
            flags: (names(&columns[7])? | self.delivery.as_ref().map_or(Ok(Flags::default()), names)?).0,
            latency_ns: whole(&self.latency_ns)?,
        }))
    }
}

fn flags(text: &str) -> Option<Flags> {
    let bit = |name: &str| Flags::NAMES.iter().find(|(_, known)| *known == name).map(|(bit, _)| Flags(1 << bit));
    match text {
        "-" => Some(Flags::default()),
        _ => text.split('|').try_fold(Flags::default(), |all, name| Some(all | bit(name)?)),
    }
}
