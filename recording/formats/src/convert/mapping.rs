//! The mapping file: which columns of a text are time, accelerometers, gyroscopes and temperature, and what their
//! numbers mean.
//!
//! ```toml
//! format = 1
//! [time]
//! column = "t"
//! unit = "s"
//! interval_s = 0.01
//! [accelerometer]
//! columns = ["ax", "ay", "az"]
//! kind = "reading"
//! offset = 32768
//! resolution = 1
//! sign = [1, 1, 1]
//! [temperature]
//! columns = ["temperature"]
//! ```

use super::columns::{ColumnRef, SensorColumns, Sensors, Temperature, columns};
use super::unit::Quantity;
use isotherm_shared::document::{Document, Faults, Section};
use isotherm_shared::wire::MAX_INTERVAL_NS;

/// Shortest nominal interval \[ns\].
const MIN_INTERVAL_NS: f64 = 1e3;
/// Most lines that may be skipped.
const MAX_SKIP: i64 = 1_000_000;

/// What the columns of a text mean.
#[derive(Clone, Debug, PartialEq)]
pub struct Mapping {
    /// The decimal mark; `None`: it is found.
    pub decimal: Option<Decimal>,
    /// Whether the first row that is not skipped has the names of the columns.
    pub header: bool,
    /// Number of lines above the header, or above the first row.
    pub skip: u64,
    /// The time.
    pub time: RowTimes,
    /// The accelerometers.
    pub accelerometer: Sensors,
    /// The gyroscopes, if the IMU has any.
    pub gyroscope: Option<Sensors>,
    /// The temperature.
    pub temperature: Temperature,
    /// The columns of set point and position, of a sheet of means. It has no times.
    pub labels: Option<[ColumnRef; 2]>,
    /// Whether it stands in a campaign file, in the section `samples`.
    pub is_of_campaign: bool,
}

/// A decimal mark.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Decimal {
    /// `1.5`
    Point,
    /// `1,5`
    Comma,
}

impl Decimal {
    /// The mark itself.
    #[must_use]
    pub const fn byte(self) -> u8 {
        match self {
            Self::Point => b'.',
            Self::Comma => b',',
        }
    }
}

/// The time of the rows.
#[derive(Clone, Debug, Default, Eq, PartialEq)]
pub struct RowTimes {
    /// The column and its unit; `None`: the rows are `interval_ns` apart.
    pub column: Option<(ColumnRef, TimeUnit)>,
    /// The column of the time of the day, where that of the date is another one.
    pub of_day: Option<ColumnRef>,
    /// Nominal interval \[ns\]; `None`: it is found from the time.
    pub interval_ns: Option<u64>,
}

/// How a text has the time.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum TimeUnit {
    /// Numbers of 10 to this power ns.
    Power(u32),
    /// Dates and times of ISO 8601, or times of a day as hh:mm:ss.
    Iso8601,
}

/// What a mapping may say about data whose columns are known, such as `sensor_msgs/msg/Imu`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KnownColumns {
    /// Nominal interval \[ns\]; `None`: it is found from the time.
    pub interval_ns: Option<u64>,
    /// The temperature of all rows; `None`: that of the data, if they have any.
    pub temperature: Option<f64>,
    /// One of the data's unit of accelerations \[m/s2\] and of rates \[rad/s\]; `None`: 1.
    pub units: [Option<f64>; 2],
}

const WANTED: &str = "give the mapping file; the data come without --mapping";

impl Mapping {
    /// Reads the mapping of a text.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_recording_formats::convert::Mapping;
    ///
    /// let text = include_str!("../../../../examples/mapping.toml");
    /// let mapping = Mapping::from_toml(text)?;
    /// assert!(mapping.gyroscope.is_some());
    /// let faults = Mapping::from_toml(&text.replace("\"reading\"", "\"readings\"")).err().ok_or("no such kind")?;
    /// assert!(!faults.0.is_empty());
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// All faults, with line and key.
    pub fn from_toml(text: &str) -> Result<Self, Faults> {
        Self::with_interval(text, None)
    }

