//! The text of a campaign file that is proposed.

use super::columns::{Channels, ColumnRoles, PositionMeans};
use isotherm_recording_formats::convert::{Calendar, LookedTable};
use isotherm_statistics::median;
use std::fmt::Write as _;

/// A temperature that follows the set points by about 1 is one in degC.
const DEGREES: std::ops::RangeInclusive<f64> = 0.7..=1.3;
/// A number of pulses that is farther from a whole one was not counted.
const WHOLE: f64 = 0.05;

/// The columns of the time.
#[derive(Clone, Debug, Default)]
pub(super) struct TimeColumns {
    /// Date and time, one column or two; or a time that rises.
    pub columns: Vec<usize>,
    is_calendar: bool,
    /// From row to row, in the unit of the time.
    step: Option<f64>,
}

impl TimeColumns {
    /// Those of a table.
    pub(super) fn of(table: &LookedTable) -> Self {
        let find = |of: Calendar| table.columns.iter().position(|column| column.calendar == Some(of));
        let of_day = find(Calendar::OfDay);
        let columns: Vec<usize> = match (find(Calendar::Both), find(Calendar::Date), of_day) {
            (Some(both), ..) => vec![both],
            (None, Some(date), Some(of_day)) => vec![date, of_day],
            (None, None, Some(of_day)) => vec![of_day],
            _ => Vec::new(),
        };
        let steps = |values: &[f64]| median(values.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 0.0));
        if let Some(last) = columns.last() {
            let step = steps(&table.columns[*last].times_s);
            return Self { columns, is_calendar: true, step: Some(step).filter(|step| step.is_finite()) };
        }
        let rises = |values: &[f64]| values.len() > 2 && values.windows(2).all(|pair| pair[1] > pair[0]);
        let rising = table.columns.iter().position(|column| column.is_numeric() && rises(&column.values));
        let step = rising.map(|column| steps(&table.columns[column].values));
        Self { columns: rising.into_iter().collect(), is_calendar: false, step }
    }
}

/// What no file says.
const HEAD: &str = r#"# Proposed by `isotherm calibrate turntable --propose` only from the files. Fill in every "?", and check
# what a comment calls a guess; then: isotherm check campaign.toml
format = 1
imu = "?"                       # the name of the IMU: 1 to 32 of a-z 0-9 - _
# serial = "S/N 0042"
gravity_reference = "?"         # m/s2, the value of 1 g0, for example 9.80665
gravity_local = "?"             # m/s2, at the station
"#;
/// What finds counts that are taken for rates.
const NOMINAL: &str = "\
# nominal_scale_factor = 90000  # pulse/(s*g0), of the data sheet: with it a factor between counts and rates is found
";

/// What was found in files or a sheet.
pub(super) struct ProposedCampaign {
    table: LookedTable,
    times: TimeColumns,
    means: Vec<PositionMeans>,
    columns: ColumnRoles,
}

impl ProposedCampaign {
    /// `labels` are the columns of set point and position, of a sheet.
    pub(super) fn of(table: LookedTable, times: TimeColumns, means: Vec<PositionMeans>, labels: &[usize]) -> Self {
        let is_candidate = |index: &usize| {
            table.columns[*index].is_numeric() && !times.columns.contains(index) && !labels.contains(index)
        };
        let candidates: Vec<_> = (0..table.columns.len()).filter(is_candidate).collect();
        let names: Vec<_> = table.columns.iter().map(|column| column.name.clone()).collect();
        let columns = ColumnRoles::of(&means, &candidates, &names);
        Self { table, times, means, columns }
    }

    /// The campaign file. `lines` say where the samples are.
    pub(super) fn campaign(&self, lines: &[String], remarks: &[String]) -> String {
        let mut out = String::from(HEAD);
        let unit = self.unit();
        line(&mut out, &format!("temperature_unit = \"{}\"", unit.0), unit.1);
        out.push_str(NOMINAL);
        for remark in remarks {
            line(&mut out, &format!("# {remark}"), "");
        }
        out.push_str("\n[samples]\n");
        lines.iter().for_each(|text| line(&mut out, text, ""));
        self.write_table(&mut out);
        self.write_time(&mut out);
        self.write_accelerometer(&mut out, lines.len() > 1);
        self.write_temperature(&mut out);
        self.write_others(&mut out);
        self.write_positions(&mut out);
        out
    }

