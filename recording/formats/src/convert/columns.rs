//! What the columns of the sensors mean: the sections `[accelerometer]`, `[gyroscope]` and `[temperature]`, which a
//! mapping and the description of an acquisition's source have alike.

use super::unit::{Linear, Quantity};
use isotherm_shared::document::{Document, Section};
use isotherm_shared::wire::{AXES, MAX_INTERVAL_NS};

/// Highest number of a column.
const MAX_COLUMN: i64 = 4096;

/// A column: by its name in the header, or by its number from 1 in a text without header.
#[derive(Clone, Debug, Eq, PartialEq)]
pub enum ColumnRef {
    /// Its name.
    Name(String),
    /// Its number, from 1.
    Number(usize),
}

/// What a number of a column is.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Kind {
    /// A value at a moment. It counts over the nominal interval, whatever the jitter of the time.
    Reading,
    /// What was counted since the row before.
    Increment,
    /// Pulses that a channel counted over the gate.
    Count,
    /// Pulses of a channel a second, a mean over the gate.
    Rate,
}

impl Kind {
    /// What a description of an acquisition can have.
    const OF_SIGNALS: [(Self, &str); 2] = [(Self::Reading, "reading"), (Self::Increment, "increment")];
    /// What a text can have, too.
    const OF_TEXTS: [(Self, &str); 4] =
        [Self::OF_SIGNALS[0], Self::OF_SIGNALS[1], (Self::Count, "count"), (Self::Rate, "rate")];

    /// Whether the numbers are pulses of a converter, or pulses a second.
    #[must_use]
    pub const fn is_of_pulses(self) -> bool {
        matches!(self, Self::Count | Self::Rate)
    }

    /// As a mapping has it.
    pub(super) fn name(self) -> &'static str {
        Self::OF_TEXTS.iter().find(|(kind, _)| *kind == self).map_or("", |(_, name)| name)
    }
}

/// Three sensors.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensors {
    /// The columns of the axes 1, 2, 3; with `negative` those of the positive channels.
    pub columns: [ColumnRef; AXES],
    /// The columns of the negative channels, where each channel has its own.
    pub negative: Option<[ColumnRef; AXES]>,
    /// The time that counts and rates are over \[s\]; `None` of counts: the nominal interval.
    pub gate_s: Option<f64>,
    /// What the numbers are.
    pub kind: Kind,
    /// What is taken off each number first, such as the digital zero of an unsigned count, in the column's unit.
    pub offset: f64,
    /// One pulse, in the column's unit; `None`: 1 for whole numbers, otherwise 1e-6.
    pub resolution: Option<f64>,
    /// 1, or -1 for an axis that points the other way.
    pub sign: [f64; AXES],
    /// One of the column's unit \[m/s2 or rad/s; of increments m/s or rad\]; `None`: 1 for readings, unless the numbers
    /// are counts.
    pub unit: Option<f64>,
    /// Largest reading of the type, in the column's unit.
    pub range: Option<f64>,
    /// The column of the time \[us\] that each number was summed up over; the readings are the numbers over this time.
    pub duration: Option<ColumnRef>,
}

/// What the numbers of a section can be.
#[derive(Clone, Copy)]
struct NumberRules {
    kinds: &'static [(Kind, &'static str)],
    /// Whether they come as they are measured, so that their temperature has an age.
    are_live: bool,
    /// Whether they are means, without the time of a row.
    are_means: bool,
}

impl Sensors {
    /// All columns of pulses or readings.
    pub fn all(&self) -> impl Iterator<Item = &ColumnRef> {
        self.columns.iter().chain(self.negative.iter().flatten())
    }
}

/// Where the temperature comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum Temperature {
    /// From columns. Each is for all sensors, for an axis, or for one sensor.
    Columns {
        /// 1, 3 or 6 columns of the sensor heads.
        head: Vec<ColumnRef>,
        /// 1, 3 or 6 columns of the converter boards; those of the heads if there are none of their own.
        board: Vec<ColumnRef>,
        /// What makes temperature of the numbers; `None`: they are temperature.
        linear: Option<Linear>,
    },
    /// The same for all rows.
    Constant(f64),
}

