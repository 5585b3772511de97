//! A bias curve through the means of narrow bins of temperature.
//!
//! A warm-up slows down: most of its rows are of a few degrees at its end. Where the noise of the rows is all there is,
//! a mean is as good as it has rows, and the plain fit of all rows is best. Where hysteresis or a floor of flicker
//! moves the means by much more than that, more rows make a mean hardly better, and a plain fit would follow a few
//! degrees. [`Scatter`] distinguishes these.

use crate::transients::BinValue;
use core::ops::Range;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::units::SensorKind;
use isotherm_statistics::{least_squares, median};
use isotherm_support::checkpoint::checkpoint;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// Bins of the temperature's range.
const NARROW: f64 = 200.0;

/// Narrow bins of a wide one.
const WIDE: i64 = 8;

/// Bins that a curve needs for each of its coefficients.
const BINS_PER_COEFFICIENT: usize = 3;

/// Means scatter by more than their rows explain only if their mean square is over this many times what it would be.
const FLOOR: f64 = 4.0;
/// What rows do not explain becomes less with the number of rows, with this power of it. On a real run with hysteresis,
/// 0 is what fits its own rows best, and 0.15 predicts another sweep hardly worse; with a lag, which is small where the
/// temperature is slow, more is better.
const LESS: f64 = 0.15;
/// Steps of the bisection for the floor: a factor of 1 to 1e12 is found to 1e-3.
const FLOOR_STEPS: usize = 40;
/// Order of the curve that means scatter about.
const SCATTER_ORDER: usize = 3;

/// How much temperatures weigh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Weight {
    /// Bins of this width of temperature weigh alike.
    Alike(f64),
    /// Each by its rows.
    Rows,
    /// Each by the variance of its mean.
    Scatter(Scatter),
}

/// Variance of the mean of a narrow bin of temperature, by the number of its values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scatter {
    /// Of one value: the noise of the rows.
    white: f64,
    /// Of the mean of the usual number of values, next to that.
    floor: f64,
    usual: f64,
}

impl Scatter {
    fn variance(&self, count: f64) -> f64 {
        self.white / count + self.floor * libm::pow(self.usual / count, LESS)
    }
}

/// Bins of one recording.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Part {
    /// Number of the recording.
    pub recording: usize,
    /// The bins.
    pub bins: Range<usize>,
}

/// A bias, bin by bin.
#[derive(Clone, Debug)]
pub(super) struct Series {
    pub kind: SensorKind,
    pub axis: usize,
    /// Least and largest temperature of the rows.
    pub range: [f64; 2],
    /// The bins of each recording; the values without the transient that is written.
    pub recordings: Vec<Vec<BinValue>>,
}

/// The mean of some bins of one recording.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Mean {
    pub recording: usize,
    pub temperature: f64,
    pub value: f64,
    pub age_s: f64,
    pub count: f64,
}

/// A curve without a constant, and the constant of each recording \[g0 or deg/h\].
#[derive(Clone, Debug)]
pub(super) struct Shape {
    range: [f64; 2],
    /// Coefficients of the powers 1, 2, ... of the place in the range, -1 to 1.
    powers: Vec<f64>,
    /// `None` for recordings without bins in the fit.
    pub constants: Vec<Option<f64>>,
    /// Weighted sum of the squares of what the curve leaves of the means of bins, and their number less that of the
    /// unknowns.
    left: (f64, f64),
    /// Covariance of the powers and of the constants' mean, for weights that are inverse variances.
    covariance: DMatrix<f64>,
}

impl Series {
    /// All bins.
    pub(super) fn whole(&self) -> Vec<Part> {
        let part = |(recording, bins): (usize, &Vec<BinValue>)| Part { recording, bins: 0..bins.len() };
        self.recordings.iter().enumerate().map(part).collect()
    }

    /// The bins of a part.
    pub(super) fn bins(&self, part: &Part) -> &[BinValue] {
        &self.recordings[part.recording][part.bins.clone()]
    }

    /// Width of the narrow bins.
    pub(super) fn narrow(&self) -> f64 {
        let [low, high] = self.range;
        (high - low) / NARROW
    }

