//! Temperature of a static pose, without the glitches of a thermometer.

use isotherm_campaign::{joint_range, stretches};
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_statistics::median;

/// What common thermometers give for an error.
pub(super) const ERROR_CODES: [f64; 3] = [-127.0, 85.0, 0.0];
/// A glitch is as many robust standard deviations off the median of its static pose,
const DEVIATIONS: f64 = 8.0;
/// and as many steps.
const STEPS: f64 = 10.0;
/// Standard deviation of normal values over their median absolute deviation.
const MAD: f64 = 1.4826;
/// The step is this quantile of the changes from row to row.
const QUANTILE: f64 = 0.01;

/// Head and board temperature of each accelerometer.
pub(crate) type Temperature = [[f64; AXES]; 2];

/// The temperature of a row.
pub(super) fn of_row(row: &RawSample) -> Temperature {
    [row.accelerometers.head_temperature, row.accelerometers.board_temperature]
}

/// The steps of the temperature of a recording: the 1 % quantile of its changes from row to row; 0 without any. Changes
/// over a gap, and to and from error codes, do not count.
#[must_use]
pub fn temperature_steps(rows: &[RawSample]) -> Temperature {
    let stretches = stretches(rows);
    let is_code = |value: f64| ERROR_CODES.contains(&value);
    let step = |sensor: usize, axis: usize| {
        let pairs = stretches.iter().flat_map(|stretch| rows[stretch.clone()].windows(2));
        let changes = pairs.filter_map(|pair| {
            let [before, after] = [&pair[0], &pair[1]].map(|row| of_row(row)[sensor][axis]);
            let counts = before != after && !is_code(before) && !is_code(after);
            Some((after - before).abs()).filter(|change| counts && change.is_finite())
        });
        let mut changes: Vec<f64> = changes.collect();
        let index = (changes.len() as f64 * QUANTILE) as usize;
        if changes.is_empty() { 0.0 } else { *changes.select_nth_unstable_by(index, f64::total_cmp).1 }
    };
    [0, 1].map(|sensor| [0, 1, 2].map(|axis| step(sensor, axis)))
}

/// The temperature of one sensor over a static pose.
pub(super) struct CleanTemperature {
    pub mean: f64,
    pub range: [f64; 2],
    /// Rows that are glitches.
    pub glitches: usize,
    pub median: f64,
}

impl CleanTemperature {
    pub(super) fn of(values: &[f64], step: f64) -> Self {
        let middle = median(values.iter().copied());
        let deviation = MAD * median(values.iter().map(|value| (value - middle).abs()));
        let limit = (DEVIATIONS * deviation).max(STEPS * step);
        let good = || values.iter().copied().filter(|value| (value - middle).abs() <= limit);
        let count = good().count();
        Self {
            // About the median, so that the mean of equal values is that value, to the last bit.
            mean: middle + good().map(|value| value - middle).sum::<f64>() / count as f64,
            range: joint_range(good().map(|value| [value; 2])),
            glitches: values.len() - count,
            median: middle,
        }
    }
}

/// Noise of a row: of the differences from row to row, at least that of the digits.
pub(super) fn noise(values: &[f64], step: f64) -> f64 {
    let limit = median(values.windows(2).map(|pair| (pair[1] - pair[0]).abs())) * DEVIATIONS;
    let changes: Vec<f64> = values.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let usual: Vec<f64> = changes.into_iter().filter(|change| change.abs() <= limit.max(STEPS * step)).collect();
    let mean = usual.iter().sum::<f64>() / usual.len().max(1) as f64;
    let variance = usual.iter().map(|change| (change - mean).powi(2)).sum::<f64>() / usual.len().max(1) as f64;
    (variance / 2.0).sqrt().max(step / 12.0_f64.sqrt())
}
