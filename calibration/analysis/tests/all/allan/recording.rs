//! Which rows of a recording are analysed, in what units, and what is warned of.

use super::simulated::{Truth, rates};
use isotherm_analysis::{NoiseAnalysis, NoiseError, NoiseRows, RateKind, imu_yaml};
use isotherm_recording::foreign::LeftOutRows;
use isotherm_report::noise;
use isotherm_report::noise::NoiseSource;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{AXES, RawSample, Triad};
use isotherm_simulation::RandomGenerator;

pub(super) const ALL: [f64; 2] = [0.0, f64::INFINITY];
pub(super) const INTERVAL_NS: u64 = 100_000_000;
const WHITE: Truth = Truth { quantisation: 0.0, white: 1.0, flicker: 0.0, walk: 0.0 };

/// Rows of 0.1 s at rest, whose channels count `counts` a row plus `offset`; what is left is carried into the next row.
pub(super) fn rows(counts: &[Vec<f64>; AXES], offset: f64) -> Vec<RawSample> {
    let mut carried = [0.37; AXES];
    let row = |index: usize| {
        let positive_pulses = [0, 1, 2].map(|axis| {
            carried[axis] += offset + counts[axis][index];
            let whole = carried[axis].floor();
            carried[axis] -= whole;
            whole as u32
        });
        let (head_temperature, board_temperature) = ([25.0; AXES], [25.0; AXES]);
        let time = (index as u64 + 1) * INTERVAL_NS;
        let accelerometers = Triad { positive_pulses, head_temperature, board_temperature, ..Triad::default() };
        RawSample {
            session: 1,
            sequence: index as u64,
            timestamp_ns: time,
            interval_ns: INTERVAL_NS,
            accelerometers,
            ..RawSample::default()
        }
    };
    (0..counts[0].len()).map(row).collect()
}

/// White noise of this many counts a row on three axes.
fn white(counts: f64, count: usize) -> Vec<RawSample> {
    rows(&[1, 2, 3].map(|seed| rates(&WHITE, count, seed).into_iter().map(|rate| rate * counts).collect()), 4000.3)
}

fn table(gyroscopes: bool) -> CoefficientTable {
    let axis = |name: &str, bias: &str, unit: &str| {
        let curve = |unit: &str, value: &str| format!("{{ unit = \"{unit}\", range = [0.0, 60.0], c0 = {value} }}\n");
        let (plus, minus) = if unit == "deg/h" { ("2.0", "-2.0") } else { ("40000.0", "-40000.0") };
        let scale = if unit == "deg/h" { "pulse/arcsec" } else { "pulse/(s*g0)" };
        format!(
            "name = \"{name}\"\nbias = {}positive_scale_factor = {}negative_scale_factor = {}",
            curve(unit, bias),
            curve(scale, plus),
            curve(scale, minus)
        )
    };
    let mut text = format!(
        "format = {}\n[imu]\nid = \"imu-n\"\ngravity = 9.8\n[temperature]\nunit = \"degC\"\nout_of_range = \"reject\"\n",
        if gyroscopes { 2 } else { 1 }
    );
    for name in ["A1", "A2", "A3"] {
        text += &format!("[[axis]]\n{}", axis(name, "0.0", "ug0"));
    }
    if gyroscopes {
        for name in ["G1", "G2", "G3"] {
            text += &format!("[[gyroscope]]\n{}", axis(name, "0.0", "deg/h"));
        }
    }
    CoefficientTable::from_toml(&text, None).unwrap_or_else(|faults| panic!("{faults:?}\n{text}"))
}

fn used(rows: &[RawSample]) -> (usize, usize) {
    let found = NoiseAnalysis::of(rows, None, ALL).unwrap();
    (found.used.start, found.used.end)
}

#[test]
fn the_longest_stretch_without_gap_session_or_change_of_interval_is_taken() {
    let all = white(1.0, 6000);
    assert_eq!(used(&all), (0, 6000));
    // A gap that is too long.
    let mut rows = all.clone();
    rows.drain(2000..2017);
    assert_eq!(used(&rows), (2000, 5983));
    // A new session.
    let mut rows = all.clone();
    rows[3500..].iter_mut().for_each(|row| row.session = 2);
    assert_eq!(used(&rows), (0, 3500));
    // A clock that is set back.
    let mut rows = all.clone();
    rows[3700..].iter_mut().for_each(|row| row.timestamp_ns -= INTERVAL_NS);
    assert_eq!(used(&rows), (0, 3700));
    // Rows of twice the interval.
    let mut rows = all.clone();
    for (index, row) in rows.iter_mut().enumerate().skip(4000) {
        row.timestamp_ns += (index as u64 - 3999) * INTERVAL_NS;
        row.interval_ns *= 2;
        row.accelerometers.positive_pulses = row.accelerometers.positive_pulses.map(|pulses| 2 * pulses);
    }
    assert_eq!(used(&rows), (0, 4000));
}

