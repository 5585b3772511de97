//! Steps in a ramp: what a bump of the IMU, or a jump of a sensor, leaves in the values.
//!
//! What constant, curve, lag, start, plays and time leave over is smooth or noise. A step is where a line with a step
//! in it explains the blocks nearby better than a line: by over 6 errors, those of the blocks nearby and of all the
//! steps that noise makes elsewhere.

use super::blocks::{RampSweep, Ramps};
use super::recording::RampRecording;
use core::ops::Range;
use isotherm_shared::units::SensorKind;
use isotherm_statistics::{median, robust_sd};

/// Blocks on each side of a step.
const SIDE: usize = 8;
/// A step is over this many of its errors.
const ERRORS: f64 = 6.0;
/// After a turn a sensor may follow faster than any column of the fit: this part of a sweep does not count.
const TURN: f64 = 0.15;
/// Steps of several sensors within this many blocks are one.
const TOGETHER: usize = 3;

/// A step of one bias.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Step {
    /// Index of the bias.
    pub bias: usize,
    /// Index of the first block after it.
    pub block: usize,
    /// Size \[g0 or deg/h\].
    pub size: f64,
    errors: f64,
}

/// The largest step in the sweeps of each recording, with those of other biases at the same time. `residuals` gives
/// what is left of each bias, by block.
pub(super) fn steps(ramps: &Ramps, residuals: &[Vec<f64>]) -> Vec<Vec<Step>> {
    let of_recording = |recording: usize| {
        let windows = windows(ramps, recording);
        let all = residuals.iter().enumerate().map(|(bias, values)| of_bias(&windows, bias, values));
        let found: Vec<Step> = all.flatten().collect();
        let largest = found.iter().copied().max_by(|a, b| a.errors.total_cmp(&b.errors))?;
        Some(found.into_iter().filter(|step| step.block.abs_diff(largest.block) <= TOGETHER).collect())
    };
    (0..ramps.recordings).filter_map(of_recording).collect()
}

/// The blocks around each place where a step is looked for: in one sweep, without a gap.
fn windows(ramps: &Ramps, recording: usize) -> Vec<Range<usize>> {
    let usual_s = {
        let own = &ramps.blocks[ramps.blocks_of(recording)];
        median(own.windows(2).map(|pair| pair[1].age_s - pair[0].age_s))
    };
    let whole = |window: &Range<usize>| {
        let span_s = ramps.blocks[window.end - 1].age_s - ramps.blocks[window.start].age_s;
        span_s < 1.5 * usual_s * (2 * SIDE) as f64 && ramps.blocks[window.clone()].iter().all(|block| !block.left_out)
    };
    let of_sweep = |sweep: &RampSweep| {
        let ends = sweep.pieces.first().zip(sweep.pieces.last()).map(|(first, last)| first.start..last.end);
        let Range { start, end } = ends.unwrap_or_default();
        let begin = start + ((end - start) as f64 * TURN) as usize;
        (begin..end).map(|begin| begin..begin + 2 * SIDE).take_while(move |window| window.end <= end)
    };
    ramps.sweeps.iter().filter(|sweep| sweep.recording == recording).flat_map(of_sweep).filter(whole).collect()
}

/// The largest step of one bias in the windows of a recording.
fn of_bias(windows: &[Range<usize>], bias: usize, residuals: &[f64]) -> Option<Step> {
    let of_window = |window: &Range<usize>| {
        let (size, error) = step_of(&residuals[window.clone()]);
        (window.start + SIDE, size, error)
    };
    let found: Vec<(usize, f64, f64)> = windows.iter().map(of_window).collect();
    let noise = robust_sd(&found.iter().map(|(_, size, _)| *size).collect::<Vec<_>>());
    let step = |(block, size, error): (usize, f64, f64)| {
        let errors = size.abs() / error.max(noise).max(f64::MIN_POSITIVE);
        Step { bias, block, size, errors }
    };
    let largest = found.into_iter().map(step).max_by(|a, b| a.errors.total_cmp(&b.errors))?;
    (largest.errors > ERRORS).then_some(largest)
}

