//! Standstills: the parts of a recording in which the IMU was at rest, found from its counts alone.
//!
//! The variance of each accelerometer's counts over windows of W rows is compared with the noise of the recording
//! itself, so that no threshold is to be set:
//!
//! ```text
//! S = ln( mean over the axes of max(variance, 1/4) / noise^2 ),    noise^2: the mode of the windows' variances
//! at rest: S < m + z s,    m: mode of S,  s^2 = mean of (S - m)^2 over the windows below m
//!          z: normal quantile of 1 - W/rows
//! ```
//! Counts of one that alternate have a variance of 1/4. Movement cannot make a window quieter, so the windows below the
//! mode show the scatter of those at rest. It is at least sqrt(2/(3 (W - 1))), that of white noise on three axes. z
//! stands for a false alarms in a recording: one where standstills are wanted, far fewer where a long stretch is.

use isotherm_shared::wire::{AXES, RawSample};
use statrs::function::erf::erfc_inv;
use std::ops::Range;

/// Least rows of a window.
const LEAST_ROWS: usize = 10;
/// A row that comes later than this many intervals after the row before has a gap before it.
const GAP: f64 = 1.5;
/// Variance of counts of one that alternate \[count^2\].
const LEAST_VARIANCE: f64 = 0.25;
/// Windows at rest scatter by less than this many times what white noise does.
const MOST_SCATTER: f64 = 3.0;
/// Means of two windows at one attitude differ by less than this many standard deviations.
const SAME_MEAN: f64 = 5.0;
/// Least normal quantile, for recordings of a few windows.
const LEAST_QUANTILE: f64 = 1.0;

/// What [`find_standstills`] found.
#[derive(Clone, Debug, PartialEq)]
pub struct Standstills {
    /// Rows of a window, W.
    pub window_rows: usize,
    /// The rows of each standstill, at least W.
    pub found: Vec<Range<usize>>,
    /// Standstills that are shorter than W when half a window is cut off towards each movement.
    pub too_short: usize,
    /// Standard deviation of the counts of a row at rest, of each accelerometer, at least 1/2.
    pub noise: [f64; AXES],
    /// Scatter of the windows at rest, over that of white noise, at least 1.
    pub scatter: f64,
}

/// False alarms in a recording that was at rest all the time, on average: where each of many standstills is short.
pub const TUMBLED: f64 = 1.0;
/// The same where one long standstill is wanted.
pub const AT_REST: f64 = 1e-4;

/// Why there are no standstills.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum StandstillError {
    /// There are no rows.
    #[error("there are no rows; is it the right recording?")]
    Empty,
    /// No stretch of the recording is as long as a window.
    #[error("no {window_rows} rows without a gap; a standstill needs as many: record longer, or give a shorter window")]
    TooFewRows {
        /// Rows of a window.
        window_rows: usize,
    },
    /// The quietest windows differ by more than noise does.
    #[error(
        "never at rest: the noise of the quietest windows scatters {scatter:.1} times as much as that of an IMU at rest, over {MOST_SCATTER} times; \
         put the IMU down and take the hand off, 3 s for each attitude"
    )]
    NeverAtRest {
        /// The scatter, over that of white noise.
        scatter: f64,
    },
}

/// The stretches of `rows` without a gap: no row comes later than 1.5 intervals after the row before, and the session
/// is the same.
#[must_use]
pub fn stretches(rows: &[RawSample]) -> Vec<Range<usize>> {
    let breaks = |pair: &[RawSample]| {
        let passed = pair[1].timestamp_ns.saturating_sub(pair[0].timestamp_ns) as f64;
        pair[1].session != pair[0].session || passed > GAP * pair[1].interval_ns as f64
    };
    let starts = rows.windows(2).enumerate().filter(|(_, pair)| breaks(pair)).map(|(i, _)| i + 1);
    let starts: Vec<usize> = core::iter::once(0).chain(starts).chain([rows.len()]).collect();
    starts.windows(2).map(|ends| ends[0]..ends[1]).filter(|rows| !rows.is_empty()).collect()
}

