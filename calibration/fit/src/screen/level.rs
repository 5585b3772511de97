//! The level of a channel around each row, and how far the row is off.

use super::piece::Piece;
use core::ops::Range;
use std::collections::VecDeque;

/// Rows that are judged with one parabola …
const BLOCK: usize = 32;
/// … through these and so many on each side.
const SIDE: usize = 48;
/// Parts of these rows whose medians give the lines that are tried.
const CELLS: usize = 10;
/// Rows whose distances judge a line, at most.
const JUDGES: usize = 64;
/// A row is off by over this many standard deviations …
pub(super) const FAR: f64 = 6.5;
/// … and by over this many steps of the channel.
pub(super) const STEPS: f64 = 1.75;
/// The deviation is at least this part of the usual one, and at least this part of a step.
const LEAST: [f64; 2] = [0.7, 0.3];
/// Rows within this many deviations make the parabola.
const NEAR: f64 = 3.0;
/// Their standard deviation is smaller than that of all, by this.
const CUT: f64 = 0.985;
/// Largest distance from a plain line, in deviations, where no row can be bad.
const PLAIN: f64 = 4.2;
/// From a median of distances to a standard deviation.
const NORMAL: f64 = 1.4826;
/// Parts whose deviations give the usual one.
const PARTS: usize = 48;

/// How far a row is from its level, and the limit.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Level {
    pub residual: f64,
    pub limit: f64,
    /// Change of the level to the next row.
    pub slope: f64,
    /// The step of the channel.
    pub step: f64,
}

impl Level {
    pub(super) fn is_off(&self) -> bool {
        self.residual.abs() > self.limit
    }
}

/// The deviations of the last parts.
#[derive(Clone, Debug, Default)]
pub(super) struct Usual(VecDeque<f64>);

impl Usual {
    fn add(&mut self, deviation: f64) {
        if self.0.len() == PARTS {
            self.0.pop_front();
        }
        self.0.push_back(deviation);
    }

    fn median(&self) -> f64 {
        if self.0.is_empty() { 0.0 } else { isotherm_statistics::median(self.0.iter().copied()) }
    }
}

/// The level of each row.
pub(super) fn levels(piece: &Piece<'_>, step: f64, usual: &mut Usual) -> Vec<Level> {
    let n = piece.values.len();
    let mut levels = vec![Level::default(); n];
    let mut work = Work::default();
    for start in (0..n).step_by(BLOCK) {
        let block = start..(start + BLOCK).min(n);
        work.take(piece, &window(&block, n));
        let Some(curve) = work.curve(step) else { continue };
        let deviation = curve.deviation.max(LEAST[0] * usual.median()).max(LEAST[1] * step);
        usual.add(curve.deviation);
        let limit = (FAR * deviation).max(STEPS * step);
        for row in block {
            levels[row] = Level {
                residual: if piece.is_known[row] { 0.0 } else { piece.values[row] - curve.at(piece.times[row]) },
                limit,
                step,
                slope: curve.at(*piece.times.get(row + 1).unwrap_or(&piece.times[row])) - curve.at(piece.times[row]),
            };
        }
    }
    levels
}

/// The rows around a block: as many at the ends of the piece.
fn window(block: &Range<usize>, n: usize) -> Range<usize> {
    let length = (BLOCK + 2 * SIDE).min(n);
    let start = block.start.saturating_sub(SIDE).min(n - length);
    start..start + length
}

/// A parabola, and the standard deviation of the rows about it.
#[derive(Clone, Copy, Debug, Default)]
struct Curve {
    origin: f64,
    scale: f64,
    powers: [f64; 3],
    deviation: f64,
}

impl Curve {
    fn at(&self, time: f64) -> f64 {
        let x = (time - self.origin) / self.scale;
        self.powers[0] + x * (self.powers[1] + x * self.powers[2])
    }
}

/// The rows that a curve goes through.
#[derive(Default)]
struct Work {
    places: Vec<f64>,
    values: Vec<f64>,
    distances: Vec<f64>,
    origin: f64,
    scale: f64,
}

impl Work {
    fn take(&mut self, piece: &Piece<'_>, rows: &Range<usize>) {
        let ends = [piece.times[rows.start], piece.times[rows.end - 1]];
        self.origin = ends[0].midpoint(ends[1]);
        self.scale = ((ends[1] - ends[0]) / 2.0).max(f64::MIN_POSITIVE);
        self.places.clear();
        self.values.clear();
        for row in rows.clone().filter(|row| !piece.is_known[*row]) {
            self.places.push((piece.times[row] - self.origin) / self.scale);
            self.values.push(piece.values[row]);
        }
    }

