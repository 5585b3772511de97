//! Layouts of texts that are recognised, so that they need no mapping: they have the same columns, in the same units,
//! wherever they come from.

use super::columns::{ColumnRef, Sensors};
use super::found::{ProposedColumn, length};
use super::mapping::Mapping;
use super::opening::{Table, TextOpening, rows_of};
use super::proposal::{CELSIUS, first_columns, quoted};
use super::unit::{self, Quantity, UnitWord, without_brackets};
use isotherm_recording::RecordingError;
use isotherm_recording::csv::Rows;
use isotherm_recording::foreign::PLACEHOLDER;
use isotherm_shared::wire::AXES;
use std::fmt::Write as _;
use std::io::{Cursor, Read};
use std::path::Path;

mod table;

use table::{ARDUINO, LAYOUTS, Layout, PLAIN, TEMPERATURES};

/// Rows that are looked at.
const ROWS: usize = 200;
/// Lengths of the specific force \[m/s2\], of a sensor that need not be still, and with its bias.
const GRAVITY: std::ops::Range<f64> = 7.0..13.0;

/// A text that is recognised.
#[derive(Clone, Debug)]
pub(super) struct LayoutMatch {
    pub(super) mapping: Mapping,
    /// The mapping as text.
    text: String,
    /// What it is, and what was taken for what.
    pub(super) note: String,
    /// Whether nothing says the unit of the numbers.
    pub(super) counts: bool,
    /// Whether the text has no temperature.
    pub(super) is_without_temperature: bool,
}

/// Recognises a text by its beginning. `name` stands for it in messages.
///
/// # Errors
/// The reason why a text that is recognised has no accelerations, with the remedy.
pub(super) fn recognise(beginning: &[u8], name: &Path) -> Result<Option<LayoutMatch>, String> {
    let beginning: Box<dyn Read> = Box::new(Cursor::new(beginning.to_vec()));
    let read = || {
        let (opening, source) = TextOpening::read(beginning, 0)?;
        let Some(table) = opening.table() else { return Ok(None) };
        let mut rows = rows_of(source, &table, 0)?;
        Ok::<_, RecordingError>(rows.next_row()?.then(|| First::read(&mut rows, &table)))
    };
    // What cannot be read is an error where the rows are.
    let Ok(Some(first)) = read() else { return Ok(None) };
    match LAYOUTS.iter().find(|layout| layout.fits(&first.bases)) {
        Some(layout) => first.of_layout(layout, name),
        None if first.has_header => Ok(None),
        None => first.without_header(name),
    }
}

/// Names of columns as layouts have them.
fn bases(names: &[String]) -> Vec<String> {
    let base = |name: &String| {
        let name = without_brackets(name.trim().trim_start_matches('#')).to_lowercase();
        name.split_whitespace().collect::<String>()
    };
    names.iter().map(base).collect()
}

/// The first rows of a text.
struct First {
    bases: Vec<String>,
    columns: Vec<ProposedColumn>,
    skip: u64,
    has_header: bool,
    /// Whether all fields that are numbers have an exponent.
    is_exponential: bool,
}

impl First {
    /// Of a table whose first row is the current one.
    fn read(rows: &mut Rows<Box<dyn Read>>, table: &Table) -> Self {
        let is_exponential = rows.names().all(|field| field.is_empty() || field.contains(['e', 'E']));
        let (mut columns, _) = first_columns(rows, table, ROWS);
        // The beginning may end in the middle of a row.
        if !rows.is_terminated() && columns.iter().all(|column| column.values.len() > 1) {
            columns.iter_mut().for_each(|column| column.values.truncate(column.values.len() - 1));
        }
        let bases = table.header.as_ref().map_or_else(Vec::new, |header| bases(&header.names));
        Self { bases, columns, skip: table.line() - 1, has_header: table.header.is_some(), is_exponential }
    }

    fn place(&self, column: &str) -> Option<usize> {
        self.bases.iter().position(|base| base == column)
    }

    fn triad(&self, columns: [&str; AXES]) -> Option<[usize; AXES]> {
        let [x, y, z] = columns.map(|column| self.place(column));
        Some([x?, y?, z?])
    }

    fn length(&self, columns: [usize; AXES]) -> Option<f64> {
        length(columns.map(|column| &self.columns[column]))
    }

    /// Whether accelerations in this unit are as long as gravity, roughly; of counts nobody knows.
    fn is_gravity(&self, columns: [usize; AXES], unit: &str) -> bool {
        let factor = Quantity::Acceleration.choices().into_iter().find(|(_, name)| *name == unit);
        let length = self.length(columns).zip(factor).map(|(length, (factor, _))| length * factor);
        length.is_none_or(|length| GRAVITY.contains(&length))
    }

