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
//! The covariance A - gamma(h), with a level that is nearly free (A is large), stands for the variogram. Where the
//! estimate is no covariance, as of smooth rows, its variance is raised until it is one.

use super::stretch::MOST_MISSING;
use isotherm_simulation::RandomGenerator;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use std::collections::HashMap;

/// Rows on each side that a missing one is predicted from.
const SIDE: usize = 32;
/// Rows that are looked at for one gap.
const WINDOW: usize = 2 * SIDE + MOST_MISSING;
/// A over the largest value of the variogram.
const FREE_LEVEL: f64 = 100.0;
/// First addition to the variance, over gamma(1), where the estimate is no covariance.
const LEAST_ADDED: f64 = 1e-3;
/// Parts of the rows; those in which the variogram is over so many times the median are left out: a knock is no noise.
const PARTS: usize = 32;
const MOST_OVER_MEDIAN: f64 = 4.0;
/// The seed of all draws.
const SEED: u64 = 1;

/// What tells gaps apart: the rows before, those that are missing, and which of the rows after are there.
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
    let covariances = covariances(rates);
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
        // Rates that never change have exactly their value.
        let mean = known[0] + known.add_scalar(-known[0]).mean();
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

/// The covariance of rates by their distance, up to the length of a window. That of any places in it has a factor.
fn covariances(rates: &[f64]) -> Vec<f64> {
    let variogram = variogram(rates);
    let largest = variogram.iter().copied().fold(0.0, f64::max);
    let mut covariances: Vec<f64> = variogram.iter().map(|gamma| FREE_LEVEL * largest - gamma).collect();
    let places: Vec<usize> = (0..WINDOW).collect();
    let (start, mut added) = (covariances[0], LEAST_ADDED * variogram[1].max(1e-9 * largest));
    while added > 0.0 && added < FREE_LEVEL * largest && factor(&places, &covariances).is_none() {
        covariances[0] = start + added;
        added *= 2.0;
    }
    covariances
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