/// The step in the middle of the values next to a line, with its standard error.
fn step_of(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let rows = values.iter().enumerate().map(|(i, value)| {
        let t = i as f64 - (n - 1.0) / 2.0;
        (t, 0.5 * t.signum(), value - mean)
    });
    let mut sums = [0.0; 6];
    for (t, side, y) in rows {
        for (sum, product) in sums.iter_mut().zip([t * t, t * side, side * side, t * y, side * y, y * y]) {
            *sum += product;
        }
    }
    let [tt, ts, ss, ty, sy, yy] = sums;
    let determinant = tt * ss - ts * ts;
    let (slope, step) = ((ty * ss - sy * ts) / determinant, (sy * tt - ty * ts) / determinant);
    let left = (yy - slope * ty - step * sy).max(0.0) / (n - 3.0);
    (step, (left * tt / determinant).sqrt())
}

/// When a step was, and how large it is in each bias: `the IMU moved at 12:31: A1 by 0.50 mrad (500 ug0)`.
pub(super) fn words(ramps: &Ramps, recordings: &[RampRecording], steps: &[Step]) -> Option<String> {
    let block = &ramps.blocks[steps.first()?.block];
    let recording = &recordings[block.recording];
    let sizes = steps.iter().map(|step| {
        let bias = &ramps.biases[step.bias];
        let name = bias.kind.names()[bias.axis];
        match bias.kind {
            SensorKind::Accelerometer => format!("{name} by {:.2} mrad ({:.0} ug0)", step.size * 1e3, step.size * 1e6),
            SensorKind::Gyroscope => format!("{name} by {:.3} deg/h", step.size),
        }
    });
    let at = clock(recording.begin_ns(&block.bins), block.age_s);
    Some(format!("{}: moved {at}: {}", recording.name(), sizes.collect::<Vec<_>>().join(", ")))
}

/// `at 12:31 UTC` of a time since 1970, otherwise `1:05:10 after its begin`.
pub(crate) fn clock(time_ns: u64, age_s: f64) -> String {
    /// Earlier times count from something else, such as the start of a computer.
    const SINCE_1970: u64 = 946_684_800_000_000_000;
    if time_ns >= SINCE_1970 {
        let minutes = time_ns / 60_000_000_000;
        return format!("at {:02}:{:02} UTC", minutes / 60 % 24, minutes % 60);
    }
    let seconds = age_s as u64;
    format!("{}:{:02}:{:02} after its begin", seconds / 3600, seconds / 60 % 60, seconds % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_beside_a_line_has_its_size_and_error() {
        let noise = |i: i32| 0.1 * f64::from([3, -7, 5, -2, 8, -6, -4, 1][(i % 8) as usize]) / 8.0;
        let values = |step: f64| -> Vec<f64> {
            (0..16).map(|i| 0.3 * f64::from(i) + noise(i) + if i < 8 { 0.0 } else { step }).collect()
        };
        let (size, error) = step_of(&values(2.0));
        assert!((size - 2.0).abs() < 3.0 * error && error < 0.2, "{size} {error}");
        let (size, error) = step_of(&values(0.0));
        assert!(size.abs() < 3.0 * error, "{size} {error}");
        // A single broken value is no step.
        let mut one = values(0.0);
        one[8] += 20.0;
        let (size, error) = step_of(&one);
        assert!(size.abs() < 4.0 * error, "{size} {error}");
    }

    #[test]
    fn the_time_of_a_step_is_that_of_a_clock_where_there_is_one() {
        assert_eq!(clock(1_764_073_890_000_000_000, 90.0), "at 12:31 UTC");
        assert_eq!(clock(5_000_000_000, 3910.0), "1:05:10 after its begin");
    }
}