/// The columns of an IMU's sensors.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorColumns {
    /// The accelerometers.
    pub accelerometer: Sensors,
    /// The gyroscopes, if the IMU has any.
    pub gyroscope: Option<Sensors>,
    /// The temperature.
    pub temperature: Temperature,
    /// The age at which the temperature of an acquisition's source is stale \[s\], which may be infinite; `None`: by
    /// its pace.
    pub temperature_max_age_s: Option<f64>,
}

impl SensorColumns {
    /// Reads the three sections. With `header` columns have names, otherwise numbers. Faults are added to `document`.
    pub fn read(document: &Document<'_>, root: &Section<'_, '_>, header: bool) -> Option<Self> {
        Self::sections(
            document,
            root,
            header,
            false,
            NumberRules { kinds: &Kind::OF_SIGNALS, are_live: true, are_means: false },
        )
    }

    /// As [`read`](Self::read), of a text, which may have the pulses of a converter. With `two_files` accelerometers
    /// and gyroscopes are in two files, whose columns may have the same names.
    pub(super) fn of_text(
        document: &Document<'_>,
        root: &Section<'_, '_>,
        header: bool,
        two_files: bool,
        are_means: bool,
    ) -> Option<Self> {
        Self::sections(
            document,
            root,
            header,
            two_files,
            NumberRules { kinds: &Kind::OF_TEXTS, are_live: false, are_means },
        )
    }

    fn sections(
        document: &Document<'_>,
        root: &Section<'_, '_>,
        header: bool,
        of_two_files: bool,
        numbers: NumberRules,
    ) -> Option<Self> {
        let accelerometer = root
            .section("accelerometer", "a section [accelerometer]")
            .and_then(|s| sensors(s, header, Quantity::Acceleration, numbers));
        let mixed = root.optional_section("gyroscope");
        let has_gyroscope = mixed.is_some();
        let gyroscope = mixed.and_then(|section| {
            let line = section.line();
            let path = section.key(if section.has("positive") { "positive" } else { "columns" });
            let sensors = sensors(section, header, Quantity::Rate, numbers);
            if let (Some(a), Some(g)) = (&accelerometer, &sensors)
                && !of_two_files
                && a.all().any(|column| g.all().any(|other| other == column))
            {
                document.fault(
                    line,
                    path,
                    "has a column of the accelerometers; give that of the gyroscope, or its own file with \
                     --gyroscope-file",
                );
            }
            sensors
        });
        let temperature = root.section("temperature", "a section [temperature]");
        let temperature_max_age_s = match &temperature {
            Some(section) if numbers.are_live => section.optional_limit("temperature_max_age_s"),
            _ => None,
        };
        let temperature = temperature.and_then(|section| temperature_of(section, header, has_gyroscope));
        Some(Self { accelerometer: accelerometer?, gyroscope, temperature: temperature?, temperature_max_age_s })
    }
}

/// The columns of a key: names, or without a header numbers.
pub(super) fn columns(
    section: &Section<'_, '_>,
    key: &'static str,
    counts: &[usize],
    expected: &str,
    header: bool,
) -> Option<Vec<ColumnRef>> {
    if section.is_open(key) {
        section.fault(key, format!("has a \"?\", which is to be filled in; give {expected}"));
        section.ignore(key);
        return None;
    }
    let columns: Vec<_> = if header {
        let expected = format!("{expected}, by name as in the header");
        section.strings(key, &expected)?.into_iter().map(|name| ColumnRef::Name(name.trim().to_owned())).collect()
    } else {
        if !section.has(key) {
            section.fault(key, format!("missing; give {expected}, by number from 1"));
        }
        let numbers = section.optional_integers(key, 1..=MAX_COLUMN)?;
        numbers.into_iter().map(|number| ColumnRef::Number(number as usize)).collect()
    };
    if counts.contains(&columns.len()) {
        return Some(columns);
    }
    section.fault(key, format!("has {} columns, give {expected}", columns.len()));
    None
}

