//! The mapping that a text would have, by the names of its columns and its first rows: for messages, to be copied into
//! a file and checked.
//!
//! Over 400 lines: the names of columns that are recognised and the text that is made of them belong together, with
//! their tests.

use super::text::Table;
use super::{calendar, interval};
use isotherm_failure::printable;
use isotherm_recording::RecordingError;
use isotherm_recording::csv::{Rows, Separator, looks_like_number};
use isotherm_shared::wire::AXES;
use std::borrow::Cow;
use std::fmt::Write as _;
use std::io::Read;

/// Rows that are looked at.
const ROWS: usize = 1000;
/// Most columns that are listed.
const LISTED: usize = 40;

/// A column of the text.
struct Found {
    name: String,
    /// The name in lower case, in parts.
    parts: Vec<String>,
    values: Vec<f64>,
    is_whole: bool,
    /// The times \[ns\] while all fields are times of ISO 8601.
    times: Option<Vec<u64>>,
}

/// The unit of a time, its length \[s\], and where it comes from.
struct Unit {
    name: &'static str,
    factor: f64,
    guess: Option<String>,
}

/// Units of time, how names write them, and their length \[s\].
const UNITS: [(&str, &str, f64); 4] =
    [("ns", "nano", 1e-9), ("us", "micro", 1e-6), ("ms", "milli", 1e-3), ("s", "sec", 1.0)];
/// Times since 1970 that recordings have \[s\]: from 2001 to 2100.
const EPOCH_S: std::ops::Range<f64> = 1e9..4.1e9;

/// Proposes a mapping for the rows of a table, of which none has been read.
///
/// # Errors
/// If there is no row, or the text cannot be read.
pub(super) fn propose(rows: &mut Rows<Box<dyn Read>>, table: &Table) -> Result<String, RecordingError> {
    if !rows.next_row()? {
        return Err(rows.error("no rows".to_owned()));
    }
    Ok(of_table(rows, table))
}

/// The unit of time that a name says.
pub(super) fn named_unit(name: &str) -> Option<&'static str> {
    let parts = parts(name);
    let says = |unit: &str, long: &str| parts.iter().any(|part| part == unit || part.starts_with(long));
    UNITS.iter().find(|(unit, long, _)| says(unit, long)).map(|(unit, ..)| *unit)
}

