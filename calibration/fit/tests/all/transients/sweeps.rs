//! What sweeps show against each other: the error of a curve, a bump, another unit, one direction, rows that are
//! missing.

use super::consumer;
use super::simulated::{TAU_S, TRANSIENTS, afternoon, quiet, recorded, recorded_with, schedule, truth};
use isotherm_campaign::Campaign;
use isotherm_fit::{
    CalibrationError, CalibrationOptions, CurveSource, LagChoice, RampCalibration, RampRecording, TransientOptions,
    TransientVerdict, Transients, calibrate_ramps, fit,
};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::RawSample;
use isotherm_simulation::{Play, RampSchedule, Truth, ramp, ramps_toml};
use isotherm_support::failure::Exit;
use isotherm_support::finding::{Severity, name};
use std::path::Path;

fn alone(
    truth: &Truth,
    schedules: &[RampSchedule],
    recordings: &[RampRecording],
    options: CalibrationOptions,
) -> Result<RampCalibration, CalibrationError> {
    let ramps: Vec<_> = schedules.iter().zip(1..).map(|(it, number)| it.ramp(&format!("ramp-{number}"))).collect();
    let campaign = Campaign::from_toml(&ramps_toml(truth, "table.toml", &ramps)).unwrap();
    calibrate_ramps(&campaign, recordings, &truth.static_table(), options)
}

/// Largest difference of a bias curve of the ramps from the truth, both taken off at mid range \[g0\].
fn off(found: &Transients, truth: &Truth, axis: usize) -> f64 {
    let (curve, right) = (&found.biases[axis].curve, &truth.table.content().axes[axis]);
    let [low, high] = curve.range();
    let differs = |u: f64| curve.at(u) - right.bias_at(u).0;
    let middle = differs(low.midpoint(high));
    (0..=100).map(|k| (differs(low + (high - low) * f64::from(k) / 100.0) - middle).abs()).fold(0.0, f64::max)
}

fn fault(error: &CalibrationError) -> (&'static str, String) {
    match error {
        CalibrationError::Faults { findings, .. } => (findings[0].name, findings[0].message.clone()),
        other => panic!("{other}"),
    }
}

#[test]
fn the_error_of_the_curves_holds_the_truth() {
    for seed in 1..=6 {
        // One third of the IMUs has no lag but hysteresis, a third has both.
        let plays = match seed % 3 {
            0 => Vec::new(),
            _ => vec![Play { half_width: 0.1, accelerometers: [2e-5, -1e-5, 3e-5], gyroscopes: [0.0; 3] }],
        };
        let truth = truth(TAU_S, if seed % 3 == 1 { [0.0; 3] } else { TRANSIENTS }, plays);
        let schedules = afternoon(quiet());
        let found = alone(&truth, &schedules, &recorded(&truth, &schedules, seed), CalibrationOptions::default());
        let found = found.unwrap();
        assert!(!found.findings.iter().any(|finding| [name::RAMP_STEP, name::RAMP_DEVICE].contains(&finding.name)));
        for (axis, bias) in found.transients.biases.iter().enumerate() {
            let (off, error) = (off(&found.transients, &truth, axis), bias.curve_error.as_ref().unwrap().half_width);
            println!("{seed} {}: {:.2} ug0 off, {:.2} stated", bias.name(), off * 1e6, error * 1e6);
            assert!(off < 1.5 * error + 0.5e-6 && error < 6e-6, "{off} {error}");
        }
        let first = isotherm_report::text::ramps(&found);
        assert!(first.starts_with("errors of the curves, half of the band between sweeps: A1 "), "{first}");
    }
}

/// Moves a sample by a tilt of 0.5 mrad from the time on.
fn bumped(raw: &RawSample, since_ns: u64, pulses: u32) -> RawSample {
    let mut raw = *raw;
    if raw.timestamp_ns > since_ns {
        let all = &mut raw.accelerometers;
        let sum = i64::from(all.positive_pulses[0]) - i64::from(all.negative_pulses[0]) + i64::from(pulses);
        (all.positive_pulses[0], all.negative_pulses[0]) = (sum.max(0) as u32, (-sum).max(0) as u32);
    }
    raw
}

