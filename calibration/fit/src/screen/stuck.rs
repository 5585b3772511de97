//! Equal values in turn, where the channel hardly ever repeats a value.

use super::piece::Piece;
use core::ops::Range;

/// Rows on each side that show how often a value is repeated.
const NEARBY: usize = 256;
/// Fewest equal rows in turn.
const FEWEST: usize = 3;
/// Chance of equal rows in any place of the piece that is no chance any more.
const CHANCE: f64 = 1e-2;
/// The part of equal rows is known to this many standard errors.
const DOUBT: f64 = 3.0;
/// Runs of this part of a run's length and more are nearly as long …
const SIMILAR: [usize; 2] = [2, 3];
/// … and have less than this part of the rows.
const RARE: f64 = 0.1;
/// More equal rows than this part are those of a coarse channel.
const COARSE: f64 = 0.05;
/// A channel with fewer different values nearby is coarse: its level stays within a step for as long as it likes.
const VALUES: usize = 8;
/// More rows of a thermometer are judged as a whole recording: its equilibrium is legal.
const LONGEST_OF_THERMOMETER: usize = 60;
/// After equal rows a thermometer has to catch up with this part of what it usually changes in that time.
const CAUGHT_UP: f64 = 0.5;
/// … and by over this many of its usual changes.
const AT_ONCE: f64 = 3.0;

/// Equal rows in turn that are no chance, without the first of each run: it was measured.
pub(super) fn stuck(piece: &Piece<'_>, step: f64) -> Vec<usize> {
    let is_equal = |row: usize| (piece.values[row] - piece.values[row - 1]).abs() <= piece.tolerance;
    let n = piece.values.len();
    // Equal pairs up to each row.
    let mut equal = Vec::with_capacity(n + 1);
    equal.extend([0_u32, 0]);
    for row in 1..n {
        equal.push(equal[row] + u32::from(is_equal(row)));
    }
    let mut runs: Vec<Range<usize>> = Vec::new();
    let mut start = 0;
    while start < n {
        let end = (start + 1..n).find(|row| !is_equal(*row)).unwrap_or(n);
        runs.push(start..end);
        start = end;
    }
    let lengths = Lengths::of(&runs);
    let is_stuck = |run: &&Range<usize>| {
        run.len() >= FEWEST
            && is_no_chance(piece, run, &equal)
            && lengths.is_rare(run.len())
            && is_missed(piece, run, step)
    };
    runs.iter().filter(is_stuck).flat_map(|run| run.start + 1..run.end).collect()
}

/// How long the runs of equal rows of a piece are. A level that stays within a step makes long runs again and again; a
/// channel that is stuck makes one that stands out.
struct Lengths {
    /// In order, and the rows of the runs up to each.
    lengths: Vec<usize>,
    rows: Vec<usize>,
}

impl Lengths {
    fn of(runs: &[Range<usize>]) -> Self {
        let mut lengths: Vec<usize> = runs.iter().map(Range::len).collect();
        lengths.sort_unstable();
        let rows = lengths.iter().scan(0, |sum, length| Some(core::mem::replace(sum, *sum + length)));
        let rows = rows.collect();
        Self { lengths, rows }
    }

    /// Whether few rows are in other runs that are nearly as long, or longer.
    fn is_rare(&self, length: usize) -> bool {
        let first = self.lengths.partition_point(|other| other * SIMILAR[1] < length * SIMILAR[0]);
        let all: usize = self.rows.last().zip(self.lengths.last()).map_or(0, |(rows, last)| rows + last);
        let similar = all - self.rows.get(first).copied().unwrap_or(all);
        ((similar - length) as f64) < RARE * all as f64
    }
}

/// Whether such a run is no chance.
fn is_no_chance(piece: &Piece<'_>, run: &Range<usize>, equal: &[u32]) -> bool {
    let n = piece.values.len();
    let around = |rows: usize| run.start.saturating_sub(rows)..(run.end + rows).min(n);
    let pairs = |rows: &Range<usize>| f64::from(equal[rows.end] - equal[rows.start + 1]);
    let part = |near: &Range<usize>| {
        let others = near.len().saturating_sub(run.len()) as f64;
        let part = (pairs(near) - pairs(run) + 0.5) / (others + 1.0);
        part + DOUBT * (part / (others + 1.0)).sqrt()
    };
    let near = around(NEARBY);
    let of_near = part(&near);
    // A coarse channel repeats values more often within a step than between two.
    let part = if of_near > COARSE { of_near.max(part(&around(NEARBY / 4))) } else { of_near };
    if n as f64 * part.powi(run.len() as i32 - 1) > CHANCE {
        return false;
    }
    let mut values: Vec<f64> = piece.values[near.start..run.start].to_vec();
    values.extend_from_slice(&piece.values[run.end..near.end]);
    values.sort_by(f64::total_cmp);
    1 + values.windows(2).filter(|pair| pair[1] - pair[0] > piece.tolerance).count() >= VALUES
}

/// Whether a thermometer catches up after the run with what it missed; of a sensor, always.
fn is_missed(piece: &Piece<'_>, run: &Range<usize>, step: f64) -> bool {
    if !piece.is_thermometer {
        return true;
    }
    let Some(after) = piece.values.get(run.end) else { return false };
    let near = run.start.saturating_sub(run.len() + 8)..(run.end + run.len() + 8).min(piece.values.len());
    let changes = near.clone().skip(1).filter(|row| !(run.start..=run.end).contains(row));
    let usual = isotherm_statistics::median(changes.map(|row| (piece.values[row] - piece.values[row - 1]).abs()));
    let jump = (after - piece.values[run.start]).abs();
    run.len() <= LONGEST_OF_THERMOMETER
        && jump > CAUGHT_UP * usual * run.len() as f64
        && jump > AT_ONCE * usual
        && jump > 1.5 * step
}
