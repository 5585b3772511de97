//! Increments of recordings in every format.

use super::mcap::McapReader;
use super::open::{SourceContent, open_source};
use super::parquet::ParquetReader;
use super::table::{ImuChoice, TableReader, WantedColumn};
use isotherm_recording::columns::{ColumnKind, INCREMENT, store_increment};
use isotherm_recording::csv::{CsvColumn, Rows};
use isotherm_recording::{ANGLE_CSV_COLUMNS, INCREMENT_CSV_COLUMNS, Progress, RecordingError};
use isotherm_shared::wire::{CompensatedIncrement, Flags};
use isotherm_support::failure::{Failure, shown};
use isotherm_support::finding::{Finding, Location, name};
use isotherm_support::source::DataSource;
use std::io::Read;

/// Passes the increments of a file to `take`: of text as `replay` and `feed` write it, whose session and latency are 0,
/// or of what `record` writes in any format.
///
/// # Errors
/// If it cannot be read, or is no recording of increments.
pub fn read_increments(
    of: &DataSource,
    choice: &ImuChoice,
    bar: &Progress,
    take: impl FnMut(CompensatedIncrement),
) -> Result<(), Failure> {
    let failed = |error: RecordingError| error.failure(of.name());
    let read = match open_source(of, bar, None)? {
        SourceContent::Csv(source) => read_text(source, take).map(|()| None),
        SourceContent::Mcap(source) => read_table(McapReader::new(of, source, wanted(), choice.clone(), false), take),
        SourceContent::Parquet(file) => {
            read_table(ParquetReader::open(file, |_| Ok(wanted()), choice, bar).map_err(failed)?, take)
        }
    };
    if let Some(warning) = read.map_err(failed)? {
        let place = Location::Recording(shown(of.name()).to_string());
        let finding = Finding::warning(name::TRUNCATED, warning).at(place);
        bar.warn(&finding.tagged(|line| line.to_string()).to_string());
    }
    Ok(())
}

/// The columns by which increments are read: all flags are one number.
fn read_columns() -> impl Iterator<Item = usize> {
    (0..INCREMENT.len()).filter(|index| INCREMENT[*index].kind != ColumnKind::Flags)
}

fn wanted() -> Vec<WantedColumn> {
    read_columns().map(|index| WantedColumn::from(&INCREMENT[index])).collect()
}

/// The rows of a binary format. Returns a warning if their end is missing.
fn read_table(
    mut reader: impl TableReader,
    mut take: impl FnMut(CompensatedIncrement),
) -> Result<Option<String>, RecordingError> {
    let mut values = Vec::new();
    while reader.read(&mut values)? {
        let mut increment = CompensatedIncrement { angle_increment: [f64::NAN; 3], ..CompensatedIncrement::default() };
        for (index, value) in read_columns().zip(&values) {
            value.iter().for_each(|value| store_increment(&mut increment, index, *value));
        }
        take(increment);
    }
    Ok(reader.truncation())
}

/// The rows of a text.
fn read_text(source: impl Read, mut take: impl FnMut(CompensatedIncrement)) -> Result<(), RecordingError> {
    let mut rows = Rows::new(source);
    rows.next_row()?;
    let columns =
        rows.columns(&INCREMENT_CSV_COLUMNS, "is this a comma-separated recording of increments with a header row?")?;
    let delivery = rows.optional_column("delivery")?;
    let [session, latency_ns] = [rows.optional_column("session")?, rows.optional_column("latency_ns")?];
    let angles = match rows.optional_column(ANGLE_CSV_COLUMNS[0])? {
        Some(_) => Some(rows.columns(&ANGLE_CSV_COLUMNS, "the angle increments of all gyroscopes belong together")?),
        None => None,
    };
    rows.find_checks()?;
    let count = rows.len();
    let hexadecimal = |text: &str| u64::from_str_radix(text, 16).ok().filter(|_| text.len() == 16);
    while rows.next_row()? && !rows.is_cut() {
        rows.verify(count)?;
        let names = |column| rows.parse(column, "- or names of flags joined by |", flags);
        let whole = |column: &Option<CsvColumn>| column.as_ref().map_or(Ok(0), |column| rows.integer(column));
        let floats = |columns: &[CsvColumn]| -> Result<[f64; 3], RecordingError> {
            Ok([rows.float(&columns[0])?, rows.float(&columns[1])?, rows.float(&columns[2])?])
        };
        take(CompensatedIncrement {
            session: whole(&session)?,
            sequence: rows.integer(&columns[0])?,
            timestamp_ns: rows.integer(&columns[1])?,
            interval_ns: rows.integer(&columns[2])?,
            velocity_increment: floats(&columns[3..6])?,
            angle_increment: angles.as_deref().map_or(Ok([f64::NAN; 3]), floats)?,
            table: rows.parse(&columns[6], "16 hexadecimal digits", hexadecimal)?,
            flags: (names(&columns[7])? | delivery.as_ref().map_or(Ok(Flags::default()), names)?).0,
            latency_ns: whole(&latency_ns)?,
        });
    }
    Ok(())
}

fn flags(text: &str) -> Option<Flags> {
    let bit = |name: &str| Flags::NAMES.iter().find(|(_, known)| *known == name).map(|(bit, _)| Flags(1 << bit));
    match text {
        "-" => Some(Flags::default()),
        _ => text.split('|').try_fold(Flags::default(), |all, name| Some(all | bit(name)?)),
    }
}
