//! The units that the names of columns say, in all usual spellings.

use isotherm_shared::table::STANDARD_GRAVITY;

/// A unit, as a mapping names it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct NumberUnit {
    pub(super) name: &'static str,
    /// One of it \[m/s2 or rad/s\].
    pub(super) factor: f64,
}

impl NumberUnit {
    /// One pulse of readings in it: finer than noise, with room for the range of every IMU.
    pub(super) const fn resolution(self) -> &'static str {
        if self.factor < 0.01 { "1e-3" } else { "1e-6" }
    }
}

/// What three sensors measure.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Quantity {
    Acceleration,
    Rate,
}

/// The units of accelerations that a mapping may name, with one of each \[m/s2\].
#[must_use]
pub fn acceleration_units() -> Vec<(f64, &'static str)> {
    Quantity::Acceleration.choices()
}

/// The units of rates that a mapping may name, with one of each \[rad/s\].
#[must_use]
pub fn rate_units() -> Vec<(f64, &'static str)> {
    Quantity::Rate.choices()
}

/// The unit that a header says.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum UnitWord {
    Nothing,
    Unit(NumberUnit),
    /// Brackets around this text, which is no unit of the quantity.
    Unknown(String),
}

/// What makes degrees Celsius of the numbers of a column: `number * scale + offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linear {
    /// One of the column's unit \[K\].
    pub scale: f64,
    /// What is added after the scale \[degC\].
    pub offset: f64,
}

/// What temperature of an IMU is, with a wide margin \[degC\].
const CREDIBLE: core::ops::Range<f64> = -150.0..250.0;

impl Linear {
    /// Of numbers that are degrees Celsius.
    pub(super) const CELSIUS: Self = Self { scale: 1.0, offset: 0.0 };

    /// Settles what the offset means by the first number: degrees that are added after the scale; or counts that are
    /// taken off before it, as those of the sensors, if only that makes a temperature of the number. Returns a note of
    /// the latter.
    pub(super) fn settle(&mut self, first: f64) -> Option<String> {
        let added = first * self.scale + self.offset;
        let before = Self { offset: -self.offset * self.scale, ..*self };
        let taken_off = first * before.scale + before.offset;
        let is_before = !CREDIBLE.contains(&added) && CREDIBLE.contains(&taken_off);
        let note = is_before.then(|| {
            format!(
                "temperature.offset: {} is taken off before the scale, as the sensors' offset is, which makes {taken_off:.1} degC of \
                 the first number; added after it, it would make {added:.1} degC",
                self.offset
            )
        });
        if is_before {
            *self = before;
        }
        note
    }
}

/// A unit of temperatures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Thermal {
    pub(super) name: &'static str,
    pub(super) linear: Linear,
}

const DEGREE: f64 = core::f64::consts::PI / 180.0;

/// Units and their canonical spellings.
type Spellings = [(NumberUnit, &'static [&'static str])];

/// A g is the standard one, whatever gravity is where the IMU is.
const ACCELERATIONS: &Spellings = &[
    (
        NumberUnit { name: "m/s2", factor: 1.0 },
        &["m/s2", "m/s/s", "m/ss", "ms-2", "ms2", "mps2", "mpss", "mps/s", "m/s\u{fffd}"],
    ),
    (NumberUnit { name: "g", factor: STANDARD_GRAVITY }, &["g", "gs", "g0", "gn", "gee", "g-force", "gforce"]),
    (NumberUnit { name: "mg", factor: STANDARD_GRAVITY / 1e3 }, &["mg", "mgs", "mg0", "mgn"]),
];

const RATES: &Spellings = &[
    (NumberUnit { name: "rad/s", factor: 1.0 }, &["rad/s", "rads-1", "rads", "radps"]),
    (
        NumberUnit { name: "deg/s", factor: DEGREE },
        &["deg/s", "degs-1", "degs", "degps", "dps", "\u{fffd}/s", "\u{fffd}s-1"],
    ),
    (NumberUnit { name: "mrad/s", factor: 1e-3 }, &["mrad/s", "mrads-1", "mrads", "mradps"]),
    (NumberUnit { name: "mdeg/s", factor: DEGREE / 1e3 }, &["mdeg/s", "mdegs-1", "mdegs", "mdegps", "mdps"]),
    (NumberUnit { name: "deg/h", factor: DEGREE / 3600.0 }, &["deg/h", "degh-1", "degph", "dph", "\u{fffd}/h"]),
];