    /// The unit of the temperature, and why.
    fn unit(&self) -> (&'static str, &'static str) {
        let slopes = || self.columns.temperature.iter().map(|(_, slope)| *slope);
        match slopes().next() {
            Some(_) if slopes().all(|slope| DEGREES.contains(&slope)) => ("degC", "a guess: it follows the set points"),
            _ => ("?", "the unit of the temperature, any label, as \"V\""),
        }
    }

    fn write_table(&self, out: &mut String) {
        if self.table.skip > 0 {
            line(out, &format!("skip = {}", self.table.skip), "");
        }
        if !self.table.header {
            line(out, "header = false", "columns by number, from 1");
        }
        if self.table.comma {
            line(out, "decimal = \",\"", "");
        }
    }

    fn write_time(&self, out: &mut String) {
        if self.times.columns.is_empty() {
            return;
        }
        out.push_str("\n[samples.time]\n");
        line(out, &format!("column = {}", self.names(&self.times.columns)), "");
        match self.times.is_calendar {
            true => line(out, "unit = \"iso8601\"", "date and time"),
            false => line(out, "unit = \"s\"", "a guess: \"s\", \"ms\", \"us\" or \"ns\""),
        }
    }

    fn write_accelerometer(&self, out: &mut String, are_means: bool) {
        out.push_str("\n[samples.accelerometer]\n");
        let Some(channels) = &self.columns.channels else {
            let following = self.names(&self.columns.following_gravity);
            line(
                out,
                "# three columns with both signs, or three positive and three negative ones; gravity is seen in",
                "",
            );
            line(out, &format!("# {following}"), "");
            line(out, "columns = \"?\"", "of A1, A2, A3");
            line(out, "kind = \"count\"", "or \"rate\"");
            line(out, "gate_s = \"?\"", "the time that a count or rate is over [s]");
            return;
        };
        if !self.columns.has_one_length {
            line(out, "# The length is not the same in all positions: check which column is what, and its unit", "");
        }
        match channels {
            Channels::Signed(columns) => line(out, &format!("columns = {}", self.names(columns)), "of A1, A2, A3"),
            Channels::Both(axes) => {
                let of = |channel: usize| self.names(&axes.map(|axis| axis[channel]));
                line(out, &format!("positive = {}", of(0)), "of A1, A2, A3: check which channel is which");
                line(out, &format!("negative = {}", of(1)), "");
            }
        }
        self.write_kind(out, &channels.all(), are_means);
    }

    /// Whether the numbers are counts or rates, and over which time.
    fn write_kind(&self, out: &mut String, columns: &[usize], are_means: bool) {
        let decimals = columns.iter().map(|column| self.table.columns[*column].decimals).max().unwrap_or_default();
        // Without a unit of the time its step says nothing.
        let step_s = self.times.step.filter(|_| self.times.is_calendar);
        if decimals == 0 && !are_means {
            line(out, "kind = \"count\"", "a guess: all numbers are whole");
            match step_s {
                Some(step_s) => {
                    line(out, &format!("gate_s = {step_s}"), "a guess, from row to row [s]");
                }
                None => line(out, "gate_s = \"?\"", "the time that a count is over [s]"),
            }
            return;
        }
        line(out, "kind = \"rate\"", "a guess: the numbers are not whole");
        let values = || columns.iter().flat_map(|column| &self.table.columns[*column].values);
        let fits = |gate_s: &f64| values().all(|value| ((value * gate_s) - (value * gate_s).round()).abs() < WHOLE);
        let steps = 10_f64.powi(i32::try_from(decimals.min(3)).unwrap_or(3));
        match step_s.filter(fits).or(Some(steps).filter(fits)) {
            _ if are_means => line(out, "# gate_s = 10", "only of means of counts, with kind = \"count\""),
            Some(gate_s) => line(out, &format!("gate_s = {gate_s}"), "a guess: then all are whole pulses"),
            None => line(out, "gate_s = \"?\"", "the time that a rate is over [s]"),
        }
    }