    /// As [`from_toml`](Self::from_toml). An interval \[ns\] that is given wins, also over one that the mapping leaves
    /// open as `"?"`.
    ///
    /// # Errors
    /// As [`from_toml`](Self::from_toml).
    pub fn with_interval(text: &str, given_ns: Option<u64>) -> Result<Self, Faults> {
        Self::read(text, given_ns, false)
    }

    /// Reads the mapping of two texts, of accelerometers and of gyroscopes, whose columns may have the same names. The
    /// time is in both.
    ///
    /// # Errors
    /// As [`from_toml`](Self::from_toml).
    pub fn of_two_files(text: &str, given_ns: Option<u64>) -> Result<Self, Faults> {
        Self::read(text, given_ns, true)
    }

    fn read(text: &str, given_ns: Option<u64>, of_two_files: bool) -> Result<Self, Faults> {
        let document = Document::parse_as(text, WANTED)?;
        let root = document.root();
        format(&root);
        let mapping = Self::of_section(&document, &root, given_ns, of_two_files);
        root.finish();
        document.finish(mapping)
    }

    /// The same, of the section `samples` of a campaign file, which has other keys in addition; `None` if it names no
    /// columns, as of recordings, or if it is faulty.
    ///
    /// # Errors
    /// All faults of the mapping, with line and key.
    pub fn of_campaign(text: &str) -> Result<Option<Self>, Faults> {
        // If it is not TOML, the rest of the file shows it.
        let Ok(document) = Document::parse(text) else { return Ok(None) };
        let root = document.root();
        let samples = root.unchecked("samples");
        if !samples.is_some_and(|samples| Self::SECTIONS.iter().any(|key| samples.has(key))) {
            return Ok(None);
        }
        let Some(section) = root.optional_section("samples") else { return Ok(None) };
        let mapping = Self::of_section(&document, &section, None, false);
        document.finish(mapping.map(|mapping| Self { is_of_campaign: true, ..mapping })).map(Some)
    }

    /// The keys of a mapping that stands in a campaign file, in the section `samples`.
    pub const SECTIONS: [&str; 7] = ["decimal", "header", "skip", "time", "accelerometer", "gyroscope", "temperature"];

    fn of_section(
        document: &Document<'_>,
        root: &Section<'_, '_>,
        given_ns: Option<u64>,
        of_two_files: bool,
    ) -> Option<Self> {
        let decimal = root.optional_choice("decimal", &[(Decimal::Point, "."), (Decimal::Comma, ",")]);
        let header = root.optional_bool("header").unwrap_or(true);
        let skip = root.optional_integer("skip", 0..=MAX_SKIP).map_or(0, i64::cast_unsigned);
        let has_gate = root.unchecked("accelerometer").is_some_and(|section| section.has("gate_s"));
        let labels = labels(root, header);
        if labels.is_some() && root.has("time") {
            root.fault("time", "a mean has no time; leave the section out");
        }
        let time = match labels.is_some() || has_gate && !root.has("time") {
            true => {
                root.ignore("time");
                Some(RowTimes::default())
            }
            false => root.section("time", "a section [time]").map(|section| time(section, header, given_ns, has_gate)),
        };
        let columns = SensorColumns::of_text(document, root, header, of_two_files, labels.is_some());
        if let Some(SensorColumns { accelerometer, gyroscope, .. }) = &columns {
            let at =
                |key: &'static str| (root.optional_section(key).map_or(1, |section| section.line()), root.key(key));
            if labels.is_some() && !accelerometer.kind.is_of_pulses() {
                let (line, path) = at("accelerometer");
                let message = "means are of pulses: give \"rate\", or \"count\" with gate_s";
                document.fault(line, format!("{path}.kind"), message);
            }
            if of_two_files && accelerometer.kind.is_of_pulses() {
                let (line, path) = at("accelerometer");
                let message = "is of pulses, which are read from one file; give the gyroscopes' columns of that file";
                document.fault(line, format!("{path}.kind"), message);
            }
            let differing = gyroscope.iter().filter_map(|gyroscope| differing(accelerometer, gyroscope));
            for (key, message) in differing {
                let (line, path) = at("gyroscope");
                document.fault(line, format!("{path}.{key}"), message);
            }
        }
        let SensorColumns { accelerometer, gyroscope, temperature, .. } = columns?;
        let mut time = time?;
        if let Some(gate_s) = accelerometer.gate_s {
            time.interval_ns = Some((gate_s * 1e9).round() as u64);
        }
        Some(Self { decimal, header, skip, time, accelerometer, gyroscope, temperature, labels, is_of_campaign: false })
    }

