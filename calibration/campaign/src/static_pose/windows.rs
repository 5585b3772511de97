//! The windows of a recording: W rows each, in order, without glitches.

use crate::net::{net, steps};
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_statistics::median;
use isotherm_support::checkpoint::checkpoint;
use std::ops::Range;

/// A row that comes later than this many intervals after the row before has a gap before it.
pub(super) const GAP: f64 = 1.5;
/// Least rows of a window: 12 degrees of freedom on three axes.
const LEAST_ROWS: usize = 5;
/// Share of a window's rows that may be lost; less than the half window that is cut off towards a movement.
const MOST_LOST: f64 = 0.2;
/// A row is a glitch if it leaves the median of the five around it by so many median absolute deviations.
const GLITCH: f64 = 10.0;
/// Variance of a window in which nothing changes but the last digit, over that of one step.
const LIVE: f64 = 1e-6;
/// No static pose goes on over a pause as long \[ns\].
const LONGEST_PAUSE_NS: u64 = 600_000_000_000;

/// Net counts of a row, of each accelerometer.
pub(super) type Counts = [f64; AXES];

/// All windows; one begins at each row that is no glitch, but for the last.
pub(super) struct Windows {
    /// W.
    pub window_rows: usize,
    /// Usual interval \[ns\].
    pub interval_ns: f64,
    /// Rows that are no glitch.
    pub rows: Vec<usize>,
    /// Rows that are a glitch.
    pub glitches: Vec<usize>,
    /// Counts of a usual interval, of the rows that are no glitch.
    pub counts: Vec<Counts>,
    /// Mean of each window.
    pub means: Vec<Counts>,
    /// Variance of each window, at least that of two neighbouring steps in turn.
    pub variances: Vec<Counts>,
    /// Mean over the axes of ln variance.
    pub levels: Vec<f64>,
    /// Whether a window has its rows: at most a fifth is lost, and all are of one session.
    pub whole: Vec<bool>,
    /// Whether a window changes.
    pub live: Vec<bool>,
    /// Whether the window after it follows without a pause.
    pub paired: Vec<bool>,
    /// Number of the part of the recording that each row without a glitch is in: a new session, or one after a long
    /// pause.
    part: Vec<u32>,
    times_ns: Vec<u64>,
}

impl Windows {
    /// The windows of `window_s` seconds.
    pub(super) fn new(rows: &[RawSample], window_s: f64) -> Self {
        let interval_ns = median(rows.iter().map(|row| row.interval_ns as f64)).max(1.0);
        // A window that is longer than the recording is as good as any other that is.
        let most = (rows.len() + 1) as f64;
        let window_rows = ((window_s * 1e9 / interval_ns).round_ties_even().min(most) as usize).max(LEAST_ROWS);
        checkpoint();
        let steps = steps(rows);
        let all: Vec<Counts> = rows.iter().map(|row| rate(row, interval_ns)).collect();
        checkpoint();
        let is_glitch = glitches(&all, window_rows, steps);
        let split = |wanted: bool| (0..rows.len()).filter(|row| is_glitch[*row] == wanted).collect::<Vec<_>>();
        let (kept, glitches) = (split(false), split(true));
        let times_ns: Vec<u64> = kept.iter().map(|row| rows[*row].timestamp_ns).collect();
        let mut windows = Self {
            window_rows,
            interval_ns,
            glitches,
            counts: kept.iter().map(|row| all[*row]).collect(),
            means: Vec::new(),
            variances: Vec::new(),
            levels: Vec::new(),
            whole: Vec::new(),
            live: Vec::new(),
            paired: Vec::new(),
            part: parts(rows, &kept),
            times_ns,
            rows: kept,
        };
        windows.sum(steps.map(|step| step * step / 4.0));
        windows.look_for_pauses();
        windows
    }

    /// Number of windows.
    pub(super) fn len(&self) -> usize {
        self.means.len()
    }

    /// Whether two windows are of one part of the recording.
    pub(super) fn are_together(&self, one: usize, other: usize) -> bool {
        self.part[one] == self.part[other]
    }

    /// Mean counts of rows.
    pub(super) fn mean(&self, rows: Range<usize>) -> Counts {
        let n = rows.len().max(1) as f64;
        [0, 1, 2].map(|axis| self.counts[rows.clone()].iter().map(|counts| counts[axis]).sum::<f64>() / n)
    }

    /// Whether two windows' means differ in any axis by more than so many standard errors of a difference.
    pub(super) fn differ(&self, one: usize, other: usize, errors: f64, allan: Counts) -> bool {
        let off = |axis: usize| (self.means[one][axis] - self.means[other][axis]).abs();
        (0..AXES).any(|axis| off(axis) > errors * (2.0 * allan[axis]).sqrt())
    }

