//! What is wrong with a recording at one attitude stands first: the real run, with one mistake each.

use crate::transients::consumer::{nominal, rows};
use isotherm_campaign::Campaign;
use isotherm_fit::{CalibrationError, LagChoice, RampRecording, WarmUpCalibration, WarmUpOptions, calibrate_warm_up};
use isotherm_shared::wire::{AXES, RawSample, Triad};
use isotherm_simulation::RandomGenerator;
use isotherm_support::finding::{Finding, Severity};

fn calibrated(recordings: &[Vec<RawSample>], options: &WarmUpOptions) -> Result<WarmUpCalibration, CalibrationError> {
    let names: Vec<_> = (1..=recordings.len()).map(|number| format!("run-{number}")).collect();
    let read = |(name, rows): (&String, &Vec<RawSample>)| {
        let mut recording = RampRecording::new(name.clone());
        rows.iter().for_each(|raw| recording.add(raw).unwrap());
        recording
    };
    let read: Vec<_> = names.iter().zip(recordings).map(read).collect();
    let campaign = Campaign::warm_up(nominal().content().imu.clone(), 9.80665, "degC", &names);
    calibrate_warm_up(&campaign, &read, &nominal(), options)
}

/// The first finding of the recordings.
fn first(recordings: &[Vec<RawSample>]) -> Finding {
    let options = WarmUpOptions { lag: LagChoice::None, ..WarmUpOptions::default() };
    match calibrated(recordings, &options) {
        Ok(found) => found.ramps.findings[0].clone(),
        Err(CalibrationError::Faults { findings, .. }) => findings[0].clone(),
        Err(error) => panic!("{error}"),
    }
}

fn net(triad: &Triad, axis: usize) -> f64 {
    f64::from(triad.positive_pulses[axis]) - f64::from(triad.negative_pulses[axis])
}

/// The rows with other pulses on an axis.
fn with(rows: &[RawSample], change: impl Fn(usize, &mut Triad, &mut Triad)) -> Vec<RawSample> {
    let mut rows = rows.to_vec();
    let all = rows.iter_mut().enumerate();
    all.for_each(|(row, raw)| change(row, &mut raw.accelerometers, &mut raw.gyroscopes));
    rows
}

fn set(triad: &mut Triad, axis: usize, pulses: f64) {
    triad.positive_pulses[axis] = pulses.max(0.0).round() as u32;
    triad.negative_pulses[axis] = (-pulses).max(0.0).round() as u32;
}

fn scaled(triad: &mut Triad, factor: f64) {
    (0..AXES).for_each(|axis| set(triad, axis, net(triad, axis) * factor));
}

fn with_temperature(rows: &[RawSample], of: impl Fn(f64) -> f64) -> Vec<RawSample> {
    with(rows, |_, accelerometers, gyroscopes| {
        for triad in [accelerometers, gyroscopes] {
            triad.head_temperature = triad.head_temperature.map(&of);
            triad.board_temperature = triad.board_temperature.map(&of);
        }
    })
}

#[track_caller]
fn assert_first(recordings: &[Vec<RawSample>], name: &str, severity: Severity, words: &str) {
    let found = first(recordings);
    println!("{found}");
    assert!(found.name == name && found.severity == severity && found.message.contains(words), "{found}");
}

/// What is before and after it is used, with a constant each.
#[test]
fn a_bump_is_named() {
    // 5 mrad, 5e-3 g0 of 1e7 pulses per g0 and second and 0.505 s; its size is found to some percent.
    let bumped = with(&rows(), |row, all, _| {
        if row > 4400 {
            set(all, 1, net(all, 1) + 5e-3 * 1e7 * 0.505);
        }
    });
    assert_first(&[bumped], "motion", Severity::Warning, "the IMU was bumped at 0:37:04 by 5.");
}

/// Where the steps of the ramps do not look: at the begin of a sweep, twice; for a moment, in rows that nobody
/// screened.
#[test]
fn large_jumps_are_named_wherever_they_are() {
    let moved = |from: usize, to: usize, g0: f64| {
        with(&rows(), |row, all, _| {
            if (from..to).contains(&row) {
                set(all, 0, net(all, 0) + g0 * 1e7 * 0.505);
            }
        })
    };
    for (from, to, words) in [
        (2800, 9000, "bumped at 0:23:34 by 51"),
        (3500, 3600, "bumped at 0:30:18 by 51"),
        (3500, 6000, "bumped at 0:29:28 by 51"),
        (5000, 9000, "bumped at 0:42:0"),
    ] {
        assert_first(&[moved(from, to, 0.05)], "motion", Severity::Warning, words);
    }
    assert_first(&[moved(3500, 3501, 20.0)], "ramp-step", Severity::Fault, "is off for a moment 0:29:2");
}

