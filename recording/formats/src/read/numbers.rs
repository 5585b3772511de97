//! Reads columns of numbers by name, and differences of two columns, from files of every format.

use super::mcap::McapReader;
use super::open::{SourceContent, open_source};
use super::order::{FirstRow, first_row_columns, in_order};
use super::part::{Clip, Part, RowPlace};
use super::places::Places;
use super::table::{ImuChoice, TableReader, WantedColumn};
use core::ops::Sub;
use isotherm_recording::csv::{CsvColumn, DecimalMark, Rows, Separator};
use isotherm_recording::{Progress, RecordingError};
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::source::DataSource;
use std::borrow::Cow;
use std::io::Read;

/// The wanted numbers of a row.
#[derive(Clone, Debug)]
pub struct NumberRow<T> {
    /// Its line or row number, counted over all pieces.
    pub line: u64,
    /// The wanted values, in the order of the request.
    pub values: Vec<T>,
}

/// The wanted numbers of all pieces.
#[derive(Clone, Debug)]
pub struct NumberTable<T> {
    /// The rows of all pieces.
    pub rows: Vec<NumberRow<T>>,
    /// Where they come from.
    pub places: Places,
    /// A sentence for each text whose columns are not separated by commas, or whose numbers have decimal commas.
    pub notes: Vec<String>,
}

/// Reads numbers of all pieces. Each of `names` is a column, or `a-b`: the difference of the columns `a` and `b`, of a
/// file that has no column `a-b`. `parse` gets the index of a name and a text; it returns a value, or a description of
/// a valid one. A double of a binary format is passed as text, in the shortest form that reads back as the same double.
///
/// The columns of a text are separated by commas, semicolons, tabs or spaces, as its header shows; [`DecimalMark`] says
/// which decimal commas are read. Pieces are sorted as those of every recording, as far as they have sessions,
/// sequences and times. Only rows of `part` are read, by their column `timestamp_ns`.
///
/// # Errors
/// If a piece cannot be opened, lacks a column, has several columns that a name may mean, or a value is refused.
pub fn read_numbers<T: Sub<Output = T>>(
    sources: &[DataSource],
    names: &[&str],
    choice: &ImuChoice,
    part: Part,
    bar: &Progress,
    parse: impl Fn(usize, &str) -> Result<T, &'static str>,
) -> Result<NumberTable<T>, Failure> {
    let first_row = |of: &DataSource| {
        let mut source = NumberReader::open(of, names, &first_row_columns(), choice, &Progress::default())?;
        let row = source.next().map_err(|error| error.failure(of.name()))?;
        Ok(row.then(|| source.first_row()))
    };
    let places = in_order(sources, false, first_row)?.places;
    let ordered: Vec<_> = places.into_iter().map(|place| &sources[place]).collect();
    let mut table = NumberTable { rows: Vec::new(), places: Places::default(), notes: Vec::new() };
    let (mut before, mut clip) = (0, Clip::new(part));
    let times = if part.is_whole() { Vec::new() } else { first_row_columns().to_vec() };
    'pieces: for of in ordered.iter().copied() {
        let (path, mut source) = (of.name(), NumberReader::open(of, names, &times, choice, bar)?);
        table.places.begin(path, source.unit(), before);
        let failed = |error: RecordingError| error.failure(path);
        while source.next().map_err(failed)? {
            if !part.is_whole() {
                match source.judged(&mut clip).map_err(failed)? {
                    RowPlace::Before => continue,
                    RowPlace::Within => {}
                    RowPlace::After => break 'pieces,
                }
            }
            let line = before + source.place();
            let values = (0..names.len()).map(|index| source.value(index, &parse)).collect::<Result<_, _>>();
            table.rows.push(NumberRow { line, values: values.map_err(failed)? });
        }
        let note = source.note().map_err(failed)?;
        table.notes.extend(note.map(|note| format!("{}: {note}", shown(path))));
        before += source.place();
    }
    if ordered.is_empty() {
        return Err(Failure::new(Exit::Usage, "no data are named"));
    }
    if let Some(last) = ordered.last() {
        clip.check(last.name())?;
        table.notes.extend(clip.note());
    }
    Ok(table)
}

/// The columns that names stand for.
#[derive(Default)]
struct Operands {
    /// The columns, each once.
    columns: Vec<String>,
    /// For each name, the index of its column, and that of the column which is subtracted from it.
    terms: Vec<(usize, Option<usize>)>,
}

