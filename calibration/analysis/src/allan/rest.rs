//! The rows at rest, sought in pieces: the search takes over a hundred bytes a row, and a recording of a day would take
//! all memory.
//!
//! A recording of up to [`PIECE_ROWS`] rows is one piece. A rest that goes on over the border of two pieces is one.
//! What is at rest is decided by the quietest lasting level of a piece, so a piece that is louder than the others as a
//! whole is left out, by the margins of the search itself.

use super::rows::{Cursor, Rows};
use core::ops::Range;
use isotherm_campaign::{STATIC_POSE_WINDOW_S, StaticPoseError, faults, find_static_poses};
use isotherm_shared::wire::RawSample;
use isotherm_statistics::median;
use isotherm_support::checkpoint::checkpoint;
use isotherm_support::finding::Finding;

/// Most rows of a piece.
pub(super) const PIECE_ROWS: usize = 1 << 19;
/// Least rows of a window in which movement is looked for: with fewer, chance ends a long static pose.
const LEAST_WINDOW_ROWS: f64 = 10.0;
/// How far the level of a piece may lie over the usual one of all pieces, and below it (ln of variance).
const ABOVE: f64 = core::f64::consts::LN_2;
const BELOW: f64 = 1.5;

/// What is found in the pieces.
pub(super) struct Rest {
    pub(super) at_rest: Vec<Range<usize>>,
    /// What is wrong with the counts.
    pub(super) faults: Vec<Finding>,
}

/// What is found in a piece.
struct Piece {
    rows: Range<usize>,
    at_rest: Vec<Range<usize>>,
    /// Mean over the axes of ln variance of a row at rest.
    level: f64,
}

impl Rest {
    /// Looks through the rows, in pieces of so many rows at most, and shows each of them to `take`.
    ///
    /// # Errors
    /// If no piece has a rest: why the first has none.
    pub(super) fn of(
        rows: &Rows,
        most_rows: usize,
        mut take: impl FnMut(usize, &RawSample),
    ) -> Result<Self, StaticPoseError> {
        let count = rows.len().div_ceil(most_rows).max(1);
        let (mut cursor, mut pieces, mut failed) = (Cursor::default(), Vec::new(), None);
        let mut found: Vec<Finding> = Vec::new();
        for piece in 0..count {
            let range = rows.len() * piece / count..rows.len() * (piece + 1) / count;
            let mut samples = Vec::with_capacity(range.len());
            for row in range.clone() {
                if row % 4096 == 0 {
                    checkpoint();
                }
                let Some(sample) = cursor.next(rows) else { break };
                take(row, &sample);
                samples.push(sample);
            }
            let poses = match find_static_poses(&samples, window_s(&samples)) {
                Ok(poses) => poses,
                Err(error) => {
                    failed.get_or_insert(error);
                    continue;
                }
            };
            let local: Vec<_> = poses.found.iter().map(|rest| rest.rows.clone()).collect();
            found.extend(
                faults(&samples, &local)
                    .into_iter()
                    .filter(|new| found.iter().all(|old| !is_same(old, new)))
                    .collect::<Vec<_>>(),
            );
            let at_rest = local.into_iter().map(|rest| range.start + rest.start..range.start + rest.end).collect();
            let level = poses.noise.iter().map(|noise| 2.0 * libm::log(*noise)).sum::<f64>() / poses.noise.len() as f64;
            pieces.push(Piece { rows: range, at_rest, level });
        }
        match failed {
            Some(error) if pieces.is_empty() => Err(error),
            _ => Ok(Self { at_rest: joined(pieces), faults: found }),
        }
    }
}

/// Whether two findings say the same of the same sensor. They begin with its name.
fn is_same(one: &Finding, other: &Finding) -> bool {
    let sensor = |finding: &Finding| finding.message.split(' ').next().map(str::to_owned);
    one.name == other.name && sensor(one) == sensor(other)
}

/// The rests of pieces that are about as quiet as the others.
fn joined(pieces: Vec<Piece>) -> Vec<Range<usize>> {
    let usual = median(pieces.iter().map(|piece| piece.level));
    let is_usual = |piece: &Piece| (usual - BELOW..=usual + ABOVE).contains(&piece.level) || !usual.is_finite();
    let mut all: Vec<Range<usize>> = Vec::new();
    for piece in pieces.into_iter().filter(is_usual) {
        for rest in piece.at_rest {
            match all.last_mut().filter(|last| last.end == rest.start && rest.start == piece.rows.start) {
                Some(last) => last.end = rest.end,
                None => all.push(rest),
            }
        }
    }
    all
}

/// The windows in which movement is looked for \[s\], where the usual ones have too few rows.
fn window_s(rows: &[RawSample]) -> Option<f64> {
    let least_s = LEAST_WINDOW_ROWS * median(rows.iter().map(|row| row.interval_ns as f64)) / 1e9;
    (least_s > STATIC_POSE_WINDOW_S).then_some(least_s)
}