    fn of_layout(&self, layout: &Layout, name: &Path) -> Result<Option<LayoutMatch>, String> {
        let time = layout.time.iter().find_map(|(column, unit)| Some((self.place(column)?, *unit)));
        let (Some(time), Some(accelerometer)) = (time, self.triad(layout.accelerometer)) else { return Ok(None) };
        let gyroscope = layout.gyroscope.and_then(|columns| self.triad(columns));
        let is_arduino = layout.name == ARDUINO.name;
        let temperature = match is_arduino {
            true => TEMPERATURES.iter().find_map(|column| self.place(column)),
            false => layout.temperature.and_then(|column| self.place(column)),
        };
        let all = || accelerometer.into_iter().chain(gyroscope.into_iter().flatten());
        // What is not counts has a unit that an Arduino does not say, nor that of a temperature far from room's.
        let is_celsius = |column: usize| self.columns[column].median().is_some_and(|median| CELSIUS.contains(&median));
        if is_arduino && !(all().all(|column| self.columns[column].is_whole) && temperature.is_none_or(is_celsius)) {
            return Ok(None);
        }
        // The topics of accelerometers and gyroscopes have the same columns.
        if layout.accelerometer == PLAIN.accelerometer && self.are_rates(accelerometer, name) {
            return Err(rates_alone("ulog2csv, sensor_gyro"));
        }
        // A script may write the names of a layout above numbers in another unit.
        let names = accelerometer.map(|column| self.columns[column].heading.name.as_str());
        let is_unsaid =
            matches!(Quantity::Acceleration.of_triad(names), UnitWord::Nothing) && layout.durations.is_none();
        if is_unsaid && !self.is_gravity(accelerometer, layout.units[0]) {
            return Ok(None);
        }
        let taken = UsedColumn { time, accelerometer, gyroscope, temperature, units: layout.units };
        let recognised = self.recognised(layout.name, &taken, layout.resolution, true, layout.remark);
        Ok(recognised.map(|mut recognised| {
            if let Some(durations) = layout.durations {
                let [of_accelerometer, of_gyroscope] = durations.map(|column| self.place(column));
                let column = |index: usize| ColumnRef::Name(self.columns[index].heading.name.clone());
                recognised.mapping.accelerometer.duration = of_accelerometer.map(column);
                if let Some(gyroscope) = &mut recognised.mapping.gyroscope {
                    gyroscope.duration = of_gyroscope.map(column);
                }
            }
            recognised
        }))
    }

    /// Whether columns that are called x, y, z are those of gyroscopes: by the name of the file, otherwise by their
    /// length.
    fn are_rates(&self, columns: [usize; AXES], name: &Path) -> bool {
        let file = name.file_name().map(|name| name.to_string_lossy().to_lowercase()).unwrap_or_default();
        match (file.contains("gyr"), file.contains("acc")) {
            (true, false) => true,
            (false, true) => false,
            _ => self.length(columns).is_some_and(|length| !GRAVITY.contains(&length)),
        }
    }

    /// Layouts whose rows show what they are.
    fn without_header(&self, name: &Path) -> Result<Option<LayoutMatch>, String> {
        let count = self.columns.iter().filter(|column| !column.values.is_empty()).count();
        let last = self.columns.last().is_some_and(|column| column.is_numeric());
        let count = if last { count } else { count.saturating_sub(1) };
        let numeric = |from: usize, to: usize| self.columns[from..to].iter().all(ProposedColumn::is_numeric);
        if count == 13 && numeric(2, 13) && self.columns[1].is_calendar() && !self.columns[0].is_numeric() {
            let taken = UsedColumn {
                time: (1, "iso8601"),
                accelerometer: [2, 3, 4],
                gyroscope: Some([5, 6, 7]),
                temperature: Some(11),
                units: ["mg", "deg/s"],
            };
            let is_gravity = self.length([2, 3, 4]).is_some_and(|length| GRAVITY.contains(&(length * 9.80665e-3)));
            let is_celsius = self.columns[11].median().is_some_and(|median| CELSIUS.contains(&median));
            let fits = is_gravity && is_celsius;
            return Ok(fits.then(|| self.recognised("OpenLog Artemis", &taken, "1e-3", false, "")).flatten());
        }
        let are_counts = || (1..4).all(|column| self.columns[column].values.iter().all(|value| value.fract() == 0.0));
        if self.columns.len() == 4 && self.is_exponential && numeric(0, 4) && self.columns[0].rises() && are_counts() {
            let file = name.file_name().map(|name| name.to_string_lossy().to_lowercase()).unwrap_or_default();
            if file.contains("gyr") {
                return Err(rates_alone("imu_tk"));
            }
            let taken = UsedColumn {
                time: (0, "s"),
                accelerometer: [1, 2, 3],
                gyroscope: None,
                temperature: None,
                units: ["", ""],
            };
            return Ok(self.recognised("imu_tk", &taken, "1", false, ""));
        }
        Ok(None)
    }