#[test]
fn a_bump_is_a_step_and_no_hysteresis() {
    let truth = truth(TAU_S, TRANSIENTS, Vec::new());
    let schedules = [schedule(70.0, quiet())];
    let pulses = (0.5e-3 * truth.table.content().axes[0].positive_scale_factor.at(2.5) * 10.0).round() as u32;
    for minutes in [55, 80, 105, 180] {
        let mut recording = RampRecording::new("ramp-1");
        let rows: Vec<_> = ramp(&truth, &schedules[0], 3).collect();
        let since_ns = rows[0].timestamp_ns + minutes * 60_000_000_000;
        rows.iter().for_each(|raw| recording.add(&bumped(raw, since_ns, pulses)).unwrap());
        let error = alone(&truth, &schedules, &[recording.clone()], CalibrationOptions::default()).unwrap_err();
        let (name, message) = fault(&error);
        println!("{message}");
        assert_eq!(name, name::RAMP_STEP, "{minutes}: {message}");
        let sized = ["A1 by 0.4", "A1 by 0.5"].iter().any(|size| message.contains(size));
        assert!(message.starts_with("ramp-1: moved ") && sized, "{message}");
        assert!(!message.contains("A2") && !message.contains("A3"), "{message}");
        let accepted = CalibrationOptions { accept: vec![name::RAMP_STEP], ..CalibrationOptions::default() };
        let found = alone(&truth, &schedules, &[recording], accepted).unwrap();
        assert_eq!(found.transients.verdict, TransientVerdict::Undetermined);
        assert!(!found.transients.words.join(" ").contains("hysteresis"));
        assert!(
            off(&found.transients, &truth, 0)
                < 2.0 * found.transients.biases[0].curve_error.as_ref().unwrap().half_width
        );
    }
}

#[test]
fn a_ramp_of_another_device_is_refused() {
    let (unit, other) = (truth(TAU_S, TRANSIENTS, Vec::new()), {
        let mut other = truth(TAU_S, TRANSIENTS, Vec::new());
        let mut content = other.table.content().clone();
        // Curves of another accelerometer in A1 and A3.
        content.axes.swap(0, 2);
        let names: Vec<_> = other.table.content().axes.iter().map(|axis| axis.bias).collect();
        let biases = [names[2], names[1], names[0]];
        content.axes.swap(0, 2);
        content.axes.iter_mut().zip(biases).for_each(|(axis, bias)| axis.bias = bias);
        other.table = CoefficientTable::new(content).unwrap();
        other
    });
    let schedules = afternoon(quiet());
    let [first, _] = &recorded(&unit, &schedules, 5)[..] else { panic!("two ramps") };
    let second = recorded(&other, &schedules, 6).remove(1);
    let error = alone(&unit, &schedules, &[first.clone(), second], CalibrationOptions::default()).unwrap_err();
    let (name, message) = fault(&error);
    println!("{message}");
    assert_eq!(name, name::RAMP_DEVICE);
    assert!(message.contains("ramp-2: the biases do not change over temperature as ramp-1"), "{message}");
    // Two ramps of one device agree.
    assert!(alone(&unit, &schedules, &recorded(&unit, &schedules, 5), CalibrationOptions::default()).is_ok());
}

