//! Steps of a rate: a knock moves a bias at once and for good, which a random walk does not.
//!
//! Means of W rows before and after a row differ by over 6 errors, those of the Allan deviation at W once the step is
//! taken out. As much would remain of a walk, so the likelihood decides: of the differences of neighbouring means of
//! blocks, under the model of the rates, and under that of the rates without the step, with the step as a second
//! unknown.

use super::deviations::{self, Curve, phase, variance_of};
use super::model::ModelFit;

/// Most steps that are taken out of a rate.
const MOST: usize = 8;
/// Least difference of the means, in its errors.
const ERRORS: f64 = 6.0;
/// The model with the step is better by this in -2 ln L. A walk whose steps are Gaussian rarely reaches 20.
const BETTER: f64 = 30.0;
/// Shortest means \[s\], \[rows\].
const SHORTEST: (f64, usize) = (1.0, 5);
/// Blocks whose differences have a likelihood.
const BLOCKS: usize = 512;

/// A step that was found, and taken out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// The first rate after it, counted from 0.
    pub row: usize,
    /// Its time \[s\]: since the first rate, or of a recording since its begin.
    pub at_s: f64,
    /// The rate after it less that before, in the unit of the rate.
    pub size: f64,
}

impl Step {
    /// Takes it out of rates.
    pub(super) fn take_out(&self, rates: &mut [f64]) {
        rates.iter_mut().skip(self.row).for_each(|rate| *rate -= self.size);
    }
}

/// The steps of rates, and the curve without them.
pub(super) fn take_out(rates: &mut [f64], interval_s: f64) -> (Vec<Step>, Curve) {
    let mut curve = Curve::of(rates, interval_s);
    let mut steps = Vec::new();
    while steps.len() < MOST
        && let Some(model) = &curve.model
        && let Some((step, without)) = find(rates, interval_s, model)
    {
        step.take_out(rates);
        steps.push(step);
        curve = without;
    }
    steps.sort_by_key(|step| step.row);
    (steps, curve)
}

/// The step that the shortest means show, and the curve without it.
fn find(rates: &[f64], interval_s: f64, model: &ModelFit) -> Option<(Step, Curve)> {
    let mut phase = phase(rates, interval_s);
    let (seconds, rows) = SHORTEST;
    let shortest = ((seconds / interval_s).ceil() as usize).max(rows);
    let widths = core::iter::successors(Some(shortest), |width| Some(2 * width));
    for width in widths.take_while(|width| *width <= rates.len() / 4) {
        let Some(step) = largest(&phase, width, interval_s) else { continue };
        if step.size.abs() > ERRORS * 2_f64.sqrt() * deviation_without(&phase, &step, width, interval_s) {
            // One series next to the rates is enough.
            drop(phase);
            let confirmed = confirmed(rates, interval_s, &step, model);
            if confirmed.is_some() {
                return confirmed;
            }
            phase = deviations::phase(rates, interval_s);
        }
    }
    None
}

/// The row around which the means of `width` rows differ most. `None` if they differ half as much around the rows a
/// width away: then the rate drifts, or it has a spike, and no step.
fn largest(phase: &[f64], width: usize, interval_s: f64) -> Option<Step> {
    let scale = width as f64 * interval_s;
    let difference = |row: usize| (phase[row + width] - 2.0 * phase[row] + phase[row - width]) / scale;
    let rows = width..phase.len() - width;
    let row = rows.clone().max_by(|a, b| difference(*a).abs().total_cmp(&difference(*b).abs()))?;
    let size = difference(row);
    let beside = [row - width, row + width].into_iter().filter(|row| rows.contains(row));
    let is_alone = beside.into_iter().all(|row| difference(row).abs() < 0.5 * size.abs());
    is_alone.then_some(Step { row, at_s: row as f64 * interval_s, size })
}

/// The Allan deviation at `width` rows when the step is taken out.
fn deviation_without(phase: &[f64], step: &Step, width: usize, interval_s: f64) -> f64 {
    let after = |index: usize| index.saturating_sub(step.row) as f64 * interval_s;
    variance_of(phase, width, interval_s, |index, x| x - step.size * after(index)).sqrt()
}

/// The step with its best size, and the curve without it, if that model is better than `model`, which has none.
fn confirmed(rates: &[f64], interval_s: f64, rough: &Step, model: &ModelFit) -> Option<(Step, Curve)> {
    let without = |step: &Step| {
        let left = |row: usize| if row < step.row { rates[row] } else { rates[row] - step.size };
        Curve::of_each(rates.len(), left, interval_s)
    };
    let length = rates.len().div_ceil(BLOCKS);
    let means: Vec<f64> = rates[rough.row % length..]
        .chunks_exact(length)
        .map(|block| block.iter().sum::<f64>() / length as f64)
        .collect();
    let differences: Vec<f64> = means.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mut unit = vec![0.0; differences.len()];
    *unit.get_mut((rough.row / length).checked_sub(1)?)? = 1.0;
    let (determinant, [of_walk, _]) = whitened(model, length, [&differences, &unit])?;
    let with_walk = determinant + dot(&of_walk, &of_walk);
    let (determinant, [left, shape]) = whitened(without(rough).model.as_ref()?, length, [&differences, &unit])?;
    let size = dot(&shape, &left) / dot(&shape, &shape);
    let with_step = determinant + dot(&left, &left) - size * dot(&shape, &left);
    let step = Step { size, ..*rough };
    (with_walk - with_step > BETTER).then(|| (step, without(&step)))
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Differences of neighbouring means of `length` rates, made white and of variance 1 by what the model predicts from
/// those before (Levinson and Durbin), and the logarithm of the determinant of their covariance. `None` if that is not
/// positive.
fn whitened(model: &ModelFit, length: usize, vectors: [&[f64]; 2]) -> Option<(f64, [Vec<f64>; 2])> {
    let count = vectors[0].len();
    let means: Vec<_> = (0..=count + 1).map(|distance| model.of_means(length, distance)).collect();
    let covariance = |lag: usize| 2.0 * means[lag] - means[lag + 1] - means[lag.abs_diff(1)];
    let (mut variance, mut determinant) = (covariance(0), 0.0);
    let mut weights: Vec<f64> = Vec::with_capacity(count);
    let mut white = [Vec::with_capacity(count), Vec::with_capacity(count)];
    for row in 0..count {
        if !(variance > 0.0 && variance.is_finite()) {
            return None;
        }
        determinant += libm::log(variance);
        for (white, vector) in white.iter_mut().zip(vectors) {
            let predicted: f64 = weights.iter().zip(vector[..row].iter().rev()).map(|(w, x)| w * x).sum();
            white.push((vector[row] - predicted) / variance.sqrt());
        }
        let known: f64 = weights.iter().enumerate().map(|(index, w)| w * covariance(row - index)).sum();
        let last = (covariance(row + 1) - known) / variance;
        let turned: Vec<_> = weights.iter().rev().map(|w| last * w).collect();
        weights.iter_mut().zip(turned).for_each(|(w, turned)| *w -= turned);
        weights.push(last);
        variance *= 1.0 - last * last;
    }
    Some((determinant, white))
}