/// Rows of 10 s, coarse values, a clock that begins with the first row, and IMUs whose noise is as large as what they
/// do over temperature: nothing is refused.
#[test]
fn honest_recordings_are_not_refused() {
    let whole = rows();
    let coarse = |triad: &mut Triad, step: f64| {
        (0..AXES).for_each(|axis| set(triad, axis, (net(triad, axis) / step).round() * step));
    };
    let merged = |some: &[RawSample]| {
        let mut sum = some[0];
        some[1..].iter().for_each(|raw| sum.merge(raw).unwrap());
        sum
    };
    let long: Vec<_> = whole.chunks_exact(20).map(merged).collect();
    let zero = whole[0].timestamp_ns;
    let early: Vec<_> = whole.iter().map(|raw| RawSample { timestamp_ns: raw.timestamp_ns - zero, ..*raw }).collect();
    let mut all = vec![whole.clone(), long, early];
    // Up to 8 mg0, and 0.4 mrad/s.
    for part in [1.0, 4.0, 8.0] {
        all.push(with(&whole, |_, accelerometers, gyroscopes| {
            coarse(accelerometers, part * 1e-3 * 1e7 * 0.505);
            coarse(gyroscopes, part * 5e-5 * 206_265.0 * 10.0 * 0.505);
        }));
    }
    let mut random = RandomGenerator::new(5, 1);
    for _ in 0..20 {
        // Only white noise, of 1 to 100 steps, in rows of coarse values.
        let size = libm::pow(10.0_f64, random.uniform() * 2.0);
        let mut noise = || (0..12).map(|_| random.uniform()).sum::<f64>() - 6.0;
        let levels: Vec<[f64; 6]> =
            whole.iter().map(|_| core::array::from_fn(|_| (noise() * size).round() * 1e3)).collect();
        all.push(with(&whole, |row, accelerometers, gyroscopes| {
            let level = levels[row];
            (0..AXES).for_each(|axis| {
                set(accelerometers, axis, level[axis] + if axis == 2 { 5_050_000.0 } else { 0.0 });
                set(gyroscopes, axis, level[axis + AXES]);
            });
        }));
    }
    for (number, recording) in all.into_iter().enumerate() {
        let options = WarmUpOptions { lag: LagChoice::None, ..WarmUpOptions::default() };
        if let Err(error) = calibrated(&[recording], &options) {
            panic!("{number}: {error}");
        }
    }
}

#[test]
fn a_dead_sensor_and_a_temperature_that_stands_are_named() {
    let dead = with(&rows(), |_, accelerometers, gyroscopes| {
        set(accelerometers, 1, 0.0);
        set(gyroscopes, 2, 0.0);
    });
    assert_first(&[dead], "dead-axis", Severity::Fault, "run-1: A2, G3 never changes");
    let still = with_temperature(&rows(), |celsius| 25.0 + celsius / 100.0);
    assert_first(&[still], "temperature-constant", Severity::Fault, "the temperature moves by 0.92 degC");
}

#[test]
fn another_device_is_named() {
    let rows = rows();
    let mean = rows.iter().map(|raw| net(&raw.accelerometers, 0)).sum::<f64>() / rows.len() as f64;
    let other = with(&rows, |_, all, _| set(all, 0, 2.0 * mean - net(all, 0)));
    assert_first(
        &[rows, other],
        "ramp-device",
        Severity::Fault,
        "run-2: the biases do not change over temperature as run-1",
    );
}

#[test]
fn missing_rows_are_named() {
    let rows = rows();
    let left: Vec<_> = rows[..4000].iter().chain(&rows[5000..]).copied().collect();
    assert_first(&[left], "missing-rows", Severity::Warning, "rows are missing for 505 of ");
}

#[test]
fn one_direction_is_named() {
    assert_first(&[rows()[2680..6180].to_vec()], "one-direction", Severity::Warning, "are not known");
}

#[test]
fn a_wrong_interval_is_named() {
    let with_intervals = |factor: f64| {
        let mut wrong = rows();
        wrong.iter_mut().for_each(|raw| raw.interval_ns = (raw.interval_ns as f64 * factor) as u64);
        wrong
    };
    let words = "interval_ns is 1.000e-3 of the time from row to row";
    assert_first(&[with_intervals(1e-3)], "interval", Severity::Fault, words);
    // Pulses would be counted twice: it is not read.
    let mut recording = RampRecording::new("run");
    let error = with_intervals(2.0).iter().find_map(|raw| recording.add(raw).err()).unwrap();
    assert!(error.contains("intervals of the 1000 rows up to here add up to 1010768506000 ns"), "{error}");
}

#[test]
fn a_wrong_unit_is_named() {
    let rows = rows();
    let g = with(&rows, |_, all, _| scaled(all, 1.0 / 9.80665));
    assert_first(&[g], "not-gravity", Severity::Fault, "the readings look like g, not m/s2");
    let degrees = with(&rows, |_, _, all| scaled(all, 180.0 / core::f64::consts::PI));
    assert_first(&[degrees], "rate-at-rest", Severity::Fault, "the readings look like deg/s, not rad/s");
    let kelvin = with_temperature(&rows, |celsius| celsius + 273.15);
    assert_first(&[kelvin], "temperature-offset", Severity::Fault, "it looks like kelvin");
    let thousandths = with_temperature(&rows, |celsius| celsius * 1000.0);
    assert_first(&[thousandths], "temperature-offset", Severity::Fault, "thousandths of a degree");
}

#[test]
fn what_is_refused_can_be_accepted_and_an_order_that_is_too_high_is_told() {
    let kelvin = with_temperature(&rows(), |celsius| celsius + 273.15);
    let options = WarmUpOptions {
        lag: LagChoice::None,
        order: Some(2),
        at: Some(300.0),
        accept: vec!["temperature-offset"],
        ..WarmUpOptions::default()
    };
    let found = calibrated(&[kelvin], &options).unwrap();
    assert_eq!((found.order.order, found.order.given), (2, true));
    assert_eq!(found.ramps.accepted, ["temperature-offset"]);
    for bias in &found.biases[..AXES] {
        assert!(bias.curve.at(300.0).abs() < 1e-15, "{}", bias.name());
    }
    // The temperature of all rows has two values.
    let two = with_temperature(&rows(), |celsius| if celsius > 30.0 { 40.0 } else { 20.0 });
    let error = calibrated(&[two], &WarmUpOptions { order: Some(3), at: None, ..options.clone() }).unwrap_err();
    assert!(error.to_string().contains("too few temperatures for order 3"), "{error}");
    let error = calibrated(&[rows()], &options).unwrap_err();
    assert!(
        error.to_string().starts_with("the reference temperature is 300, and the temperature reaches from "),
        "{error}"
    );
}