/// Temperatures: the unit, its scale and offset, and its canonical spellings.
const THERMAL: [(Thermal, &[&str]); 4] = [
    (thermal("degC", 1.0, 0.0), &["degc", "c", "\u{fffd}c"]),
    (thermal("K", 1.0, -273.15), &["k", "degk"]),
    (thermal("degF", 5.0 / 9.0, -160.0 / 9.0), &["degf", "f", "\u{fffd}f"]),
    (thermal("mdegC", 1e-3, 0.0), &["mdegc"]),
];

/// Units of time, how names write them, and their length \[s\].
pub(super) const TIMES: [(&str, &str, f64); 4] =
    [("ns", "nano", 1e-9), ("us", "micro", 1e-6), ("ms", "milli", 1e-3), ("s", "sec", 1.0)];

const OPEN: [char; 4] = ['[', '(', '{', '<'];
const CLOSE: [char; 4] = [']', ')', '}', '>'];
/// Longest text that can be a unit \[bytes\].
const LONGEST: usize = 40;

/// Words in brackets that say that the numbers have no unit.
const COUNTS: [&str; 12] =
    ["lsb", "lsbs", "count", "counts", "raw", "adc", "digit", "digits", "int16", "bit", "bits", "ticks"];

/// What is written in several ways, and how the spellings above have it.
const WORDS: [(&str, &str); 20] = [
    ("fahrenheit", "f"),
    ("squared", "2"),
    ("milli", "m"),
    ("micro", "u"),
    ("degrees", "deg"),
    ("degree", "deg"),
    ("radians", "rad"),
    ("radian", "rad"),
    ("meters", "m"),
    ("metres", "m"),
    ("meter", "m"),
    ("metre", "m"),
    ("seconds", "s"),
    ("second", "s"),
    ("sec", "s"),
    ("hour", "h"),
    ("hr", "h"),
    ("per", "/"),
    ("celsius", "c"),
    ("kelvin", "k"),
];

const fn thermal(name: &'static str, scale: f64, offset: f64) -> Thermal {
    Thermal { name, linear: Linear { scale, offset } }
}

impl Quantity {
    const fn spellings(self) -> &'static Spellings {
        match self {
            Self::Acceleration => ACCELERATIONS,
            Self::Rate => RATES,
        }
    }

    /// The section of a mapping.
    pub(super) const fn section(self) -> &'static str {
        match self {
            Self::Acceleration => "accelerometer",
            Self::Rate => "gyroscope",
        }
    }

    /// The units that a mapping may name, with one of each \[m/s2 or rad/s\].
    pub(super) fn choices(self) -> Vec<(f64, &'static str)> {
        self.spellings().iter().map(|(unit, _)| (unit.factor, unit.name)).collect()
    }

    /// The unit with this factor, if a mapping can name it.
    pub(super) fn named(self, factor: f64) -> Option<NumberUnit> {
        self.spellings().iter().map(|(unit, _)| *unit).find(|unit| unit.factor == factor)
    }

    /// Whether a text is a unit of the other quantity.
    pub(super) fn is_other(self, text: &str) -> bool {
        let other = match self {
            Self::Acceleration => Self::Rate,
            Self::Rate => Self::Acceleration,
        };
        other.unit(text).is_some()
    }

    fn unit(self, text: &str) -> Option<NumberUnit> {
        let text = canonical(text);
        self.spellings().iter().find(|(_, all)| all.contains(&text.as_str())).map(|(unit, _)| *unit)
    }

    /// The unit that the name of a column says: in brackets, or in its last parts, as in `ax_m_s2` and `gyro_dps_x`.
    pub(super) fn said(self, name: &str) -> UnitWord {
        let mut unknown = None;
        for text in bracketed(name) {
            if let Some(unit) = self.unit(text) {
                return UnitWord::Unit(unit);
            }
            let is_count = COUNTS.contains(&text.to_lowercase().trim());
            unknown = unknown.or((!is_count).then_some(text));
        }
        let found = endings(name).iter().find_map(|ending| self.unit(ending));
        match (found, unknown) {
            (Some(unit), _) => UnitWord::Unit(unit),
            (None, Some(text)) => UnitWord::Unknown(text.trim().to_owned()),
            (None, None) => UnitWord::Nothing,
        }
    }

    /// The unit of three columns. One that says it says it for all.
    pub(super) fn of_triad(self, names: [&str; 3]) -> UnitWord {
        let mut joint = UnitWord::Nothing;
        for said in names.map(|name| self.said(name)) {
            joint = match (joint, said) {
                (joint, UnitWord::Nothing) => joint,
                (UnitWord::Nothing, said) => said,
                (UnitWord::Unit(one), UnitWord::Unit(other)) if one != other => {
                    return UnitWord::Unknown(format!("{} and {}", one.name, other.name));
                }
                (UnitWord::Unknown(_), UnitWord::Unit(unit)) => UnitWord::Unit(unit),
                (joint, _) => joint,
            };
        }
        joint
    }
}