/// The mapping of a table whose first row is the current one.
fn of_table(rows: &mut Rows<Box<dyn Read>>, table: &Table) -> String {
    let names = table.header.as_ref().map(|header| &header.names);
    let name = |column: usize| names.map_or("", |names| &names[column]);
    let mut columns: Vec<_> = (0..table.width).map(|column| Found::new(name(column))).collect();
    let mut commas = false;
    for _ in 0..ROWS {
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
    Text { columns, header: names.is_some(), skip: table.line() - 1, commas }.mapping()
}

struct Text {
    columns: Vec<Found>,
    header: bool,
    skip: u64,
    commas: bool,
}

impl Text {
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
        out.push_str("[time]\n");
        if let Some(time) = time {
            let unit = self.columns[time].unit();
            line(&mut out, format_args!("column = {}", self.name(time)));
            let key = format!("unit = \"{}\"", unit.name);
            match &unit.guess {
                Some(guess) => line(&mut out, format_args!("{key:<31} # a guess, {guess}: check it")),
                None => line(&mut out, format_args!("{key}")),
            }
            let interval_s = self.columns[time].interval_s(unit.factor);
            // Any other is left to be found.
            if let Some(seconds) = interval_s.filter(|seconds| (1e-6..=3600.0).contains(seconds)) {
                line(&mut out, format_args!("interval_s = {seconds:<18} # nominal, from the first rows: check it"));
            }
        } else {
            out.push_str("interval_s = 0.01               # nominal; there is no column of the time\n");
        }
        let numbered = |first: usize| {
            let exists = !self.header && self.columns.len() >= first + AXES;
            exists.then(|| [first, first + 1, first + 2])
        };
        let first = usize::from(time.is_some());
        let accelerometer = self.triad(Found::accelerometer).or_else(|| numbered(first));
        let gyroscope = self.triad(Found::gyroscope).or_else(|| numbered(first + AXES));
        self.sensors(&mut out, "accelerometer", accelerometer);
        if let Some(gyroscope) = gyroscope {
            self.sensors(&mut out, "gyroscope", Some(gyroscope));
        }
        out.push_str("[temperature]\n");
        let is_temperature = |index: &usize| Some(*index) != time && self.columns[*index].is_temperature();
        let temperatures: Vec<_> = (0..self.columns.len()).filter(is_temperature).collect();
        let is_right = [1, 3].contains(&temperatures.len()) || temperatures.len() == 6 && gyroscope.is_some();
        if is_right {
            line(&mut out, format_args!("columns = {}", self.names(&temperatures)));
        } else if let Some(first) = temperatures.first() {
            let key = format!("columns = {}", self.names(&[*first]));
            line(&mut out, format_args!("{key:<31} # or 1, 3 or 6 of {}", self.names(&temperatures)));
        } else {
            out.push_str("constant = 25.0                 # a placeholder, in the unit of the table; or columns = [..], 1, 3 or 6\n");
        }
        out
    }

    /// The column of the time: one whose name says it, before one that may be a temperature, and one that rises.
    fn time(&self) -> Option<usize> {
        let rising = |is: fn(&Found) -> bool| self.find(|column| is(column) && column.rises());
        let calendar = self.find(|column| column.times.as_ref().is_some_and(|times| times.len() > 1));
        let named = || rising(Found::is_time).or_else(|| rising(Found::is_t));
        let any = || self.find(Found::is_time).or_else(|| self.find(Found::is_t));
        calendar.or_else(named).or_else(any).or((!self.header && self.columns.len() > AXES).then_some(0))
    }

    fn sensors(&self, out: &mut String, section: &str, columns: Option<[usize; AXES]>) {
        line(out, format_args!("[{section}]"));
        match columns {
            Some(columns) => line(out, format_args!("columns = {}", self.names(&columns))),
            None => {
                let listed: Vec<_> = (0..self.columns.len().min(LISTED)).map(|index| self.name(index)).collect();
                let more = if self.columns.len() > LISTED { ", .." } else { "" };
                line(out, format_args!("columns = [\"?1\", \"?2\", \"?3\"]    # three of {}{more}", listed.join(", ")));
            }
        }
        out.push_str("kind = \"reading\"                # or \"increment\": what was counted since the row before\n");
        let Some(columns) = columns else { return };
        let whole = columns.iter().all(|index| self.columns[*index].is_whole);
        if whole && columns.iter().all(|index| self.columns[*index].is_around_32768()) {
            out.push_str("offset = 32768                  # digital zero of unsigned counts of 16 bits\n");
        }
        match whole {
            true => out.push_str("resolution = 1                  # one pulse, in the column's unit\n"),
            false => out.push_str("resolution = 1e-6               # one pulse, in the column's unit\n"),
        }
    }

    /// The column as a mapping names it.
    fn name(&self, index: usize) -> String {
        if self.header { quoted(&self.columns[index].name) } else { (index + 1).to_string() }
    }

    fn names(&self, columns: &[usize]) -> String {
        let names: Vec<_> = columns.iter().map(|index| self.name(*index)).collect();
        if let [name] = &names[..] { name.clone() } else { format!("[{}]", names.join(", ")) }
    }

    fn find(&self, is: impl Fn(&Found) -> bool) -> Option<usize> {
        self.columns.iter().position(is)
    }

    /// The first columns of the axes 1, 2, 3 of a kind of sensors.
    fn triad(&self, axis_of: impl Fn(&Found) -> Option<usize>) -> Option<[usize; AXES]> {
        let of = |axis: usize| self.find(|column| axis_of(column) == Some(axis));
        Some([of(0)?, of(1)?, of(2)?])
    }
}

impl Found {
    fn new(name: &str) -> Self {
        Self { name: name.to_owned(), parts: parts(name), values: Vec::new(), is_whole: true, times: Some(Vec::new()) }
    }

    fn take(&mut self, field: &str) {
        let value = field.replacen(',', ".", 1).parse().unwrap_or(f64::NAN);
        self.is_whole &= !field.contains([',', '.', 'e', 'E']) && value.is_finite();
        self.values.push(value);
        match (calendar::time_ns(field), &mut self.times) {
            (Some((time_ns, _)), Some(times)) => times.push(time_ns),
            _ => self.times = None,
        }
    }

    fn has(&self, names: &[&str]) -> bool {
        self.parts.iter().any(|part| names.contains(&part.as_str()))
    }

    fn begins(&self, beginnings: &[&str]) -> bool {
        self.parts.iter().any(|part| beginnings.iter().any(|beginning| part.starts_with(beginning)))
    }

