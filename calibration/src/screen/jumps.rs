//! Rows that are off their level, with a jump before and after them.

use super::level::{Level, STEPS};
use super::piece::Piece;
use core::ops::Range;

/// A jump is at least this part of the limit.
const JUMP: f64 = 0.65;
/// More rows in turn are no bad rows: the IMU moved, or its level changed.
const LONGEST: usize = 40;
/// Where a channel changes fast, a jump is over this many deviations of the changes nearby ..
const FAST: f64 = 8.0;
/// .. of so many rows on each side ..
const NEARBY: usize = 15;
/// .. and the values come back by this part of it.
const BACK: f64 = 0.5;

/// The rows that are off and begin and end with a jump.
pub(super) fn framed(piece: &Piece<'_>, levels: &[Level], step: f64) -> Vec<usize> {
    let mut bad = Vec::new();
    let mut row = 0;
    while row < levels.len() {
        if !levels[row].is_off() {
            row += 1;
            continue;
        }
        let end = (row..levels.len()).find(|next| !levels[*next].is_off()).unwrap_or(levels.len());
        let run = row..end;
        if run.len() <= LONGEST && is_framed(piece, levels, &run) {
            bad.extend(run);
        } else {
            bad.extend(pairs(piece, &run, step));
        }
        row = end;
    }
    bad
}

/// Whether a run begins and ends with a jump, or with the piece.
fn is_framed(piece: &Piece<'_>, levels: &[Level], run: &Range<usize>) -> bool {
    let before = (0..run.start).rev().find(|row| !piece.is_known[*row]);
    let after = (run.end..piece.values.len()).find(|row| !piece.is_known[*row]);
    if before.is_none() && after.is_none() {
        return false;
    }
    let jumps = |from: usize, to: usize| {
        let usual: f64 = levels[from..to].iter().map(|level| level.slope).sum();
        let limit = JUMP * levels[from].limit.min(levels[to].limit);
        (piece.values[to] - piece.values[from] - usual).abs() >= limit
    };
    before.is_none_or(|before| jumps(before, run.start)) && after.is_none_or(|after| jumps(run.end - 1, after))
}

/// The rows between two jumps, there and back, in a run without a frame: the channel changes fast there.
fn pairs(piece: &Piece<'_>, run: &Range<usize>, step: f64) -> Vec<usize> {
    let rows = run.start.saturating_sub(NEARBY)..(run.end + NEARBY).min(piece.values.len());
    let rows: Vec<usize> = rows.filter(|row| !piece.is_known[*row]).collect();
    let changes: Vec<f64> = rows.windows(2).map(|pair| piece.values[pair[1]] - piece.values[pair[0]]).collect();
    let mut bad = Vec::new();
    let mut first = 0;
    while first < changes.len() {
        let near = &changes[first.saturating_sub(NEARBY)..(first + NEARBY + 1).min(changes.len())];
        let usual = isotherm_statistics::median(near.iter().copied());
        let deviations: Vec<f64> = near.iter().map(|change| change - usual).collect();
        let limit = (FAST * isotherm_statistics::robust_sd(&deviations)).max(STEPS * step);
        let jump = changes[first] - usual;
        let last = first + LONGEST.min(changes.len() - 1 - first);
        let comes_back = |second: &usize| {
            let back = changes[*second] - usual;
            let gone =
                piece.values[rows[*second + 1]] - piece.values[rows[first]] - usual * (*second + 1 - first) as f64;
            back.abs() > limit && back * jump < 0.0 && gone.abs() < BACK * jump.abs()
        };
        match (first + 1..=last).find(comes_back) {
            Some(second) if jump.abs() > limit => {
                bad.extend_from_slice(&rows[first + 1..=second]);
                first = second + 1;
            }
            _ => first += 1,
        }
    }
    bad
}
