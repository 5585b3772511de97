//! Rows of a text with a mapping.
//!
//! Rows that are cut or spoilt are left out and counted, if they are few. Lines that are no rows are passed over:
//! comments, a header that comes again, what a program writes when it starts.

mod axes;
mod bad_rows;
mod counting;
mod marks;
pub(super) mod means;

pub(super) use bad_rows::{BadRows, Fault};

use super::columns::{ColumnRef, Kind, Sensors, Temperature};
use super::mapping::{Mapping, TimeUnit};
use super::opening::{Checksums, Table, TextOpening, rows_of, uncommented};
use super::proposal::ProposedMapping;
use super::unit::Linear;
use super::{calendar, header_units};
use axes::{TextAxes, bad};
use bad_rows::RowRefusal;
use isotherm_recording::RecordingError;
use isotherm_recording::csv::{Checksum, CsvColumn, Rows, missing_columns};
use isotherm_recording::foreign::Counter;
use isotherm_recording::foreign::Units;
use isotherm_recording::foreign::{ForeignRow, ForeignRows, placeholder};
use isotherm_shared::readings::Resolution;
use isotherm_shared::wire::AXES;
use isotherm_support::finding::Finding;
use marks::ColumnMarks;
use std::borrow::Cow;
use std::io::Read;
use std::path::Path;

/// Rows of a text.
pub(super) struct TextSource {
    rows: Rows<Box<dyn Read>>,
    marks: ColumnMarks,
    /// Number of fields of a row.
    width: usize,
    checksums: Checksums,
    has_header: bool,
    /// The lines above the first row, with the header, and how many stand above that.
    above: (Vec<Vec<u8>>, usize),
    /// Whether lines that begin as a comment are none: all rows do.
    has_signs: bool,
    /// Line of the header, otherwise of the first row.
    begin: u64,
    columns: TextColumns,
    /// The columns of set point and position, of a sheet of means.
    labels: Option<[CsvColumn; 2]>,
    accelerometers: TextAxes,
    gyroscopes: Option<TextAxes>,
    /// Whether `accelerometers` has the gyroscopes: in a text of only them.
    is_of_gyroscopes: bool,
    /// What the header says of units.
    notes: Vec<String>,
    /// The mapping that was found, in the place of one that is given.
    found: Option<ProposedMapping>,
    /// Whether all times so far are whole numbers.
    whole_times: bool,
    /// Whether they are times of a day.
    of_day: bool,
    kind: Kind,
    /// Rows so far, with the bad ones.
    count: u64,
    bad: BadRows,
    /// Lines between the rows that are none.
    no_rows: u64,
    /// The line of the first row of a table in memory, whose rows are counted from 0.
    first_row: Option<u64>,
}

/// The columns next to those of the sensors.
struct TextColumns {
    time: Option<(CsvColumn, TimeUnit)>,
    /// That of the time of the day, where `time` is the date.
    of_day: Option<CsvColumn>,
    temperature: TextTemperature,
}

enum TextTemperature {
    /// Of the heads and the boards, what makes temperature of the numbers, and whether a number has been seen.
    Columns([Vec<CsvColumn>; 2], Linear, bool),
    Constant(f64),
}

/// What messages call a line of a text, or of a table in memory whose first row has the line `first_row`.
pub(super) fn name_of(line: u64, first_row: Option<u64>) -> String {
    match first_row {
        None => format!("line {line}"),
        Some(first) => line.checked_sub(first).map_or_else(|| "header".to_owned(), |row| format!("row {row}")),
    }
}

