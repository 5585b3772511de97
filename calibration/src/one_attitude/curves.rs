//! A bias curve through means of narrow bins of temperature, each of which weighs alike.
//!
//! A warm-up slows down: most of its rows are of a few degrees at its end. Rows that weigh alike make a curve that fits
//! these degrees.

use crate::transients::BinValue;
use core::ops::Range;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::units::SensorKind;
use isotherm_statistics::least_squares;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// Bins of the telemetry's range.
const NARROW: f64 = 200.0;

/// Bins that a curve needs for each of its coefficients.
const BINS_PER_COEFFICIENT: usize = 3;

/// How much temperatures weigh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Weight {
    /// Bins of this width of telemetry weigh alike.
    Alike(f64),
    /// Each by its rows.
    Rows,
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
    /// Least and largest telemetry of the rows.
    pub range: [f64; 2],
    /// The bins of each recording; the values without the transient that is written.
    pub recordings: Vec<Vec<BinValue>>,
}

/// The mean of some bins of one recording.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Mean {
    pub recording: usize,
    pub telemetry: f64,
    pub value: f64,
    pub age_s: f64,
    pub count: f64,
}

/// A curve without a constant, and the constant of each recording \[g0 or deg/h\].
#[derive(Clone, Debug)]
pub(super) struct Shape {
    range: [f64; 2],
    /// Coefficients of the powers 1, 2, .. of the place in the range, -1 to 1.
    powers: Vec<f64>,
    /// `None` for recordings without bins in the fit.
    pub constants: Vec<Option<f64>>,
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

    /// Means by recording and bin of the telemetry, with the number of its bin. Bins are `width` wide, and begin at
    /// whole widths.
    pub(super) fn means(&self, parts: &[Part], width: f64) -> Vec<(i64, Mean)> {
        let mut all: BTreeMap<(i64, usize), Mean> = BTreeMap::new();
        for part in parts {
            for bin in self.bins(part) {
                let index = (bin.telemetry / width).floor() as i64;
                let mean = all.entry((index, part.recording)).or_default();
                mean.recording = part.recording;
                mean.telemetry += bin.telemetry;
                mean.value += bin.value;
                mean.age_s += bin.age_s;
                mean.count += 1.0;
            }
        }
        let finish = |((index, _), sum): ((i64, usize), Mean)| {
            let mean = |total: f64| total / sum.count;
            let of = Mean { telemetry: mean(sum.telemetry), value: mean(sum.value), age_s: mean(sum.age_s), ..sum };
            (index, of)
        };
        all.into_iter().map(finish).collect()
    }

    /// The curve of this order through the bins of these parts; `None` if they do not determine it.
    pub(super) fn fit(&self, parts: &[Part], order: usize, weight: Weight) -> Option<Shape> {
        let means = self.means(parts, if let Weight::Alike(width) = weight { width } else { self.narrow() });
        let mut in_bin: BTreeMap<i64, f64> = BTreeMap::new();
        means.iter().for_each(|(index, mean)| *in_bin.entry(*index).or_default() += mean.count);
        if in_bin.len() < BINS_PER_COEFFICIENT * (order + 1) {
            return None;
        }
        let mut there: Vec<usize> = means.iter().map(|(_, mean)| mean.recording).collect();
        there.sort_unstable();
        there.dedup();
        let column = |recording: usize| there.binary_search(&recording).unwrap_or_default();
        let weight = |(index, mean): &(i64, Mean)| match weight {
            Weight::Alike(_) => (mean.count / in_bin[index]).sqrt(),
            Weight::Rows => mean.count.sqrt(),
        };
        let jacobian = DMatrix::from_fn(means.len(), order + there.len(), |i, j| {
            let (_, mean) = &means[i];
            let value = match j.checked_sub(order) {
                None => place(self.range, mean.telemetry).powi(j as i32 + 1),
                Some(constant) => f64::from(u8::from(constant == column(mean.recording))),
            };
            value * weight(&means[i])
        });
        let residual = DVector::from_fn(means.len(), |i, _| -means[i].1.value * weight(&means[i]));
        let change = least_squares(&jacobian, &residual)?.change;
        let constant = |recording: usize| there.contains(&recording).then(|| change[order + column(recording)]);
        Some(Shape {
            range: self.range,
            powers: change.iter().take(order).copied().collect(),
            constants: (0..self.recordings.len()).map(constant).collect(),
        })
    }
}

impl Shape {
    /// Mean constant of the recordings.
    pub(super) fn constant(&self) -> Option<f64> {
        let known: Vec<f64> = self.constants.iter().copied().flatten().collect();
        (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
    }

    /// The curve without its constant.
    pub(super) fn at(&self, telemetry: f64) -> f64 {
        let x = place(self.range, telemetry);
        self.powers.iter().rev().fold(0.0, |sum, power| (sum + power) * x)
    }

    /// The curve that is `value` at the telemetry `at`; `None` if it is no polynomial of a table.
    pub(super) fn polynomial(&self, at: f64, value: f64) -> Option<Polynomial> {
        let [low, high] = self.range;
        let coefficients: Vec<f64> = core::iter::once(value - self.at(at)).chain(self.powers.iter().copied()).collect();
        Polynomial::new(&coefficients, low.midpoint(high), (high - low) / 2.0, self.range)
    }
}

/// The place in the range, -1 to 1.
fn place([low, high]: [f64; 2], telemetry: f64) -> f64 {
    (2.0 * telemetry - low - high) / (high - low)
}

/// Standard deviation about the mean, and largest distance from it; 0 of none.
pub(super) fn spread(values: &[f64]) -> [f64; 2] {
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    let largest = values.iter().map(|value| (value - mean).abs()).fold(0.0, f64::max);
    [(squares / n).sqrt(), largest]
}
