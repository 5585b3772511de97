//! The real run of a consumer IMU, 51 -> -17 -> 74 -> 32 degC, against what both autopilots made of it.

use super::autopilots::{AutopilotCubics, of_all_rows, of_the_heating};
use crate::transients::consumer::{COOLING_AND_HEATING, nominal, rows};
use core::ops::Range;
use isotherm_autopilot::Autopilot;
use isotherm_campaign::Campaign;
use isotherm_fit::{LagChoice, RampRecording, WarmUpCalibration, WarmUpOptions, calibrate_warm_up};
use isotherm_shared::compensate::answer;
use isotherm_shared::lag::Lag;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{Flags, RawSample};
use std::collections::BTreeMap;

/// Rows of the heating, as the autopilots' scripts had them.
const HEATING: Range<usize> = 2680..6180;

fn calibrated(rows: &[RawSample], options: &WarmUpOptions) -> WarmUpCalibration {
    let mut recording = RampRecording::new("thermal-run");
    rows.iter().for_each(|raw| recording.add(raw).unwrap());
    let imu = nominal().content().imu.clone();
    let campaign = Campaign::warm_up(imu, 9.80665, "degC", &["thermal-run".to_owned()]);
    calibrate_warm_up(&campaign, &[recording], &nominal(), options).unwrap()
}

fn without_lag() -> WarmUpOptions {
    WarmUpOptions { lag: LagChoice::None, ..WarmUpOptions::default() }
}

/// Readings of A1 to G3 under a table \[m/s2, rad/s\], with their temperature.
fn readings(table: &CoefficientTable, rows: &[RawSample]) -> Vec<(f64, [f64; 6])> {
    let mut lag = Lag::new(table.lag_ns());
    let of_row = |raw: &RawSample| {
        let mut raw = *raw;
        lag.follow(&raw);
        lag.fill(&mut raw);
        let found = answer(Some(table), &raw);
        let seconds = raw.interval_ns as f64 / 1e9;
        let [x, y, z] = found.velocity_increment.map(|dv| dv / seconds);
        let [p, q, r] = found.angle_increment.map(|angle| angle / seconds);
        (raw.accelerometers.head_temperature[0], [x, y, z, p, q, r])
    };
    rows.iter().map(of_row).collect()
}

/// The means of bins of 1 degC.
fn bins(values: impl Iterator<Item = (f64, f64)>) -> Vec<f64> {
    let mut all: BTreeMap<i64, (f64, f64)> = BTreeMap::new();
    for (temperature, value) in values {
        let (sum, count) = all.entry(temperature.floor() as i64).or_default();
        *sum += value;
        *count += 1.0;
    }
    all.values().map(|(sum, count)| sum / count).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let squares: Vec<f64> = values.map(|value| value * value).collect();
    mean(&squares).sqrt()
}

/// What a table leaves of the bins, about their mean.
fn left(readings: &[(f64, [f64; 6])]) -> [f64; 6] {
    core::array::from_fn(|sensor| {
        let means = bins(readings.iter().map(|(temperature, of)| (*temperature, of[sensor])));
        rms(means.iter().map(|value| value - mean(&means)))
    })
}

/// What the better autopilot leaves of raw readings.
fn left_by_the_better(raw: &[(f64, [f64; 6])], theirs: &[AutopilotCubics; 2]) -> [f64; 6] {
    let of = theirs.each_ref().map(|theirs| {
        let corrected = |(temperature, of): &(f64, [f64; 6])| {
            (*temperature, core::array::from_fn(|sensor| of[sensor] - theirs.at(sensor, *temperature)))
        };
        left(&raw.iter().map(corrected).collect::<Vec<_>>())
    });
    core::array::from_fn(|sensor| of[0][sensor].min(of[1][sensor]))
}

#[test]
fn all_rows_are_within_a_percent_of_the_better_autopilot() {
    let rows = rows();
    let found = calibrated(&rows, &without_lag());
    assert_eq!((found.order.order, found.order.sweeps_left_out), (3, 3));
    let own = readings(found.table(), &rows);
    let theirs = left_by_the_better(&readings(&nominal(), &rows), &of_all_rows());
    let ours = left(&own);
    println!("all rows: ours {ours:.6?}, the better {theirs:.6?}");
    for (sensor, (ours, theirs)) in ours.iter().zip(theirs).enumerate() {
        assert!(*ours < 1.01 * theirs, "{sensor}: {ours} {theirs}");
    }
    // The figures of the result are those of its table.
    for (bias, ours) in found.biases.iter().zip(ours) {
        let si = isotherm_fit::TriadUnits::of(bias.kind).si(bias.after.sd, 9.80665).0;
        assert!((si / ours - 1.0).abs() < 0.02, "{} {si} {ours}", bias.name());
    }
    // Its own rows are in its range.
    for raw in &rows {
        let flags = Flags(answer(Some(found.table()), raw).flags);
        assert_eq!(flags, Flags::default(), "{flags}");
    }
}