#[test]
fn movement_ends_the_stretch() {
    let mut random = RandomGenerator::new(1, 1);
    let mut rows = white(1.0, 6000);
    for row in &mut rows[2500..2530] {
        row.accelerometers.positive_pulses =
            row.accelerometers.positive_pulses.map(|pulses| (f64::from(pulses) + random.between(-800.0, 800.0)) as u32);
    }
    let (start, end) = used(&rows);
    assert!((2530..2550).contains(&start) && end == 6000, "{start} {end}");
}

#[test]
fn over_5_percent_of_rows_that_are_left_out_are_refused() {
    let analyse = |left_out: u64| {
        let mut rows = NoiseRows::new(None, ALL);
        white(1.0, 2000).iter().for_each(|row| rows.push(row));
        rows.leave_out(LeftOutRows { rows: left_out, of: 2000 });
        rows.analyse()
    };
    assert!(analyse(0).is_ok() && analyse(100).is_ok());
    let error = analyse(101).unwrap_err();
    assert_eq!(error, NoiseError::LeftOut(LeftOutRows { rows: 101, of: 2000 }));
    assert!(error.to_string().contains("5.05 %"), "{error}");
}

#[test]
fn a_part_of_the_recording_is_taken() {
    let rows = white(1.0, 6000);
    let found = NoiseAnalysis::of(&rows, None, [100.0, 350.0]).unwrap();
    assert_eq!((found.used.clone(), found.used_s), (1000..3500, [100.0, 350.0]));
    assert_eq!(found.rows, 6000);
    let error = NoiseAnalysis::of(&rows, None, [700.0, 800.0]).unwrap_err();
    assert_eq!(error.to_string(), "no row from 600 s to 600 s; the recording is 600.0 s long");
    let error = NoiseAnalysis::of(&rows, None, [10.0, 100.0]).unwrap_err();
    assert!(matches!(&error, NoiseError::TooShort { rows, .. } if *rows == (100..1000)), "{error}");
    assert!(
        error.to_string().contains("has 900 rows, 101 to 1000; at least 1000 rows are needed: record longer"),
        "{error}"
    );
    assert!(NoiseAnalysis::of(&[], None, ALL).is_err());
}

#[test]
fn outputs_that_are_no_numbers_are_bridged() {
    let (mut rows, table) = (white(1.0, 4000), table(false));
    rows[1500].accelerometers.head_temperature[1] = f64::NAN;
    let found = NoiseAnalysis::of(&rows, Some(&table), ALL).unwrap();
    let bridged = found.bridged;
    assert_eq!((found.used.clone(), bridged.rows, bridged.not_a_number, bridged.of), (0..4000, 1, 1, 4000));
    assert!(
        found.findings()[0]
            .message
            .starts_with("1 row is missing (1 row with an output that is not a number) in 1 gap, ")
    );
    // Too many of them end the stretch.
    rows[1500..1520].iter_mut().for_each(|row| row.accelerometers.head_temperature[1] = f64::NAN);
    assert_eq!(NoiseAnalysis::of(&rows, Some(&table), ALL).unwrap().used, 1520..4000);
    // Beyond the range of a table that rejects.
    rows.iter_mut().for_each(|row| row.accelerometers.board_temperature = [70.0; AXES]);
    let error = NoiseAnalysis::of(&rows, Some(&table), ALL).unwrap_err().to_string();
    assert!(error.contains("4000 rows have an output that is not a number"), "{error}");
}

