//! The mapping of a text that is given none: by the layouts that are known, otherwise by the names of its columns. What
//! the text does not say is `"?"` there. A mapping without a `"?"` is used; any other is for the user to complete.

use super::layouts::{self, Layout};
use super::looked::LookedTable;
use super::opening::TextOpening;
use super::roles::{CELSIUS, ColumnNumbers, ColumnRoles, Role, SensorRole};
use super::stated_interval;
use super::unit::{self, Quantity};
use isotherm_recording::RecordingError;
use isotherm_recording::foreign::PLACEHOLDER;
use isotherm_support::failure::printable;
use std::borrow::Cow;
use std::fmt::{Arguments, Write as _};
use std::io::Read;
use std::path::Path;

#[cfg(test)]
mod tests;

/// Most columns that are listed.
const LISTED: usize = 40;

/// The mapping of a text.
pub(super) struct ProposedMapping {
    pub(super) text: String,
    /// The layout that was recognised.
    pub(super) layout: Option<&'static Layout>,
    /// Whether it has a placeholder for the temperature.
    pub(super) is_without_temperature: bool,
}

impl ProposedMapping {
    /// Of a text that begins so, of which `source` is what is behind `skip` lines. `name` is that of its file; the
    /// temperature of all rows may be given.
    ///
    /// # Errors
    /// If it is no table of numbers, or cannot be read; if its layout has no accelerations.
    pub(super) fn of(
        opening: &TextOpening,
        source: Box<dyn Read>,
        skip: u64,
        name: &Path,
        temperature: Option<f64>,
    ) -> Result<Self, RecordingError> {
        let table = opening.table_of_numbers()?;
        let looked = LookedTable::read(source, &table, skip)?;
        let error = |message: String| RecordingError::Data { line: table.line(), message };
        if looked.columns.iter().all(|column| column.values.is_empty()) {
            return Err(error("no rows".to_owned()));
        }
        let (layout, roles) = match layouts::known(&looked, name).map_err(error)? {
            Some((layout, roles)) => (Some(layout), roles),
            None => (None, ColumnRoles::by_names(&looked)),
        };
        let is_without_temperature = temperature.is_none() && matches!(roles.temperature, Role::Absent);
        let above: Vec<_> = opening.before(table.line()).iter().map(|line| printable_line(line)).collect();
        let stated = stated_interval::interval_s(above.iter().map(String::as_str));
        let text = MappingText { looked: &looked, stated, out: String::new() }.written(&roles, temperature);
        Ok(Self { text, layout, is_without_temperature })
    }

    /// What it was made by, and the mapping itself, to be saved.
    pub(super) fn note(&self) -> String {
        let known = match self.layout {
            Some(layout) => format!("a text as of {}{}", layout.name, layout.remark),
            None => "the columns are known by their names".to_owned(),
        };
        let text = self.text.trim_end();
        format!("{known}; the text is read with this mapping, which can be saved and given with --mapping:\n\n{text}\n")
    }
}

/// A line of a text, in letters that a mapping may show.
fn printable_line(line: &[u8]) -> String {
    printable(String::from_utf8_lossy(line).trim()).into_owned()
}

/// The text of a mapping.
struct MappingText<'a> {
    looked: &'a LookedTable,
    /// The interval \[s\] that a line above the header says, and that line.
    stated: Option<(f64, &'a str)>,
    out: String,
}

