//! Rows that a filter made alike: they correlate from one to the next more than the noise of the model does.
//!
//! With covariances c of rates some rows apart, half of the mean square of r(i+2) - r(i), less that of r(i+1) - r(i),
//! is c1 - c2. It needs no stationary rates. White noise has 0, quantisation less, slow noise what the model says; a
//! low-pass, a vibration and repeated values have more.

use super::model::{Coefficient, ModelFit};

/// Least excess, in its errors.
const ERRORS: f64 = 5.0;
/// Parts of the rates whose scatter gives the error.
const PARTS: usize = 64;
/// c1 - c2 of flicker noise over B^2, (9 ln 3 - 12 ln 2)/(2 pi), and of a random walk over K^2 Ts.
const SLOW: [f64; 2] = [0.249_8, 0.5];
/// Standard errors from a square to the end of its 95 % range.
const QUANTILE: f64 = 1.96;

/// What is left for a model where rows correlate.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FilterFit {
    /// The excess over its error.
    pub errors: f64,
    /// The model of the longer tau, from the first octave at which one holds; `None` if none does.
    pub model: Option<ModelFit>,
}

/// Whether the rates correlate beyond the model, which is fitted to `octaves` by averaging factor.
pub(super) fn filtered(
    rates: &[f64],
    octaves: &[(usize, f64)],
    model: &ModelFit,
    interval_s: f64,
) -> Option<FilterFit> {
    let holding = |from: usize| ModelFit::of(&octaves[from..], rates.len(), interval_s).filter(ModelFit::holds);
    let (mean, error) = excess(rates);
    if mean <= ERRORS * error {
        return None;
    }
    // A model that does not hold says nothing of its rows; that of longer tau knows no quantisation, which only lowers
    // the difference.
    let longer = (1..octaves.len().saturating_sub(3)).find_map(holding);
    let judge = if model.holds() { Some(model) } else { longer.as_ref() };
    let expected = judge.map_or(0.0, |model| model.of_means(1, 1) - model.of_means(1, 2));
    let of_model = judge.map_or(0.0, |judge| error_of_model(judge, interval_s, model.holds()));
    let errors = (mean - expected) / libm::hypot(error, of_model);
    (errors > ERRORS).then_some(FilterFit { errors, model: longer })
}

/// The standard error of c1 - c2 of the model, with its quantisation or without.
fn error_of_model(model: &ModelFit, interval_s: f64, quantised: bool) -> f64 {
    let [quantisation, _, flicker, walk] = &model.coefficients;
    let error = |it: &Coefficient| it.range.map_or(0.0, |[_, high]| (high * high - it.value * it.value) / QUANTILE);
    let fast = if quantised { error(quantisation) / (interval_s * interval_s) } else { 0.0 };
    libm::hypot(libm::hypot(fast, SLOW[0] * error(flicker)), SLOW[1] * error(walk) * interval_s)
}

/// c1 - c2, and its standard error.
fn excess(rates: &[f64]) -> (f64, f64) {
    let half_square = |a: f64, b: f64| 0.5 * (a - b) * (a - b);
    let part = |part: &[f64]| {
        let each = part.windows(3).map(|row| half_square(row[2], row[0]) - half_square(row[1], row[0]));
        each.sum::<f64>() / (part.len() - 2) as f64
    };
    let parts: Vec<f64> = rates.chunks_exact(rates.len() / PARTS).map(part).collect();
    let count = parts.len() as f64;
    let mean = parts.iter().sum::<f64>() / count;
    let squares: f64 = parts.iter().map(|part| (part - mean) * (part - mean)).sum();
    (mean, (squares / (count * (count - 1.0))).sqrt())
}