    /// Means by recording and bin of the temperature, with the number of its bin. Bins are `width` wide, and begin at
    /// whole widths.
    pub(super) fn means(&self, parts: &[Part], width: f64) -> Vec<(i64, Mean)> {
        let mut all: BTreeMap<(i64, usize), Mean> = BTreeMap::new();
        for part in parts {
            for bin in self.bins(part) {
                let index = (bin.temperature / width).floor() as i64;
                let mean = all.entry((index, part.recording)).or_default();
                mean.recording = part.recording;
                mean.temperature += bin.temperature;
                mean.value += bin.value;
                mean.age_s += bin.age_s;
                mean.count += 1.0;
            }
        }
        let finish = |((index, _), sum): ((i64, usize), Mean)| {
            let mean = |total: f64| total / sum.count;
            let of = Mean { temperature: mean(sum.temperature), value: mean(sum.value), age_s: mean(sum.age_s), ..sum };
            (index, of)
        };
        all.into_iter().map(finish).collect()
    }

    /// The curve of this order through the bins of these parts; `None` if they do not determine it.
    pub(super) fn fit(&self, parts: &[Part], order: usize, weight: Weight) -> Option<Shape> {
        let means = self.means(parts, if let Weight::Alike(width) = weight { width } else { self.narrow() });
        self.fit_to(&means, order, weight)
    }

    /// The curve of this order through means of bins. The constants of the recordings, which may be hundreds, are
    /// eliminated first: values and powers are taken about their weighted means in each recording.
    pub(super) fn fit_to(&self, means: &[(i64, Mean)], order: usize, weight: Weight) -> Option<Shape> {
        checkpoint();
        let mut in_bin: BTreeMap<i64, f64> = BTreeMap::new();
        means.iter().for_each(|(index, mean)| *in_bin.entry(*index).or_default() += mean.count);
        if in_bin.len() < BINS_PER_COEFFICIENT * (order + 1) {
            return None;
        }
        let weight = |(index, mean): &(i64, Mean)| match weight {
            Weight::Alike(_) => mean.count / in_bin[index],
            Weight::Rows => mean.count,
            Weight::Scatter(scatter) => scatter.variance(mean.count).recip(),
        };
        // The powers of the place, and the value.
        let column = |mean: &Mean, j: usize| match j < order {
            true => place(self.range, mean.temperature).powi(j as i32 + 1),
            false => mean.value,
        };
        let mut weights = vec![0.0; self.recordings.len()];
        let mut centers = DMatrix::zeros(self.recordings.len(), order + 1);
        for it in means {
            let (recording, weight) = (it.1.recording, weight(it));
            weights[recording] += weight;
            (0..=order).for_each(|j| centers[(recording, j)] += weight * column(&it.1, j));
        }
        let there: Vec<usize> = (0..weights.len()).filter(|recording| weights[*recording] > 0.0).collect();
        there.iter().for_each(|recording| centers.row_mut(*recording).unscale_mut(weights[*recording]));
        let freedom = means.len().checked_sub(order + there.len())?;
        let about = DMatrix::from_fn(means.len(), order + 1, |i, j| {
            (column(&means[i].1, j) - centers[(means[i].1.recording, j)]) * weight(&means[i]).sqrt()
        });
        let (jacobian, residual) = (about.columns(0, order).into_owned(), -about.column(order));
        let (change, inverse) = match order {
            0 => (DVector::zeros(0), DMatrix::zeros(0, 0)),
            _ => least_squares(&jacobian, &residual).map(|solution| (solution.change, solution.inverse))?,
        };
        let constant = |recording: usize| {
            let powers = centers.row(recording).columns(0, order).transpose();
            (weights[recording] > 0.0).then(|| centers[(recording, order)] - powers.dot(&change))
        };
        let count = there.len() as f64;
        let mean_powers = DVector::from_fn(order, |j, _| there.iter().map(|it| centers[(*it, j)]).sum::<f64>() / count);
        let shared = -(&inverse * &mean_powers);
        let own: f64 = there.iter().map(|it| weights[*it].recip()).sum::<f64>() / (count * count);
        let mut covariance = inverse.resize(order + 1, order + 1, own - shared.dot(&mean_powers));
        (0..order).for_each(|j| [covariance[(j, order)], covariance[(order, j)]] = [shared[j]; 2]);
        Some(Shape {
            range: self.range,
            left: ((&jacobian * &change + &residual).norm_squared(), freedom as f64),
            constants: (0..self.recordings.len()).map(constant).collect(),
            powers: change.iter().copied().collect(),
            covariance,
        })
    }