/// Begin of each row after that of the first one \[ns\]. A new session has a new clock; its rows follow those before
/// without a pause.
#[must_use]
pub fn begins_ns(rows: &[RawSample]) -> Vec<u64> {
    let (mut begins, mut offset_ns): (Vec<u64>, i128) = (Vec::with_capacity(rows.len()), 0);
    let mut previous: Option<&RawSample> = None;
    for row in rows {
        let begin_ns = i128::from(row.timestamp_ns) - i128::from(row.interval_ns);
        match previous {
            None => offset_ns = -begin_ns,
            Some(before) if before.session != row.session => {
                offset_ns += i128::from(before.timestamp_ns) - begin_ns;
            }
            Some(_) => {}
        }
        begins.push(u64::try_from(begin_ns + offset_ns).unwrap_or_default());
        previous = Some(row);
    }
    begins
}

/// Finds the standstills of a recording. A window has `window_s` seconds, at least ten rows. `false_alarms` is
/// [`TUMBLED`] or [`AT_REST`].
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_campaign::{TUMBLED, find_standstills};
/// use isotherm_shared::wire::RawSample;
///
/// // 10 samples a second: 20 s at rest on A3, 5 s of movement, 20 s at rest on A1. Noise of a few counts.
/// let row = |i: u64| {
///     let mut raw = RawSample { sequence: i, timestamp_ns: (i + 1) * 100_000_000, ..RawSample::default() };
///     raw.interval_ns = 100_000_000;
///     let noise = |axis: u64| 20 + (i * (7 + axis) * 2_654_435_761 >> 16) as u32 % 7;
///     raw.accelerometers.positive_pulses = [noise(0), noise(1), noise(2)];
///     let moving = (200..250).contains(&i);
///     let swing = if moving { (i as u32 * 397) % 1500 } else { 0 };
///     raw.accelerometers.positive_pulses[if i < 225 { 2 } else { 0 }] += 2000 - swing;
///     raw
/// };
/// let rows: Vec<_> = (0..450).map(row).collect();
/// let standstills = find_standstills(&rows, 4.0, TUMBLED)?;
/// assert_eq!((standstills.window_rows, standstills.found.len()), (40, 2));
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// If no stretch is as long as a window, or if the IMU was never at rest.
pub fn find_standstills(rows: &[RawSample], window_s: f64, false_alarms: f64) -> Result<Standstills, StandstillError> {
    if rows.is_empty() {
        return Err(StandstillError::Empty);
    }
    let interval_ns = middle(rows.iter().map(|row| row.interval_ns as f64).collect()).max(1.0);
    // A window that is longer than the recording is as good as any other that is.
    let window_rows = ((window_s * 1e9 / interval_ns).round().min((rows.len() + 1) as f64) as usize).max(LEAST_ROWS);
    let stretches: Vec<_> =
        stretches(rows).into_iter().map(|stretch| Windows::new(rows, stretch, interval_ns, window_rows)).collect();
    let all = || stretches.iter().flat_map(|windows| &windows.variances);
    if all().next().is_none() {
        return Err(StandstillError::TooFewRows { window_rows });
    }
    let variance = [0, 1, 2].map(|axis| mode(all().map(|variances| variances[axis].ln()).collect()).exp());
    let level = |variances: &[f64; AXES]| {
        (variances.iter().zip(variance).map(|(variance, noise)| variance / noise).sum::<f64>() / AXES as f64).ln()
    };
    let levels: Vec<f64> = all().map(level).collect();
    let usual = mode(levels.clone());
    let below: Vec<f64> = levels.iter().map(|level| level - usual).filter(|below| *below < 0.0).collect();
    let of_noise = (2.0 / (3.0 * (window_rows - 1) as f64)).sqrt();
    let scatter = (below.iter().map(|below| below * below).sum::<f64>() / below.len().max(1) as f64).sqrt() / of_noise;
    if scatter > MOST_SCATTER {
        return Err(StandstillError::NeverAtRest { scatter });
    }
    let scatter = scatter.max(1.0);
    let limit = usual + scatter * of_noise * quantile(false_alarms * window_rows as f64 / rows.len() as f64);
    let noise = variance.map(f64::sqrt);
    let (mut found, mut too_short) = (Vec::new(), 0);
    for windows in &stretches {
        let at_rest: Vec<bool> = windows.variances.iter().map(|variances| level(variances) < limit).collect();
        for standstill in windows.standstills(&at_rest, noise) {
            if standstill.len() >= window_rows {
                found.push(standstill);
            } else {
                too_short += 1;
            }
        }
    }
    Ok(Standstills { window_rows, found, too_short, noise, scatter })
}

/// The windows of a stretch, one from each row on.
struct Windows {
    rows: Range<usize>,
    window_rows: usize,
    /// Mean of each axis over each window \[counts of a usual interval\].
    means: Vec<[f64; AXES]>,
    /// Variance of each axis over each window, at least [`LEAST_VARIANCE`].
    variances: Vec<[f64; AXES]>,
}

