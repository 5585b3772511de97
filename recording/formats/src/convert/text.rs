//! Rows of a text with a mapping.
//!
//! Over 400 lines: the columns, their numbers and decimal marks form one reader.

use super::columns::{ColumnRef, Kind, Sensors, Temperature};
use super::layouts::Recognised;
use super::mapping::{Decimal, Mapping, TimeUnit};
use super::rollover::Counter;
use super::scale::Units;
use super::source::{Reading, Source, placeholder, pulses};
use super::unit::Linear;
use super::{calendar, header_units, proposal, unit};
use isotherm_finding::Finding;
use isotherm_recording::RecordingError;
use isotherm_recording::csv::{
    CsvColumn, DecimalMark, Rows, digits_with, looks_like_number, missing_columns, nearest_double,
};
use isotherm_shared::readings::Resolution;
use isotherm_shared::wire::AXES;
use std::borrow::Cow;
use std::io::Read;

/// One pulse of numbers that are not whole, unless it is given.
const FINE: f64 = 1e-6;

/// Rows of a text.
pub(super) struct TextSource {
    rows: Rows<Box<dyn Read>>,
    marks: Marks,
    /// Whether the current row has not been returned yet: the first, in a text without header.
    waiting: bool,
    /// Number of fields of a row.
    count: usize,
    header: bool,
    time: Option<(CsvColumn, TimeUnit)>,
    /// Whether all times so far are whole numbers.
    whole_times: bool,
    /// Whether they are times of a day.
    of_day: bool,
    accelerometers: Axes,
    gyroscopes: Option<Axes>,
    /// Whether `accelerometers` has the gyroscopes: in a text of them alone.
    is_of_gyroscopes: bool,
    telemetry: Telemetry,
    kind: Kind,
    /// What the header says of units.
    notes: Vec<String>,
    /// The layout that was recognised, in the place of a mapping that is given.
    recognised: Option<Recognised>,
}

/// The columns of three sensors, and what their numbers mean.
struct Axes {
    columns: [CsvColumn; AXES],
    offset: f64,
    /// Of the first row on.
    resolution: Option<f64>,
    /// Whether the resolution was taken from the first row, where all numbers are whole.
    taken_for_whole: bool,
    /// Whether all numbers so far are whole.
    all_whole: bool,
    sign: [f64; AXES],
    /// One of the column's unit \[m/s2 or rad/s\], and the largest reading in it.
    unit: Option<f64>,
    range: Option<f64>,
    /// The time \[us\] that the numbers are sums over.
    duration: Option<CsvColumn>,
}

enum Telemetry {
    /// Of the heads and the boards, and what makes telemetry of the numbers.
    Columns([Vec<CsvColumn>; 2], Linear),
    Constant(f64),
}

/// The decimal mark of the text.
struct Marks {
    given: Option<Decimal>,
    found: DecimalMark,
    /// The mark that every further number must have, once it is known.
    settled: Option<u8>,
}

/// A number of a field.
#[derive(Clone, Copy)]
struct Number {
    value: f64,
    is_whole: bool,
}