impl TextSource {
    /// Finds the header, or the first row.
    ///
    /// # Errors
    /// If a column is missing, with the columns that were found and the mapping that would be.
    pub(super) fn new(source: Box<dyn Read>, mut mapping: Mapping) -> Result<Self, RecordingError> {
        let (opening, source) = TextOpening::read(source, mapping.skip)?;
        let wanted: Vec<_> = mapping.columns().filter_map(ColumnRef::name).collect();
        let numbers: Vec<_> = mapping.columns().filter_map(ColumnRef::number).collect();
        let found = if mapping.header { opening.with_names(&wanted) } else { opening.with_numbers(&numbers) };
        let Some(table) = found.or_else(|| opening.widest().filter(|table| fits(table, &mapping))) else {
            return Err(Self::missing(&opening, source, &mapping));
        };
        let rows = rows_of(source, &table, mapping.skip)?;
        let begin = table.line();
        let error = |message| RecordingError::Data { line: begin, message };
        // The full names: a mapping may leave out a unit that has a line of its own.
        let full = |name: &str| {
            let header = table.header.as_ref()?;
            Some(header.names[header.column(name).ok()??].clone())
        };
        let notes = header_units::apply(&mut mapping, full).map_err(error)?;
        let find = |column: &ColumnRef| -> Result<CsvColumn, RecordingError> {
            match (column, &table.header) {
                (ColumnRef::Name(name), Some(header)) => {
                    let index = header.column(name).map_err(error)?.unwrap_or_default();
                    Ok(CsvColumn::new(header.names[index].clone(), index))
                }
                _ => Ok(CsvColumn::new(column.shown(), column.number().unwrap_or(1) - 1)),
            }
        };
        let all = |columns: &[ColumnRef]| columns.iter().map(find).collect::<Result<Vec<_>, _>>();
        let time = match &mapping.time.column {
            Some((column, unit)) => Some((find(column)?, *unit)),
            None => None,
        };
        let of_day = mapping.time.of_day.as_ref().map(find).transpose()?;
        let labels = mapping.labels.as_ref().map(|[one, other]| Ok::<_, RecordingError>([find(one)?, find(other)?]));
        let labels = labels.transpose()?;
        let axes = |sensors: &Sensors| TextAxes::new(sensors, find);
        let temperature = match &mapping.temperature {
            Temperature::Constant(constant) => TextTemperature::Constant(*constant),
            Temperature::Columns { head, board, linear } => {
                TextTemperature::Columns([all(head)?, all(board)?], linear.unwrap_or(Linear::CELSIUS), linear.is_none())
            }
        };
        Ok(Self {
            rows,
            marks: ColumnMarks::new(table.separator, mapping.decimal),
            width: table.width,
            checksums: table.checksums,
            has_header: table.header.is_some(),
            above: (opening.before(table.begin()), opening.before(begin).len()),
            has_signs: opening.is_comment(table.first),
            begin,
            columns: TextColumns { time, of_day, temperature },
            labels,
            accelerometers: axes(&mapping.accelerometer)?,
            gyroscopes: mapping.gyroscope.as_ref().map(axes).transpose()?,
            is_of_gyroscopes: false,
            notes,
            found: None,
            whole_times: true,
            of_day: false,
            kind: mapping.accelerometer.kind,
            count: 0,
            bad: BadRows::default(),
            no_rows: 0,
            first_row: None,
        })
    }

    /// As [`new`](Self::new), of a text that has only the gyroscopes of `mapping`, and no temperature.
    pub(super) fn of_gyroscopes(source: Box<dyn Read>, mapping: Mapping) -> Result<Self, RecordingError> {
        let Some(gyroscope) = mapping.gyroscope else {
            let message = "the mapping has no gyroscopes; give [gyroscope] with the columns of this file".to_owned();
            return Err(RecordingError::Data { line: 1, message });
        };
        let temperature = Temperature::Constant(f64::NAN);
        let alone = Mapping { accelerometer: gyroscope, gyroscope: None, temperature, ..mapping };
        Self::new(source, alone).map(|source| Self { is_of_gyroscopes: true, ..source })
    }

    /// Says that the mapping was found, and which it is.
    pub(super) fn with_found(self, found: Option<ProposedMapping>) -> Self {
        Self { found, ..self }
    }

    /// Counts rows from 0, from this line on, in messages.
    pub(super) fn with_first_row(self, first_row: Option<u64>) -> Self {
        Self { first_row, ..self }
    }