    fn is_time(&self) -> bool {
        self.begins(&["time", "stamp", "second", "millis", "micros", "nanos"])
            || self.has(&["sec", "secs", "tow"])
            || matches!(&self.parts[..], [only] if ["s", "ms", "us", "ns"].contains(&only.as_str()))
    }

    /// Whether it is named t or T: the time, or beside a time the temperature.
    fn is_t(&self) -> bool {
        self.has(&["t"])
    }

    fn is_temperature(&self) -> bool {
        self.begins(&["temp"]) || self.has(&["degc"]) || self.parts.first().is_some_and(|part| part == "t")
    }

    fn rises(&self) -> bool {
        self.values.windows(2).all(|pair| pair[0] <= pair[1]) && self.values.first() < self.values.last()
    }

    fn accelerometer(&self) -> Option<usize> {
        let short = ["ax", "ay", "az"];
        self.one_of(short).or_else(|| self.begins(&["acc", "linear"]).then(|| self.axis())?)
    }

    fn gyroscope(&self) -> Option<usize> {
        let named = || self.begins(&["gyr", "omega", "angular", "rate", "angvel"]).then(|| self.axis())?;
        let found = self.one_of(["gx", "gy", "gz"]).or_else(|| self.one_of(["wx", "wy", "wz"])).or_else(named);
        found.filter(|_| self.accelerometer().is_none())
    }

    fn one_of(&self, names: [&str; AXES]) -> Option<usize> {
        names.iter().position(|name| self.has(&[name]))
    }

    /// The axis that a part of the name is, or that its last part ends with. The unit in brackets does not count: it
    /// may have digits.
    fn axis(&self) -> Option<usize> {
        let name = self.name.split(['[', '(']).next().unwrap_or_default();
        let parts = parts(name);
        let axes = [["x", "1"], ["y", "2"], ["z", "3"]];
        let is = axes.iter().position(|names| parts.iter().any(|part| names.contains(&part.as_str())));
        is.or_else(|| axes.iter().position(|names| parts.last().is_some_and(|last| last.ends_with(names[0]))))
    }

    fn median_step(&self) -> Option<f64> {
        let mut steps: Vec<_> = self.values.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.retain(|step| *step > 0.0);
        steps.sort_by(f64::total_cmp);
        steps.get(steps.len() / 2).copied()
    }

    /// The nominal interval, if the numbers are times in this unit \[s\].
    fn interval_s(&self, unit: f64) -> Option<f64> {
        let times = self.values.iter().filter(|value| **value >= 0.0);
        let numbers = || times.map(|value| (value * unit * 1e9).round() as u64).collect();
        let times = self.times.clone().unwrap_or_else(numbers);
        // What jitters or comes in bursts is found from more rows.
        let shape = interval::found(&times).filter(|shape| shape.is_even)?;
        interval::rounded(&shape).map(|ns| ns as f64 / 1e9)
    }

    /// The unit of the time: of the name; or else a guess by size.
    fn unit(&self) -> Unit {
        if self.times.is_some() {
            return Unit { name: "iso8601", factor: 1.0, guess: None };
        }
        let of = |name: &'static str, guess| {
            let factor = UNITS.iter().find(|(unit, ..)| *unit == name).map_or(1.0, |(.., factor)| *factor);
            Unit { name, factor, guess }
        };
        if let Some(name) = named_unit(&self.name) {
            return of(name, None);
        }
        let first = self.values.first().copied().unwrap_or(0.0);
        let step = self.median_step().unwrap_or(0.0);
        let of_epoch = |factor: f64| EPOCH_S.contains(&(first * factor)) && step * factor < 2.0;
        if let Some((name, ..)) = UNITS.iter().find(|(.., factor)| of_epoch(*factor)) {
            return of(name, Some("as a time since 1970".to_owned()));
        }
        let fits = UNITS.iter().rev().find(|(.., factor)| step > 0.0 && step * factor < 2.0);
        match fits {
            Some((name, _, factor)) => of(name, Some(format!("rows are {} s apart then", shown(step * factor)))),
            None => of("s", Some("nothing says it".to_owned())),
        }
    }

    fn is_around_32768(&self) -> bool {
        let mut values = self.values.clone();
        values.sort_by(f64::total_cmp);
        let middle = values.get(values.len() / 2).copied().unwrap_or(0.0);
        let all = values.iter().all(|value| (0.0..=65535.0).contains(value));
        all && (8192.0..57344.0).contains(&middle)
    }
}