/// The unit that the name of a column of temperatures says.
pub(super) fn of_temperature(name: &str) -> Option<Thermal> {
    let of = |text: &str| {
        let text = canonical(text);
        THERMAL.iter().find(|(_, all)| all.contains(&text.as_str())).map(|(thermal, _)| *thermal)
    };
    bracketed(name).find_map(of).or_else(|| endings(name).iter().find_map(|ending| of(ending)))
}

/// The unit of time that a name says.
pub(super) fn of_time(name: &str) -> Option<&'static str> {
    let parts = parts(name);
    let says = |unit: &str, long: &str| parts.iter().any(|part| part == unit || part.starts_with(long));
    TIMES.iter().find(|(unit, long, _)| says(unit, long)).map(|(unit, ..)| *unit)
}

/// The texts in brackets, without indices such as `[0]`.
pub(super) fn bracketed(name: &str) -> impl Iterator<Item = &str> {
    name.split(OPEN).skip(1).filter_map(|text| {
        let text = text.split(CLOSE).next().unwrap_or_default();
        (!text.trim().is_empty() && text.len() <= LONGEST && !is_index(text)).then_some(text)
    })
}

fn is_index(text: &str) -> bool {
    text.bytes().all(|byte| byte.is_ascii_digit())
}

/// The name without brackets and what is in them. An index stays.
pub(super) fn without_brackets(name: &str) -> String {
    let (mut plain, mut rest) = (String::new(), name);
    while let Some((before, inside)) = rest.split_once(OPEN) {
        let (text, after) = inside.split_once(CLOSE).unwrap_or((inside, ""));
        plain.push_str(before);
        if is_index(text) {
            plain = plain + "[" + text + "]";
        } else {
            plain.push(' ');
        }
        rest = after;
    }
    plain + rest
}

/// The last parts of a name, the longest first; then those before an axis at the end.
fn endings(name: &str) -> Vec<String> {
    let base = without_brackets(name);
    let base = match base.trim().strip_suffix(']').and_then(|base| base.rsplit_once('[')) {
        Some((base, _)) => base,
        None => base.trim(),
    };
    let of = |text: &str| {
        let ends =
            text.char_indices().filter(|(at, letter)| text.len() - at <= LONGEST && "_ -.:,\t".contains(*letter));
        ends.map(|(at, letter)| text[at + letter.len_utf8()..].to_owned()).collect::<Vec<_>>()
    };
    let before =
        base.rsplit_once(['_', ' ', '-', '.']).filter(|(_, last)| ["x", "y", "z", "X", "Y", "Z"].contains(last));
    of(base).into_iter().chain(before.map_or_else(Vec::new, |(text, _)| of(text))).collect()
}

/// A unit in lower case without blanks, powers and signs of multiplication, with short words.
fn canonical(text: &str) -> String {
    let mut plain = String::new();
    for letter in text.to_lowercase().chars() {
        match letter {
            '\u{b2}' => plain.push('2'),
            '\u{b9}' => plain.push('1'),
            '\u{207b}' | '\u{2212}' | '\u{2013}' => plain.push('-'),
            '\u{b0}' | '\u{ba}' | '\u{2da}' => plain.push_str("deg"),
            '\u{b5}' | '\u{3bc}' => plain.push('u'),
            '/' | '-' | '\u{fffd}' => plain.push(letter),
            _ if letter.is_alphanumeric() => plain.push(letter),
            _ => {}
        }
    }
    for (long, short) in WORDS {
        plain = plain.replace(long, short);
    }
    plain
}

