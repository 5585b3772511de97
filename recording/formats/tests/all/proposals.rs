//! The mapping that is found for a text gives the right readings, or leaves open by name what the text does not say.
//! What the header says of units is used.

use isotherm_recording_formats::convert::{Conversion, Scale, Settings};
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::{Exit, Failure};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use std::io::Cursor;
use std::path::Path;

const G: f64 = 9.80665;
const DEGREE: f64 = std::f64::consts::PI / 180.0;
const FORCE: [f64; 3] = [0.213, -0.117, 9.791];
const RATES: [f64; 3] = [0.0117, -0.0231, 0.0319];
const CELSIUS: f64 = 31.37;

/// Units of accelerations, rates, temperatures and times: how names say them, one of each in SI, and the offset.
const ACCELERATIONS: [(&str, f64); 16] = [
    (" [m/s^2]", 1.0),
    (" (m/s2)", 1.0),
    ("_mps2", 1.0),
    (" [m s^-2]", 1.0),
    ("(m/s\u{b2})", 1.0),
    ("_m_s2", 1.0),
    (" (ms-2)", 1.0),
    ("", 1.0),
    ("(g)", G),
    ("_g", G),
    (" [G]", G),
    ("", G),
    ("(mg)", G / 1e3),
    ("_mg", G / 1e3),
    (" [milli g]", G / 1e3),
    (" [ft/s2]", 0.3048),
];
const ANGULAR: [(&str, f64); 14] = [
    (" [rad/s]", 1.0),
    (" [rad s^-1]", 1.0),
    ("_rad_s", 1.0),
    ("", 1.0),
    ("(degree/s)", DEGREE),
    (" [deg/s]", DEGREE),
    (" (dps)", DEGREE),
    ("_dps", DEGREE),
    ("(\u{b0}/s)", DEGREE),
    (" [DEG/SEC]", DEGREE),
    ("_mdps", DEGREE / 1e3),
    (" (mrad/s)", 1e-3),
    (" [deg/h]", DEGREE / 3600.0),
    (" (rpm)", DEGREE * 6.0),
];
const THERMAL: [(&str, f64, f64); 8] = [
    ("temp", 1.0, 0.0),
    ("Temperature (degC)", 1.0, 0.0),
    ("T [\u{b0}C]", 1.0, 0.0),
    ("imu_degC", 1.0, 0.0),
    ("temp [K]", 1.0, -273.15),
    ("Temp (F)", 5.0 / 9.0, -160.0 / 9.0),
    ("temp [mdegC]", 1e-3, 0.0),
    ("temp", 1.0 / 340.0, 36.53),
];
const TIMES: [(&str, f64); 6] =
    [("time_s", 1.0), ("t [ms]", 1e3), ("micros", 1e6), ("timestamp(us)", 1e6), ("Time [ns]", 1e9), ("", 1.0)];
const NAMES: [[&str; 6]; 6] = [
    ["ax", "ay", "az", "gx", "gy", "gz"],
    ["Accelerometer X", "Accelerometer Y", "Accelerometer Z", "Gyroscope X", "Gyroscope Y", "Gyroscope Z"],
    ["aX", "aY", "aZ", "gX", "gY", "gZ"],
    ["a_RS_S_x", "a_RS_S_y", "a_RS_S_z", "w_RS_S_x", "w_RS_S_y", "w_RS_S_z"],
    ["accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z"],
    ["AccX", "AccY", "AccZ", "GyrX", "GyrY", "GyrZ"],
];

