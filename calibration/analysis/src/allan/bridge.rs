//! Values for rows that are missing, so that the series has the covariance of a whole one.
//!
//! A straight line between the neighbours would scatter too little, and take a part of each neighbour twice: of white
//! noise of which 2 % is missing, N would be off by 1 %, more than its range. So a missing row is drawn (conditional
//! simulation, J.-P. Chiles and P. Delfiner, Geostatistics, chapter 7): ordinary kriging from the rows around it, and a
//! normal number with the variance that kriging leaves. The variogram is that of the pairs of rows that are there,
//!
//! ```text
//! gamma(h) = 1/2 mean of (r(i+h) - r(i))^2
//! ```
//! It needs no stationary rates and no model: white noise, quantisation, filtered rows, flicker noise and random walk
//! all have one. Gaps are filled in turn, from the rows before, those filled included, and from the rows after that
//! are there.
//!
//! The rows lie about a level, the mean of the rows up to W away on each side. W is the one by which rows are predicted
//! best: all rows, of white noise. With a level of few rows, white noise would grow over times that are longer than
//! they cover, by twice the part that is missing. Where slow noise makes W shorter, it is larger there than white
//! noise.
//! About its level a row has the covariance A - gamma(h). Where that is none, as of smooth rows, A is raised at h = 0.

use super::stretch::MOST_MISSING;
use isotherm_simulation::RandomGenerator;
use isotherm_statistics::mean;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use std::collections::HashMap;

/// Rows on each side that a missing one is predicted from.
const SIDE: usize = 32;
/// Rows that are looked at for one gap.
const WINDOW: usize = 2 * SIDE + MOST_MISSING;
/// Rows next to a row that are left out where its level is tried: filtered rows resemble their neighbours.
const ALIKE: usize = 16;
/// First addition to the variance, over gamma(1), where the estimate is no covariance.
const LEAST_ADDED: f64 = 1e-3;
/// Parts of the rows; those in which the variogram is over so many times the median are left out: a knock is no noise.
const PARTS: usize = 32;
const MOST_OVER_MEDIAN: f64 = 4.0;
/// The seed of all draws.
const SEED: u64 = 1;

/// The pattern of a gap: the rows before it, the missing rows, and which of the rows after it are present.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Pattern {
    before: usize,
    missing: usize,
    after: u32,
}

/// How the rows of a pattern are drawn: what multiplies the differences of the known rows from their mean, and normal
/// numbers.
struct Draw {
    known: DMatrix<f64>,
    normal: DMatrix<f64>,
}

/// Gives each rate that is NaN a value. `stream` is the number of the sensor: each has its own random numbers. The
/// first and the last rate are numbers.
pub(super) fn fill(rates: &mut [f64], stream: u64) {
    let Some(first) = rates.iter().position(|rate| rate.is_nan()) else { return };
    let level = Level::of(rates);
    let covariances = covariances(rates, level.variance);
    let mut random = RandomGenerator::new(SEED, stream);
    let mut draws: HashMap<Pattern, Draw> = HashMap::new();
    let mut place = first;
    while place < rates.len() {
        let missing = rates[place..].iter().take_while(|rate| rate.is_nan()).count();
        if missing == 0 {
            place += 1;
            continue;
        }
        let after = &rates[place + missing..rates.len().min(place + missing + SIDE)];
        let is_there = |index: usize| after.get(index).is_some_and(|rate| !rate.is_nan());
        let pattern = Pattern {
            before: place.min(SIDE),
            missing,
            after: (0..SIDE).filter(|index| is_there(*index)).fold(0, |mask, index| mask | 1 << index),
        };
        let draw = draws.entry(pattern).or_insert_with(|| Draw::of(&pattern, &covariances));
        let known = rates[place - pattern.before..place].iter().chain(after.iter().filter(|rate| !rate.is_nan()));
        let known = DVector::from_iterator(draw.known.ncols(), known.copied());
        let mean = level.at(place + missing / 2);
        let normal = DVector::from_fn(missing, |_, _| random.normal());
        let values = &draw.known * known.add_scalar(-mean) + &draw.normal * normal;
        for (rate, value) in rates[place..].iter_mut().zip(&values) {
            *rate = mean + value;
        }
        place += missing;
    }
}

impl Draw {
    /// From the factor of the covariance of the known rows and, behind them, the missing ones.
    fn of(pattern: &Pattern, covariances: &[f64]) -> Self {
        let Pattern { before, missing, after } = *pattern;
        let behind = before + missing;
        let after = (0..SIDE).filter(|index| after & 1 << index != 0).map(|index| behind + index);
        let places: Vec<usize> = (0..before).chain(after).chain(before..behind).collect();
        let known = places.len() - missing;
        let zero = || Self { known: DMatrix::zeros(missing, known), normal: DMatrix::zeros(missing, missing) };
        let Some(factor) = factor(&places, covariances) else { return zero() };
        let factor = factor.l();
        // Rows times the inverse of the factor of the known ones.
        let of_known = factor.view((0, 0), (known, known)).transpose();
        let products = factor.view((known, 0), (missing, known)).transpose();
        let Some(weights) = of_known.solve_upper_triangular(&products) else { return zero() };
        Self { known: weights.transpose(), normal: factor.view((known, known), (missing, missing)).into_owned() }
    }
}