#[test]
fn with_a_table_the_units_are_g0_and_deg_h() {
    let mut rows = white(1.5, 20000);
    for row in &mut rows {
        row.gyroscopes = row.accelerometers;
    }
    let table = table(true);
    let found = NoiseAnalysis::of(&rows, Some(&table), ALL).unwrap();
    assert_eq!(
        found.sensors.iter().map(|sensor| sensor.name).collect::<Vec<_>>(),
        ["A1", "A2", "A3", "G1", "G2", "G3"]
    );
    for (sensor, scale_factor) in found.sensors.iter().zip([40000.0, 40000.0, 40000.0, 2.0, 2.0, 2.0]) {
        let white = sensor.allan.as_ref().unwrap().model.as_ref().unwrap().coefficients[1];
        // 1.5 counts a row of 0.1 s are 15 counts a second.
        let right = 15.0 * 0.1_f64.sqrt() / scale_factor;
        assert!((white.value / right - 1.0).abs() < 0.03, "{}: {} {right}", sensor.name, white.value);
        assert!((sensor.white_counts.unwrap() / 1.5 - 1.0).abs() < 0.03, "{:?}", sensor.white_counts);
    }
    assert_eq!(found.sensors[3].kind, RateKind::AngularRate);
    // deg, deg/sqrt(h), deg/h and deg/(h sqrt(h)) from deg/h and s: N of 60 deg/(h sqrt(Hz)) are 1 deg/sqrt(h).
    let units = found.sensors[3].kind.units();
    assert_eq!(units.coefficients.map(|(_, factor)| factor), [1.0 / 3600.0, 1.0 / 60.0, 1.0, 60.0]);
    // Without a table the same gyroscopes are counts, and a table without gyroscopes leaves them out.
    let counts = NoiseAnalysis::of(&rows, None, ALL).unwrap();
    assert!(counts.sensors.len() == 6 && counts.sensors.iter().all(|sensor| sensor.kind == RateKind::Counts));
    let without = NoiseAnalysis::of(&rows, Some(&self::table(false)), ALL).unwrap();
    assert_eq!(without.sensors.len(), 3);
    assert_eq!(without.findings()[0].message, "the gyroscopes are left out: the table has none");
    // Kalibr's file has the worst axis in SI units.
    let yaml = imu_yaml(&found, 9.8, "night\n.csv").unwrap();
    let value = |key: &str| -> f64 {
        let line = yaml.lines().find(|line| line.starts_with(key)).unwrap_or_else(|| panic!("{key}: {yaml}"));
        line.split_whitespace().nth(1).unwrap().parse().unwrap()
    };
    let worst = |sensors: core::ops::Range<usize>, k: usize| {
        let of = |sensor: &isotherm_analysis::SensorNoise| {
            let coefficient = sensor.allan.as_ref().unwrap().model.as_ref().unwrap().coefficients[k];
            coefficient.below().unwrap_or(coefficient.value)
        };
        found.sensors[sensors].iter().map(of).fold(0.0, f64::max)
    };
    let arcsec = core::f64::consts::PI / 648_000.0;
    let pairs = [
        ("accelerometer_noise_density: ", worst(0..3, 1) * 9.8),
        ("accelerometer_random_walk: ", worst(0..3, 3) * 9.8),
        ("gyroscope_noise_density: ", worst(3..6, 1) * arcsec),
        ("gyroscope_random_walk: ", worst(3..6, 3) * arcsec),
        ("update_rate: ", 10.0),
    ];
    for (key, right) in pairs {
        assert!((value(key) / right - 1.0).abs() < 1e-5, "{key}: {right}\n{yaml}");
    }
    assert!(
        yaml.contains("an upper limit (95 %) of ") && yaml.lines().nth(1).unwrap().starts_with("rostopic: "),
        "{yaml}"
    );
    assert!(imu_yaml(&counts, 9.8, "").is_none());
    let yaml = imu_yaml(&without, 9.8, "").unwrap();
    assert!(yaml.contains("\n# gyroscope_noise_density: not written, "), "{yaml}");
}

#[test]
fn temperature_contaminates_what_a_line_explains() {
    let mut counts = [1, 2, 3].map(|seed| rates(&WHITE, 32768, seed));
    let temperature = |row: usize| 25.0 + 1.5 * libm::sin(row as f64 / 6000.0);
    for (row, count) in counts[0].iter_mut().enumerate() {
        *count += 0.15 * temperature(row);
    }
    let mut rows = rows(&counts, 4000.3);
    for (row, sample) in rows.iter_mut().enumerate() {
        sample.accelerometers.head_temperature = [(temperature(row) * 100.0).round() / 100.0; AXES];
    }
    let found = NoiseAnalysis::of(&rows, None, ALL).unwrap();
    let (line, from_s) = found.sensors[0].contamination().unwrap();
    assert!((line.slope / 1.5 - 1.0).abs() < 0.05, "{}", line.slope);
    assert!((10.0..200.0).contains(&from_s), "{from_s}");
    let random_walk = |allan: &isotherm_analysis::Allan| allan.model.as_ref().unwrap().coefficients[3];
    let (raw, without) = (random_walk(found.sensors[0].allan.as_ref().unwrap()), random_walk(&line.without));
    assert!(without.below().unwrap() < raw.range.unwrap()[1], "{raw:?} {without:?}");
    assert!(found.sensors[1..].iter().all(|sensor| sensor.contamination().is_none() && sensor.line.is_some()));
    assert!(
        found
            .findings()
            .iter()
            .any(|finding| finding.message.starts_with("A1: contaminated by the temperature from tau = "))
    );
    // Temperature that never changes, or is not a number, has no line.
    rows.iter_mut().for_each(|row| row.accelerometers.head_temperature = [25.0, f64::NAN, 25.0]);
    let found = NoiseAnalysis::of(&rows, None, ALL).unwrap();
    assert!(found.sensors.iter().all(|sensor| sensor.line.is_none()));
}