/// A number to four digits.
fn shown(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// The parts of a name in lower case: "AccX [m/s2]" has acc, x, m, s2.
fn parts(name: &str) -> Vec<String> {
    let (mut spaced, mut was_lower) = (String::new(), false);
    for letter in name.chars() {
        if !letter.is_alphanumeric() || letter.is_uppercase() && was_lower {
            spaced.push(' ');
        }
        if letter.is_alphanumeric() {
            spaced.extend(letter.to_lowercase());
        }
        was_lower = letter.is_lowercase();
    }
    spaced.split_whitespace().map(str::to_owned).collect()
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

fn line(out: &mut String, text: std::fmt::Arguments<'_>) {
    // Writing to a String cannot fail.
    let _ = writeln!(out, "{text}");
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convert::mapping::{Decimal, Mapping, TimeUnit};
    use crate::convert::text;
    use crate::convert::{ColumnRef, Temperature};

    fn proposed(text: &'static str) -> (String, Mapping) {
        let proposal = text::proposal(Box::new(text.as_bytes())).unwrap();
        let mapping = Mapping::from_toml(&proposal).unwrap_or_else(|faults| panic!("{faults}\n{proposal}"));
        (proposal, mapping)
    }

    #[test]
    fn the_columns_of_many_programs_are_recognised() {
        for header in [
            "time_s,ax_counts,ay_counts,az_counts,gx_counts,gy_counts,gz_counts",
            "Timestamp,AccX,AccY,AccZ,GyroX,GyroY,GyroZ",
            "t [s],accel_x [m/s^2],accel_y [m/s^2],accel_z [m/s^2],gyro_x [rad/s],gyro_y [rad/s],gyro_z [rad/s]",
            "header.stamp,linear_acceleration.x,linear_acceleration.y,linear_acceleration.z,angular_velocity.x,angular_velocity.y,angular_velocity.z",
            "seconds,acc_1 [m/s^2],acc_2 [m/s^2],acc_3 [m/s^2],rate_1,rate_2,rate_3",
            "sec,accx,accy,accz,wx,wy,wz",
        ] {
            let text = format!("{header}\n0.01,1.5,2,3,4,5,6.5\n0.02,1,2,3,4,5,6\n");
            let (proposal, mapping) = proposed(text.leak());
            let names: Vec<_> = header.split(',').map(|name| ColumnRef::Name(name.to_owned())).collect();
            assert_eq!(mapping.time.column, Some((names[0].clone(), TimeUnit::Power(9))), "{proposal}");
            assert_eq!(mapping.time.interval_ns, Some(10_000_000));
            assert_eq!(mapping.accelerometer.columns, names[1..4], "{proposal}");
            assert_eq!(mapping.gyroscope.unwrap().columns, names[4..], "{proposal}");
            assert_eq!(
                (mapping.accelerometer.resolution, mapping.temperature),
                (Some(1e-6), Temperature::Constant(25.0))
            );
        }
    }

    #[test]
    fn units_offsets_decimal_commas_and_temperatures_are_found() {
        let (proposal, mapping) = proposed(
            "# made by a logger\ntime_ms;AX;AY;AZ;Temp;note\n10;32768;32000;33000;25,5;1\n20;32768;32000;33000;25,6;1\n",
        );
        assert_eq!(
            mapping.time.column,
            Some((ColumnRef::Name("time_ms".to_owned()), TimeUnit::Power(6))),
            "{proposal}"
        );
        assert_eq!(
            (mapping.skip, mapping.decimal, mapping.time.interval_ns),
            (1, Some(Decimal::Comma), Some(10_000_000))
        );
        assert_eq!((mapping.accelerometer.offset, mapping.accelerometer.resolution), (32768.0, Some(1.0)));
        let temp = vec![ColumnRef::Name("Temp".to_owned())];
        assert_eq!(mapping.temperature, Temperature::Columns { head: temp.clone(), board: temp });
        assert_eq!(mapping.gyroscope, None);

        let (proposal, mapping) = proposed("1000\t1\t-2\t3\t4\t5\t6\n2000\t1\t2\t3\t4\t5\t6\n");
        assert!(!mapping.header, "{proposal}");
        assert_eq!(mapping.time.column, Some((ColumnRef::Number(1), TimeUnit::Power(6))), "{proposal}");
        assert_eq!(mapping.accelerometer.columns, [2, 3, 4].map(ColumnRef::Number));
        assert_eq!(mapping.gyroscope.unwrap().columns, [5, 6, 7].map(ColumnRef::Number));

        let (proposal, mapping) = proposed("u,v,w,q\n1,2,3,4\n");
        assert!(proposal.contains("# three of \"u\", \"v\", \"w\", \"q\""), "{proposal}");
        assert_eq!(mapping.time.column, None);
    }

    /// The unit of the time, its line, and the temperature.
    fn time_and_temperature(text: &'static str) -> (ColumnRef, TimeUnit, String, Temperature) {
        let (proposal, mapping) = proposed(text);
        let (column, unit) = mapping.time.column.unwrap_or_else(|| panic!("{proposal}"));
        let line = proposal.lines().find(|line| line.starts_with("unit")).unwrap_or_default().to_owned();
        (column, unit, line, mapping.temperature)
    }

    #[test]
    fn t_beside_a_time_is_the_temperature() {
        let name = |name: &str| ColumnRef::Name(name.to_owned());
        for (text, time, temperature) in [
            ("T,time_s,ax,ay,az\n25.1,1,2,3,4\n25.0,1.01,2,3,4\n", "time_s", "T"),
            ("timestamp,ax,ay,az,T\n1,2,3,4,25.1\n1.01,2,3,4,25.2\n", "timestamp", "T"),
            ("T,t,ax,ay,az\n25.1,1,2,3,4\n25.0,1.01,2,3,4\n", "t", "T"),
            ("t,ax,ay,az,T [degC]\n1,2,3,4,25.1\n1.01,2,3,4,25.2\n", "t", "T [degC]"),
        ] {
            let (column, _, _, found) = time_and_temperature(text);
            let columns = vec![name(temperature)];
            assert_eq!((column, found), (name(time), Temperature::Columns { head: columns.clone(), board: columns }));
        }
        // Only what is missing is a constant.
        let (_, _, _, two) = time_and_temperature("t,ax,ay,az,temp1,temp2\n1,2,3,4,5,6\n2,2,3,4,5,6\n");
        assert_eq!(two, Temperature::Columns { head: vec![name("temp1")], board: vec![name("temp1")] });
        let (_, _, _, none) = time_and_temperature("T,ax,ay,az\n1,2,3,4\n2,2,3,4\n");
        assert_eq!(none, Temperature::Constant(25.0));
    }

    #[test]
    fn a_unit_by_size_is_called_a_guess_and_a_calendar_is_found() {
        for (text, unit, guess) in [
            (
                "timestamp,ax,ay,az\n1000,2,3,4\n1010,2,3,4\n",
                TimeUnit::Power(6),
                "# a guess, rows are 0.01 s apart then",
            ),
            ("stamp,ax,ay,az\n1700000000123,2,3,4\n1700000000133,2,3,4\n", TimeUnit::Power(6), "a time since 1970"),
            ("stamp,ax,ay,az\n1700000000123000,2,3,4\n1700000000133000,2,3,4\n", TimeUnit::Power(3), "since 1970"),
            ("time_us,ax,ay,az\n1000,2,3,4\n11000,2,3,4\n", TimeUnit::Power(3), ""),
            ("when,ax,ay,az\n2026-05-01T12:00:00.00Z,2,3,4\n2026-05-01T12:00:00.01Z,2,3,4\n", TimeUnit::Iso8601, ""),
            ("clock;ax;ay;az\n23:59:59,990;2;3;4\n00:00:00,000;2;3;4\n", TimeUnit::Iso8601, ""),
        ] {
            let (_, found, line, _) = time_and_temperature(text);
            assert!(found == unit && line.contains(guess) && line.contains("guess") != guess.is_empty(), "{line}");
        }
    }

    #[test]
    fn names_are_quoted_as_toml_and_for_a_terminal() {
        let (proposal, mapping) = proposed("t,a\u{1b}[2J x,a\\y,\"a \"\"z\"\"\"\n1,1,2,3\n2,1,2,3\n");
        assert!(matches!(printable(&proposal), Cow::Borrowed(_)), "{proposal}");
        assert!(proposal.contains(r#""a\U0000001B[2J x", "a\\y", "a \"z\"""#), "{proposal}");
        assert_eq!(mapping.time.column, Some((ColumnRef::Name("t".to_owned()), TimeUnit::Power(9))));
    }

    #[test]
    fn what_is_no_table_gets_no_proposal() {
        for text in ["a\nb\n", "", "one,two\n1,2\n"] {
            assert!(
                text::proposal(Box::new(text.as_bytes()))
                    .unwrap_err()
                    .to_string()
                    .contains("this is no table of numbers"),
                "{text:?}"
            );
        }
    }
}