/// The parts of a name in lower case: "AccX [m/s2]" has acc, x, m, s2.
pub(super) fn parts(name: &str) -> Vec<String> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_usual_spellings_are_read() {
        for (unit, names) in [
            (
                "m/s2",
                &[
                    "ax [m/s^2]",
                    "ax (m/s2)",
                    "ax_mps2",
                    "a_RS_S_x [m s^-2]",
                    "Accelerometer X (m/s\u{b2})",
                    "ax_m_s2",
                    "acc x m/s^2",
                    "ax [m\u{b7}s\u{207b}\u{b2}]",
                    "ax (M/S2)",
                    "accel_x_m_s2",
                    "ax(m/s**2)",
                    "ax (ms-2)",
                    "ax [meters per second squared]",
                    "accelerometer_m_s2[0]",
                    "acc_ms2_x",
                    "ax [m/s/s]",
                ][..],
            ),
            ("g", &["ax(g)", "ax_g", "Accelerometer X (g)", "acc x [G]", "AX_G", "acc_g_x", "ax [g0]", "ax (g's)"]),
            ("mg", &["ax(mg)", "ax_mg", "acc_mg_x", "ax [milli g]", "aX [mG]"]),
        ] {
            for name in names {
                let UnitWord::Unit(said) = Quantity::Acceleration.said(name) else { panic!("{name}") };
                assert_eq!(said.name, unit, "{name}");
            }
        }
        for (unit, names) in [
            ("rad/s", &["gx [rad/s]", "w_RS_S_x [rad s^-1]", "gx_rad_s", "gx(rad/sec)", "gx [radians/second]"][..]),
            (
                "deg/s",
                &[
                    "gx(degree/s)",
                    "gx [deg/s]",
                    "gx (dps)",
                    "gx_dps",
                    "GX_DPS",
                    "gx (\u{b0}/s)",
                    "gyro x [deg/sec]",
                    "gyro_dps_x",
                    "gx [degrees per second]",
                    "gx_deg_s",
                    "gx_deg/s",
                    "Gyr_X \u{b0}/s",
                    "gx [deg s^-1]",
                ],
            ),
            ("mrad/s", &["gx (mrad/s)", "gx_mrad_s"]),
            ("mdeg/s", &["gx (mdps)", "gx_mdps", "gx [mdeg/s]", "gx [millidegrees/s]"]),
            ("deg/h", &["gx [deg/h]", "gx (deg/hr)", "gx (\u{b0}/h)", "gx (degrees/hour)"]),
        ] {
            for name in names {
                let UnitWord::Unit(said) = Quantity::Rate.said(name) else { panic!("{name}") };
                assert_eq!(said.name, unit, "{name}");
            }
        }
        for (unit, names) in [
            ("degC", &["imu_degC", "T [\u{b0}C]", "temp (C)", "temp_C", "Temperature (degC)", "temp [Celsius]"][..]),
            ("K", &["temp (K)", "T [Kelvin]", "temperature_K"]),
            ("degF", &["temp (F)", "Temp [\u{b0}F]", "temp_degF", "temp (Fahrenheit)"]),
            ("mdegC", &["temp [mdegC]", "temp_mdegC", "temp (milli degC)"]),
        ] {
            for name in names {
                assert_eq!(of_temperature(name).map(|thermal| thermal.name), Some(unit), "{name}");
            }
        }
    }

    #[test]
    fn what_is_no_unit_is_not_taken_for_one() {
        for name in ["gx", "ax", "AccX", "acc_1", "linear_acceleration.x", "ax_counts", "ax [LSB]", "clip_counter[0]"] {
            assert_eq!(Quantity::Acceleration.said(name), UnitWord::Nothing, "{name}");
            assert_eq!(Quantity::Rate.said(name), UnitWord::Nothing, "{name}");
        }
        assert_eq!(Quantity::Acceleration.said("ax (ft/s2)"), UnitWord::Unknown("ft/s2".to_owned()));
        assert_eq!(Quantity::Rate.said("gx (m/s^2)"), UnitWord::Unknown("m/s^2".to_owned()));
        let joint = Quantity::Acceleration.of_triad(["ax(g)", "ay", "az"]);
        assert!(matches!(joint, UnitWord::Unit(unit) if unit.name == "g"));
        let mixed = Quantity::Acceleration.of_triad(["ax(g)", "ay(mg)", "az"]);
        assert_eq!(mixed, UnitWord::Unknown("g and mg".to_owned()));
        assert_eq!((of_temperature("temp"), of_temperature("temperature1")), (None, None));
    }
}