    /// Means and variances, at least `floor`. Sums are of differences from a row nearby: counts are large, their
    /// scatter is small.
    fn sum(&mut self, floor: Counts) {
        let (n, window_rows, counts) = (self.window_rows as f64, self.window_rows, &self.counts);
        for start in (0..counts.len()).step_by(window_rows) {
            checkpoint();
            checkpoint();
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
                if end < start + window_rows {
                    continue;
                }
                let variance = [0, 1, 2].map(|axis| (squares[axis] - sum[axis].powi(2) / n) / (n - 1.0));
                let least = [0, 1, 2].map(|axis| variance[axis].max(floor[axis]));
                self.means.push([0, 1, 2].map(|axis| near[axis] + sum[axis] / n));
                self.live.push((0..AXES).any(|axis| variance[axis] > LIVE * floor[axis]));
                self.levels.push(least.iter().map(|variance| libm::log(*variance)).sum::<f64>() / AXES as f64);
                self.variances.push(least);
            }
        }
    }

    fn look_for_pauses(&mut self) {
        let (count, n) = (self.len(), self.window_rows);
        let without_pause = |first: usize, rows: usize| {
            let last = first + rows - 1;
            let most = ((rows - 1) as f64 * (1.0 + MOST_LOST) + 0.5) * self.interval_ns;
            let passed = self.times_ns[last].saturating_sub(self.times_ns[first]) as f64;
            passed <= most && self.part[first] == self.part[last]
        };
        let whole: Vec<bool> = (0..count).map(|window| without_pause(window, n)).collect();
        // A movement may be hidden in a row that is missing between the two.
        let passed = |row: usize| self.times_ns[row].saturating_sub(self.times_ns[row - 1]) as f64;
        let paired = |window: usize| {
            let next = window + n;
            let both = next < count && whole[window] && whole[next];
            both && passed(next) <= GAP * self.interval_ns && without_pause(window, 2 * n)
        };
        self.paired = (0..count).map(paired).collect();
        self.whole = whole;
    }
}

/// Net counts of a row, times the usual interval over its own.
fn rate(row: &RawSample, interval_ns: f64) -> Counts {
    let usual = interval_ns / row.interval_ns.max(1) as f64;
    [0, 1, 2].map(|axis| net(row, axis) * usual)
}

/// Whether each row is a glitch in any axis. The scale is that of the signal in the W rows nearby, not that of the
/// residuals, which are small next to a fan.
fn glitches(counts: &[Counts], window_rows: usize, steps: Counts) -> Vec<bool> {
    let last = counts.len().saturating_sub(1);
    let mut is_glitch = vec![false; counts.len()];
    let mut values = Vec::with_capacity(window_rows);
    for start in (0..counts.len()).step_by(window_rows) {
        let end = (start + window_rows).min(counts.len());
        let block = &counts[end.saturating_sub(window_rows)..end];
        for axis in 0..AXES {
            values.clear();
            values.extend(block.iter().map(|row| row[axis]));
            let middle = middle(&mut values);
            values.iter_mut().for_each(|value| *value = (*value - middle).abs());
            let limit = GLITCH * self::middle(&mut values).max(steps[axis] / 2.0);
            for row in start..end {
                let around = [2, 1, 0].map(|before| counts[row.saturating_sub(before)][axis]);
                let after = [1, 2].map(|after| counts[(row + after).min(last)][axis]);
                let mut five = [around[0], around[1], around[2], after[0], after[1]];
                five.sort_unstable_by(f64::total_cmp);
                is_glitch[row] |= (counts[row][axis] - five[2]).abs() > limit;
            }
        }
    }
    is_glitch
}

/// The median, in place. There is at least one value.
fn middle(values: &mut [f64]) -> f64 {
    let half = values.len() / 2;
    let odd = values.len() % 2 == 1;
    let (below, upper, _) = values.select_nth_unstable_by(half, f64::total_cmp);
    let upper = *upper;
    if odd { upper } else { (upper + below.iter().copied().fold(f64::NEG_INFINITY, f64::max)) / 2.0 }
}

/// Number of the part of the recording that each of `kept` is in.
fn parts(rows: &[RawSample], kept: &[usize]) -> Vec<u32> {
    let mut part = 0;
    let mut parts = Vec::with_capacity(kept.len());
    let mut previous: Option<&RawSample> = None;
    for row in kept.iter().map(|row| &rows[*row]) {
        let is_new = |before: &RawSample| {
            before.session != row.session || row.timestamp_ns.saturating_sub(before.timestamp_ns) > LONGEST_PAUSE_NS
        };
        part += u32::from(previous.is_some_and(is_new));
        parts.push(part);
        previous = Some(row);
    }
    parts
}