impl Operands {
    /// Resolves `names` in a file; `has` shows whether the file has a column. A name that is neither a column nor a
    /// difference of columns is taken for a column, which is then missing.
    fn resolve(names: &[&str], has: impl Fn(&str) -> bool) -> Result<Self, String> {
        let mut operands = Self::default();
        for &name in names {
            let splits = name.match_indices('-').map(|(at, _)| (name[..at].trim(), name[at + 1..].trim()));
            let splits: Vec<_> = splits.filter(|(minuend, subtrahend)| has(minuend) && has(subtrahend)).collect();
            let term = match splits[..] {
                _ if has(name) => (operands.index(name), None),
                [] => (operands.index(name), None),
                [(minuend, subtrahend)] => (operands.index(minuend), Some(operands.index(subtrahend))),
                [(a, b), (c, d), ..] => {
                    return Err(format!(
                        "{name} may be {a:?} less {b:?}, or {c:?} less {d:?}; give one of the columns another name"
                    ));
                }
            };
            operands.terms.push(term);
        }
        Ok(operands)
    }

    fn index(&mut self, column: &str) -> usize {
        let found = self.columns.iter().position(|other| other == column);
        found.unwrap_or_else(|| {
            self.columns.push(column.to_owned());
            self.columns.len() - 1
        })
    }

    /// The columns to read, and `times`.
    fn wanted(&self, times: &[WantedColumn]) -> Vec<WantedColumn> {
        self.columns.iter().map(|name| WantedColumn::number(name)).chain(times.iter().cloned()).collect()
    }
}

/// Whether a protobuf schema can have this field.
fn may_be_field(name: &str) -> bool {
    !name.contains('-')
}

/// One piece, read row by row.
struct NumberReader {
    operands: Operands,
    source: NumberSource,
}

enum NumberSource {
    Csv { rows: Box<Rows<Box<dyn Read>>>, columns: Vec<Option<CsvColumn>>, count: usize, mark: DecimalMark },
    Table { reader: Box<dyn TableReader>, values: Vec<Option<u64>> },
}

impl NumberReader {
    fn open(
        of: &DataSource,
        names: &[&str],
        times: &[WantedColumn],
        choice: &ImuChoice,
        bar: &Progress,
    ) -> Result<Self, Failure> {
        let failed = |error: RecordingError| error.failure(of.name());
        let mut operands = Operands::default();
        let mut resolve = |found: &dyn Fn(&str) -> bool| {
            operands = Operands::resolve(names, found)?;
            Ok(operands.wanted(times))
        };
        let reader: Box<dyn TableReader> = match open_source(of, bar, None)? {
            SourceContent::Csv(source) => return Self::csv(source, names, times).map_err(failed),
            SourceContent::Mcap(source) => {
                let wanted = resolve(&may_be_field).map_err(|error: String| Failure::new(Exit::Data, error))?;
                Box::new(McapReader::new(of, source, wanted, choice.clone(), false))
            }
        };
        Ok(Self { operands, source: NumberSource::Table { reader, values: Vec::new() } })
    }

    fn csv(source: Box<dyn Read>, names: &[&str], times: &[WantedColumn]) -> Result<Self, RecordingError> {
        let mut rows = Box::new(Rows::new(source));
        rows.next_row()?;
        let resolve = |found: &[String]| Operands::resolve(names, |name| found.iter().any(|other| other == name));
        let separator = rows.detect_separator(|found| {
            let has = |name: &String| found.contains(name);
            resolve(found).is_ok_and(|operands| operands.columns.iter().all(has))
        })?;
        let found: Vec<_> = rows.names().collect();
        let operands = resolve(&found).map_err(|message| rows.error(message))?;
        let required: Vec<_> = operands.columns.iter().map(String::as_str).collect();
        rows.columns(&required, "does the first row name the columns? a-b is the difference of the columns a and b")?;
        let wanted = operands.wanted(times);
        let columns = wanted.iter().map(|column| rows.optional_column(&column.name)).collect::<Result<_, _>>()?;
        let count = rows.len();
        let mark = DecimalMark::new(separator);
        Ok(Self { operands, source: NumberSource::Csv { rows, columns, count, mark } })
    }

