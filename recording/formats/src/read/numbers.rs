//! Reads columns of numbers by name, from files of every format.

use super::mcap::McapReader;
use super::parquet::ParquetReader;
use super::places::Places;
use super::recording::{Opened, in_order, open_source, time_column};
use super::table::{ImuChoice, TableReader, WantedColumn};
use indicatif::ProgressBar;
use isotherm_failure::{Exit, Failure};
use isotherm_recording::RecordingError;
use isotherm_recording::columns::{ColumnSet, RAW, RECORDED_NS, TIMESTAMP_NS};
use isotherm_recording::csv::{CsvColumn, Rows};
use std::io::Read;
use std::path::{Path, PathBuf};

/// The wanted numbers of a row.
#[derive(Clone, Debug)]
pub struct NumberRow<T> {
    /// Its line or row number, counted over all pieces.
    pub line: u64,
    /// The values of the wanted columns, in the order of the request.
    pub values: Vec<T>,
}

/// Reads the columns `names` of all pieces. `parse` gets the index of a column and a text; it returns a value, or a description
/// of a valid one. A double of a binary format is passed as text, in the shortest form that reads back as the same double.
///
/// Pieces are sorted by their first `recorded_ns`, else by their first `timestamp_ns`, if all of them have it.
///
/// # Errors
/// If a piece cannot be opened, lacks a column, or a value is refused.
pub fn read_numbers<T>(
    paths: &[PathBuf],
    names: &[&str],
    choice: &ImuChoice,
    bar: &ProgressBar,
    parse: impl Fn(usize, &str) -> Result<T, &'static str>,
) -> Result<(Vec<NumberRow<T>>, Places), Failure> {
    let times = [RECORDED_NS, TIMESTAMP_NS].map(|index| RAW[index].name);
    let wanted: Vec<_> = names.iter().map(|name| WantedColumn::number(name)).collect();
    let timed: Vec<_> = wanted.iter().cloned().chain(times.map(time_column)).collect();
    let first_times = |path: &Path| {
        let mut source = Numbers::open(path, &timed, choice, &ProgressBar::hidden())?;
        let row = source.next().map_err(|error| error.failure(path))?;
        Ok(row.then(|| [0, 1].map(|time| source.integer(names.len() + time))))
    };
    let ordered = in_order(paths, first_times, |firsts: &[Option<[Option<u64>; 2]>]| {
        let all_have = |time: usize| firsts.iter().flatten().all(|times| times[time].is_some());
        let time = (0..times.len()).find(|time| all_have(*time));
        firsts.iter().map(|times| time.and_then(|time| times.as_ref()?[time])).collect()
    })?;
    let (mut rows, mut places, mut before) = (Vec::new(), Places::default(), 0);
    for path in &ordered {
        let mut source = Numbers::open(path, &wanted, choice, bar)?;
        places.begin(path, source.unit(), before);
        let failed = |error: RecordingError| error.failure(path);
        while source.next().map_err(failed)? {
            let line = before + source.place();
            let values = (0..names.len()).map(|column| source.parse(column, &parse)).collect::<Result<_, _>>();
            rows.push(NumberRow { line, values: values.map_err(failed)? });
        }
        before += source.place();
    }
    if ordered.is_empty() {
        return Err(Failure::new(Exit::Usage, "no data are named"));
    }
    Ok((rows, places))
}

/// One piece, read row by row.
enum Numbers {
    Csv { rows: Box<Rows<Box<dyn Read>>>, columns: Vec<Option<CsvColumn>>, count: usize },
    Table { reader: Box<dyn TableReader>, names: Vec<String>, values: Vec<Option<u64>> },
}

impl Numbers {
    fn open(path: &Path, wanted: &[WantedColumn], choice: &ImuChoice, bar: &ProgressBar) -> Result<Self, Failure> {
        let failed = |error: RecordingError| error.failure(path);
        let reader: Box<dyn TableReader> = match open_source(path, bar, None)? {
            Opened::Csv(source) => return Self::csv(source, wanted).map_err(failed),
            Opened::Mcap(source) => Box::new(McapReader::new(source, wanted.to_vec(), choice.clone(), false)),
            Opened::Parquet(file) => Box::new(ParquetReader::open(file, wanted.to_vec(), choice, bar).map_err(failed)?),
        };
        let names = wanted.iter().map(|column| column.name.clone()).collect();
        Ok(Self::Table { reader, names, values: Vec::new() })
    }

    fn csv(source: Box<dyn Read>, wanted: &[WantedColumn]) -> Result<Self, RecordingError> {
        let mut rows = Box::new(Rows::new(source));
        rows.next_row()?;
        let required: Vec<_> = wanted.iter().filter(|c| c.set == ColumnSet::Always).map(|c| c.name.as_str()).collect();
        rows.columns(&required, "is this comma-separated with a header row?")?;
        let columns = wanted.iter().map(|column| rows.optional_column(&column.name)).collect::<Result<_, _>>()?;
        let count = rows.len();
        Ok(Self::Csv { rows, columns, count })
    }

    fn next(&mut self) -> Result<bool, RecordingError> {
        match self {
            Self::Csv { rows, count, .. } => {
                let has_row = rows.next_row()?;
                if has_row {
                    rows.expect_len(*count)?;
                }
                Ok(has_row)
            }
            Self::Table { reader, values, .. } => reader.read(values),
        }
    }

    fn place(&self) -> u64 {
        match self {
            Self::Csv { rows, .. } => rows.line(),
            Self::Table { reader, .. } => reader.row(),
        }
    }

    fn unit(&self) -> Option<&'static str> {
        match self {
            Self::Csv { .. } => None,
            Self::Table { reader, .. } => Some(reader.unit()),
        }
    }

    fn parse<T>(
        &self,
        column: usize,
        parse: &impl Fn(usize, &str) -> Result<T, &'static str>,
    ) -> Result<T, RecordingError> {
        match self {
            Self::Csv { rows, columns, .. } => {
                let Some(column_in_row) = &columns[column] else {
                    return Err(rows.error("a column is missing".to_owned()));
                };
                rows.parse_or(column_in_row, |text| parse(column, text))
            }
            Self::Table { reader, names, values } => {
                let text = values[column].map(|bits| format!("{:?}", f64::from_bits(bits))).unwrap_or_default();
                let refused = |expected| reader.error(format!("{} is {text:?}, give {expected}", names[column]));
                parse(column, &text).map_err(refused)
            }
        }
    }

    /// The integer of a column in the current row, if there is one.
    fn integer(&self, column: usize) -> Option<u64> {
        match self {
            Self::Csv { rows, columns, .. } => rows.integer(columns[column].as_ref()?).ok(),
            Self::Table { values, .. } => values[column].map(|bits| f64::from_bits(bits) as u64),
        }
    }
}