impl TextSource {
    /// Reads the header, or the first row.
    ///
    /// # Errors
    /// If a column is missing, with the columns that were found and the mapping that would be.
    pub(super) fn new(mut rows: Rows<Box<dyn Read>>, mut mapping: Mapping) -> Result<Self, RecordingError> {
        rows.skip_lines(mapping.skip)?;
        if !rows.next_row()? {
            return Err(rows.error("there are no rows".to_owned()));
        }
        let separator = if mapping.header {
            let wanted: Vec<_> = mapping.columns().filter_map(ColumnRef::name).collect();
            let separator =
                rows.detect_separator(|names| wanted.iter().all(|wanted| names.iter().any(|name| name == wanted)))?;
            // Where a column is missing, blanks within names are no separators.
            let is_split = rows.names().any(|name| wanted.contains(&name.as_str()));
            if is_split { separator } else { rows.detect_separator(proposal::is_separated)? }
        } else {
            let wanted: Vec<_> = mapping.columns().filter_map(ColumnRef::number).collect();
            rows.detect_separator(|fields| {
                let is_number = |number: &usize| fields.get(number - 1).is_some_and(|field| looks_like_number(field));
                wanted.iter().all(is_number)
            })?
        };
        let (names, count) = (rows.names().collect::<Vec<_>>(), rows.len());
        let missing: Vec<_> =
            mapping.columns().filter(|column| column.is_missing(&names)).map(ColumnRef::shown).collect();
        if !missing.is_empty() {
            return Err(Self::missing(&mut rows, &missing, mapping.header));
        }
        let notes = header_units::apply(&mut mapping).map_err(|message| rows.error(message))?;
        let find = |column: &ColumnRef| match column {
            ColumnRef::Number(number) => Ok(CsvColumn::new(column.shown(), number - 1)),
            ColumnRef::Name(name) => {
                let mut indices = (0..count).filter(|index| names[*index] == *name);
                match (indices.next(), indices.next()) {
                    (Some(index), None) => Ok(CsvColumn::new(name.clone(), index)),
                    _ => Err(rows.error(format!("the column {name} is there twice"))),
                }
            }
        };
        let all = |columns: &[ColumnRef]| columns.iter().map(find).collect::<Result<Vec<_>, _>>();
        let time = match &mapping.time.column {
            Some((column, unit)) => Some((find(column)?, *unit)),
            None => None,
        };
        let axes = |sensors: &Sensors| -> Result<Axes, RecordingError> {
            let [x, y, z] = &sensors.columns;
            let Sensors { offset, resolution, sign, unit, range, .. } = *sensors;
            let columns = [find(x)?, find(y)?, find(z)?];
            let duration = sensors.duration.as_ref().map(find).transpose()?;
            let (taken_for_whole, all_whole) = (false, true);
            Ok(Axes { columns, offset, resolution, taken_for_whole, all_whole, sign, unit, range, duration })
        };
        let telemetry = match &mapping.temperature {
            Temperature::Constant(constant) => Telemetry::Constant(*constant),
            Temperature::Columns { head, board, linear } => {
                Telemetry::Columns([all(head)?, all(board)?], linear.unwrap_or(Linear { scale: 1.0, offset: 0.0 }))
            }
        };
        let accelerometers = axes(&mapping.accelerometer)?;
        let gyroscopes = mapping.gyroscope.as_ref().map(axes).transpose()?;
        let found = DecimalMark::new(separator);
        let settled = mapping.decimal.map(Decimal::byte);
        let marks = Marks { given: mapping.decimal, found, settled };
        let kind = mapping.accelerometer.kind;
        let (header, waiting) = (mapping.header, !mapping.header);
        Ok(Self {
            rows,
            marks,
            waiting,
            count,
            header,
            time,
            whole_times: true,
            of_day: false,
            accelerometers,
            gyroscopes,
            is_of_gyroscopes: false,
            telemetry,
            kind,
            notes,
            recognised: None,
        })
    }

    /// As [`new`](Self::new), of a layout that was recognised. The telemetry \[degC\] may be given.
    pub(super) fn recognised(
        rows: Rows<Box<dyn Read>>,
        mut recognised: Recognised,
        temperature: Option<f64>,
    ) -> Result<Self, RecordingError> {
        if let Some(temperature) = temperature {
            recognised.mapping.temperature = Temperature::Constant(temperature);
            recognised.is_without_temperature = false;
        }
        Ok(Self { recognised: Some(recognised.clone()), ..Self::new(rows, recognised.mapping)? })
    }

    /// As [`new`](Self::new), of a text that has the gyroscopes of `mapping` alone, and no telemetry.
    pub(super) fn of_gyroscopes(rows: Rows<Box<dyn Read>>, mapping: Mapping) -> Result<Self, RecordingError> {
        let Some(gyroscope) = mapping.gyroscope else {
            let message = "the mapping has no gyroscopes; give [gyroscope] with the columns of this file";
            return Err(rows.error(message.to_owned()));
        };
        let temperature = Temperature::Constant(f64::NAN);
        let alone = Mapping { accelerometer: gyroscope, gyroscope: None, temperature, ..mapping };
        Self::new(rows, alone).map(|source| Self { is_of_gyroscopes: true, ..source })
    }