    fn next(&mut self) -> Result<bool, RecordingError> {
        match &mut self.source {
            NumberSource::Csv { rows, count, mark, .. } => {
                let has_row = rows.next_row()?;
                if has_row && rows.len() > *count && mark.separator() == Separator::Comma {
                    return Err(rows.error(format!(
                        "{} fields, but the header has {count}; if the comma is also the decimal mark, separate the columns \
                         with semicolons",
                        rows.len()
                    )));
                }
                if has_row { rows.verify(*count).map(|()| true) } else { Ok(false) }
            }
            NumberSource::Table { reader, values, .. } => reader.read(values),
        }
    }

    fn place(&self) -> u64 {
        match &self.source {
            NumberSource::Csv { rows, .. } => rows.line(),
            NumberSource::Table { reader, .. } => reader.row(),
        }
    }

    fn unit(&self) -> Option<&'static str> {
        match &self.source {
            NumberSource::Csv { .. } => None,
            NumberSource::Table { reader, .. } => Some(reader.unit()),
        }
    }

    /// How the columns and numbers of a text were read, unless by commas and with points. Valid after the last row.
    fn note(&self) -> Result<Option<String>, RecordingError> {
        let NumberSource::Csv { mark, .. } = &self.source else { return Ok(None) };
        let commas = mark.has_commas().map_err(|(line, message)| RecordingError::Data { line, message })?;
        let note = (commas || mark.separator() != Separator::Comma).then(|| {
            let numbers = if commas { "commas" } else { "points" };
            format!("columns separated by {}, numbers with decimal {numbers}", mark.separator().name())
        });
        Ok(note)
    }

    /// The value of the name with this index.
    fn value<T: Sub<Output = T>>(
        &mut self,
        index: usize,
        parse: &impl Fn(usize, &str) -> Result<T, &'static str>,
    ) -> Result<T, RecordingError> {
        let (minuend, subtrahend) = self.operands.terms[index];
        let minuend = self.parse(minuend, index, parse)?;
        Ok(match subtrahend {
            Some(subtrahend) => minuend - self.parse(subtrahend, index, parse)?,
            None => minuend,
        })
    }

    fn parse<T>(
        &mut self,
        column: usize,
        index: usize,
        parse: &impl Fn(usize, &str) -> Result<T, &'static str>,
    ) -> Result<T, RecordingError> {
        match &mut self.source {
            NumberSource::Csv { rows, columns, mark, .. } => {
                let Some(column_in_row) = &columns[column] else {
                    return Err(rows.error("a column is missing".to_owned()));
                };
                rows.parse_or(column_in_row, |text| {
                    let number = mark.with_point(rows.line(), text)?;
                    parse(index, &number).map_err(Cow::Borrowed)
                })
            }
            NumberSource::Table { reader, values } => {
                let text = values[column].map(|bits| format!("{:?}", f64::from_bits(bits))).unwrap_or_default();
                let name = &self.operands.columns[column];
                parse(index, &text).map_err(|expected| reader.error(format!("{name} is {text:?}, give {expected}")))
            }
        }
    }

    /// Where the current row lies.
    fn judged(&self, clip: &mut Clip) -> Result<RowPlace, RecordingError> {
        let stamp_ns = self.first_row().timestamp_ns;
        let stamp_ns = stamp_ns.ok_or_else(|| {
            self.error("a part of the data is found by the column timestamp_ns, which is missing".to_owned())
        })?;
        Ok(clip.judge_times(stamp_ns, 0))
    }

    /// An error about the current row.
    fn error(&self, message: String) -> RecordingError {
        match &self.source {
            NumberSource::Csv { rows, .. } => rows.error(message),
            NumberSource::Table { reader, .. } => reader.error(message),
        }
    }

    /// The current row, which is the first. A session of a binary format is rounded to a double, so that of a text is,
    /// too.
    fn first_row(&self) -> FirstRow {
        let integer = |place: usize| {
            let column = self.operands.columns.len() + place;
            match &self.source {
                NumberSource::Csv { rows, columns, .. } => rows.integer(columns[column].as_ref()?).ok(),
                NumberSource::Table { values, .. } => values[column].map(|bits| f64::from_bits(bits) as u64),
            }
        };
        let rounded = |number: u64| (number as f64).to_bits();
        FirstRow {
            session: integer(0).filter(|session| *session != 0).map_or(0, rounded),
            sequence: integer(1).unwrap_or(0),
            recorded_ns: integer(2),
            timestamp_ns: integer(3),
            ..FirstRow::default()
        }
    }
}