fn sensors(section: Section<'_, '_>, header: bool, quantity: Quantity, numbers: NumberRules) -> Option<Sensors> {
    let kind = section.choice("kind", numbers.kinds);
    let is_of_pulses = kind.is_some_and(Kind::is_of_pulses);
    let duration = match section.has("duration_us") && !numbers.are_live {
        true => columns(&section, "duration_us", &[1], "the column of the time of the sums", header)?.pop(),
        false => None,
    };
    let [columns, negative] = match section.has("positive") || section.has("negative") {
        true => channels(&section, kind, header)?,
        false => {
            let columns = columns(&section, "columns", &[AXES], THREE, header);
            let twice = columns.iter().find_map(|columns| (1..AXES).find(|at| columns[..*at].contains(&columns[*at])));
            let message = "has one column for two axes; give three different columns";
            section.refuse("columns", twice.map(|_| message.to_owned()));
            [columns, None]
        }
    };
    let gate_s = gate(&section, kind, numbers.are_means);
    let offset = section.optional_number("offset").unwrap_or(0.0);
    let resolution = section.optional_number("resolution");
    section.refuse(
        "resolution",
        resolution
            .filter(|resolution| *resolution <= 0.0 || !(1.0 / resolution).is_finite())
            .map(|resolution| format!("is {resolution}, give one pulse in the column's unit, over 0")),
    );
    let unit = section.optional_choice("unit", &quantity.choices());
    let scale = section.optional_number("scale");
    let wrong = scale.filter(|scale| *scale <= 0.0);
    section.refuse(
        "scale",
        wrong.map(|scale| format!("is {scale}, give one of the column's unit in m/s2, rad/s, m/s or rad, over 0")),
    );
    let both = section.has("unit") && section.has("scale");
    section.refuse("scale", both.then(|| "is given in addition to unit; give one of them".to_owned()));
    let unit = unit.or(scale);
    let range = section.optional_number("range");
    let wrong = range.filter(|range| *range <= 0.0);
    section.refuse(
        "range",
        wrong.map(|range| format!("is {range}, give the largest reading in the column's unit, over 0")),
    );
    let not_of_kind: &[&'static str] = match kind {
        Some(Kind::Increment) => &["unit", "range", "duration_us"],
        Some(Kind::Count | Kind::Rate) => &["unit", "range", "scale", "offset", "resolution", "duration_us"],
        _ => &[],
    };
    for key in not_of_kind.iter().filter(|key| section.has(key)) {
        let name = kind.map_or("", Kind::name);
        section.fault(key, format!("is for readings, and kind is \"{name}\"; leave it out"));
    }
    let sign = signs(&section);
    section.finish();
    let three = |columns: Vec<ColumnRef>| <[ColumnRef; AXES]>::try_from(columns).ok();
    let negative = negative.map(three);
    let resolution = if is_of_pulses {
        Some(gate_s.filter(|_| kind == Some(Kind::Rate)).map_or(1.0, f64::recip))
    } else {
        resolution
    };
    Some(Sensors {
        columns: three(columns?)?,
        negative: negative.flatten(),
        gate_s,
        kind: kind?,
        offset,
        resolution,
        sign: sign?,
        unit,
        range,
        duration,
    })
}

/// What a key of three columns has to be.
const THREE: &str = "three columns, of the axes 1, 2, 3";

/// The columns of the positive and of the negative channels; `None` if one of them is missing.
fn channels(section: &Section<'_, '_>, kind: Option<Kind>, header: bool) -> Option<[Option<Vec<ColumnRef>>; 2]> {
    section.ignore("columns");
    if section.has("columns") {
        section.fault(
            "columns",
            "is given in addition to positive and negative; give one number an axis, or both channels",
        );
    }
    if kind.is_some_and(|kind| !kind.is_of_pulses()) {
        let key = if section.has("positive") { "positive" } else { "negative" };
        section.fault(key, "is for pulses: give kind = \"count\" or \"rate\", or columns in its place");
    }
    let both = ["positive", "negative"].map(|key| columns(section, key, &[AXES], THREE, header));
    let [Some(positive), Some(negative)] = &both else { return None };
    let all: Vec<_> = positive.iter().chain(negative).collect();
    let twice = (1..all.len()).any(|at| all[..at].contains(&all[at]));
    section.refuse("negative", twice.then(|| "has one column for two channels; give six different ones".to_owned()));
    Some(both)
}