impl Windows {
    fn new(rows: &[RawSample], stretch: Range<usize>, interval_ns: f64, window_rows: usize) -> Self {
        let counts: Vec<[f64; AXES]> = rows[stretch.clone()]
            .iter()
            .map(|row| {
                let usual = interval_ns / row.interval_ns.max(1) as f64;
                let triad = &row.accelerometers;
                let net = |axis: usize| f64::from(triad.positive_pulses[axis]) - f64::from(triad.negative_pulses[axis]);
                [0, 1, 2].map(|axis| net(axis) * usual)
            })
            .collect();
        let n = window_rows as f64;
        let (mut means, mut variances) = (Vec::new(), Vec::new());
        // Sums of differences from a row nearby: counts are large, their scatter is small.
        for start in (0..counts.len()).step_by(window_rows) {
            let near = counts[start];
            let off = |row: usize| [0, 1, 2].map(|axis| counts[row][axis] - near[axis]);
            let (mut sum, mut squares) = ([0.0; AXES], [0.0; AXES]);
            for end in start + 1..=counts.len().min(start + 2 * window_rows - 1) {
                let leaving = end.checked_sub(window_rows + 1).filter(|row| *row >= start).map(off).unwrap_or_default();
                let entering = off(end - 1);
                for axis in 0..AXES {
                    sum[axis] += entering[axis] - leaving[axis];
                    squares[axis] += entering[axis].powi(2) - leaving[axis].powi(2);
                }
                if end >= start + window_rows {
                    let variance = |axis: usize| (squares[axis] - sum[axis].powi(2) / n) / (n - 1.0);
                    variances.push([0, 1, 2].map(|axis| variance(axis).max(LEAST_VARIANCE)));
                    means.push([0, 1, 2].map(|axis| near[axis] + sum[axis] / n));
                }
            }
        }
        Self { rows: stretch, window_rows, means, variances }
    }

    /// The rows of each standstill, less half a window towards each movement.
    fn standstills(&self, at_rest: &[bool], noise: [f64; AXES]) -> Vec<Range<usize>> {
        // First and last window of each.
        let mut runs: Vec<[usize; 2]> = Vec::new();
        for window in (0..at_rest.len()).filter(|window| at_rest[*window]) {
            match runs.last_mut() {
                // Every row up to this window is in one at rest: a false alarm lies between, unless the attitude is
                // another.
                Some([_, last]) if window <= *last + self.window_rows && self.is_same(*last, window, noise) => {
                    *last = window;
                }
                _ => runs.push([window, window]),
            }
        }
        let half = self.window_rows.div_ceil(2);
        let first = self.rows.start;
        let rows = |&[start, last]: &[usize; 2]| {
            let end = last + self.window_rows;
            let start = if start == 0 { 0 } else { start + half };
            let end = if end == self.rows.len() { end } else { end - half };
            first + start..first + end.max(start)
        };
        runs.iter().map(rows).collect()
    }

    fn is_same(&self, before: usize, after: usize, noise: [f64; AXES]) -> bool {
        let limit = SAME_MEAN * (2.0 / self.window_rows as f64).sqrt();
        after == before + 1
            || (0..AXES).all(|axis| (self.means[after][axis] - self.means[before][axis]).abs() < limit * noise[axis])
    }
}

/// The normal quantile of 1 - `tail`.
fn quantile(tail: f64) -> f64 {
    (core::f64::consts::SQRT_2 * erfc_inv((2.0 * tail).min(1.0))).max(LEAST_QUANTILE)
}

fn middle(mut values: Vec<f64>) -> f64 {
    let half = values.len() / 2;
    if values.is_empty() { 1.0 } else { *values.select_nth_unstable_by(half, f64::total_cmp).1 }
}

/// The half-sample mode: the half of the values that lies closest together, again and again (Bickel and
/// Fruehwirth 2006).
fn mode(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let mut part = values.as_slice();
    while part.len() > 2 {
        let half = part.len().div_ceil(2);
        let width = |start: usize| part[start + half - 1] - part[start];
        let closest = (0..=part.len() - half).min_by(|a, b| width(*a).total_cmp(&width(*b))).unwrap_or(0);
        part = &part[closest..closest + half];
    }
    part.iter().sum::<f64>() / part.len().max(1) as f64
}