impl MappingText<'_> {
    fn written(mut self, roles: &ColumnRoles, temperature: Option<f64>) -> String {
        self.line(format_args!("format = 1"), "");
        if self.looked.skip > 0 {
            self.line(format_args!("skip = {}", self.looked.skip), "");
        }
        if !self.looked.header {
            self.line(format_args!("header = false"), "columns by number, from 1");
        }
        self.write_time(&roles.time);
        let [accelerometer, gyroscope] = &roles.sensors;
        self.write_sensors(Quantity::Acceleration, accelerometer);
        self.write_sensors(Quantity::Rate, gyroscope);
        self.line(format_args!("[temperature]"), "");
        match temperature {
            Some(temperature) => self.line(format_args!("constant = {temperature:?}"), "as given"),
            None => self.write_temperature(&roles.temperature),
        }
        self.out
    }

    fn write_time(&mut self, time: &Role<(usize, Option<&'static str>)>) {
        self.line(format_args!("[time]"), "");
        let why = "\"s\", \"ms\", \"us\", \"ns\", or \"iso8601\"";
        match time {
            Role::Known((column, unit)) => {
                self.line(format_args!("column = {}", self.name(*column)), "");
                let comment = if unit.is_some() { "" } else { why };
                self.line(format_args!("unit = \"{}\"", unit.unwrap_or("?")), comment);
            }
            Role::Open(columns) => {
                self.line(format_args!("column = \"?\""), &format!("one of {}", self.listed(columns)));
                self.line(format_args!("unit = \"?\""), why);
            }
            Role::Absent => match self.stated {
                Some((interval_s, line)) => self.line(format_args!("interval_s = {interval_s}"), line),
                None => {
                    let why = "nominal [s], or give --interval; or give the column of the time and its unit";
                    self.line(format_args!("interval_s = \"?\""), why);
                }
            },
        }
    }

    fn write_sensors(&mut self, quantity: Quantity, role: &Role<SensorRole>) {
        if !matches!(role, Role::Absent) {
            self.line(format_args!("[{}]", quantity.section()), "");
        }
        match role {
            Role::Known(sensors) => self.write_known(quantity, sensors),
            Role::Open(columns) => {
                let why = format!("three of {}", self.listed(columns));
                self.line(format_args!("columns = [\"?1\", \"?2\", \"?3\"]"), &why);
                self.write_unsaid(quantity, None);
            }
            Role::Absent => {}
        }
    }

    fn write_known(&mut self, quantity: Quantity, sensors: &SensorRole) {
        self.line(format_args!("columns = {}", self.names(&sensors.columns)), "");
        match &sensors.numbers {
            ColumnNumbers::Unit(unit, resolution) => {
                self.line(format_args!("kind = \"reading\""), "");
                self.line(format_args!("unit = \"{unit}\""), "");
                self.line(format_args!("resolution = {resolution}"), "one pulse, in the column's unit");
            }
            ColumnNumbers::Unsaid(said) => self.write_unsaid(quantity, said.as_deref()),
            ColumnNumbers::Counts => {
                self.line(format_args!("kind = \"reading\""), "in counts; scale = .. says what a count is");
                self.line(format_args!("resolution = 1"), "");
            }
            ColumnNumbers::Whole => {
                self.line(
                    format_args!("kind = \"?\""),
                    "\"reading\", in counts or with unit = ..; \"increment\", \"count\" or \"rate\"",
                );
            }
        }
        if let Some(offset) = sensors.offset {
            self.line(format_args!("offset = {offset}"), "digital zero: 32768 of unsigned counts of 16 bits");
        }
        if let Some(duration) = sensors.duration {
            self.line(format_args!("duration_us = {}", self.name(duration)), "the numbers are sums over this time");
        }
    }

    /// Numbers in a unit that is not known, and what the header says of it.
    fn write_unsaid(&mut self, quantity: Quantity, said: Option<&str>) {
        let said = said.map(|text| format!("the header says {}; ", quoted(text))).unwrap_or_default();
        let choices: Vec<_> = quantity.choices().iter().map(|(_, name)| format!("\"{name}\"")).collect();
        let choices = choices.join(", ");
        self.line(format_args!("kind = \"reading\""), "or \"increment\": what was counted since the row before");
        self.line(format_args!("unit = \"?\""), &format!("{said}{choices}, or scale = ..; of counts leave it out"));
    }

    fn write_temperature(&mut self, role: &Role<Vec<usize>>) {
        match role {
            Role::Known(columns) => {
                self.line(format_args!("columns = {}", self.names(columns)), "");
                self.write_linear(columns[0]);
            }
            Role::Open(columns) => {
                let why = format!("1, 3 or 6 of {}", self.listed(columns));
                self.line(format_args!("columns = \"?\""), &why);
            }
            Role::Absent => {
                let why = "a placeholder: the text has no temperature";
                self.line(format_args!("constant = {PLACEHOLDER:?}"), why);
            }
        }
    }

    /// Writes what makes degrees Celsius of the numbers of a temperature, if they are none.
    fn write_linear(&mut self, column: usize) {
        let column = &self.looked.columns[column];
        if let Some(unit) = unit::of_temperature(&column.name).filter(|_| self.looked.header) {
            if unit.linear.scale != 1.0 || unit.linear.offset != 0.0 {
                let why = format!("degC = scale * number + offset, of {} as the header says", unit.name);
                self.line(format_args!("scale = {}", unit.linear.scale), &why);
                self.line(format_args!("offset = {}", unit.linear.offset), "");
            }
        } else if !column.median().is_some_and(|median| CELSIUS.contains(&median)) {
            let why = "degC = scale * number + offset: see docs/your-data.md";
            self.line(format_args!("scale = \"?\""), why);
            self.line(format_args!("offset = \"?\""), "");
        }
    }

    /// The column as a mapping names it.
    fn name(&self, column: usize) -> String {
        if self.looked.header { quoted(&self.looked.columns[column].name) } else { (column + 1).to_string() }
    }

    fn names(&self, columns: &[usize]) -> String {
        match columns {
            [column] => self.name(*column),
            _ => format!("[{}]", self.listed(columns)),
        }
    }

    fn listed(&self, columns: &[usize]) -> String {
        let names: Vec<_> = columns.iter().take(LISTED).map(|column| self.name(*column)).collect();
        names.join(", ") + if columns.len() > LISTED { ", .." } else { "" }
    }

    /// A line with a comment behind it, unless that is empty.
    fn line(&mut self, key: Arguments<'_>, comment: &str) {
        // Writing to a String cannot fail.
        let _ = match comment {
            "" => writeln!(self.out, "{key}"),
            _ => writeln!(self.out, "{:<31} # {comment}", key.to_string()),
        };
    }
}

/// A string of TOML that a terminal can show.
fn quoted(name: &str) -> String {
    let mut quoted = String::from("\"");
    for letter in name.chars() {
        // Writing to a String cannot fail.
        let _ = match letter {
            '"' | '\\' => write!(quoted, "\\{letter}"),
            _ if matches!(printable(letter.encode_utf8(&mut [0; 4])), Cow::Owned(_)) || letter == '\t' => {
                write!(quoted, "\\U{:08X}", u32::from(letter))
            }
            _ => write!(quoted, "{letter}"),
        };
    }
    quoted + "\""
}
