//! What counts alone say of a noise: their step, and whether rows repeat.

use core::ops::Range;

/// Changes within this many steps are single steps.
const SINGLE: f64 = 1.5;
/// Of counts that repeat a pattern at least this part of the changes are single steps.
const PATTERN: f64 = 0.9;
/// Parts of the rows, each of which must repeat: a quiet hour beside a loud one is no repetition.
const PARTS: usize = 10;
/// Rows repeat if fewer than this part of them are new.
const MOST_NEW: f64 = 0.9;
/// Chance that a new row equals the one before, above which nothing can be told.
const MOST_CHANCE: f64 = 0.5;

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
        let changes = counts.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        let mut changes: Vec<f64> = changes.filter(|change| *change > 0.0).collect();
        changes.sort_by(f64::total_cmp);
        let step = *changes.get(changes.len() / 100)?;
        let single = changes.partition_point(|change| *change <= SINGLE * step);
        Some(Self { step, single: single as f64 / changes.len() as f64 })
    }

    /// Whether the counts go to and fro by one step, as those of a noise that is smaller do.
    #[must_use]
    pub(super) const fn are_single(&self) -> bool {
        self.single >= PATTERN
    }
}

/// The part of the rows that have new values, if rows repeat. `counts` are those of the axes of a triad, which a sensor
/// reads at once: rows repeat where no axis changes, more often than axes stay while another changes. `None` too where
/// fewer than two axes change by more than single steps: such counts repeat by chance.
pub(super) fn new_rows(counts: &[Vec<f64>]) -> Option<f64> {
    let coarse = |counts: &&Vec<f64>| CountChanges::of(counts).is_some_and(|changes| !changes.are_single());
    let counts: Vec<&Vec<f64>> = counts.iter().filter(coarse).collect();
    let rows = counts.first().filter(|_| counts.len() > 1)?.len();
    let part = |part: usize| 1 + (rows - 1) * part / PARTS..1 + (rows - 1) * (part + 1) / PARTS;
    let repeats = (0..PARTS).all(|index| new_part(&counts, part(index)).is_some_and(|new| new < MOST_NEW));
    new_part(&counts, 1..rows).filter(|_| repeats)
}

/// The part of these rows that have new values, counting those that equal the row before by chance.
fn new_part(counts: &[&Vec<f64>], rows: Range<usize>) -> Option<f64> {
    let (all, mut changed, mut stayed) = (rows.len() as f64, 0_usize, vec![[0_usize; 2]; counts.len()]);
    for row in rows {
        let changes: Vec<bool> = counts.iter().map(|counts| counts[row] != counts[row - 1]).collect();
        let number = changes.iter().filter(|change| **change).count();
        changed += usize::from(number > 0);
        for (stayed, change) in stayed.iter_mut().zip(&changes) {
            // How often another axis changes, and this one stays then.
            let others = usize::from(number > usize::from(*change));
            *stayed = [stayed[0] + others, stayed[1] + if *change { 0 } else { others }];
        }
    }
    let chance: f64 = stayed.iter().map(|[others, stayed]| *stayed as f64 / (*others).max(1) as f64).product();
    (chance < MOST_CHANCE).then_some(changed as f64 / (1.0 - chance) / all)
}
