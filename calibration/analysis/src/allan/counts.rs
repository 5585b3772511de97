//! What can be learned of a noise from counts only: their step, and whether values repeat. A count is NaN where a row
//! is missing, and only consecutive rows are used.

use std::collections::HashMap;

/// Changes within this many steps are single steps.
const SINGLE: f64 = 1.5;
/// Of counts that repeat a pattern at least this part of the changes are single steps.
const PATTERN: f64 = 0.8;
/// Parts of the rows, each of which must repeat: a quiet hour next to a loud one is no repetition.
const PARTS: usize = 10;
/// Rows repeat if fewer than this part of them are new …
const MOST_NEW: f64 = 0.9;
/// … and if whether they change correlates by less than this from row to row.
const MOST_CORRELATION: f64 = -0.05;

/// The changes of a sensor's counts from row to row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CountChanges {
    /// The step of the counts: the 1 % quantile of the changes that are not 0 \[pulse\].
    pub step: f64,
    /// The part of these changes that are of one step.
    pub single: f64,
}

impl CountChanges {
    /// Of the counts of rows in turn; `None` if they never change.
    #[must_use]
    pub(super) fn of(counts: &[f64]) -> Option<Self> {
        // Few sizes occur often: that takes less memory than the changes would.
        let mut sizes: HashMap<u64, usize> = HashMap::new();
        let changes = counts.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        changes.filter(|change| *change > 0.0).for_each(|change| *sizes.entry(change.to_bits()).or_default() += 1);
        let mut sizes: Vec<_> = sizes.into_iter().map(|(size, times)| (f64::from_bits(size), times)).collect();
        sizes.sort_by(|a, b| a.0.total_cmp(&b.0));
        let all: usize = sizes.iter().map(|(_, times)| times).sum();
        let mut passed = 0;
        let (step, _) = *sizes.iter().find(|(_, times)| {
            passed += times;
            passed > all / 100
        })?;
        let single: usize = sizes.iter().filter(|(size, _)| *size <= SINGLE * step).map(|(_, times)| times).sum();
        Some(Self { step, single: single as f64 / all as f64 })
    }

    /// Whether the counts go to and fro by one step, as those of a noise that is smaller do.
    #[must_use]
    pub(super) const fn are_single(&self) -> bool {
        self.single >= PATTERN
    }
}

/// The root of half the mean squared change from row to row: the Allan deviation over one row.
pub(super) fn scatter(counts: &[f64]) -> f64 {
    let squares = counts.windows(2).map(|pair| (pair[1] - pair[0]) * (pair[1] - pair[0]));
    let (sum, count) =
        squares.filter(|square| !square.is_nan()).fold((0.0, 0_u64), |(sum, n), square| (sum + square, n + 1));
    (0.5 * sum / count as f64).sqrt()
}

/// The part of the rows that have a new value, if values repeat. Counts that go to and fro by one step repeat by
/// chance, and show nothing. A value repeats regularly: one that stays is followed by one that changes more often than
/// by chance, other than in a quiet hour next to a loud one, or between bursts.
pub(super) fn new_part(counts: &[f64]) -> Option<f64> {
    let changes = CountChanges::of(counts).filter(|changes| !changes.are_single())?;
    let rows = counts.len() - 1;
    let mut parts = (0..PARTS).map(|part| &counts[rows * part / PARTS..=rows * (part + 1) / PARTS]);
    let all = new_values(counts, changes.step);
    let repeats = all < MOST_NEW && parts.all(|part| new_values(part, changes.step) < MOST_NEW);
    (repeats && correlation_of_changes(counts) < MOST_CORRELATION).then_some(all)
}

/// The part of these rows that have a new value. New ones may equal those before by chance, as often as the changes by
/// one step and by two say: the logarithm of the frequency falls with the square of the change.
fn new_values(counts: &[f64], step: f64) -> f64 {
    let within = |least: f64, most: f64| {
        let steps = counts.windows(2).map(|pair| (pair[1] - pair[0]).abs() / step);
        steps.filter(|steps| (least..most).contains(steps)).count() as f64
    };
    let (single, double) = (within(0.5, 1.5), within(1.5, 2.5).max(1.0));
    let by_chance = 0.5 * single * libm::cbrt((single / double).max(1.0));
    1.0 - (within(0.0, 0.5) - by_chance).max(0.0) / within(0.0, f64::INFINITY)
}

/// The correlation of whether a row changes with whether the next one does.
fn correlation_of_changes(counts: &[f64]) -> f64 {
    let mean = |changes: &mut dyn Iterator<Item = bool>| {
        let (sum, count) = changes.fold((0_u64, 0_u64), |(sum, count), change| (sum + u64::from(change), count + 1));
        sum as f64 / count as f64
    };
    let are_there = |rows: &&[f64]| rows.iter().all(|count| !count.is_nan());
    let part = mean(&mut counts.windows(2).filter(are_there).map(|pair| pair[0] != pair[1]));
    let three = counts.windows(3).filter(are_there);
    let both = mean(&mut three.map(|rows| rows[0] != rows[1] && rows[1] != rows[2]));
    (both - part * part) / (part * (1.0 - part))
}
