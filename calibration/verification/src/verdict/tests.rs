//! Verdicts on errors that are known.

use super::*;
use crate::occupancy::Bins;
use crate::window::Window;
use isotherm_simulation::RandomGenerator;

pub(crate) const FORCE: [f64; AXES] = [0.6, -0.48, 0.64];

/// A run of `count` windows with these errors of A1, A2, A3 and white noise \[g0\].
pub(crate) fn windows(count: usize, seed: u64, noise: f64, error: impl Fn(f64) -> [f64; AXES]) -> Vec<Window> {
    let mut random = RandomGenerator::new(seed, 7);
    let window = |index: usize| {
        let error = error(index as f64 / count as f64);
        let after = [0, 1, 2].map(|axis| FORCE[axis] + error[axis] + noise * random.normal());
        Window {
            time_s: index as f64 * 10.0,
            seconds: 10.0,
            before: after,
            after,
            head: [0.0; AXES],
            board: [0.0; AXES],
            temperature: [[[0.0; 2]; 2]; AXES],
            touched: [[Bins::default(); 2]; AXES],
            flagged: false,
            counts: true,
            still: true,
        }
    };
    (0..count).map(window).collect()
}

#[test]
fn the_noise_and_a_slow_wave_are_found() {
    for seed in 0..400 {
        let run = windows(600, seed, 3e-6, |t| [20e-6, 5e-6 * libm::sin(6.0 * t), 0.0]);
        let verdict = Verdict::of(&run, FORCE, true, Some(1.0));
        let (of, wave) = (verdict.axes[0], verdict.axes[1]);
        assert!((of.noise / 3e-6 - 1.0).abs() < 0.15, "{of:?}");
        assert!(wave.variation.value > 3e-6 && wave.variation.most() < 15e-6, "{wave:?}");
    }
}

#[test]
fn what_is_not_a_number_is_never_a_small_error() {
    let mut run = windows(600, 1, 3e-6, |_| [0.0; AXES]);
    run[300].after[1] = f64::NAN;
    let verdict = Verdict::of(&run, FORCE, true, Some(1.0));
    let errors = verdict.axes[1];
    for value in [errors.variation.value, errors.worst.value, errors.worst.least(), errors.largest_window] {
        assert!(value.is_nan(), "{errors:?}");
    }
    assert!(verdict.level.worst.value.is_nan() && verdict.largest().1.most().is_nan());
    assert!(verdict.axes[0].worst.value < 10e-6);
}

/// How many intervals contain the truth, which is no error \[%\]: that of the constant error, and that of the worst
/// group. Noise is correlated from window to window by `correlation`.
fn coverage(count: usize, correlation: f64, trials: u64) -> [f64; 2] {
    let innovation = (1.0 - correlation * correlation).sqrt();
    let mut inside = [0_u32; 2];
    for seed in 0..trials {
        let mut random = RandomGenerator::new(seed, 9);
        let mut noise = random.normal();
        let mut next = || {
            noise = correlation * noise + innovation * random.normal();
            noise
        };
        let found = errors(&(0..count).map(|_| next()).collect::<Vec<_>>(), true);
        for (inside, estimate) in inside.iter_mut().zip([found.constant.unwrap(), found.worst]) {
            *inside += u32::from(estimate.value.abs() <= estimate.interval);
        }
    }
    inside.map(|inside| 100.0 * f64::from(inside) / trials as f64)
}

/// 4000 trials scatter by 0.35 %. In a short run the noise and its estimate come from the same few windows: then
/// intervals are too wide.
#[test]
fn intervals_contain_the_truth_at_their_rate() {
    for (count, highest) in [(3, 100.0), (9, 98.5), (30, 96.5), (600, 96.0)] {
        let [constant, worst] = coverage(count, 0.0, 4000);
        assert!((94.0..=96.0).contains(&constant), "{count} windows: constant {constant} %");
        assert!((94.0..=highest).contains(&worst), "{count} windows: worst {worst} %");
    }
}

/// The figures of the module's definition: how slow the noise may be.
#[test]
fn the_interval_of_the_constant_error_holds_for_noise_that_a_tenth_of_the_run_averages_out() {
    for (correlation, right) in [(0.8, 94.5), (0.95, 90.5), (0.99, 66.3)] {
        let [constant, _] = coverage(600, correlation, 4000);
        assert!((constant - right).abs() < 2.5, "correlation {correlation}: {constant} %");
    }
}

#[test]
fn without_an_attitude_a_constant_error_is_not_judged() {
    let run = windows(600, 1, 1e-6, |_| [20e-6, 0.0, 0.0]);
    let verdict = Verdict::of(&run, [FORCE[0] + 20e-6, FORCE[1], FORCE[2]], false, None);
    assert!(verdict.axes.iter().all(|errors| errors.constant.is_none() && errors.worst.most() < 3e-6));
    assert!(verdict.length.is_none() && verdict.level.constant.is_none());
    assert_eq!(verdict.missing().map(|[words, _]| words.contains("attitude and local gravity")), Some(true));
}

#[test]
fn the_largest_error_can_be_the_length_and_level_is_across_the_force() {
    // An error along the force changes the length only.
    let along = windows(600, 1, 0.1e-6, |_| FORCE.map(|f| f * 50e-6));
    let verdict = Verdict::of(&along, FORCE, true, Some(1.0));
    assert_eq!(verdict.largest().0, "the length");
    assert!((verdict.length.unwrap().worst.value - 50e-6).abs() < 1e-6 && verdict.level.worst.most() < 1e-6);
    // An error across it changes the level only: (0.48, 0.6, 0) is perpendicular to the force.
    let across = windows(600, 1, 0.1e-6, |_| [48e-6, 60e-6, 0.0]);
    let verdict = Verdict::of(&across, FORCE, true, Some(1.0));
    let size = libm::hypot(48e-6, 60e-6);
    // No axis has the whole of it, so that it is the largest error. "up to" is its bound.
    let (name, largest) = verdict.largest();
    assert!(name == "the level" && (largest.value - size).abs() < 1e-6, "{name} {largest:?}");
    let words = format!(": up to {:.2} arcsec of level", arcsec(verdict.level.worst.most()));
    assert!(verdict.conclusion().contains(&words), "{}", verdict.conclusion());
    assert!((verdict.level.worst.value - size).abs() < 1e-6 && verdict.length.unwrap().worst.most() < 1e-6);
}

#[test]
fn a_short_run_has_wide_intervals_and_no_group_of_nothing() {
    for count in 3..40 {
        let verdict = Verdict::of(&windows(count, 3, 2e-6, |_| [0.0; AXES]), FORCE, true, Some(1.0));
        assert!(verdict.groups >= 3 && verdict.groups * verdict.windows <= count, "{count}: {verdict:?}");
        let errors = verdict.axes[0];
        assert!(errors.worst.interval > 0.0 && errors.constant.unwrap().interval.is_finite(), "{count}: {errors:?}");
    }
}