/// The time that counts and rates are over \[s\].
fn gate(section: &Section<'_, '_>, kind: Option<Kind>, are_means: bool) -> Option<f64> {
    const KEY: &str = "gate_s";
    const EXPECTED: &str = "the time that the pulses were counted over [s], for example gate_s = 10";
    if section.is_open(KEY) {
        section.ignore(KEY);
        section.fault(KEY, format!("is \"?\", which is to be filled in; give {EXPECTED}"));
        return None;
    }
    // Means of rates are rates, over whatever time; those of counts need it.
    if let Some(needs @ (Kind::Rate | Kind::Count)) = kind
        && (needs == Kind::Count) == are_means
        && !section.has(KEY)
    {
        section.ignore(KEY);
        section.fault(KEY, format!("missing; kind = \"{}\" needs {EXPECTED}", needs.name()));
        return None;
    }
    let gate_s = section.optional_number(KEY)?;
    let is_right = (1e-6..=MAX_INTERVAL_NS as f64 / 1e9).contains(&gate_s);
    let fault = match kind {
        Some(kind) if !kind.is_of_pulses() => {
            Some(format!("is for counts and rates, and kind is \"{}\"; leave it out", kind.name()))
        }
        _ => (!is_right).then(|| format!("is {gate_s}, give a number of seconds from 0.000001 to 3600")),
    };
    section.refuse(KEY, fault);
    is_right.then_some(gate_s)
}

/// The signs of the axes.
fn signs(section: &Section<'_, '_>) -> Option<[f64; AXES]> {
    let sign = match section.has("sign") {
        true => section.numbers("sign", "three signs, each 1 or -1"),
        false => {
            section.ignore("sign");
            Some(vec![1.0; AXES])
        }
    };
    let right = sign.and_then(|sign| <[f64; AXES]>::try_from(sign).ok());
    let right = right.filter(|sign| sign.iter().all(|sign| sign.abs() == 1.0));
    section.refuse("sign", right.is_none().then(|| "give three signs, each 1 or -1, of the axes 1, 2, 3".to_owned()));
    right
}

fn temperature_of(section: Section<'_, '_>, header: bool, gyroscopes: bool) -> Option<Temperature> {
    let (counts, expected): (&[_], _) = match gyroscopes {
        true => (&[1, 3, 6], "1 column of all sensors, 3 of the axes, or 6 of A1, A2, A3, G1, G2, G3"),
        false => (&[1, 3], "1 column of all sensors, or 3 of A1, A2, A3"),
    };
    let constant = section.optional_number("constant");
    let linear = linear(&section);
    let temperature = match (section.has("constant"), section.has("columns")) {
        (true, true) => {
            section.ignore("columns");
            section.fault("constant", "is given in addition to columns; give one of them");
            None
        }
        (true, false) => constant.map(Temperature::Constant),
        (false, true) => columns(&section, "columns", counts, expected, header).and_then(|head| {
            let board = match section.has("board_columns") {
                true => columns(&section, "board_columns", counts, expected, header)?,
                false => head.clone(),
            };
            Some(Temperature::Columns { head, board, linear })
        }),
        (false, false) => {
            section.fault("columns", "missing; give the columns of the temperature, or a constant");
            None
        }
    };
    section.ignore("columns");
    section.ignore("board_columns");
    for key in ["board_columns", "scale", "offset", "temperature_max_age_s"] {
        if section.has("constant") && section.has(key) {
            section.fault(key, "is there without columns; leave it out");
        }
    }
    section.finish();
    temperature
}

/// What makes temperature of the numbers: `number * scale + offset`.
fn linear(section: &Section<'_, '_>) -> Option<Linear> {
    let number = |key: &'static str, expected: &str| {
        if section.is_open(key) {
            section.fault(key, format!("is \"?\", which is to be filled in; give {expected}"));
            section.ignore(key);
            return None;
        }
        section.optional_number(key)
    };
    let scale = number("scale", "what one of the column's unit is in degC, as 0.00294117647 of an MPU-6050");
    let offset = number("offset", "what is added after the scale in degC, as 36.53 of an MPU-6050");
    let wrong = scale.filter(|scale| *scale == 0.0);
    section.refuse(
        "scale",
        wrong.map(|_| "is 0, give what one of the column's unit is, in the unit of the table".to_owned()),
    );
    let is_given = section.has("scale") || section.has("offset");
    is_given.then_some(Linear { scale: scale.unwrap_or(1.0), offset: offset.unwrap_or(0.0) })
}
