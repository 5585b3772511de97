//! Rows that are off their level, with a jump before and after them.

use super::level::{Level, STEPS};
use super::piece::Piece;
use core::ops::Range;

/// A jump is at least this part of the limit.
const JUMP: f64 = 0.6;
/// … at the ends of the recording, where there is one jump in the place of two, at least this part of it …
const JUMP_AT_END: f64 = 1.0;
/// … at least so many steps of the channel …
const JUMP_STEPS: f64 = 1.5;
/// … and within rows that are off, at least so many times the limit.
const JUMP_INSIDE: f64 = 1.3;
/// More rows in turn are no bad rows: the IMU moved, or its level changed.
const LONGEST: usize = 40;
/// Where a channel changes fast, a jump is over this many deviations of the changes nearby …
const FAST: f64 = 8.0;
/// … of so many rows on each side …
const NEARBY: usize = 15;
/// … and the values come back by this part of it.
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
        let run = run(piece, levels, row);
        let end = run.end;
        if run.len() <= LONGEST && is_framed(piece, levels, &run) {
            bad.extend(run.filter(|row| !piece.is_known[*row]));
        } else {
            let found = pairs(piece, &run, step);
            bad.extend(inside(piece, levels, &run, &found));
            bad.extend(found);
        }
        row = end;
    }
    bad
}

/// The rows that are off from this one on. Bad rows that are known do not end them: behind one the level is not
/// back.
fn run(piece: &Piece<'_>, levels: &[Level], first: usize) -> Range<usize> {
    let goes_on = |row: &usize| levels[*row].is_off() || piece.is_known[*row];
    let last = (first..levels.len()).take_while(goes_on).filter(|row| levels[*row].is_off()).last();
    first..last.unwrap_or(first) + 1
}

/// Whether a run begins and ends with a jump, or with the piece.
fn is_framed(piece: &Piece<'_>, levels: &[Level], run: &Range<usize>) -> bool {
    let before = (0..run.start).rev().find(|row| !piece.is_known[*row]);
    let after = (run.end..piece.values.len()).find(|row| !piece.is_known[*row]);
    if before.is_none() && after.is_none() {
        return false;
    }
    let least = if before.is_some() && after.is_some() { JUMP } else { JUMP_AT_END };
    before.is_none_or(|before| has_jump(piece, levels, [before, run.start], least))
        && after.is_none_or(|after| has_jump(piece, levels, [run.end - 1, after], least))
}

/// Whether there is a jump between two rows, of at least this part of the limit.
fn has_jump(piece: &Piece<'_>, levels: &[Level], [from, to]: [usize; 2], least: f64) -> bool {
    let usual: f64 = levels[from..to].iter().map(|level| level.slope).sum();
    let limit = (least * levels[from].limit.min(levels[to].limit)).max(JUMP_STEPS * levels[from].step);
    (piece.values[to] - piece.values[from] - usual).abs() >= limit
}

/// The rows of a run without a frame, and without those that are `known`, that have a frame of their own: the values of
/// a burst differ, so that its last ones may be too near to the level for a jump.
fn inside(piece: &Piece<'_>, levels: &[Level], run: &Range<usize>, known: &[usize]) -> Vec<usize> {
    let is_left = |row: &usize| !piece.is_known[*row] && !known.contains(row);
    let rest: Vec<usize> = run.clone().filter(is_left).collect();
    if rest.len() > LONGEST {
        return Vec::new();
    }
    let before = (0..run.start).rev().find(|row| !piece.is_known[*row]);
    let after = (run.end..piece.values.len()).find(|row| !piece.is_known[*row]);
    let (Some(before), Some(after)) = (before, after) else { return Vec::new() };
    let rows: Vec<usize> = core::iter::once(before).chain(rest).chain([after]).collect();
    let is_jump: Vec<bool> =
        rows.windows(2).map(|pair| has_jump(piece, levels, [pair[0], pair[1]], JUMP_INSIDE)).collect();
    let first = is_jump.iter().position(|jump| *jump);
    let last = is_jump.iter().rposition(|jump| *jump);
    first.zip(last).map_or_else(Vec::new, |(first, last)| rows[first + 1..last + 1].to_vec())
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