    fn missing(opening: &TextOpening, source: Box<dyn Read>, mapping: &Mapping) -> RecordingError {
        let table = opening.table().or_else(|| opening.widest());
        let Some(table) = table else {
            return RecordingError::Data { line: mapping.skip + 1, message: "there are no rows".to_owned() };
        };
        let header = table.header.as_ref().filter(|_| mapping.header);
        let (line, names) = match header {
            Some(header) => (header.line, header.names.clone()),
            None => opening.first_fields(table.separator),
        };
        let missing = mapping.columns().filter(|column| match column {
            ColumnRef::Name(name) => !header.map_or_else(|| names.contains(name), |header| header.has(name)),
            ColumnRef::Number(number) => *number > names.len(),
        });
        let named = |column: &ColumnRef| match mapping.key(column) {
            Some(key) => format!("{} ({key})", column.shown()),
            None => column.shown(),
        };
        let mut missing: Vec<_> = missing.map(named).collect();
        // The boards have the columns of the heads.
        missing.dedup();
        let missing: Vec<_> = missing.iter().map(String::as_str).collect();
        let message = if mapping.header {
            missing_columns(&missing, names, "")
        } else {
            format!("missing columns: {}; the row has {}", missing.join(", "), names.len())
        };
        let message = match ProposedMapping::of(opening, source, mapping.skip, Path::new(""), None) {
            _ if mapping.is_of_campaign => format!("{message}; correct these keys of the campaign file, or the file"),
            Ok(proposed) => format!("{message}; a mapping for these columns would be\n\n{}", proposed.text),
            Err(_) => message,
        };
        RecordingError::Data { line, message }
    }

    /// The reading of the current row.
    fn reading(&mut self) -> Result<ForeignRow, RowRefusal> {
        self.check_width()?;
        let (rows, marks) = (&self.rows, &mut self.marks);
        let mut reading = ForeignRow { place: rows.line(), row: self.count, ..ForeignRow::default() };
        let (mut is_whole, mut of_day) = (self.whole_times, self.of_day);
        match &self.columns.time {
            Some((column, TimeUnit::Power(power))) => {
                let time = marks.time(rows, column, *power).map_err(|error| bad(rows, column, error))?;
                reading.timestamp_ns = Some(time.0);
                is_whole &= time.1;
            }
            Some((column, TimeUnit::Iso8601)) => {
                let hour = self.columns.of_day.as_ref().map(|of_day| rows.field(of_day.index()));
                let time = |text: &str| match hour {
                    Some(of_day) => calendar::time_ns(&format!("{text} {}", String::from_utf8_lossy(of_day))),
                    None => calendar::time_ns(text),
                };
                let time = |text: &str| time(text).ok_or(Cow::Borrowed(calendar::EXPECTED));
                let time = rows.parse_or(column, time).map_err(|error| bad(rows, column, error))?;
                reading.timestamp_ns = Some(time.0);
                of_day = time.1;
            }
            None => {}
        }
        let accelerometers = self.accelerometers.numbers(rows, marks)?;
        let gyroscopes = self.gyroscopes.as_ref().map(|axes| axes.numbers(rows, marks)).transpose()?;
        [reading.head, reading.board] = self.temperature()?;
        let rows = &self.rows;
        let (a, g) = reading.pulses.split_at_mut(AXES);
        let (negative_a, negative_g) = reading.negative.split_at_mut(AXES);
        let (rest_a, rest_g) = reading.rest.split_at_mut(AXES);
        let of_first = if self.is_of_gyroscopes { (&mut *g, &mut *rest_g) } else { (a, rest_a) };
        self.accelerometers.pulses(rows, &accelerometers, of_first, negative_a)?;
        if let Some((axes, numbers)) = self.gyroscopes.as_mut().zip(gyroscopes) {
            axes.pulses(rows, &numbers, (g, rest_g), negative_g)?;
        }
        (self.whole_times, self.of_day) = (is_whole, of_day);
        Ok(reading)
    }

    /// Refuses a row of another width, or with a wrong checksum.
    fn check_width(&self) -> Result<(), RowRefusal> {
        let rows = &self.rows;
        if !rows.fits(self.width) {
            let first = if self.has_header { "the header" } else { "the first row" };
            let message = format!("{} fields, but {first} has {}; is the row cut?", rows.len(), self.width);
            return Err(RowRefusal::Row(Fault::Fields, message));
        }
        match self.checksums {
            Checksums::Checked => {
                checked(rows.line_text()).map_err(|message| RowRefusal::Row(Fault::Checksum, message))
            }
            _ => Ok(()),
        }
    }

