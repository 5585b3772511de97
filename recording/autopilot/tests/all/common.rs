//! The data of both autopilots, tables, and what the kernel subtracts.

use isotherm_autopilot::{Autopilot, ImportOptions, import};
use isotherm_shared::compensate::answer;
use isotherm_shared::table::{CoefficientTable, STANDARD_GRAVITY};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::RawSample;
use std::fmt::Write as _;

pub(crate) const FULL_PARAMS: &str = include_str!("../data/full.params");
pub(crate) const FULL_PARM: &str = include_str!("../data/full.parm");
pub(crate) const HEATING_PARAMS: &str = include_str!("../data/heating.params");
pub(crate) const HEATING_PARM: &str = include_str!("../data/heating.parm");

/// The devices of `full.params`.
pub(crate) const DEVICES: [u32; 2] = [3_014_666, 3_080_202];

pub(crate) const KINDS: [SensorKind; 2] = [SensorKind::Accelerometer, SensorKind::Gyroscope];

pub(crate) fn import_options(autopilot: Autopilot) -> ImportOptions {
    ImportOptions {
        autopilot,
        instance: None,
        imu: "imu-a".parse().unwrap(),
        interval_ns: 2_500_000,
        gravity: STANDARD_GRAVITY,
    }
}

pub(crate) fn imported(text: &str, autopilot: Autopilot) -> CoefficientTable {
    import(text, &import_options(autopilot)).unwrap()
}

/// What the kernel subtracts at a temperature: the answer to a sample without pulses [m/s2; rad/s].
pub(crate) fn subtracted(table: &CoefficientTable, temperature: f64) -> [[f64; 3]; 2] {
    let mut raw = RawSample { interval_ns: 2_500_000, ..RawSample::default() };
    for triad in [&mut raw.accelerometers, &mut raw.gyroscopes] {
        triad.head_temperature = [temperature; 3];
        triad.board_temperature = [temperature; 3];
    }
    let increment = answer(Some(table), &raw);
    [increment.specific_force(), increment.angular_rate()].map(|triad| triad.map(|value| -value))
}

/// Two hundred temperatures in, at and beyond a range, as a firmware has them.
pub(crate) fn temperatures([low, high]: [f64; 2]) -> Vec<f32> {
    let (from, to) = (low - 40.0, high + 40.0);
    let mut all: Vec<f32> = (0..195).map(|k| (from + (to - from) * f64::from(k) / 194.0) as f32).collect();
    all.extend([low as f32, high as f32, (low as f32).next_down(), (high as f32).next_up(), 35.0]);
    all
}

/// A sensor of a table: K+ and K- are constants of this size.
fn sensor(text: &mut String, section: &str, name: &str, bias: &str, (unit, k): (&str, &str)) {
    let scale = |sign: &str| format!("{{ unit = \"{unit}\", range = [-40.0, 85.0], c0 = {sign}{k} }}");
    writeln!(text, "[[{section}]]\nname = \"{name}\"\nbias = {{ {bias} }}").unwrap();
    writeln!(text, "positive_scale_factor = {}\nnegative_scale_factor = {}", scale(""), scale("-")).unwrap();
}

/// The text of a table in degC, with these biases.
pub(crate) fn table(accelerometers: [&str; 3], gyroscopes: [&str; 3]) -> String {
    let mut text = "format = 2\n[imu]\nid = \"imu-a\"\ngravity = 9.8015\n".to_owned();
    text += "[temperature]\nunit = \"degC\"\nout_of_range = \"clamp\"\n";
    for (name, bias) in ["A1", "A2", "A3"].into_iter().zip(accelerometers) {
        sensor(&mut text, "axis", name, bias, ("pulse/(s*g0)", "9e4"));
    }
    for (name, bias) in ["G1", "G2", "G3"].into_iter().zip(gyroscopes) {
        sensor(&mut text, "gyroscope", name, bias, ("pulse/arcsec", "1.0"));
    }
    text
}

/// The text of a table of different orders, centres, scales and units.
pub(crate) fn mixed() -> String {
    let range = "range = [-30.0, 70.0]";
    let centred = format!("{range}, center = 20.0, scale = 50.0");
    let reversed = format!("{range}, center = -12.0, scale = -3.0");
    table(
        [
            &format!("unit = \"mg0\", {centred}, c0 = 12.0, c1 = -40.0, c2 = 21.0, c3 = 9.0"),
            &format!("unit = \"ug0\", {range}, c0 = -2500.0, c1 = 31.0, c2 = -1.7, c3 = 0.012"),
            &format!("unit = \"g0\", {reversed}, c0 = 0.03, c1 = 0.0004"),
        ],
        [
            &format!("unit = \"deg/h\", {centred}, c0 = 900.0, c1 = -2300.0, c2 = 700.0, c3 = 55.0"),
            &format!("unit = \"deg/h\", {range}, c0 = -120.0"),
            &format!("unit = \"deg/h\", {range}, center = 20.0, c0 = 30.0, c1 = -4.0, c2 = 0.7"),
        ],
    )
}

pub(crate) fn parsed(text: &str) -> CoefficientTable {
    CoefficientTable::from_toml(text, None).unwrap_or_else(|faults| panic!("{faults}\n{text}"))
}