    /// The curve; `None` of too few rows.
    fn curve(&mut self, step: f64) -> Option<Curve> {
        if self.values.len() < CELLS {
            return None;
        }
        if let Some(plain) = self.plain(step) {
            return Some(plain);
        }
        let [constant, slope] = self.least_median();
        let mut powers = [constant, slope, 0.0];
        let mut deviation = NORMAL * self.median_distance(powers, 1);
        for _ in 0..3 {
            let near = (NEAR * deviation).max(STEPS * step);
            powers = self.parabola(powers, near).unwrap_or(powers);
            let near = (NEAR * deviation).max(STEPS * step);
            deviation = self.deviation(powers, near);
        }
        Some(Curve { origin: self.origin, scale: self.scale, powers, deviation })
    }

    /// The line of least squares, where no row is far from it: most rows of most recordings.
    fn plain(&mut self, step: f64) -> Option<Curve> {
        self.distances.clear();
        self.distances.extend(self.values.windows(2).map(|pair| (pair[1] - pair[0]).abs()));
        let of_changes = NORMAL * middle(&mut self.distances) / core::f64::consts::SQRT_2;
        let n = self.values.len() as f64;
        let mut sums = [0.0; 4];
        for (x, y) in self.places.iter().zip(&self.values) {
            for (sum, value) in sums.iter_mut().zip([*x, x * x, *y, x * y]) {
                *sum += value;
            }
        }
        let [x, xx, y, xy] = sums.map(|sum| sum / n);
        let slope = (xy - x * y) / (xx - x * x).max(f64::MIN_POSITIVE);
        let powers = [y - slope * x, slope, 0.0];
        let deviation = of_changes.max(LEAST[1] * step);
        let limit = PLAIN * deviation;
        let distance = |x: &f64, y: &f64| (y - powers[0] - powers[1] * x).abs();
        let is_plain = self.places.iter().zip(&self.values).all(|(x, y)| distance(x, y) <= limit);
        is_plain.then_some(Curve { origin: self.origin, scale: self.scale, powers, deviation })
    }

    /// Constant and slope of the line with the least median distance, of those through two medians of cells.
    fn least_median(&mut self) -> [f64; 2] {
        let n = self.values.len();
        let mut cells = [[0.0; 2]; CELLS];
        for (number, cell) in cells.iter_mut().enumerate() {
            let rows = n * number / CELLS..n * (number + 1) / CELLS;
            self.distances.clear();
            self.distances.extend_from_slice(&self.values[rows.clone()]);
            *cell = [self.places[rows.start].midpoint(self.places[rows.end - 1]), middle(&mut self.distances)];
        }
        let mut best = ([cells[0][1], 0.0], f64::INFINITY);
        let stride = n.div_ceil(JUDGES);
        for (number, one) in cells.iter().enumerate() {
            for other in &cells[number + 1..] {
                let slope = (other[1] - one[1]) / (other[0] - one[0]).max(f64::MIN_POSITIVE);
                let line = [one[1] - slope * one[0], slope];
                let distance = self.median_distance([line[0], line[1], 0.0], stride);
                if distance < best.1 {
                    best = (line, distance);
                }
            }
        }
        best.0
    }

    fn distance(&self, powers: [f64; 3], row: usize) -> f64 {
        let x = self.places[row];
        (self.values[row] - powers[0] - x * (powers[1] + x * powers[2])).abs()
    }

    fn median_distance(&mut self, powers: [f64; 3], stride: usize) -> f64 {
        let mut distances = core::mem::take(&mut self.distances);
        distances.clear();
        distances.extend((0..self.values.len()).step_by(stride).map(|row| self.distance(powers, row)));
        let median = middle(&mut distances);
        self.distances = distances;
        median
    }

    /// Standard deviation of the rows that are near.
    fn deviation(&self, powers: [f64; 3], near: f64) -> f64 {
        let distances = (0..self.values.len()).map(|row| self.distance(powers, row)).filter(|it| *it <= near);
        let (count, squares) = distances.fold((0.0, 0.0), |(n, sum), distance| (n + 1.0, sum + distance * distance));
        (squares / f64::max(count - 3.0, 1.0)).sqrt() / CUT
    }

    /// The parabola of least squares through the rows that are near another one.
    fn parabola(&self, powers: [f64; 3], near: f64) -> Option<[f64; 3]> {
        let mut sums = [0.0; 5];
        let mut right = [0.0; 3];
        for row in (0..self.values.len()).filter(|row| self.distance(powers, *row) <= near) {
            let (x, y) = (self.places[row], self.values[row] - powers[0]);
            let mut power = 1.0;
            for (degree, sum) in sums.iter_mut().enumerate() {
                *sum += power;
                if let Some(right) = right.get_mut(degree) {
                    *right += power * y;
                }
                power *= x;
            }
        }
        let matrix = nalgebra::Matrix3::from_fn(|i, j| sums[i + j]);
        let solved = matrix.cholesky()?.solve(&nalgebra::Vector3::from(right));
        Some([powers[0] + solved[0], solved[1], solved[2]])
    }
}

/// The middle value; 0 of none.
fn middle(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let place = values.len() / 2;
    *values.select_nth_unstable_by(place, f64::total_cmp).1
}
