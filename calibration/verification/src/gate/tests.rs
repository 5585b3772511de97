use super::*;
use crate::stability::{Collector, LocalGravity, Setup};
use isotherm_campaign::{Campaign, Dwell, read_dwells};
use isotherm_fit::{AlignmentChoice, CalibrationOptions, calibrate_accelerometers};
use isotherm_recording::CampaignCsvReader;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::Content;
use isotherm_shared::wire::{RawSample, Triad};
use isotherm_simulation::RandomGenerator;
use isotherm_support::finding::name;

const FORCE: [f64; AXES] = [0.6, -0.48, 0.64];
/// Number of windows of a run; each is one sample.
const WINDOWS: u32 = 300;
const WINDOW_S: f64 = 10.0;

pub(super) fn truth() -> CoefficientTable {
    CoefficientTable::from_toml(include_str!("../../../../tests/data/imu-a.toml"), None).unwrap()
}

pub(super) fn changed(change: impl FnOnce(&mut Content)) -> CoefficientTable {
    let mut content = truth().content().clone();
    change(&mut content);
    CoefficientTable::new(content).unwrap()
}

/// The truth with an error of the bias of A2 \[g0\].
fn off(error_g0: f64) -> CoefficientTable {
    changed(|content| {
        let axis = &mut content.axes[1];
        let mut coefficients = axis.bias.coefficients().to_vec();
        coefficients[0] += error_g0 / axis.bias_unit.factor();
        axis.bias = Polynomial::new(&coefficients, axis.bias.center(), axis.bias.scale(), axis.bias.range()).unwrap();
    })
}

/// The truth up to this temperature; beyond it, coefficients of its end.
pub(super) fn up_to(high: f64) -> CoefficientTable {
    changed(|content| {
        for axis in &mut content.axes {
            for curve in [&mut axis.bias, &mut axis.positive_scale_factor, &mut axis.negative_scale_factor] {
                let range = [curve.range()[0], high];
                *curve = Polynomial::new(curve.coefficients(), curve.center(), curve.scale(), range).unwrap();
            }
        }
    })
}

/// A run from temperature 1 to 4 as the table sees it. The head of A1 is not a number in the first `bad` windows.
pub(super) fn run(table: &CoefficientTable, bad: u32) -> Stability {
    noisy_run(table, bad, 0.0)
}

/// The same with white noise of the sensors; the noise is the same for every table.
fn noisy_run(table: &CoefficientTable, bad: u32, noise_g0: f64) -> Stability {
    run_of(table, bad, noise_g0, [1.0, 4.0])
}

/// A run between these temperatures.
pub(super) fn run_between(table: &CoefficientTable, from: f64, to: f64) -> Stability {
    run_of(table, 0, 0.0, [from, to])
}

fn run_of(table: &CoefficientTable, bad: u32, noise_g0: f64, [from, to]: [f64; 2]) -> Stability {
    let truth = truth();
    let mut random = RandomGenerator::new(1, 7);
    let interval_ns = (WINDOW_S * 1e9) as u64;
    let mut collector = Collector::new(table, WINDOW_S);
    for window in 0..WINDOWS {
        let temperature = from + (to - from) * f64::from(window) / f64::from(WINDOWS);
        let mut raw = RawSample {
            sequence: window.into(),
            timestamp_ns: u64::from(window + 1) * interval_ns,
            interval_ns,
            accelerometers: Triad {
                head_temperature: [temperature; AXES],
                board_temperature: [temperature; AXES],
                ..Triad::default()
            },
            ..RawSample::default()
        };
        for (index, axis) in truth.content().axes.iter().enumerate() {
            let indicated = FORCE[index] + axis.bias_at(temperature).0 + noise_g0 * random.normal();
            let pulses = |scale_factor: f64| (indicated * scale_factor * WINDOW_S).round() as u32;
            if indicated > 0.0 {
                raw.accelerometers.positive_pulses[index] = pulses(axis.positive_scale_factor_at(temperature).0);
            } else {
                raw.accelerometers.negative_pulses[index] = pulses(axis.negative_scale_factor_at(temperature).0);
            }
        }
        if window < bad {
            raw.accelerometers.head_temperature[0] = f64::NAN;
        }
        collector.add(&raw);
    }
    let gravity = truth.content().gravity;
    collector.finish(&Setup::new(Some(FORCE), LocalGravity::Stated(gravity))).unwrap()
}