#[test]
fn one_direction_keeps_good_curves() {
    let truth = truth(TAU_S, TRANSIENTS, Vec::new());
    let schedules = [schedule(70.0, quiet())];
    let end_ns = ramp(&truth, &schedules[0], 3).map(|raw| raw.timestamp_ns).max().unwrap();
    let rising = recorded_with(&truth, &schedules, 3, |raw| raw.timestamp_ns < end_ns / 2);
    let error = alone(&truth, &schedules, &rising, CalibrationOptions::default()).unwrap_err();
    let (name, message) = fault(&error);
    assert_eq!(name, name::ONE_DIRECTION, "{message}");
    assert!(message.contains("are of order 3") && message.contains("--replace-curves"), "{message}");
    assert_eq!(error.failure(Path::new("campaign.toml"), Path::new("ramp-1"), |_| String::new()).exit, Exit::Failed);
    let accepted = CalibrationOptions { accept: vec![name::ONE_DIRECTION], ..CalibrationOptions::default() };
    let found = alone(&truth, &schedules, &rising, accepted).unwrap();
    assert!(found.accuracy().contains("the errors of the curves are not known"), "{}", found.accuracy());
    // Constant curves are no loss, unless their error is known.
    let mut content = truth.static_table().content().clone();
    content.axes.iter_mut().for_each(|axis| {
        let [low, high] = axis.bias.range();
        axis.bias = isotherm_shared::polynomial::Polynomial::new(&[0.0], 0.0, 1.0, [low, high]).unwrap();
    });
    let constant = CoefficientTable::new(content).unwrap();
    let campaign = Campaign::from_toml(&ramps_toml(&truth, "table.toml", &[schedules[0].ramp("ramp-1")])).unwrap();
    let with = |curves_have_errors| {
        let options = CalibrationOptions { curves_have_errors, ..CalibrationOptions::default() };
        calibrate_ramps(&campaign, &rising, &constant, options)
    };
    assert!(with(false).is_ok());
    assert!(fault(&with(true).unwrap_err()).1.contains("state their errors"));
}

#[test]
fn most_of_a_sweep_that_is_lost_is_named() {
    let truth = truth(TAU_S, TRANSIENTS, Vec::new());
    let schedules = [schedule(70.0, quiet())];
    let end_ns = ramp(&truth, &schedules[0], 3).map(|raw| raw.timestamp_ns).max().unwrap();
    let lost = |raw: &RawSample| !(end_ns * 55 / 100..end_ns * 80 / 100).contains(&raw.timestamp_ns);
    let recordings = recorded_with(&truth, &schedules, 3, lost);
    let accepted = CalibrationOptions { accept: vec![name::ONE_DIRECTION], ..CalibrationOptions::default() };
    let found = alone(&truth, &schedules, &recordings, accepted).unwrap();
    let first = found.findings.iter().find(|finding| finding.name == name::MISSING_ROWS).unwrap();
    assert_eq!(first.severity, Severity::Warning);
    assert!(first.message.contains("ramp-1: rows are missing for ") && first.message.contains(" of a1_head"));
}

/// The first cooling and heating of the consumer IMU: with 151.6 s the transient of A3 is refused.
#[test]
fn a_refused_transient_leaves_the_static_curve_of_all_rows() {
    let rows = consumer::rows();
    let mut recording = RampRecording::new("thermal-run");
    rows[..consumer::COOLING_AND_HEATING].iter().for_each(|raw| recording.add(raw).unwrap());
    let fitted = |lag| {
        let options = TransientOptions { curves: CurveSource::Ramps, lag, predecessor_s: None };
        fit(&[recording.clone()], &consumer::nominal(), &options).unwrap()
    };
    let (still, given) = (fitted(LagChoice::None), fitted(LagChoice::Given(151.6)));
    assert!(given.biases.iter().any(|bias| bias.transient != 0.0));
    let refused: Vec<_> = given.biases.iter().zip(&still.biases).filter(|(bias, _)| bias.transient == 0.0).collect();
    assert!(refused.iter().any(|(bias, _)| bias.name() == "A3"));
    for (bias, of_static) in refused {
        assert_eq!(bias.curve, of_static.curve, "{}", bias.name());
        assert_eq!(bias.curve_error, of_static.curve_error);
    }
}