/// A text of a random header.
#[derive(Clone, Debug)]
struct Kind {
    names: [&'static str; 6],
    acceleration: (&'static str, f64),
    rate: (&'static str, f64),
    /// Whether only the first column says the unit.
    first_alone: bool,
    thermal: Option<(&'static str, f64, f64)>,
    time: (&'static str, f64),
    separator: &'static str,
    mark: &'static str,
    gyroscopes_first: bool,
    above: bool,
    /// Whether the texts has a magnetometer between the others.
    magnetometer: bool,
}

impl Kind {
    fn any() -> impl Strategy<Value = Self> {
        let of = (prop::sample::select(&NAMES[..]), prop::sample::select(&ACCELERATIONS[..]));
        let units = (prop::sample::select(&ANGULAR[..]), prop::option::of(prop::sample::select(&THERMAL[..])));
        let marks = [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")];
        let others = (prop::sample::select(&TIMES[..]), prop::sample::select(marks.to_vec()), any::<[bool; 4]>());
        (of, units, others).prop_map(|((names, acceleration), (rate, thermal), (time, (separator, mark), flags))| {
            let [first_alone, gyroscopes_first, above, magnetometer] = flags;
            Self {
                names,
                acceleration,
                rate,
                first_alone,
                thermal,
                time,
                separator,
                mark,
                gyroscopes_first,
                above,
                magnetometer,
            }
        })
    }

    fn text(&self) -> String {
        let named = |from: usize, unit: &str| -> Vec<String> {
            let says = |index: usize| index == 0 || !self.first_alone;
            (0..3).map(|index| self.names[from + index].to_owned() + if says(index) { unit } else { "" }).collect()
        };
        let mut header: Vec<String> = Vec::new();
        let (a, g) = (named(0, self.acceleration.0), named(3, self.rate.0));
        let (first, second) = if self.gyroscopes_first { (g, a) } else { (a, g) };
        let magnetometer = if self.magnetometer { &["mag_x [G]", "mag_y [G]", "mag_z [G]"][..] } else { &[] };
        let names = first.into_iter().chain(magnetometer.iter().map(|name| (*name).to_owned())).chain(second);
        header.extend((!self.time.0.is_empty()).then(|| self.time.0.to_owned()));
        header.extend(names);
        header.extend(self.thermal.map(|(name, ..)| name.to_owned()));
        let mut text = if self.above { "# made by a logger\n# rate 200 Hz\n" } else { "" }.to_owned();
        text += &(header.join(self.separator) + "\n");
        for row in 0..20 {
            let number = |value: f64| format!("{value:.9}");
            let a = FORCE.map(|force| number(force / self.acceleration.1));
            let g = RATES.map(|rate| number(rate / self.rate.1));
            let (first, second) = if self.gyroscopes_first { (g, a) } else { (a, g) };
            let mut fields = Vec::new();
            fields.extend((!self.time.0.is_empty()).then(|| number((7.0 + f64::from(row) * 0.005) * self.time.1)));
            fields.extend(first);
            fields.extend(magnetometer.iter().map(|_| "0.25".to_owned()));
            fields.extend(second);
            // Counts of a thermometer are whole numbers far from any temperature.
            let thermal = self.thermal.map(|(name, scale, offset)| ((CELSIUS - offset) / scale, name, scale));
            fields.extend(
                thermal.map(|(value, ..)| if value.abs() > 1e3 { format!("{value:.0}") } else { number(value) }),
            );
            text += &(fields.join(self.separator).replace('.', self.mark) + "\n");
        }
        text
    }
}

fn open(text: &str, mapping: Option<&str>) -> Result<Conversion, Failure> {
    let named = mapping.map(|mapping| (Path::new("m.toml"), mapping));
    Conversion::of_text(Path::new("in.csv"), Cursor::new(text.to_owned()), named, &Settings::default())
}

/// The mapping that is proposed; `None` if nothing in it is open, so that it is used.
fn proposed(text: &str) -> Option<String> {
    let failure = open(text, None).err()?;
    assert_eq!(failure.exit, Exit::Usage, "{failure}\n{text}");
    Some(failure.message.split_once("\n\n").unwrap().1.to_owned())
}

fn proposal(text: &str) -> String {
    proposed(text).unwrap_or_else(|| panic!("{text}"))
}

fn converted(text: &str, mapping: &str) -> (Vec<RawSample>, Scale, Vec<String>) {
    read(text, open(text, Some(mapping)), mapping)
}

fn read(text: &str, conversion: Result<Conversion, Failure>, mapping: &str) -> (Vec<RawSample>, Scale, Vec<String>) {
    let mut conversion = conversion.unwrap_or_else(|failure| panic!("{failure}\n{mapping}\n{text}"));
    let samples =
        conversion.by_ref().collect::<Result<Vec<_>, _>>().unwrap_or_else(|failure| panic!("{failure}\n{text}"));
    let scale = conversion.scale().unwrap_or_else(|why| panic!("{why}\n{mapping}\n{text}"));
    (samples, scale, conversion.notes())
}

/// Readings of accelerometers and gyroscopes in m/s2 and rad/s.
fn readings(sample: &RawSample, scale: &Scale) -> [f64; 6] {
    let net = |positive: u32, negative: u32| f64::from(positive) - f64::from(negative);
    std::array::from_fn(|index| {
        let triad = if index < 3 { &sample.accelerometers } else { &sample.gyroscopes };
        let factor = if index < 3 { scale.resolution.accelerometer } else { scale.resolution.gyroscope };
        net(triad.positive_pulses[index % 3], triad.negative_pulses[index % 3]) * factor
    })
}

/// The same texts at every run; other ones with `ISOTHERM_SEED`.
fn config() -> ProptestConfig {
    let seed = std::env::var("ISOTHERM_SEED").ok().and_then(|seed| seed.parse().ok()).unwrap_or(1);
    ProptestConfig {
        cases: 600,
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(seed),
        ..ProptestConfig::default()
    }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn a_proposal_is_right_or_open(kind in Kind::any()) {
        let text = kind.text();
        if let Some(mapping) = proposed(&text) {
            let failure = open(&text, Some(&mapping)).err().unwrap();
            prop_assert_eq!(failure.exit, Exit::Config);
            let is_unsaid = |unit: &str| unit.is_empty() || ["ft", "rpm"].iter().any(|other| unit.contains(other));
            let counts = kind.thermal.is_some_and(|of| of.2 == 36.53);
            let open = [
                ("time.interval_s", kind.time.0.is_empty() && !kind.above),
                ("accelerometer.unit", is_unsaid(kind.acceleration.0)),
                ("gyroscope.unit", is_unsaid(kind.rate.0)),
                ("temperature.scale", counts),
            ];
            for (key, is_open) in open {
                prop_assert_eq!(failure.message.contains(key), is_open, "{} {}\n{}\n{}", key, failure, mapping, text);
            }
            prop_assert!(open.iter().any(|(_, is_open)| *is_open));
            return Ok(());
        }
        let (samples, scale, notes) = read(&text, open(&text, None), "");
        // The mapping that is printed is the one that was used.
        let mapping = notes[0].split_once("\n\n").unwrap().1;
        prop_assert!(samples == converted(&text, mapping).0, "{}\n{}", mapping, text);
        prop_assert_eq!((samples.len(), scale.interval_ns), (20, 5_000_000), "{}\n{}", mapping, text);
        for (found, right) in readings(&samples[7], &scale).into_iter().zip(FORCE.into_iter().chain(RATES)) {
            prop_assert!((found / right - 1.0).abs() < 1e-2, "{} {}\n{}\n{}", found, right, mapping, text);
        }
        if kind.thermal.is_some() {
            let found = samples[7].accelerometers.head_temperature[0];
            prop_assert!((found - CELSIUS).abs() < 0.01, "{}\n{}\n{}", found, mapping, text);
        }
    }

    /// Any names and numbers: the proposal is accepted, or leaves open what is missing; nothing panics.
    #[test]
    fn any_header_has_a_proposal(
        names in prop::collection::vec(NAME, 3..9),
        numbers in prop::collection::vec(-20000..20000_i32, 27),
        is_whole in any::<bool>(),
    ) {
        let quoted = names.iter().map(|name| format!("\"{}\"", name.replace('"', "\"\"")));
        let mut text = quoted.collect::<Vec<_>>().join(",") + "\n";
        for row in numbers.chunks_exact(9) {
            let real = |value: &i32| (f64::from(*value) * 0.37).to_string();
            let field = |value: &i32| if is_whole { value.to_string() } else { real(value) };
            text += &(row[..names.len()].iter().map(field).collect::<Vec<_>>().join(",") + "\n");
        }
        let Err(failure) = open(&text, None) else { return Ok(()) };
        let Some((_, mapping)) = failure.message.split_once("\n\n") else { return Ok(()) };
        if let Err(failure) = open(&text, Some(mapping)) {
            let is_open = failure.exit == Exit::Config && mapping.contains("\"?");
            prop_assert!(is_open || failure.exit == Exit::Data, "{}\n{}", failure, mapping);
        }
    }
}

/// Names of columns, of which some are like those of sensors.
const NAME: &str = "[ -~]{0,12}|(acc|gyr|a|g|temp|mag|time)[_ ]?[xyz]?[_ (\\[]?(g|dps|m/s2|K)?[)\\]]?";
const TEXT: &str = "t,ax(g),ay,az,gx(deg/s),gy,gz,temp\n\
     0.01,0.01,0.02,0.998,0.3,-0.2,0.1,25.1\n\
     0.02,0.01,0.02,0.998,0.3,-0.2,0.1,25.2\n";
const MAPPING: &str = "format = 1\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[accelerometer]\n\
     columns = [\"ax(g)\", \"ay\", \"az\"]\n\
     kind = \"reading\"\n\
     [gyroscope]\ncolumns = [\"gx(deg/s)\", \"gy\", \"gz\"]\nkind = \"reading\"\n[temperature]\ncolumns = \"temp\"\n";

#[test]
fn what_the_header_says_is_used_and_a_contradiction_refused() {
    let (samples, scale, notes) = converted(TEXT, MAPPING);
    let found = readings(&samples[0], &scale);
    assert!((found[2] - 0.998 * G).abs() < 1e-5 && (found[3] - 0.3 * DEGREE).abs() < 1e-7, "{found:?}");
    assert!(notes.iter().any(|note| note == "gyroscope: the unit is deg/s, as the header says"), "{notes:?}");
    let with = |section: &str, key: &str| MAPPING.replace(&format!("[{section}]\n"), &format!("[{section}]\n{key}\n"));
    let refused = open(TEXT, Some(&with("gyroscope", "unit = \"rad/s\""))).err().unwrap();
    assert_eq!(refused.exit, Exit::Data);
    let expected = "in.csv:1: gyroscope.unit: the mapping says rad/s, but the header says deg/s (gx(deg/s), gy, gz)";
    assert!(refused.message.starts_with(expected), "{refused}");
    // A scale is the last word.
    let (samples, scale, _) = converted(TEXT, &with("gyroscope", "scale = 0.0174"));
    assert!((readings(&samples[0], &scale)[3] - 0.3 * 0.0174).abs() < 1e-7);
    let other = open(&TEXT.replace("(deg/s)", "(m/s^2)"), Some(&MAPPING.replace("(deg/s)", "(m/s^2)"))).err().unwrap();
    assert!(other.message.contains("gyroscope.columns: the header says m/s^2"), "{other}");
    let kelvin = |keys: &str| MAPPING.replace("\"temp\"", &format!("\"temp (K)\"\n{keys}"));
    let text = TEXT.replace("temp", "temp (K)").replace("25.", "298.");
    let refused = open(&text, Some(&kelvin(""))).err().unwrap();
    assert!(refused.message.contains("temperature.offset = -273.15"), "{refused}");
    let celsius = |keys: &str| converted(&text, &kelvin(keys)).0[0].accelerometers.head_temperature[1];
    assert!((celsius("scale = 1\noffset = -273.15") - 24.95).abs() < 1e-9);
    assert!((celsius("scale = 1") - 298.1).abs() < 1e-9);
}

#[test]
fn temperatures_have_a_scale_and_then_an_offset() {
    let mapping = MAPPING.replace("\"temp\"", "\"temp\"\nscale = 0.00294117647\noffset = 36.53");
    let text = TEXT.replace("25.1", "-3400").replace("25.2", "680");
    let (samples, scale, _) = converted(&text, &mapping);
    let found = [0, 1].map(|row| samples[row].gyroscopes.head_temperature[2]);
    assert!((found[0] - 26.53).abs() < 1e-6 && (found[1] - 38.53).abs() < 1e-6, "{found:?}");
    assert!((scale.temperature[0] - 26.53).abs() < 1e-6 && (scale.temperature[1] - 38.53).abs() < 1e-6);
    // The offset of counts, as the sensors have it: taken off before the scale.
    let counts = mapping.replace("36.53", "-12420");
    let (samples, _, notes) = converted(&text, &counts);
    let found = [0, 1].map(|row| samples[row].gyroscopes.head_temperature[2]);
    assert!((found[0] - 26.5294).abs() < 1e-3 && (found[1] - 38.5294).abs() < 1e-3, "{found:?}");
    assert!(notes.iter().any(|note| note.contains("-12420 is taken off before the scale")), "{notes:?}");
    for (keys, expected) in [
        ("scale = 0", "temperature.scale: is 0"),
        ("scale = \"?\"", "m.toml:13: temperature.scale: is \"?\", which is to be filled in"),
        ("offset = \"?\"", "temperature.offset: is \"?\", which is to be filled in"),
    ] {
        let refused = open(&text, Some(&MAPPING.replace("\"temp\"", &format!("\"temp\"\n{keys}")))).err().unwrap();
        assert!(refused.exit == Exit::Config && refused.message.contains(expected), "{refused}");
    }
    let constant = MAPPING.replace("columns = \"temp\"", "constant = 25.0\nscale = 2");
    assert!(
        open(&text, Some(&constant)).err().unwrap().message.contains("temperature.scale: is there without columns")
    );
}

#[test]
fn an_interval_that_nothing_says_is_asked_for() {
    let text = "ax_g,ay,az\n0.1,0.2,0.979\n0.1,0.2,0.978\n";
    let mapping = proposal(text);
    let refused = open(text, Some(&mapping)).err().unwrap();
    let expected = "m.toml:3: time.interval_s: is \"?\", which is to be filled in; give the nominal interval in s here, \
                    or with --interval";
    assert!(refused.exit == Exit::Config && refused.message == expected, "{refused}");
    let settings = Settings { interval_ns: Some(4_000_000), ..Settings::default() };
    let named = Some((Path::new("m.toml"), mapping.as_str()));
    for named in [named, None] {
        let conversion = Conversion::of_text(Path::new("in.csv"), Cursor::new(text), named, &settings).unwrap();
        assert_eq!(conversion.interval_ns(), 4_000_000);
    }
}

#[test]
fn a_temperature_that_is_given_leaves_none_open() {
    let text = TEXT.replace("25.1", "-3400").replace("25.2", "680").replace("t,ax", "t_s,ax");
    assert!(proposal(&text).contains("scale = \"?\""));
    let settings = Settings { temperature: Some(30.5), ..Settings::default() };
    let conversion = Conversion::of_text(Path::new("in.csv"), Cursor::new(text), None, &settings).unwrap();
    let celsius: Vec<_> = conversion.map(|sample| sample.unwrap().gyroscopes.head_temperature[0]).collect();
    assert_eq!(celsius, [30.5, 30.5]);
}

#[test]
fn blanks_within_names_are_no_separators_where_a_column_is_missing() {
    let header = "#time [ns],w x [rad s^-1],w y [rad s^-1],w z [rad s^-1],acc x [m s^-2],acc y [m s^-2],acc z [m s^-2]";
    let text = format!("{header}\n1000000,1,2,3,4,5,6.5\n2000000,1,2,3,4,5,6\n");
    let refused = open(&text, Some(&MAPPING.replace("gx(deg/s)", "w x"))).err().unwrap();
    assert!(refused.message.contains("found: time [ns], w x [rad s^-1], w y [rad s^-1]"), "{refused}");
    assert_eq!(open(&text, None).unwrap().count(), 2);
}

/// A mapping has the columns that the reader reads, whatever is between the fields.
#[test]
fn a_proposal_and_the_reader_split_a_line_alike() {
    let row = |second: u32| format!("2026-05-01 12:00:0{second}.5\t0.25\t-0.5\t9.75\t25.5\n");
    let text: String = (0..3).map(row).collect();
    let mapping = proposal(&text);
    assert!(mapping.contains("column = 1\n") && mapping.contains("# three of 2, 3, 4, 5\n"), "{mapping}");
    let mapping = mapping
        .replace("[\"?1\", \"?2\", \"?3\"]", "[2, 3, 4]")
        .replace("constant = 25.0", "columns = 5")
        .replace("unit = \"?\"", "unit = \"m/s2\"");
    let samples = converted(&text, &mapping).0;
    let first = samples[0].accelerometers;
    assert_eq!(first.positive_pulses, [250_000, 0, 9_750_000]);
    assert_eq!((samples.len(), first.head_temperature[0], samples[0].interval_ns), (3, 25.5, 1_000_000_000));
    // The same with names, which have blanks, too.
    let text = format!("Date and Time\tax [m/s2]\tay\taz\ttemp [degC]\n{text}");
    assert_eq!(open(&text, None).unwrap().map(Result::unwrap).collect::<Vec<_>>(), samples);
}