    fn missing(rows: &mut Rows<Box<dyn Read>>, missing: &[String], header: bool) -> RecordingError {
        let missing: Vec<_> = missing.iter().map(String::as_str).collect();
        let (line, names) = (rows.line(), rows.names().collect::<Vec<_>>());
        let message = if header {
            missing_columns(&missing, names, "")
        } else {
            format!("missing columns: {}; the row has {}", missing.join(", "), names.len())
        };
        let message = match proposal::propose_from(rows) {
            Ok(proposal) => format!("{message}; a mapping for these columns would be\n\n{proposal}"),
            Err(_) => message,
        };
        RecordingError::Data { line, message }
    }
}

impl Source for TextSource {
    fn read(&mut self) -> Result<Option<Reading>, RecordingError> {
        if !std::mem::take(&mut self.waiting) && !self.rows.next_row()? {
            let commas = self.marks.found.has_commas();
            return commas.map(|_| None).map_err(|(line, message)| RecordingError::Data { line, message });
        }
        let (rows, marks) = (&self.rows, &mut self.marks);
        if rows.len() != self.count {
            let first = if self.header { "the header" } else { "the first row" };
            let message = format!("{} fields, but {first} has {}; is the row cut?", rows.len(), self.count);
            return Err(rows.error(message));
        }
        let mut reading = Reading { place: rows.line(), ..Reading::default() };
        match &self.time {
            Some((column, TimeUnit::Power(power))) => {
                let (time_ns, is_whole) = marks.time(rows, column, *power)?;
                reading.timestamp_ns = Some(time_ns);
                self.whole_times &= is_whole;
            }
            Some((column, TimeUnit::Iso8601)) => {
                let (time_ns, of_day) =
                    rows.parse_or(column, |text| calendar::time_ns(text).ok_or(Cow::Borrowed(calendar::EXPECTED)))?;
                reading.timestamp_ns = Some(time_ns);
                self.of_day = of_day;
            }
            None => {}
        }
        let (a, g) = reading.pulses.split_at_mut(AXES);
        self.accelerometers.read(rows, marks, if self.is_of_gyroscopes { &mut *g } else { a })?;
        if let Some(gyroscopes) = &mut self.gyroscopes {
            gyroscopes.read(rows, marks, g)?;
        }
        match &self.telemetry {
            Telemetry::Constant(constant) => (reading.head, reading.board) = ([*constant; _], [*constant; _]),
            Telemetry::Columns(columns, linear) => {
                for (columns, values) in columns.iter().zip([&mut reading.head, &mut reading.board]) {
                    for (index, column) in columns.iter().enumerate() {
                        let value = marks.number(rows, column, true)?.value * linear.scale + linear.offset;
                        match columns.len() {
                            1 => values.fill(value),
                            3 => (values[index], values[AXES + index]) = (value, value),
                            _ => values[index] = value,
                        }
                    }
                }
            }
        }
        Ok(Some(reading))
    }

    fn error(&self, place: u64, message: String) -> RecordingError {
        RecordingError::Data { line: if place == 0 { self.rows.line() } else { place }, message }
    }

