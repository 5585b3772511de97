//! The mapping that a text would have, by the names of its columns, the lines above them and its first rows: for
//! messages, to be copied into a file and checked. What the text does not say is `"?"` there.

use super::found::{ProposedColumn, length};
use super::opening::Table;
use super::stated;
use super::unit::{self, NumberUnit, Quantity, UnitWord};
use isotherm_recording::RecordingError;
use isotherm_recording::csv::{Rows, Separator, looks_like_number};
use isotherm_shared::wire::AXES;
use isotherm_support::failure::printable;
use std::borrow::Cow;
use std::fmt::Write as _;
use std::io::Read;

mod temperature;
#[cfg(test)]
mod tests;

pub(super) use temperature::CELSIUS;

/// Rows that are looked at.
const ROWS: usize = 1000;
/// Most columns that are listed.
const LISTED: usize = 40;
/// Longest line above the header that is shown \[letters\].
const SHOWN: usize = 60;
/// How far the length of the specific force may differ from gravity, to be distinguished from other numbers.
const OFF_GRAVITY: f64 = 0.05;
/// Pulses that a number may have, with room for numbers 20 times as large as those of the first rows.
const MOST_PULSES: f64 = 2e8;

/// The sensors of a section: their columns, and why, if no name says it.
#[derive(Clone, Copy)]
struct SensorProposal {
    columns: [usize; AXES],
    guess: Option<&'static str>,
}

/// Proposes a mapping for the rows of a table, of which none has been read. `above` are the lines above it.
///
/// # Errors
/// If there is no row, or the text cannot be read.
pub(super) fn propose(
    rows: &mut Rows<Box<dyn Read>>,
    table: &Table,
    above: &[String],
) -> Result<String, RecordingError> {
    if !rows.next_row()? {
        return Err(rows.error("no rows".to_owned()));
    }
    let (columns, commas) = first_columns(rows, table, ROWS);
    let stated = stated::interval_s(above.iter().map(String::as_str));
    Ok(ProposalText { columns, header: table.header.is_some(), skip: table.line() - 1, commas, stated }.mapping())
}

/// The columns of so many rows, of which the first is the current one, and whether numbers have decimal commas.
pub(super) fn first_columns<R: Read>(rows: &mut Rows<R>, table: &Table, most: usize) -> (Vec<ProposedColumn>, bool) {
    let names = table.header.as_ref().map(|header| &header.names);
    let name = |column: usize| names.map_or("", |names| &names[column]);
    let mut columns: Vec<_> = (0..table.width).map(|column| ProposedColumn::new(name(column))).collect();
    let mut commas = false;
    for _ in 0..most {
        if rows.fits(table.width) {
            for (column, field) in columns.iter_mut().zip(rows.names()) {
                commas |= table.separator != Separator::Comma && looks_like_number(&field) && field.contains(',');
                column.take(&field);
            }
        }
        if !rows.next_row().unwrap_or(false) {
            break;
        }
    }
    (columns, commas)
}

struct ProposalText<'a> {
    columns: Vec<ProposedColumn>,
    header: bool,
    skip: u64,
    commas: bool,
    /// The interval \[s\] that a line above the header says, and that line.
    stated: Option<(f64, &'a str)>,
}