/// White noise of 0.15 counts a row: the counts repeat a pattern, and what looks like quantisation is none.
#[test]
fn noise_smaller_than_a_count_is_a_limit_cycle() {
    let found = NoiseAnalysis::of(&white(0.15, 32768), None, ALL).unwrap();
    for sensor in &found.sensors {
        assert!(sensor.limit_cycle().is_some(), "{:?}", sensor.white_counts);
        assert!(sensor.findings()[0].message.contains("smaller than a step of its counts"), "{:?}", sensor.findings());
    }
    assert!(NoiseAnalysis::of(&white(0.7, 32768), None, ALL).unwrap().findings().is_empty());
    // A sensor that never counts, next to two that do.
    let mut rows = white(1.0, 4000);
    rows.iter_mut().for_each(|row| row.accelerometers.positive_pulses[2] = 7);
    let found = NoiseAnalysis::of(&rows, None, ALL).unwrap();
    let messages: Vec<_> = found.findings().iter().map(ToString::to_string).collect();
    assert_eq!(messages, ["A3: its counts never change; look at the sensor and its cable"]);
    let text = noise::text::text(&found);
    assert!(text.contains("\nA3: the counts never change\n") && text.contains("\nA2 "), "{text}");
}

/// Only quantisation, as of a phase that is read in steps while it moves: the curve falls as 1/tau throughout, and all
/// others are below a limit.
#[test]
fn a_curve_that_falls_as_one_over_tau_has_no_white_noise() {
    let mut random = RandomGenerator::new(3, 0);
    let phase: Vec<f64> = (0..=16384).map(|_| random.between(-0.5, 0.5)).collect();
    let rates: Vec<f64> = phase.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let found = isotherm_analysis::Allan::of(&rates, 1.0).unwrap();
    let model = found.model.unwrap();
    assert!(model.holds(), "{model:?}");
    let [quantisation, others @ ..] = model.coefficients;
    let [low, high] = quantisation.range.unwrap();
    assert!((low..=high).contains(&(1.0 / 12_f64.sqrt())), "{quantisation:?}");
    assert!(others.iter().all(|coefficient| coefficient.below().is_some()), "{others:?}");
}

#[test]
fn the_report_names_every_figure() {
    let mut rows = white(1.0, 8000);
    for (row, sample) in rows.iter_mut().enumerate() {
        sample.accelerometers.head_temperature = [25.0 + row as f64 * 1e-4; AXES];
    }
    let found = NoiseAnalysis::of(&rows, Some(&table(false)), ALL).unwrap();
    let source = NoiseSource {
        tool: "t".to_owned(),
        time: "now".to_owned(),
        recording: "<night>".to_owned(),
        table: None,
        imu: "imu-n".to_owned(),
    };
    let page = noise::html(&found, &source);
    let texts =
        ["Floor of B, 0.664 B", "Minimum of the curve", "one-sided as in data sheets", "times apart", "&lt;night&gt;"];
    for text in texts.iter().chain(&["<svg", "10\u{207b}\u{2074}", "velocity random walk", "Model"]) {
        assert!(page.contains(text), "{text}");
    }
    assert!(!page.contains("NaN") && !page.contains("inf<"));
    let text = noise::text::text(&found);
    for part in [
        "floor of B, 0.664 B: below ",
        "minimum of the curve: ",
        "one-sided (data sheets)",
        " times apart",
        "bias instability                 below",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let ratio: f64 = text.lines().last().unwrap().rsplit(' ').nth(2).unwrap().parse().unwrap();
    assert!((6.0..26.0).contains(&ratio), "{text}");
}