    /// The key in which it names a column, if it stands in a campaign file.
    pub(super) fn key(&self, column: &ColumnRef) -> Option<String> {
        if !self.is_of_campaign {
            return None;
        }
        let of_sensors = |section: &str, sensors: &Sensors| {
            let first = if sensors.negative.is_some() { "positive" } else { "columns" };
            let negative = sensors.negative.iter().flatten().any(|other| other == column);
            let key = if sensors.columns.contains(column) { Some(first) } else { negative.then_some("negative") };
            key.map(|key| format!("{section}.{key}"))
        };
        let of_time = self.time.column.iter().map(|(time, _)| time).chain(&self.time.of_day);
        let is_time = of_time.into_iter().any(|other| other == column).then(|| "time.column".to_owned());
        let label = self.labels.iter().flatten().position(|other| other == column);
        let label = label.map(|index| ["set_point_c", "position"][index].to_owned());
        let of_gyroscopes = || self.gyroscope.as_ref().and_then(|sensors| of_sensors("gyroscope", sensors));
        let of_temperature = || match &self.temperature {
            Temperature::Columns { head, .. } if head.contains(column) => "temperature.columns".to_owned(),
            _ => "temperature.board_columns".to_owned(),
        };
        let found =
            is_time.or(label).or_else(|| of_sensors("accelerometer", &self.accelerometer)).or_else(of_gyroscopes);
        Some(format!("samples.{}", found.unwrap_or_else(of_temperature)))
    }

    /// All columns that it names.
    pub fn columns(&self) -> impl Iterator<Item = &ColumnRef> {
        let labels = self.labels.iter().flatten();
        let time = self.time.column.iter().map(|(column, _)| column).chain(&self.time.of_day);
        let gyroscope = self.gyroscope.iter().flat_map(Sensors::all);
        let (head, board): (&[_], &[_]) = match &self.temperature {
            Temperature::Columns { head, board, .. } => (head, board),
            Temperature::Constant(_) => (&[], &[]),
        };
        let durations = self.gyroscope.iter().chain([&self.accelerometer]).filter_map(|of| of.duration.as_ref());
        labels.chain(time).chain(self.accelerometer.all()).chain(gyroscope).chain(durations).chain(head).chain(board)
    }
}

impl KnownColumns {
    /// Reads the mapping of data whose columns are known. It may have `time.interval_s`, `accelerometer.unit`,
    /// `gyroscope.unit` and `temperature.constant`.
    ///
    /// # Errors
    /// All faults, with line and key.
    pub fn from_toml(text: &str) -> Result<Self, Faults> {
        let document = Document::parse_as(text, WANTED)?;
        let root = document.root();
        format(&root);
        let mut known = Self::default();
        if let Some(time) = root.optional_section("time") {
            known.interval_ns = interval(&time, None);
            time.finish();
        }
        for (unit, quantity) in known.units.iter_mut().zip([Quantity::Acceleration, Quantity::Rate]) {
            if let Some(sensors) = root.optional_section(quantity.section()) {
                *unit = sensors.optional_choice("unit", &quantity.choices());
                sensors.finish();
            }
        }
        if let Some(temperature) = root.optional_section("temperature") {
            known.temperature = temperature.optional_number("constant");
            temperature.finish();
        }
        root.finish();
        document.finish(Some(known))
    }
}

fn format(root: &Section<'_, '_>) {
    if !root.has("format") {
        root.fault("format", "missing; give 1");
    }
    root.optional_integer("format", 1..=1);
}

/// The columns of set point and position, if the text is a sheet of means.
fn labels(root: &Section<'_, '_>, header: bool) -> Option<[ColumnRef; 2]> {
    if !root.has("means") {
        return None;
    }
    let column =
        |key: &'static str| columns(root, key, &[1], "one column of the sheet", header).and_then(|mut it| it.pop());
    Some([column("set_point_c")?, column("position")?])
}