fn factor(places: &[usize], covariances: &[f64]) -> Option<Cholesky<f64, Dyn>> {
    let count = places.len();
    DMatrix::from_fn(count, count, |i, j| covariances[places[i].abs_diff(places[j])]).cholesky()
}

/// The covariance of rates by their distance, up to the length of a window, about a level from which they have this
/// mean squared distance. That of any places in a window has a factor.
fn covariances(rates: &[f64], about_level: f64) -> Vec<f64> {
    let variogram = variogram(rates);
    let [middle, last] = [1, 3].map(|quarter| mean(&variogram[WINDOW * quarter / 4..WINDOW * (quarter + 1) / 4]));
    // What still rises within a window has more variance than the window shows.
    let variance = about_level.max(last + (last - middle).max(0.0));
    let mut covariances: Vec<f64> = variogram.iter().map(|gamma| variance - gamma).collect();
    let places: Vec<usize> = (0..WINDOW).collect();
    let mut added = LEAST_ADDED * variogram[1].max(variance / WINDOW as f64);
    while added > 0.0 && added < variance && factor(&places, &covariances).is_none() {
        covariances[0] = variance + added;
        added *= 2.0;
    }
    covariances
}

/// The level of rates that are there: sums and numbers of them, which lie about the first.
struct Level {
    first: f64,
    sums: Vec<(f64, f64)>,
    /// Rows on each side.
    side: usize,
    /// Mean squared distance of a rate from the level that the others give.
    variance: f64,
}

impl Level {
    /// With the side by which rates are predicted best; sides are doubled up to all rates.
    fn of(rates: &[f64]) -> Self {
        let first = rates[0];
        let (mut sum, mut count) = (0.0, 0.0);
        let add = |rate: &f64| {
            if !rate.is_nan() {
                (sum, count) = (sum + (rate - first), count + 1.0);
            }
            (sum, count)
        };
        let sums = core::iter::once((0.0, 0.0)).chain(rates.iter().map(add)).collect();
        let mut level = Self { first, sums, side: 0, variance: f64::INFINITY };
        let sides = core::iter::successors(Some(2 * ALIKE), |side| (*side < rates.len()).then_some(2 * side));
        for side in sides {
            let variance = level.error(rates, side);
            if variance < level.variance {
                (level.side, level.variance) = (side, variance);
            }
        }
        level
    }

    /// Sum and number of the rates from one place to before another, about the first.
    fn between(&self, from: usize, to: usize) -> (f64, f64) {
        let last = self.sums.len() - 1;
        let [from, to] = [from.min(last), to.min(last)].map(|place| self.sums[place]);
        (to.0 - from.0, to.1 - from.1)
    }

    /// The level at a place.
    fn at(&self, place: usize) -> f64 {
        let (sum, count) = self.between(place.saturating_sub(self.side), place + self.side + 1);
        self.first + sum / count
    }

    /// The mean squared distance of a rate from the mean of others up to `side` away, without its neighbours.
    fn error(&self, rates: &[f64], side: usize) -> f64 {
        let square = |(place, rate): (usize, &f64)| {
            let before = self.between(place.saturating_sub(side), place.saturating_sub(ALIKE));
            let after = self.between(place + ALIKE + 1, place + side + 1);
            let level = self.first + (before.0 + after.0) / (before.1 + after.1);
            Some((rate - level) * (rate - level)).filter(|square| square.is_finite())
        };
        let squares = rates.iter().enumerate().filter_map(square);
        let (sum, count) = squares.fold((0.0, 0.0), |(sum, count), square| (sum + square, count + 1.0));
        sum / count
    }
}

/// The variogram, from 0 to the length of a window.
fn variogram(rates: &[f64]) -> Vec<f64> {
    let of_part = |part: usize| {
        let starts = rates.len() * part / PARTS..rates.len() * (part + 1) / PARTS;
        let mut sums = vec![(0.0, 0_usize); WINDOW];
        for start in starts {
            for (rate, (sum, count)) in rates[start..].iter().zip(&mut sums) {
                let square = (rate - rates[start]) * (rate - rates[start]);
                // Without a number on either side there is no pair.
                if square.is_finite() {
                    *sum += square;
                    *count += 1;
                }
            }
        }
        sums
    };
    let parts: Vec<_> = (0..PARTS).map(of_part).collect();
    let mean = |(sum, count): (f64, usize)| 0.5 * sum / count.max(1) as f64;
    let longest = |part: &[(f64, usize)]| mean(part[WINDOW - 1]);
    let median = isotherm_statistics::median(parts.iter().map(|part| longest(part)));
    let quiet = |part: &&Vec<(f64, usize)>| longest(part) <= MOST_OVER_MEDIAN * median;
    let kept: Vec<_> = parts.iter().filter(quiet).collect();
    let total = |lag: usize| kept.iter().fold((0.0, 0), |all, part| (all.0 + part[lag].0, all.1 + part[lag].1));
    (0..WINDOW).map(|lag| mean(total(lag))).collect()
}
