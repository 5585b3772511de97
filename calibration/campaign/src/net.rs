//! Net counts of a row, and the step in which they change.

use isotherm_shared::wire::{AXES, RawSample};

/// A change smaller than this share of all is no step: a coarse sensor may be written in fine counts.
const STEP_QUANTILE: usize = 100;

/// Net counts of an accelerometer in a row.
pub(crate) fn net(row: &RawSample, axis: usize) -> f64 {
    let triad = &row.accelerometers;
    f64::from(triad.positive_pulses[axis]) - f64::from(triad.negative_pulses[axis])
}

/// The step of each axis \[count\]: the least change from row to row but for 1 % of them, 1 where nothing changes.
pub(crate) fn steps(rows: &[RawSample]) -> [f64; AXES] {
    [0, 1, 2].map(|axis| {
        let changes = rows.windows(2).map(|pair| (net(&pair[1], axis) - net(&pair[0], axis)).abs());
        let mut changes: Vec<f64> = changes.filter(|change| *change > 0.0).collect();
        let at = changes.len() / STEP_QUANTILE;
        if changes.is_empty() { 1.0 } else { *changes.select_nth_unstable_by(at, f64::total_cmp).1 }
    })
}