    /// How the means of all narrow bins scatter about a cubic, or the highest order that they determine; `None` if they
    /// determine none.
    pub(super) fn scatter(&self) -> Option<Scatter> {
        let means = self.means(&self.whole(), self.narrow());
        let order = (0..=SCATTER_ORDER).rev().find(|order| self.fit_to(&means, *order, Weight::Rows).is_some())?;
        let usual = median(means.iter().map(|(_, mean)| mean.count));
        let white = self.white();
        // Mean square of what the cubic leaves, in variances.
        let excess = |floor: f64| {
            let scatter = Scatter { white, floor, usual };
            let (left, freedom) = self.fit_to(&means, order, Weight::Scatter(scatter))?.left;
            Some(left / freedom.max(1.0))
        };
        let mut scatter = Scatter { white, floor: 0.0, usual };
        if white > 0.0 && excess(0.0)? <= FLOOR {
            return Some(scatter);
        }
        let largest = means.iter().map(|(_, mean)| mean.value.abs()).fold(1e-12, f64::max);
        let [mut low, mut high] = [largest * 1e-12, largest].map(|value| value * value);
        for _ in 0..FLOOR_STEPS {
            let middle = (low * high).sqrt();
            *if excess(middle)? > 1.0 { &mut low } else { &mut high } = middle;
        }
        scatter.floor = high;
        Some(scatter)
    }

    /// Variance of the noise of a value. Second differences have neither level nor slope; their median knows nothing of
    /// spikes.
    fn white(&self) -> f64 {
        /// Variance of a second difference of values of variance 1.
        const OF_DIFFERENCE: f64 = 6.0;
        /// Median size of a value of variance 1.
        const MEDIAN: f64 = 0.6745;
        let second = |three: &[BinValue]| (three[2].value - 2.0 * three[1].value + three[0].value).abs();
        let all = self.recordings.iter().flat_map(|bins| bins.windows(3).map(second));
        let size = median(all) / MEDIAN;
        if size.is_finite() { size * size / OF_DIFFERENCE } else { 0.0 }
    }
}

