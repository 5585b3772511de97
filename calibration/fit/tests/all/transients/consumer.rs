//! A real thermal run of a consumer IMU with gyroscopes: it has more hysteresis than a lag explains, and its time
//! constant cannot be found from it.

use isotherm_fit::{CurveSource, LagChoice, RampRecording, TransientOptions, TransientVerdict, Transients, fit};
use isotherm_recording::RawCsvReader;
use isotherm_shared::compensate::answer;
use isotherm_shared::lag::Lag;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::units::ARCSEC;
use isotherm_shared::wire::RawSample;

/// Rows before the last cooling.
pub(crate) const COOLING_AND_HEATING: usize = 6194;
/// A time constant that the user gives \[s\].
const GIVEN_S: f64 = 100.0;

pub(crate) fn nominal() -> CoefficientTable {
    CoefficientTable::from_toml(include_str!("../../data/consumer/nominal.toml"), None).unwrap()
}

pub(crate) fn rows() -> Vec<RawSample> {
    let text = include_str!("../../data/consumer/thermal-run.csv");
    RawCsvReader::new(text.as_bytes()).unwrap().collect::<Result<_, _>>().unwrap()
}

fn fitted(rows: &[RawSample], lag: LagChoice) -> Transients {
    let mut recording = RampRecording::new("thermal-run");
    rows.iter().for_each(|raw| recording.add(raw).unwrap());
    let options = TransientOptions { curves: CurveSource::Ramps, lag, predecessor_s: None };
    let found = fit(&[recording], &nominal(), &options).unwrap();
    for bias in &found.biases {
        let written = if bias.transient == 0.0 { "not written" } else { "written" };
        let prediction = bias.prediction.unwrap();
        let part = prediction.written / prediction.static_curve;
        println!("{lag:?} {}: {part:.2} of the error of the static curve, {written}", bias.name());
    }
    found
}

fn written(found: &Transients) -> Vec<&'static str> {
    found.biases.iter().filter(|bias| bias.transient != 0.0).map(|bias| bias.name()).collect()
}

#[test]
fn hysteresis_is_not_taken_for_a_lag() {
    let found = fitted(&rows(), LagChoice::Search);
    assert_eq!(found.verdict, TransientVerdict::Hysteresis);
    assert_eq!(written(&found), [""; 0]);
    for reason in ["hysteresis", "the time constant is at the edge of its range", "hysteresis explains as much"] {
        assert!(found.words.iter().any(|words| words.contains(reason)), "{reason}: {:?}", found.words);
    }
}

#[test]
fn with_a_given_time_constant_five_of_six_are_written() {
    let found = fitted(&rows(), LagChoice::Given(GIVEN_S));
    assert_eq!(written(&found), ["A1", "A2", "A3", "G1", "G2"]);
    for reason in ["at the edge of its range", "hysteresis explains as much"] {
        assert!(found.warnings.iter().any(|warning| warning.contains(reason)), "{reason}: {:?}", found.warnings);
    }
}

/// What the table of the fit leaves of A1 to G3 in the last cooling, which was not fitted: rms about the mean of what
/// was \[g0, deg/h\].
fn left_over(found: &Transients, rows: &[RawSample]) -> [f64; 6] {
    let mut content = nominal().content().clone();
    found.apply(&mut content);
    let table = CoefficientTable::new(content).unwrap();
    let mut lag = Lag::new(table.lag_ns());
    let rates = rows.iter().map(|raw| {
        let mut raw = *raw;
        lag.follow(&raw);
        lag.fill(&mut raw);
        let increment = answer(Some(&table), &raw);
        let seconds = raw.interval_ns as f64 / 1e9;
        let [x, y, z] = increment.velocity_increment.map(|dv| dv / table.content().gravity / seconds);
        let [p, q, r] = increment.angle_increment.map(|angle| angle / ARCSEC / seconds);
        [x, y, z, p, q, r]
    });
    let rates: Vec<_> = rates.collect();
    let soaked = (3.0 * GIVEN_S / 0.505) as usize;
    core::array::from_fn(|sensor| {
        let values = |rows: core::ops::Range<usize>| rates[rows].iter().map(move |rate| rate[sensor]);
        let fitted = COOLING_AND_HEATING - soaked;
        let mean = values(soaked..COOLING_AND_HEATING).sum::<f64>() / fitted as f64;
        let left_out = rates.len() - COOLING_AND_HEATING;
        let squares: f64 = values(COOLING_AND_HEATING..rates.len()).map(|value| (value - mean).powi(2)).sum();
        (squares / left_out as f64).sqrt()
    })
}

/// A cooling and a heating are fitted, the next cooling is judged with the table, as in flight.
#[test]
fn the_cooling_that_was_left_out_is_predicted_with_half_the_error() {
    let rows = rows();
    let fitted_rows = &rows[..COOLING_AND_HEATING];
    let with_lag = fitted(fitted_rows, LagChoice::Given(GIVEN_S));
    assert_eq!(written(&with_lag), ["A1", "A2", "A3", "G1", "G2"]);
    let [still, moving] = [&fitted(fitted_rows, LagChoice::None), &with_lag].map(|found| left_over(found, &rows));
    let ratios: Vec<f64> = still.iter().zip(&moving).map(|(still, moving)| still / moving).collect();
    println!("left over {still:?} g0, deg/h, with lag {moving:?}, ratios {ratios:.2?}");
    // G1 has 1.96.
    assert_eq!(ratios.iter().filter(|ratio| **ratio >= 1.9).count(), 5, "{ratios:?}");
    assert_eq!(ratios.iter().filter(|ratio| **ratio >= 2.1).count(), 4, "{ratios:?}");
}