    fn recognised(
        &self,
        layout: &'static str,
        taken: &UsedColumn,
        resolution: &str,
        header: bool,
        remark: &str,
    ) -> Option<LayoutMatch> {
        let name = |column: usize| match header {
            true => quoted(&self.columns[column].heading.name),
            false => (column + 1).to_string(),
        };
        let names = |columns: [usize; AXES]| columns.map(name).join(", ");
        let mut text = format!("format = 1\nskip = {}\nheader = {header}\n", self.skip);
        // The header may say other units than all other files of the layout have.
        let said = unit::of_time(&self.columns[taken.time.0].heading.name).filter(|_| header);
        let (time, time_unit) = (name(taken.time.0), said.unwrap_or(taken.time.1));
        let _ = writeln!(text, "[time]\ncolumn = {time}\nunit = \"{time_unit}\"");
        let column = if header { "" } else { "column " };
        let mut note = format!("a text as of {layout}: the time is {column}{time} in {time_unit}");
        let triads = [
            (Quantity::Acceleration, Some(taken.accelerometer), "A1, A2, A3"),
            (Quantity::Rate, taken.gyroscope, "G1, G2, G3"),
        ];
        for ((quantity, columns, axes), unit) in triads.into_iter().zip(taken.units) {
            let Some(columns) = columns else { continue };
            let all = columns.map(|column| &self.columns[column]);
            let said = match quantity.of_triad(all.map(|column| column.heading.name.as_str())) {
                // Numbers in another unit have other sizes: a mapping gives them their resolution.
                UnitWord::Unit(said) if header && !unit.is_empty() && said.name != unit => return None,
                UnitWord::Unit(said) if header => said.name,
                UnitWord::Unknown(_) if header => return None,
                _ => unit,
            };
            let _ = writeln!(text, "[{}]\ncolumns = [{}]\nkind = \"reading\"", quantity.section(), names(columns));
            let _ = writeln!(text, "resolution = {resolution}");
            if said.is_empty() {
                if all.iter().all(|column| column.is_around_32768()) {
                    text.push_str("offset = 32768\n");
                }
                let _ = write!(note, "; {axes} are {column}{} in counts", names(columns));
            } else {
                let _ = writeln!(text, "unit = \"{said}\"");
                let _ = write!(note, "; {axes} are {column}{} in {said}", names(columns));
            }
        }
        text.push_str("[temperature]\n");
        match taken.temperature {
            Some(place) => {
                let _ = writeln!(text, "columns = {}", name(place));
                let _ = write!(note, "; the temperature is {column}{} in degC", name(place));
            }
            None => {
                let _ = writeln!(text, "constant = {PLACEHOLDER:?}");
            }
        }
        let mapping = Mapping::from_toml(&text).ok()?;
        let counts = taken.units[0].is_empty();
        let is_without_temperature = taken.temperature.is_none();
        Some(LayoutMatch { mapping, text, note: note + remark, counts, is_without_temperature })
    }
}

/// The columns of a text, from 0, and their units.
struct UsedColumn {
    time: (usize, &'static str),
    accelerometer: [usize; AXES],
    gyroscope: Option<[usize; AXES]>,
    temperature: Option<usize>,
    units: [&'static str; 2],
}

impl LayoutMatch {
    /// The mapping of this text of accelerometers and of one of gyroscopes, which has the same columns; `None` if this
    /// text has the gyroscopes itself.
    pub(super) fn with_gyroscopes(&self) -> Option<Mapping> {
        let accelerometer = &self.mapping.accelerometer;
        let unit = (!self.counts).then_some(1.0);
        let gyroscope = Sensors { unit, ..accelerometer.clone() };
        let is_alone = self.mapping.gyroscope.is_none();
        is_alone.then(|| Mapping { gyroscope: Some(gyroscope), ..self.mapping.clone() })
    }

    /// Why there is no nominal table of counts, with the mapping that would give one.
    pub(super) fn counts(&self) -> String {
        let open =
            "scale = \"?\"                     # what a count is, in m/s2 or rad/s: look it up in the data sheet";
        let text = self.text.replace("kind = \"reading\"\n", &format!("kind = \"reading\"\n{open}\n"));
        format!(
            "the numbers are counts, and nothing says what a count is; give --mapping with a file such as\n\n{text}"
        )
    }
}

fn rates_alone(layout: &str) -> String {
    format!(
        "a text as of {layout}: it has only rates; give the file of the accelerometers, and this one with \
         --gyroscope-file FILE"
    )
}