/// In which key two triads of one text differ that they must have alike, and why.
fn differing(accelerometer: &Sensors, gyroscope: &Sensors) -> Option<(&'static str, &'static str)> {
    if accelerometer.kind != gyroscope.kind {
        return Some(("kind", "differs from accelerometer.kind; all numbers of a row count over the same interval"));
    }
    let message = "differs from accelerometer.gate_s; all numbers of a row count over the same gate";
    (accelerometer.gate_s != gyroscope.gate_s).then_some(("gate_s", message))
}

/// The section of the time. With `has_gate` the gate is the nominal interval.
fn time(section: Section<'_, '_>, header: bool, given_ns: Option<u64>, has_gate: bool) -> RowTimes {
    let (column, of_day) = time_columns(&section, header);
    let time = RowTimes { column, of_day, interval_ns: interval(&section, given_ns) };
    if has_gate && section.has("interval_s") {
        section.fault("interval_s", "is given in addition to gate_s, which is the interval of every row; leave it out");
    } else if !section.has("column") && !section.has("interval_s") && given_ns.is_none() && !has_gate {
        section.fault("interval_s", "missing; give the nominal interval in s or --interval, or the column of the time");
    }
    section.finish();
    time
}

/// The column of the time with its unit, and that of the time of the day, if the first one has only the date.
fn time_columns(section: &Section<'_, '_>, header: bool) -> (Option<(ColumnRef, TimeUnit)>, Option<ColumnRef>) {
    let power = TimeUnit::Power;
    let units = [(power(9), "s"), (power(6), "ms"), (power(3), "us"), (power(0), "ns"), (TimeUnit::Iso8601, "iso8601")];
    let unit = section.optional_choice("unit", &units);
    if !section.has("column") {
        section.ignore("column");
        return (None, None);
    }
    if !section.has("unit") {
        section.fault("unit", "missing; give the unit of the time: \"s\", \"ms\", \"us\", \"ns\" or \"iso8601\"");
    }
    let (counts, expected): (&[usize], _) = match unit {
        Some(TimeUnit::Iso8601) => (&[1, 2], "the column of the time, or those of the date and of the time of the day"),
        _ => (&[1], "the column of the time"),
    };
    let Some(mut columns) = columns(section, "column", counts, expected, header) else { return (None, None) };
    let of_day = (columns.len() == 2).then(|| columns.pop()).flatten();
    (columns.pop().zip(unit), of_day)
}