pub(super) fn gate(granted: f64) -> Gate {
    Gate {
        require: Requirement { bias: Some(1e-3), ..Requirement::default() },
        granted,
        left: 1e-3,
        gyroscopes: None,
        accepts_holes: false,
    }
}

/// The only cause that refuses the run, if there is one.
fn refused(granted: f64, new: &Stability, present: Option<&Stability>) -> Option<String> {
    let mut found = gate(granted).refuses_run(new, present);
    assert!(found.len() <= 1, "{found:?}");
    found.pop().map(|refusal| refusal.cause)
}

#[test]
fn a_worse_table_is_refused_beyond_what_is_granted_and_a_better_one_is_not() {
    let present = run(&truth(), 0);
    let off_by = |error_g0: f64, granted: f64| refused(granted, &run(&off(error_g0), 0), Some(&present));
    assert_eq!(off_by(0.0, 0.0), None);
    let cause = off_by(30e-6, 0.0).unwrap();
    assert!(cause.starts_with("worse than the table in force: A2 is off by 30."), "{cause}");
    assert_eq!(off_by(8e-6, 10e-6), None);
    assert!(off_by(8e-6, 1e-6).is_some());
    assert_eq!(refused(0.0, &present, Some(&run(&off(30e-6), 0))), None);
}

/// The noise of a group's mean is 20e-6 g0 here. It is the same under both tables.
#[test]
fn noise_hides_no_table_that_is_worse_and_refuses_none_that_agrees() {
    let noise = 50e-6;
    let present = noisy_run(&off(20e-6), 0, noise);
    assert!(present.verdict.axes[1].worst.interval > 50e-6);
    let cause = refused(10e-6, &noisy_run(&off(35e-6), 0, noise), Some(&present)).unwrap();
    assert!(cause.contains(": A2 is off by ") && cause.ends_with("; 10.000e-6 g0 more is granted"), "{cause}");
    for error in [-9e-6, 0.0, 9e-6, 29e-6] {
        assert_eq!(refused(10e-6, &noisy_run(&off(error), 0, noise), Some(&present)), None, "{error}");
    }
}

/// Beyond its range the old table is far off, which must not excuse a new one that is worse within it.
#[test]
fn tables_are_compared_where_both_can_judge() {
    let narrow = run(&up_to(2.5), 0);
    assert!(narrow.verdict.largest().1.least() > 100e-6, "{:?}", narrow.verdict.largest());
    let cause = refused(0.0, &run(&off(30e-6), 0), Some(&narrow)).unwrap();
    assert!(cause.starts_with("worse than the table in force: A2 is off by 30."), "{cause}");
    assert_eq!(refused(0.0, &run(&truth(), 0), Some(&narrow)), None);
    // Nothing is common.
    assert_eq!(refused(0.0, &run(&off(30e-6), 0), Some(&run(&up_to(0.95), 0))), None);
}

#[test]
fn a_run_that_is_not_judged_in_a_part_is_refused() {
    assert_eq!(refused(0.0, &run(&truth(), 3), None), None);
    let four = refused(0.0, &run(&truth(), 4), None).unwrap();
    assert!(four.starts_with("Nothing can be claimed: 4 of 300 windows are not at the attitude"), "{four}");
}

#[test]
fn a_smaller_range_is_refused() {
    assert_eq!(narrower(&truth(), &truth()), None);
    assert_eq!(narrower(&truth(), &up_to(2.0)), None);
    assert_eq!(narrower(&up_to(4.2 - 0.16), &truth()), None, "5 % of it");
    let cause = narrower(&up_to(4.2 - 0.17), &truth()).unwrap();
    assert!(
        cause.starts_with("bias of A1 covers 0.9000 to 4.0300 V, in the table in force 0.9000 to 4.2000;"),
        "{cause}"
    );
}

