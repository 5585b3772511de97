//! One channel: a sensor or a thermometer.

use super::account::BadKind;
use super::piece::Piece;
use super::{jumps, level, stuck};
use std::collections::HashMap;

/// A step is the least change of a channel but for this part of the changes.
const LEAST_PART: f64 = 0.01;
/// Fewest rows that are judged by their neighbours.
const FEWEST: usize = 12;
/// A value that is off in so many places is a marker.
const MARKERS: usize = 3;

/// What is known of a channel from the rows before.
#[derive(Clone, Debug, Default)]
pub(super) struct Channel {
    /// The step of its values.
    step: Option<f64>,
    /// Standard deviations of the last parts that were judged.
    pub(super) usual: level::Usual,
}

impl Channel {
    /// The bad rows of a piece.
    pub(super) fn bad(&mut self, piece: &Piece<'_>) -> Vec<(usize, BadKind)> {
        if piece.values.len() < FEWEST {
            return Vec::new();
        }
        let step = self.step(piece);
        let levels = level::levels(piece, step, &mut self.usual);
        let off = jumps::framed(piece, &levels, step);
        let stuck = stuck::stuck(piece, step);
        let mut is_off = vec![false; piece.values.len()];
        off.iter().for_each(|row| is_off[*row] = true);
        let mut bad: Vec<(usize, BadKind)> = of_kind(piece, &off);
        bad.extend(stuck.into_iter().filter(|row| !is_off[*row]).map(|row| (row, BadKind::Stuck)));
        bad
    }

    /// The step of the channel: the least change from row to row, but for some. Changes of a rounding do not count.
    fn step(&mut self, piece: &Piece<'_>) -> f64 {
        let changes = piece.values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        let mut changes: Vec<f64> = changes.filter(|change| *change > 2.0 * piece.tolerance).collect();
        let place = (changes.len() as f64 * LEAST_PART) as usize;
        let found = (!changes.is_empty()).then(|| *changes.select_nth_unstable_by(place, f64::total_cmp).1);
        let least = match (self.step, found) {
            (Some(before), Some(now)) => Some(before.min(now)),
            (before, now) => before.or(now),
        };
        self.step = least;
        least.unwrap_or_default().max(2.0 * piece.tolerance)
    }
}

/// The kinds of rows that are off.
fn of_kind(piece: &Piece<'_>, off: &[usize]) -> Vec<(usize, BadKind)> {
    let place = |value: f64| if piece.tolerance > 0.0 { (value / (2.0 * piece.tolerance)).round() } else { value };
    let key = |row: usize| place(piece.values[row]).to_bits();
    let mut often: HashMap<u64, usize> = HashMap::new();
    off.iter().for_each(|row| *often.entry(key(*row)).or_default() += 1);
    let kind = |row: &usize| match () {
        () if piece.is_thermometer => BadKind::Temperature,
        () if often[&key(*row)] >= MARKERS || piece.values[*row] == 0.0 => BadKind::Marker,
        () => BadKind::Spike,
    };
    off.iter().map(|row| (*row, kind(row))).collect()
}