#[test]
fn a_sweep_left_out_is_within_three_percent_of_the_better_autopilot() {
    let rows = rows();
    let found = calibrated(&rows[HEATING], &without_lag());
    assert_eq!((found.order.order, found.order.sweeps_left_out), (3, 0));
    let coolings: Vec<_> = rows[..HEATING.start].iter().chain(&rows[HEATING.end..]).copied().collect();
    let ours = left(&readings(found.table(), &coolings));
    let theirs = left_by_the_better(&readings(&nominal(), &coolings), &of_the_heating());
    println!("coolings left out: ours {ours:.6?}, the better {theirs:.6?}");
    for (sensor, (ours, theirs)) in ours.iter().zip(theirs).enumerate() {
        assert!(*ours < 1.03 * theirs, "{sensor}: {ours} {theirs}");
    }
    assert!(found.accuracy().contains("not known"), "{}", found.accuracy());
    assert_eq!(found.ramps.findings[0].name, isotherm_support::finding::name::ONE_DIRECTION);
}

/// What a table leaves of the last cooling, about the mean of the rows that it was made from, by bins of 1 degC: rms,
/// and largest.
fn left_of_last_cooling(table: &CoefficientTable, rows: &[RawSample]) -> [[f64; 2]; 6] {
    let readings = readings(table, rows);
    let (fitted, last) = readings.split_at(COOLING_AND_HEATING);
    core::array::from_fn(|sensor| {
        let of = |part: &[(f64, [f64; 6])]| bins(part.iter().map(|(temperature, of)| (*temperature, of[sensor])));
        let middle = mean(&of(fitted));
        let off: Vec<f64> = of(last).iter().map(|value| (value - middle).abs()).collect();
        [rms(off.iter().copied()), off.iter().copied().fold(0.0, f64::max)]
    })
}

#[test]
fn with_a_lag_the_sweep_left_out_has_half_of_their_error() {
    let rows = rows();
    let made = |lag| calibrated(&rows[..COOLING_AND_HEATING], &WarmUpOptions { lag, ..Default::default() });
    let [still, moving] = [made(LagChoice::None), made(LagChoice::Given(100.0))];
    let [before, after] = [&still, &moving].map(|found| left_of_last_cooling(found.table(), &rows));
    println!("the last cooling: rms and largest without lag {before:.6?}, with lag {after:.6?}");
    for sensor in 0..3 {
        assert!(after[sensor][0] < 0.5 * before[sensor][0], "{sensor}: {after:?} {before:?}");
    }
    // A cubic without lag and without a constant for each recording is what both autopilots make of these rows.
    let beside = WarmUpOptions { beside: vec![Autopilot::Px4, Autopilot::ArduPilot], ..without_lag() };
    let found = calibrated(&rows[..COOLING_AND_HEATING], &beside);
    for bias in &found.biases {
        for (autopilot, _, spread) in &bias.beside {
            assert!((spread.sd / bias.after.sd - 1.0).abs() < 0.06, "{} {autopilot:?}: {spread:?}", bias.name());
        }
    }
}

/// The band is half of the largest difference of two sweeps: a third one may be outside for a few degrees.
#[test]
fn the_band_holds_the_sweep_left_out() {
    let rows = rows();
    let found = calibrated(&rows[..COOLING_AND_HEATING], &without_lag());
    let readings = readings(found.table(), &rows[COOLING_AND_HEATING..]);
    let mut held = [0; 3];
    for (sensor, bias) in found.biases.iter().enumerate() {
        let means = bins(readings.iter().map(|(temperature, of)| (*temperature, of[sensor])));
        let mut off: Vec<f64> = means.iter().map(|value| (value - mean(&means)).abs()).collect();
        off.sort_by(f64::total_cmp);
        let (rms, at_95, largest) = (rms(off.iter().copied()), off[off.len() * 95 / 100], off[off.len() - 1]);
        let band = bias.band.as_ref().unwrap().half_width;
        let band = isotherm_fit::TriadUnits::of(bias.kind).si(band, 9.80665).0;
        println!("{}: rms {rms:.6}, 95 % below {at_95:.6}, largest {largest:.6}, band {band:.6}", bias.name());
        for (held, figure) in held.iter_mut().zip([rms, at_95, largest]) {
            *held += u32::from(figure <= band);
        }
    }
    println!("held: rms {}, 95 % of the bins {}, all bins {} of 6", held[0], held[1], held[2]);
    assert!(held[0] == 6 && held[1] >= 5, "{held:?}");
}

/// The cubics for comparison are those of the scripts, but for running means and medians.
#[test]
fn the_cubics_beside_are_those_of_the_autopilots() {
    let beside = WarmUpOptions { beside: vec![Autopilot::Px4, Autopilot::ArduPilot], ..without_lag() };
    let found = calibrated(&rows(), &beside);
    for (theirs, number) in of_all_rows().iter().zip(0..) {
        for (sensor, bias) in found.biases.iter().enumerate() {
            let (autopilot, curve, _) = &bias.beside[number];
            let [low, high] = curve.range();
            let si = |value: f64| isotherm_fit::TriadUnits::of(bias.kind).si(value, 9.80665).0;
            let differs: Vec<f64> = (0..=100)
                .map(|k| low + (high - low) * f64::from(k) / 100.0)
                .map(|t| si(curve.at(t)) - theirs.at(sensor, t))
                .collect();
            let middle = mean(&differs);
            let largest = differs.iter().map(|it| (it - middle).abs()).fold(0.0, f64::max);
            let span = si(bias.before.largest);
            println!("{autopilot:?} {}: {largest:.2e} of {span:.2e}", bias.name());
            assert!(largest < 0.012 * span, "{}", bias.name());
        }
    }
}