fn interval(section: &Section<'_, '_>, given_ns: Option<u64>) -> Option<u64> {
    if section.is_open("interval_s") {
        let message = "is \"?\", which is to be filled in; give the nominal interval in s here, or with --interval";
        section.refuse("interval_s", given_ns.is_none().then(|| message.to_owned()));
        section.ignore("interval_s");
        return given_ns;
    }
    let ns = section.optional_number("interval_s")? * 1e9;
    let is_right = (MIN_INTERVAL_NS..=MAX_INTERVAL_NS as f64).contains(&ns);
    section.refuse("interval_s", (!is_right).then(|| "give a number of seconds from 0.000001 to 3600".to_owned()));
    given_ns.or(is_right.then(|| ns.round() as u64))
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "format = 1\n[time]\ncolumn = \"t\"\nunit = \"ms\"\ninterval_s = 0.01\n[accelerometer]\n\
         columns = [\"x\", \"y\", \"z\"]\nkind = \"reading\"\n[temperature]\ncolumns = \"T\"\n";

    #[test]
    fn a_mapping_of_a_few_lines_is_enough() {
        let mapping = Mapping::from_toml(GOOD).unwrap();
        let name = |name: &str| ColumnRef::Name(name.to_owned());
        assert_eq!(
            mapping.time,
            RowTimes { column: Some((name("t"), TimeUnit::Power(6))), of_day: None, interval_ns: Some(10_000_000) }
        );
        assert_eq!(mapping.accelerometer.columns, ["x", "y", "z"].map(name));
        assert_eq!((mapping.accelerometer.offset, mapping.accelerometer.resolution), (0.0, None));
        assert_eq!((mapping.header, mapping.skip, mapping.decimal, mapping.gyroscope.clone()), (true, 0, None, None));
        assert_eq!(mapping.columns().count(), 6);
        let numbers = GOOD.replace("format = 1", "format = 1\nheader = false\nskip = 2\ndecimal = \",\"");
        let numbers = numbers.replace("\"t\"", "1").replace("[\"x\", \"y\", \"z\"]", "[2, 3, 4]");
        let numbers = Mapping::from_toml(&numbers.replace("\"T\"", "[5]\nboard_columns = 6")).unwrap();
        assert_eq!(numbers.accelerometer.columns, [2, 3, 4].map(ColumnRef::Number));
        assert_eq!((numbers.header, numbers.skip, numbers.decimal), (false, 2, Some(Decimal::Comma)));
        let board = vec![ColumnRef::Number(6)];
        let head = vec![ColumnRef::Number(5)];
        assert_eq!(numbers.temperature, Temperature::Columns { head, board, linear: None });
        let known = KnownColumns::from_toml("format = 1\n[time]\ninterval_s = 0.005\n[temperature]\nconstant = 20\n");
        assert_eq!(
            known,
            Ok(KnownColumns { interval_ns: Some(5_000_000), temperature: Some(20.0), ..KnownColumns::default() })
        );
    }

    #[test]
    fn all_faults_are_reported_with_line_and_key() {
        let faults = |text: &str| Mapping::from_toml(text).unwrap_err().to_string();
        let wrong = GOOD
            .replace("format = 1", "format = 2\nseparator = \";\"")
            .replace("0.01", "0")
            .replace("\"ms\"", "\"min\"")
            .replace(", \"z\"", "")
            .replace("\"reading\"", "\"rates\"\nresolution = 0\nsign = [1, 2, 1]");
        let wrong = faults(&(wrong + "constant = 25\n"));
        for expected in [
            "line 1: format: is the integer 2",
            "line 2: separator: unknown key",
            "line 5: time.unit: is \"min\", give \"s\" or \"ms\" or \"us\" or \"ns\" or \"iso8601\"",
            "line 6: time.interval_s: give a number of seconds",
            "line 8: accelerometer.columns: has 2 columns, give three columns",
            "line 9: accelerometer.kind: is \"rates\"",
            "line 10: accelerometer.resolution: is 0, give one pulse",
            "line 11: accelerometer.sign: give three signs",
            "line 14: temperature.constant: is given in addition to columns",
        ] {
            assert!(wrong.contains(expected), "{expected}\n--\n{wrong}");
        }
        assert_eq!(
            faults("format = 1\n"),
            "line 1: time: missing; give a section [time]\n\
             line 1: accelerometer: missing; give a section [accelerometer]\n\
             line 1: temperature: missing; give a section [temperature]"
        );
        assert!(faults("t,x,y,z\n1,2,3,4\n").contains("this is CSV data, not TOML; give the mapping file"));
        let gyroscope = "[gyroscope]\ncolumns = [\"a\", \"b\", \"c\"]\nkind = \"increment\"\n";
        assert!(faults(&format!("{GOOD}{gyroscope}")).starts_with("line 11: gyroscope.kind: differs from"));
        let twice = faults(&GOOD.replace("\"y\"", "\"x\""));
        assert_eq!(twice, "line 7: accelerometer.columns: has one column for two axes; give three different columns");
        let shared = faults(&format!("{GOOD}{}", gyroscope.replace("\"a\"", "\"z\"").replace("increment", "reading")));
        assert!(shared.starts_with("line 11: gyroscope.columns: has a column of the accelerometers"), "{shared}");
        let six = GOOD.replace("\"T\"", "[\"1\", \"2\", \"3\", \"4\", \"5\", \"6\"]");
        assert!(faults(&six).contains("temperature.columns: has 6 columns, give 1 column of all sensors, or 3"));
        assert!(
            faults(&GOOD.replace("column = \"t\"\nunit = \"ms\"\ninterval_s = 0.01", ""))
                .contains("time.interval_s: missing")
        );
        assert!(faults(&GOOD.replace("unit = \"ms\"\n", "")).contains("time.unit: missing"));
        let known = KnownColumns::from_toml(GOOD).unwrap_err().to_string();
        assert!(known.contains("line 7: accelerometer.columns: unknown key; known here: unit"), "{known}");
    }
}