impl ProposalText<'_> {
    fn mapping(&self) -> String {
        let mut out = String::from("format = 1\n");
        if self.skip > 0 {
            line(&mut out, format_args!("skip = {}", self.skip));
        }
        if !self.header {
            out.push_str("header = false                  # columns by number, from 1\n");
        }
        if self.commas {
            out.push_str("decimal = \",\"\n");
        }
        let time = self.time();
        self.write_time(&mut out, time);
        let accelerometer = self.accelerometer(time);
        let gyroscope = self.gyroscope(time, accelerometer);
        self.sensors(&mut out, Quantity::Acceleration, accelerometer, time);
        if gyroscope.is_some() {
            self.sensors(&mut out, Quantity::Rate, gyroscope, time);
        }
        let taken: Vec<_> =
            [accelerometer, gyroscope].into_iter().flatten().flat_map(|of| of.columns).chain(time).collect();
        self.temperature(&mut out, &taken, gyroscope.is_some());
        out
    }

    /// The column of the time: one whose name says it, before one that may be a temperature, and one that rises. One
    /// that says its unit comes first.
    fn time(&self) -> Option<usize> {
        let rising = |is: &dyn Fn(&ProposedColumn) -> bool| self.find(|column| is(column) && column.rises());
        let is_time = |column: &ProposedColumn| column.heading.is_time();
        let is_t = |column: &ProposedColumn| column.heading.is_t();
        let says_unit = |column: &ProposedColumn| is_time(column) && unit::of_time(&column.heading.name).is_some();
        let calendar = self.find(ProposedColumn::is_calendar);
        let named = || rising(&says_unit).or_else(|| rising(&is_time)).or_else(|| rising(&is_t));
        let any = || self.find(is_time).or_else(|| self.find(is_t));
        let first = || self.columns.first().filter(|column| column.rises() && !column.counts_rows()).map(|_| 0);
        calendar.or_else(named).or_else(any).or_else(|| first().filter(|_| !self.header && self.columns.len() > AXES))
    }

    fn write_time(&self, out: &mut String, time: Option<usize>) {
        out.push_str("[time]\n");
        let mut interval_s = None;
        if let Some(time) = time {
            let column = &self.columns[time];
            let unit = column.time_unit(self.stated.map(|(seconds, _)| seconds));
            line(out, format_args!("column = {}", self.name(time)));
            commented(
                out,
                format_args!("unit = \"{}\"", unit.name),
                &match &unit.guess {
                    Some(guess) => format!("a guess, {guess}: check it"),
                    None => String::new(),
                },
            );
            // Any other is left to be found.
            interval_s = column.interval_s(unit.factor).filter(|seconds| (1e-6..=3600.0).contains(seconds));
        }
        match (interval_s, self.stated, time) {
            (Some(seconds), ..) => {
                commented(out, format_args!("interval_s = {seconds}"), "nominal, from the first rows: check it");
            }
            (None, Some((seconds, said)), _) => {
                let said: String = said.chars().take(SHOWN).collect();
                let why = format!("nominal, as the text says: {}", quoted(&said));
                commented(out, format_args!("interval_s = {seconds}"), &why);
            }
            (None, None, Some(_)) => {}
            (None, None, None) => {
                let why = "nominal [s]: fill it in, or give --interval; there is no column of the time";
                commented(out, format_args!("interval_s = \"?\""), why);
            }
        }
    }

    /// The accelerometers: by name, or by the length of gravity.
    fn accelerometer(&self, time: Option<usize>) -> Option<SensorProposal> {
        let named = self.triad(|column| column.heading.accelerometer(), &time.into_iter().collect::<Vec<_>>());
        if let Some(columns) = named {
            return Some(SensorProposal { columns, guess: None });
        }
        let is_gravity = |columns: &[usize; AXES]| self.by_length(*columns).is_some();
        let guess = Some("by their length, gravity: check it");
        if self.header {
            let bare = self.triad(|column| column.heading.bare(), &time.into_iter().collect::<Vec<_>>());
            return bare.filter(is_gravity).map(|columns| SensorProposal { columns, guess });
        }
        let unnamed = self.unnamed(time);
        if let ([columns], true) = (&unnamed[..], time.is_some()) {
            let guess = Some("the only three: check that they are accelerometers");
            return Some(SensorProposal { columns: *columns, guess });
        }
        let mut fitting = unnamed.into_iter().filter(is_gravity);
        let columns = fitting.next().filter(|_| fitting.next().is_none())?;
        Some(SensorProposal { columns, guess })
    }

    /// The gyroscopes: by name, or what is left next to accelerometers that were found by their length.
    fn gyroscope(&self, time: Option<usize>, accelerometer: Option<SensorProposal>) -> Option<SensorProposal> {
        let of = accelerometer.map(|of| of.columns);
        let taken: Vec<_> = of.into_iter().flatten().chain(time).collect();
        if self.header {
            let columns = self.triad(|column| column.heading.gyroscope(), &taken)?;
            return Some(SensorProposal { columns, guess: None });
        }
        let triads = self.unnamed(time);
        let columns = triads.iter().copied().find(|columns| Some(*columns) != of);
        let columns = columns.filter(|_| of.is_some() && triads.len() == 2)?;
        Some(SensorProposal { columns, guess: Some("what is left: check it, or leave the section out") })
    }

    /// The columns of numbers behind the time of a text without a header, by three.
    fn unnamed(&self, time: Option<usize>) -> Vec<[usize; AXES]> {
        let numbers = (0..self.columns.len()).filter(|index| Some(*index) != time && self.columns[*index].is_numeric());
        let numbers: Vec<_> = numbers.collect();
        numbers.chunks_exact(AXES).filter_map(|three| three.try_into().ok()).collect()
    }

    /// The unit in which three columns have the length of gravity.
    fn by_length(&self, columns: [usize; AXES]) -> Option<NumberUnit> {
        if columns.iter().all(|index| self.columns[*index].is_around_32768()) {
            return None;
        }
        let length = length(columns.map(|index| &self.columns[index]))?;
        let units = Quantity::Acceleration.choices().into_iter().map(|(factor, name)| NumberUnit { name, factor });
        let is_it = |unit: &NumberUnit| (length * unit.factor / 9.806_65 - 1.0).abs() < OFF_GRAVITY;
        units.into_iter().find(is_it)
    }

    fn sensors(&self, out: &mut String, quantity: Quantity, sensors: Option<SensorProposal>, time: Option<usize>) {
        line(out, format_args!("[{}]", quantity.section()));
        let kind = "or \"increment\": what was counted since the row before";
        let Some(SensorProposal { columns, guess }) = sensors else {
            let all = (0..self.columns.len()).filter(|index| Some(*index) != time);
            let listed: Vec<_> = all.clone().take(LISTED).map(|index| self.name(index)).collect();
            let more = if all.count() > LISTED { ", .." } else { "" };
            let why = format!("three of {}{more}", listed.join(", "));
            commented(out, format_args!("columns = [\"?1\", \"?2\", \"?3\"]"), &why);
            commented(out, format_args!("kind = \"reading\""), kind);
            return;
        };
        commented(out, format_args!("columns = {}", self.names(&columns)), guess.unwrap_or_default());
        commented(out, format_args!("kind = \"reading\""), kind);
        let of = columns.map(|index| &self.columns[index]);
        let whole = of.iter().all(|column| column.is_whole);
        let unit = self.unit(out, quantity, columns, whole, guess.is_some());
        if whole && unit.is_none() && of.iter().all(|column| column.is_around_32768()) {
            commented(out, format_args!("offset = 32768"), "digital zero of unsigned counts of 16 bits");
        }
        let largest = of.iter().map(|column| column.largest()).fold(0.0, f64::max);
        let fine = (-6..0).find(|power| largest / 10_f64.powi(*power) < MOST_PULSES);
        let resolution = fine.filter(|_| !whole).map_or("1".to_owned(), |power| format!("1e{power}"));
        commented(out, format_args!("resolution = {resolution}"), "one pulse, in the column's unit");
    }

    /// Writes the unit, and returns it if it is known.
    fn unit(
        &self,
        out: &mut String,
        quantity: Quantity,
        columns: [usize; AXES],
        whole: bool,
        guessed: bool,
    ) -> Option<NumberUnit> {
        let by_length = || self.by_length(columns).filter(|_| quantity == Quantity::Acceleration);
        let (key, why) = match quantity.of_triad(columns.map(|index| self.columns[index].heading.name.as_str())) {
            UnitWord::Unit(unit) => {
                commented(out, format_args!("unit = \"{}\"", unit.name), "as the header says");
                return Some(unit);
            }
            UnitWord::Unknown(text) => {
                let why = format!("the header says {}: give its unit, or scale in its place", quoted(&text));
                ("unit = \"?\"", why)
            }
            UnitWord::Nothing if by_length().is_some() && (guessed || !whole) => {
                let unit = by_length()?;
                if unit.factor != 1.0 {
                    let why = "a guess, by the length of gravity: check it";
                    commented(out, format_args!("unit = \"{}\"", unit.name), why);
                }
                return Some(unit);
            }
            UnitWord::Nothing if whole => return None,
            UnitWord::Nothing if guessed => {
                let [one, other, ..] = &quantity.choices()[..] else { return None };
                ("unit = \"?\"", format!("nothing says it: \"{}\", \"{}\" or another", one.1, other.1))
            }
            UnitWord::Nothing => {
                let other = if quantity == Quantity::Rate { "deg/s" } else { "g" };
                let si = quantity.choices()[0].1;
                let why = format!("if the numbers are not in {si}: the header does not say it");
                commented(out, format_args!("# unit = \"{other}\""), &why);
                return None;
            }
        };
        commented(out, format_args!("{key}"), &why);
        None
    }

    /// The column as a mapping names it.
    fn name(&self, index: usize) -> String {
        if self.header { quoted(&self.columns[index].heading.name) } else { (index + 1).to_string() }
    }

    fn names(&self, columns: &[usize]) -> String {
        let names: Vec<_> = columns.iter().map(|index| self.name(*index)).collect();
        if let [name] = &names[..] { name.clone() } else { format!("[{}]", names.join(", ")) }
    }

    fn find(&self, is: impl Fn(&ProposedColumn) -> bool) -> Option<usize> {
        self.columns.iter().position(is)
    }

    /// The columns of the axes 1, 2, 3 of a kind of sensors: the first of each.
    fn triad(&self, axis_of: impl Fn(&ProposedColumn) -> Option<usize>, taken: &[usize]) -> Option<[usize; AXES]> {
        let of = |axis: usize| {
            (0..self.columns.len()).find(|index| !taken.contains(index) && axis_of(&self.columns[*index]) == Some(axis))
        };
        Some([of(0)?, of(1)?, of(2)?])
    }
}

/// A string of TOML that a terminal can show.
pub(super) fn quoted(name: &str) -> String {
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

fn line(out: &mut String, text: std::fmt::Arguments<'_>) {
    // Writing to a String cannot fail.
    let _ = writeln!(out, "{text}");
}

/// A line with a comment behind it, unless that is empty.
fn commented(out: &mut String, key: std::fmt::Arguments<'_>, comment: &str) {
    match comment {
        "" => line(out, key),
        _ => line(out, format_args!("{:<31} # {comment}", key.to_string())),
    }
}