    fn unit(&self) -> Option<&'static str> {
        None
    }

    fn units(&self) -> Result<Units, String> {
        if let Some(recognised) = self.recognised.as_ref().filter(|recognised| recognised.counts) {
            return Err(recognised.counts());
        }
        if self.kind == Kind::Increment {
            return Err(
                "kind = \"increment\": what a count stands for is that of the IMU's type; make the table by hand"
                    .to_owned(),
            );
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

    fn has_gyroscopes(&self) -> bool {
        self.gyroscopes.is_some()
    }

    fn counts_since_the_row_before(&self) -> bool {
        self.kind == Kind::Increment
    }

    fn counter(&self) -> Counter {
        match self.time {
            Some((_, TimeUnit::Power(power))) if self.whole_times => Counter::Whole(10_u64.pow(power)),
            Some((_, TimeUnit::Iso8601)) if self.of_day => Counter::Day,
            _ => Counter::None,
        }
    }

    fn guessed_unit(&self) -> Option<&'static str> {
        let Some((column, TimeUnit::Power(power))) = &self.time else { return None };
        let names = [(9, "s"), (6, "ms"), (3, "us"), (0, "ns")];
        let unit = names.iter().find(|(of, _)| of == power).map(|(_, name)| *name)?;
        let is_known = self.recognised.is_some() || self.header && unit::of_time(column.name()).is_some();
        (!is_known).then_some(unit)
    }

    fn notes(&self) -> Vec<String> {
        let recognised = self.recognised.iter().map(|recognised| recognised.note.clone());
        recognised.chain(self.notes.iter().cloned()).collect()
    }

    fn findings(&self) -> Vec<Finding> {
        let is_without = self.recognised.as_ref().is_some_and(|recognised| recognised.is_without_temperature);
        is_without.then(|| placeholder(None)).flatten().into_iter().collect()
    }
}

impl Axes {
    fn read(&mut self, rows: &Rows<Box<dyn Read>>, marks: &mut Marks, to: &mut [i64]) -> Result<(), RecordingError> {
        let mut numbers = [Number { value: 0.0, is_whole: true }; AXES];
        for (number, column) in numbers.iter_mut().zip(&self.columns) {
            *number = marks.number(rows, column, false)?;
        }
        if let Some(duration) = &self.duration {
            let duration_s = marks.number(rows, duration, false)?.value / 1e6;
            if duration_s <= 0.0 {
                return Err(rows.error(format!("{}: the time of the sums is not over 0", duration.name())));
            }
            for number in &mut numbers {
                *number = Number { value: number.value / duration_s, is_whole: false };
            }
        }
        let whole = numbers.iter().all(|number| number.is_whole);
        self.all_whole &= whole;
        let resolution = *self.resolution.get_or_insert_with(|| {
            self.taken_for_whole = whole;
            if whole { 1.0 } else { FINE }
        });
        if self.taken_for_whole && !whole {
            let names: Vec<_> = self.columns.iter().map(CsvColumn::name).collect();
            let message =
                "not a whole number, as those of the first row are; give the resolution, such as resolution = 1e-6";
            return Err(rows.error(format!("{}: {message}", names.join(", "))));
        }
        for (axis, number) in numbers.iter().enumerate() {
            let pulses = pulses(number.value, self.offset, resolution, self.sign[axis]);
            to[axis] = pulses.map_err(|message| rows.error(format!("{}: {message}", self.columns[axis].name())))?;
        }
        Ok(())
    }
}

impl Axes {
    /// A pulse, and the largest reading \[m/s2 or rad/s\]. `section` is that of the mapping, `units` those it may have.
    fn scale(&self, section: &str, units: &str) -> Result<(f64, Option<f64>), String> {
        if self.unit.is_none() && (self.offset != 0.0 || self.all_whole) {
            return Err(format!(
                "{section}: the numbers look like counts; if they are readings, give {section}.unit in the mapping: \
                 {units}; else {section}.scale, what a count is"
            ));
        }
        let unit = self.unit.unwrap_or(1.0);
        let resolution = self.resolution.ok_or_else(|| format!("{section}: no row has been read"))?;
        Ok((resolution * unit, self.range.map(|range| range * unit)))
    }
}