/// The shipped campaign at these set points.
fn shipped(points: &[f64]) -> (Campaign, Vec<Dwell>) {
    let campaign = Campaign::from_toml(include_str!("../../../../examples/campaign/campaign.toml")).unwrap();
    let samples = include_bytes!("../../../../examples/campaign/samples.csv");
    let mut dwells = read_dwells(&campaign, CampaignCsvReader::new(&samples[..]).unwrap()).unwrap();
    dwells.retain(|dwell| points.contains(&dwell.set_point_c));
    (campaign, dwells)
}

#[test]
fn without_degrees_of_freedom_a_bound_must_be_given() {
    let gate = |points: &[f64], require: &str| {
        let (campaign, dwells) = shipped(points);
        let options = CalibrationOptions { order: Some(1), ..CalibrationOptions::default() };
        let calibration = calibrate_accelerometers(&campaign, dwells, options).unwrap();
        Gate::new(require.parse().unwrap(), &calibration, FORCE)
    };
    let refused = gate(&[20.0, 25.0], "10").unwrap_err();
    assert!(refused.contains("as in --require bias=20ug0"), "{refused}");
    assert_eq!(gate(&[20.0, 25.0], "bias=20ug0").unwrap().granted, 0.0);
    let gate = gate(&[15.0, 20.0, 25.0, 30.0], "10").unwrap();
    assert!(gate.granted > 0.0 && gate.granted <= GATE_FLOOR, "{}", gate.granted);
    let Requirement { factor, bias, scale, level, rate } = gate.require;
    assert!(factor == Some(10.0) && bias > Some(GATE_FLOOR) && scale == bias && level > bias && rate.is_none());
}

/// A curve of order 1 misses the set points by far more than 20e-6 g0, which must not widen the bounds.
#[test]
fn a_fit_that_does_not_explain_its_data_has_narrow_bounds() {
    let (campaign, dwells) = shipped(&(-5..=9).map(|k| 5.0 * f64::from(k)).collect::<Vec<_>>());
    let of = |order| {
        let calibration =
            calibrate_accelerometers(&campaign, dwells.clone(), CalibrationOptions { order, ..Default::default() })
                .unwrap();
        (Requirement::of_fit(&calibration, FORCE).bias.unwrap(), group_noise(&calibration), calibration)
    };
    let (bound, noise, calibration) = of(Some(1));
    assert!(calibration.findings.iter().any(|finding| finding.name == name::LACK_OF_FIT));
    assert!((0..AXES).any(|axis| calibration.residual_sd(axis) > 20e-6));
    assert!(noise > 0.1e-6 && noise < 2e-6, "{noise}");
    assert!((bound - GATE_ACCEPTED - 3.0 * noise).abs() < 1e-12, "{bound}");
    let (bound, ..) = of(None);
    assert!(bound > GATE_FLOOR && bound < GATE_ACCEPTED, "{bound}");
}

/// A bound of the fit must not let pass what the fit itself has seen.
#[test]
fn misalignments_are_refused_in_spite_of_a_wide_bound_unless_it_is_stated() {
    let (campaign, dwells) = shipped(&[-10.0, 15.0, 40.0]);
    let refusals = |alignment, require: &str| {
        let options = CalibrationOptions { alignment, order: Some(1), ..CalibrationOptions::default() };
        let calibration = calibrate_accelerometers(&campaign, dwells.clone(), options).unwrap();
        let gate = Gate::new(require.parse().unwrap(), &calibration, FORCE).unwrap();
        let left = calibration.left_without_alignment().unwrap_or_default();
        (gate.require.bias.unwrap(), left, gate.refuses_table(&calibration, None))
    };
    let (bound, left, found) = refusals(AlignmentChoice::Without, "10");
    assert!(bound > GATE_LEFT && left > 100e-6, "{bound} {left}");
    assert!(found.len() == 1 && found[0].by == "no alignment", "{found:?}");
    assert!(found[0].cause.contains("at most 20.00e-6 g0 is required"), "{found:?}");
    assert_eq!(refusals(AlignmentChoice::IfNeeded, "10").2, []);
    assert_eq!(refusals(AlignmentChoice::Without, "bias=1mg0").2, []);
    assert_eq!(refusals(AlignmentChoice::Without, "bias=15ug0").2.len(), 1);
}