    fn write_temperature(&self, out: &mut String) {
        out.push_str("\n[samples.temperature]\n");
        let all: Vec<usize> = self.columns.temperature.iter().map(|(column, _)| *column).collect();
        let is_board = |column: &usize| {
            let name = self.table.columns[*column].name.to_lowercase();
            ["board", "conv", "pcb", "elec", "i/f"].iter().any(|word| name.contains(word))
        };
        let (boards, heads): (Vec<usize>, Vec<usize>) = all.iter().copied().partition(is_board);
        match (heads.as_slice(), boards.as_slice()) {
            ([], []) => line(out, "columns = \"?\"", "no column follows the set points; or constant = 25"),
            (heads @ ([_] | [_, _, _]), boards @ ([] | [_] | [_, _, _])) => {
                line(out, &format!("columns = {}", self.names(heads)), "of the sensor heads");
                if !boards.is_empty() {
                    line(out, &format!("board_columns = {}", self.names(boards)), "of the converter boards");
                }
            }
            ([a, b, c, d, e, f], []) => {
                line(
                    out,
                    &format!("columns = {}", self.names(&[*a, *b, *c])),
                    "of the sensor heads: a guess, by order",
                );
                line(
                    out,
                    &format!("board_columns = {}", self.names(&[*d, *e, *f])),
                    "of the boards: a guess, by order",
                );
            }
            _ => {
                line(out, &format!("# these follow the set points: {}", self.names(&all)), "");
                line(out, "columns = \"?\"", "1 of all sensors, or 3 of A1, A2, A3; board_columns likewise");
            }
        }
    }

    fn write_others(&self, out: &mut String) {
        let others = &self.columns.others;
        if !others.is_empty() {
            line(out, &format!("# not used: {}", self.names(others)), "");
            line(out, "# gyroscopes, with [[turn]]: [samples.gyroscope], with keys as above", "");
        }
    }

    fn write_positions(&self, out: &mut String) {
        let mut numbers: Vec<u32> = self.means.iter().map(|row| row.position).collect();
        numbers.sort_unstable();
        numbers.dedup();
        out.push_str(
            "\n# Give outer_deg and inner_deg of all positions, too: then the tilt of the base is estimated.\n",
        );
        for number in numbers {
            let _ = write!(out, "\n[[position]]\nnumber = {number}\n# outer_deg = 0\n# inner_deg = 0\n");
            let Some(channels) = &self.columns.channels else {
                line(out, "specific_force = \"?\"", "the direction along A1, A2, A3");
                continue;
            };
            let (direction, is_near) = channels.direction(&self.means, number);
            let [x, y, z] =
                direction.map(|part| if part.fract() == 0.0 { format!("{part:.0}") } else { format!("{part:.4}") });
            let why = match is_near {
                true => "a guess, by gravity in the numbers: check it",
                false => "a guess, by gravity in the numbers, to some percent: give the direction that was set",
            };
            line(out, &format!("specific_force = [{x}, {y}, {z}]").replace("-0,", "0,").replace("-0]", "0]"), why);
        }
    }

    /// Columns as the file names them.
    fn names(&self, columns: &[usize]) -> String {
        let name = |index: &usize| match self.table.header {
            true => quoted(&self.table.columns[*index].name),
            false => (index + 1).to_string(),
        };
        let names: Vec<_> = columns.iter().map(name).collect();
        if let [name] = names.as_slice() { name.clone() } else { format!("[{}]", names.join(", ")) }
    }
}

/// A string of TOML.
pub(super) fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for letter in text.chars() {
        let _ = match letter {
            '"' | '\\' => write!(quoted, "\\{letter}"),
            _ if letter.is_control() => write!(quoted, "\\U{:08X}", u32::from(letter)),
            _ => write!(quoted, "{letter}"),
        };
    }
    quoted + "\""
}

/// A line with a comment behind it, unless that is empty.
fn line(out: &mut String, text: &str, comment: &str) {
    // Writing to a String cannot fail.
    let _ = match comment {
        "" => writeln!(out, "{text}"),
        _ => writeln!(out, "{text:<31} # {comment}"),
    };
}