    /// The temperature of heads and boards of the current row.
    #[inline]
    fn temperature(&mut self) -> Result<[[f64; 2 * AXES]; 2], RowRefusal> {
        let (rows, marks) = (&self.rows, &mut self.marks);
        let (columns, linear, is_seen) = match &mut self.columns.temperature {
            TextTemperature::Constant(constant) => return Ok([[*constant; _]; 2]),
            TextTemperature::Columns(columns, linear, is_seen) => (columns, linear, is_seen),
        };
        let mut both = [[0.0; 2 * AXES]; 2];
        for (columns, values) in columns.iter().zip(&mut both) {
            for (index, column) in columns.iter().enumerate() {
                let value = marks.number(rows, column).map_err(|error| bad(rows, column, error))?.value;
                if !*is_seen {
                    *is_seen = true;
                    self.notes.extend(linear.settle(value));
                }
                let value = value * linear.scale + linear.offset;
                match columns.len() {
                    1 => values.fill(value),
                    3 => (values[index], values[AXES + index]) = (value, value),
                    _ => values[index] = value,
                }
            }
        }
        Ok(both)
    }

    /// What the numbers stand for.
    fn known_units(&self) -> Result<Units, String> {
        if self.kind != Kind::Reading {
            let kind = self.kind.name();
            return Err(format!(
                "kind = \"{kind}\": what a count stands for is that of the IMU's type; make the table by hand"
            ));
        }
        if self.is_of_gyroscopes {
            let (gyroscope, largest) = self.accelerometers.scale("gyroscope", "\"rad/s\" or \"deg/s\"")?;
            let resolution = Resolution { gyroscope, ..Resolution::default() };
            return Ok(Units { resolution, largest: [None, largest], ..Units::default() });
        }
        let (accelerometer, of_accelerometers) = self.accelerometers.scale("accelerometer", "\"m/s2\" or \"g\"")?;
        let gyroscopes = self.gyroscopes.as_ref().map(|axes| axes.scale("gyroscope", "\"rad/s\" or \"deg/s\""));
        // Without gyroscopes any resolution will do.
        let (gyroscope, of_gyroscopes) = gyroscopes.transpose()?.unwrap_or((Resolution::default().gyroscope, None));
        let resolution = Resolution { accelerometer, gyroscope };
        Ok(Units { resolution, largest: [of_accelerometers, of_gyroscopes], ..Units::default() })
    }

    /// Whether the current line is no row, though it is not blank: a comment, only separators, or what stood above the
    /// first row, which a logger writes again when it starts again.
    fn is_no_row(&self) -> bool {
        let line = self.rows.line_text().trim_ascii();
        uncommented(line).is_some()
            || (0..self.rows.len()).all(|index| self.rows.field(index).is_empty())
            || self.above.0.iter().any(|other| other == line)
    }

    /// Whether the current line is a comment.
    fn is_comment(&self) -> bool {
        !self.has_signs && matches!(self.rows.line_text(), [b'#' | b'%', ..] | [b'/', b'/', ..])
    }
}

/// Whether a table without a header has the columns of a mapping.
fn fits(table: &Table, mapping: &Mapping) -> bool {
    !mapping.header && mapping.columns().filter_map(ColumnRef::number).all(|number| number <= table.width)
}

/// Checks that a line fits its checksum.
fn checked(line: &[u8]) -> Result<(), String> {
    match Checksum::of(line) {
        None => Err("no checksum at the end; is the row cut?".to_owned()),
        Some(Checksum { stated, computed, .. }) if stated != computed => {
            Err(format!("the checksum is {stated:02X}, but that of the row is {computed:02X}; the row is damaged"))
        }
        Some(_) => Ok(()),
    }
}