impl Marks {
    /// The number of a field with a decimal point; in most texts the field itself.
    fn with_point<'a>(&mut self, line: u64, text: &'a str) -> Result<Cow<'a, str>, Cow<'static, str>> {
        let (comma, point) = (text.contains(','), text.contains('.'));
        match self.given {
            None => {
                let result = self.found.with_point(line, text).map_err(Cow::Owned)?;
                if point {
                    self.settled = Some(b'.');
                } else if comma && self.found.has_commas() == Ok(true) {
                    self.settled = Some(b',');
                }
                Ok(result)
            }
            Some(Decimal::Comma) if point => Err("a number with a decimal comma, as the mapping says".into()),
            Some(Decimal::Comma) => Ok(text.replace(',', ".").into()),
            Some(Decimal::Point) if comma => Err("a number with a decimal point, as the mapping says".into()),
            Some(Decimal::Point) => Ok(Cow::Borrowed(text)),
        }
    }

    /// The digits of a plain decimal that needs no look at the decimal mark: it has none, or the one that is known.
    fn plain(&self, field: &[u8]) -> Option<(usize, u64, usize)> {
        let split = digits_with(field, self.settled.unwrap_or(b'.'))?;
        (split.2 == 0 || self.settled.is_some()).then_some(split)
    }

    fn number(&mut self, rows: &Rows<Box<dyn Read>>, column: &CsvColumn, any: bool) -> Result<Number, RecordingError> {
        if let Some(decimal) = self.plain(rows.field(column.index()))
            && let Some(value) = nearest_double(decimal)
        {
            return Ok(Number { value, is_whole: decimal.2 == 0 });
        }
        let line = rows.line();
        rows.parse_or(column, |text| {
            let text = self.with_point(line, text)?;
            let value = text.parse::<f64>().ok().filter(|value| any && !has_digits(&text) || value.is_finite());
            let value = value.ok_or(Cow::Borrowed("a number"))?;
            Ok(Number { value, is_whole: !text.contains(['.', 'e', 'E']) })
        })
    }

    /// The time of a field \[ns\], exactly: never by way of a floating-point number; and whether it is a whole number.
    fn time(
        &mut self,
        rows: &Rows<Box<dyn Read>>,
        column: &CsvColumn,
        power: u32,
    ) -> Result<(u64, bool), RecordingError> {
        let line = rows.line();
        if let Some((0, mantissa, after)) = self.plain(rows.field(column.index()))
            && let Some(ns) = scaled(mantissa.into(), power as i32 - after as i32)
        {
            return Ok((ns, after == 0));
        }
        rows.parse_or(column, |text| {
            let text = self.with_point(line, text)?;
            let is_whole = !text.contains(['.', 'e', 'E']);
            let ns = decimal_ns(&text, power).ok_or(Cow::Borrowed("a time from 0 on, up to 2^64 ns"))?;
            Ok::<_, Cow<'static, str>>((ns, is_whole))
        })
    }
}

/// A decimal number, with or without exponent, times a power of ten, to the nearest whole number.
pub(super) fn decimal_ns(text: &str, power: u32) -> Option<u64> {
    let (mantissa, exponent) = match text.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, exponent.parse::<i32>().ok()?),
        None => (text, 0),
    };
    let mantissa = mantissa.strip_prefix('+').unwrap_or(mantissa);
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    // Further digits are far below 1 ns, whatever the unit.
    let fraction = fraction.get(..fraction.len().min(20))?;
    let all = format!("{whole}{fraction}");
    if all.is_empty() || !all.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let exponent = exponent.checked_add(power as i32)?.checked_sub(fraction.len() as i32)?;
    scaled(all.parse().ok()?, exponent)
}

/// `mantissa * 10^exponent`, to the nearest whole number.
fn scaled(mantissa: u128, exponent: i32) -> Option<u64> {
    let factor = 10_u128.checked_pow(exponent.unsigned_abs());
    let value = match (factor, exponent < 0) {
        _ if mantissa == 0 => 0,
        (Some(factor), false) => mantissa.checked_mul(factor)?,
        // The factor is even. Half of it is not added before, since the sum may be over 2^128.
        (Some(factor), true) => mantissa / factor + u128::from(mantissa % factor >= factor / 2),
        (None, false) => return None,
        (None, true) => 0,
    };
    u64::try_from(value).ok()
}

fn has_digits(text: &str) -> bool {
    text.bytes().any(|byte| byte.is_ascii_digit())
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

    fn is_missing(&self, names: &[String]) -> bool {
        match self {
            Self::Name(name) => !names.contains(name),
            Self::Number(number) => *number > names.len(),
        }
    }
}