impl Shape {
    /// Mean constant of the recordings.
    pub(super) fn constant(&self) -> Option<f64> {
        let known: Vec<f64> = self.constants.iter().copied().flatten().collect();
        (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
    }

    /// The curve without its constant.
    pub(super) fn at(&self, temperature: f64) -> f64 {
        let x = place(self.range, temperature);
        self.powers.iter().rev().fold(0.0, |sum, power| (sum + power) * x)
    }

    /// By how much more variance than the weights say the means of wide bins scatter: 1 if the weights are right, more
    /// if neighbouring bins are off together.
    pub(super) fn together(&self, series: &Series, scatter: Scatter) -> f64 {
        let mut wide: BTreeMap<(i64, usize), (f64, f64)> = BTreeMap::new();
        for (index, mean) in series.means(&series.whole(), series.narrow()) {
            let Some(constant) = self.constants[mean.recording] else { continue };
            let weight = scatter.variance(mean.count).recip();
            let (sum, weights) = wide.entry((index.div_euclid(WIDE), mean.recording)).or_default();
            *sum += weight * (mean.value - constant - self.at(mean.temperature));
            *weights += weight;
        }
        let left: f64 = wide.values().map(|(sum, weights)| sum * sum / weights).sum();
        let unknowns = self.powers.len() + self.constants.iter().flatten().count();
        (left / wide.len().saturating_sub(unknowns).max(1) as f64).max(1.0)
    }

    /// Its highest term in standard errors; 0 for a constant.
    pub(super) fn significance(&self, together: f64) -> f64 {
        let Some(last) = self.powers.len().checked_sub(1) else { return 0.0 };
        self.powers[last].abs() / (self.covariance[(last, last)] * together).sqrt()
    }

    /// Standard error of the curve at a temperature; of its difference from that at `at`, if that is given.
    pub(super) fn standard_error(&self, temperature: f64, at: Option<f64>, together: f64) -> f64 {
        let (x, from) = (place(self.range, temperature), at.map(|at| place(self.range, at)));
        let order = self.powers.len();
        let column = |j: usize| match (j < order, from) {
            (true, None) => x.powi(j as i32 + 1),
            (true, Some(from)) => x.powi(j as i32 + 1) - from.powi(j as i32 + 1),
            (false, None) => 1.0,
            (false, Some(_)) => 0.0,
        };
        let columns = DVector::from_fn(order + 1, |j, _| column(j));
        (columns.dot(&(&self.covariance * &columns)) * together).sqrt()
    }

    /// The curve that is `value` at the temperature `at`; `None` if it is no polynomial of a table.
    pub(super) fn polynomial(&self, at: f64, value: f64) -> Option<Polynomial> {
        let [low, high] = self.range;
        let coefficients: Vec<f64> = core::iter::once(value - self.at(at)).chain(self.powers.iter().copied()).collect();
        Polynomial::new(&coefficients, low.midpoint(high), (high - low) / 2.0, self.range)
    }
}

/// The place in the range, -1 to 1.
fn place([low, high]: [f64; 2], temperature: f64) -> f64 {
    (2.0 * temperature - low - high) / (high - low)
}

/// Standard deviation about the mean, and largest distance from it; 0 of none.
pub(super) fn spread(values: &[f64]) -> [f64; 2] {
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    let largest = values.iter().map(|value| (value - mean).abs()).fold(0.0, f64::max);
    [(squares / n).sqrt(), largest]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Recordings of some values each, with noise that is none.
    fn series(recordings: usize) -> Series {
        let bin = |recording: usize, number: usize| {
            let temperature = 20.0 + (number as f64 * 0.37 + recording as f64 * 1.3) % 40.0;
            let value = 0.01 * temperature + 2e-4 * temperature * temperature + recording as f64;
            let value = value + libm::sin((number * 7 + recording * 3) as f64);
            BinValue { age_s: number as f64, temperature, value, difference: 0.0 }
        };
        let recordings = (0..recordings).map(|recording| (0..300).map(|number| bin(recording, number)).collect());
        Series { kind: SensorKind::Accelerometer, axis: 0, range: [20.0, 60.0], recordings: recordings.collect() }
    }

    #[test]
    fn a_curve_is_that_of_the_fit_with_a_column_for_each_constant() {
        let series = series(3);
        let scatter = Scatter { white: 0.5, floor: 0.02, usual: 8.0 };
        for order in 0..4 {
            let shape = series.fit(&series.whole(), order, Weight::Scatter(scatter)).unwrap();
            let means = series.means(&series.whole(), series.narrow());
            let root = |mean: &Mean| scatter.variance(mean.count).sqrt().recip();
            let jacobian = DMatrix::from_fn(means.len(), order + 3, |i, j| {
                let mean = &means[i].1;
                let value = match j.checked_sub(order) {
                    None => place(series.range, mean.temperature).powi(j as i32 + 1),
                    Some(recording) => f64::from(u8::from(mean.recording == recording)),
                };
                value * root(mean)
            });
            let residual = DVector::from_fn(means.len(), |i, _| -means[i].1.value * root(&means[i].1));
            let right = least_squares(&jacobian, &residual).unwrap();
            let found = shape.powers.iter().chain(shape.constants.iter().flatten());
            for (found, right) in found.zip(&right.change) {
                assert!((found - right).abs() < 1e-12 * right.abs().max(1.0), "order {order}: {found}, {right}");
            }
            let left = (&jacobian * &right.change + &residual).norm_squared();
            assert!((shape.left.0 / left - 1.0).abs() < 1e-12);
            assert_eq!(shape.left.1, (means.len() - order - 3) as f64);
            // Of a temperature: the powers there, and a third of each constant.
            let columns = DVector::from_fn(order + 3, |j, _| match j < order {
                true => place(series.range, 31.0).powi(j as i32 + 1),
                false => 1.0 / 3.0,
            });
            let error = columns.dot(&(&right.inverse * &columns)).sqrt();
            assert!((shape.standard_error(31.0, None, 1.0) / error - 1.0).abs() < 1e-12);
        }
    }
}