impl ForeignRows for TextSource {
    fn read(&mut self) -> Result<Option<ForeignRow>, RecordingError> {
        loop {
            let (fault, message) = match self.rows.next_row() {
                Ok(false) => {
                    self.bad.check(self.count)?;
                    return self.marks.check().map(|()| None);
                }
                Ok(true) if self.is_comment() => {
                    self.no_rows += 1;
                    continue;
                }
                Ok(true) => {
                    self.count += 1;
                    match self.reading() {
                        Ok(reading) => return Ok(Some(reading)),
                        Err(RowRefusal::Text(error)) => return Err(error),
                        Err(RowRefusal::Row(..)) if self.is_no_row() => {
                            (self.count, self.no_rows) = (self.count - 1, self.no_rows + 1);
                            continue;
                        }
                        Err(RowRefusal::Row(fault, message)) => (fault, message),
                    }
                }
                Err(RecordingError::Data { message, .. }) => {
                    self.count += 1;
                    (Fault::Line, message)
                }
                Err(error) => return Err(error),
            };
            self.bad.take(fault, self.rows.line(), message, self.count)?;
        }
    }

    fn error(&self, place: u64, message: String) -> RecordingError {
        RecordingError::Data { line: if place == 0 { self.rows.line() } else { place }, message }
    }

    fn unit(&self) -> Option<&'static str> {
        None
    }

    fn name(&self, place: u64) -> String {
        name_of(place, self.first_row)
    }

    fn units(&self) -> Result<Units, String> {
        self.known_units().map_err(|why| match &self.found {
            Some(found) => format!("{why}; add it to this mapping, and give that with --mapping:\n\n{}", found.text),
            None => why,
        })
    }

    fn has_gyroscopes(&self) -> bool {
        self.gyroscopes.is_some()
    }

    fn are_readings(&self) -> [bool; 2] {
        let of_first = self.accelerometers.are_readings();
        if self.is_of_gyroscopes {
            return [false, of_first];
        }
        [of_first, self.gyroscopes.as_ref().is_some_and(TextAxes::are_readings)]
    }

    fn are_counts(&self) -> bool {
        self.accelerometers.are_counts() || self.gyroscopes.as_ref().is_some_and(TextAxes::are_counts)
    }

    fn has_temperature(&self) -> bool {
        matches!(self.columns.temperature, TextTemperature::Columns(..))
    }

    fn counts_since_the_row_before(&self) -> bool {
        self.kind == Kind::Increment
    }

    fn counter(&self) -> Counter {
        match self.columns.time {
            Some((_, TimeUnit::Power(power))) if self.whole_times => Counter::Whole(10_u64.pow(power)),
            Some((_, TimeUnit::Iso8601)) if self.of_day => Counter::Day,
            _ => Counter::None,
        }
    }

    fn notes(&self) -> Vec<String> {
        let what = if self.has_header { "the header" } else { "the first row" };
        let above = self.above.1;
        let above = (above > 0)
            .then(|| format!("{what} is line {}; what stands above it is passed over, {above} lines", self.begin));
        let between =
            (self.no_rows > 0).then(|| format!("{} lines between the rows are not rows, as comments", self.no_rows));
        let of_units = self.notes.iter().cloned();
        // A mapping that was found says it.
        let above = above.filter(|_| self.found.is_none());
        self.found.iter().map(ProposedMapping::note).chain(of_units).chain(above).chain(between).collect()
    }

    fn findings(&self) -> Vec<Finding> {
        let is_without = self.found.as_ref().is_some_and(|found| found.is_without_temperature);
        let is_without = is_without.then(|| placeholder(None)).flatten();
        let of_gyroscopes = self.gyroscopes.as_ref().and_then(|axes| axes.finding("gyroscope"));
        let of_kind = self.accelerometers.finding("accelerometer").into_iter().chain(of_gyroscopes);
        self.bad.finding(self.count, |line| self.name(line)).into_iter().chain(is_without).chain(of_kind).collect()
    }
}

impl ColumnRef {
    fn name(&self) -> Option<&str> {
        match self {
            Self::Name(name) => Some(name),
            Self::Number(_) => None,
        }
    }

    const fn number(&self) -> Option<usize> {
        match self {
            Self::Name(_) => None,
            Self::Number(number) => Some(*number),
        }
    }

    fn shown(&self) -> String {
        match self {
            Self::Name(name) => name.clone(),
            Self::Number(number) => format!("column {number}"),
        }
    }
}
