//! The Allan variances of rates, and the model of them.

use super::model::ModelFit;
use isotherm_support::checkpoint::checkpoint;

/// Allan variances by averaging factor, and the model of their octaves.
pub(crate) struct Curve {
    pub(super) variances: Vec<(usize, f64)>,
    pub(crate) model: Option<ModelFit>,
}

impl Curve {
    pub(crate) fn of(rates: &[f64], interval_s: f64) -> Self {
        Self::of_each(rates.len(), |row| rates[row], interval_s)
    }

    /// Of rates that are computed, so that no second series is kept.
    pub(super) fn of_each(count: usize, rate: impl Fn(usize) -> f64, interval_s: f64) -> Self {
        let phase = phase_of(count, rate, interval_s);
        let variances: Vec<_> = factors(count).into_iter().map(|m| (m, variance(&phase, m, interval_s))).collect();
        let model = ModelFit::of(&octaves(&variances), count, interval_s);
        Self { variances, model }
    }
}

/// The variances that a model is fitted to.
pub(super) fn octaves(variances: &[(usize, f64)]) -> Vec<(usize, f64)> {
    variances.iter().filter(|(m, _)| m.is_power_of_two()).copied().collect()
}

/// The phase of rates that are `interval_s` apart: the running sum of the rates less their mean, times the interval;
/// one value more than rates.
#[must_use]
pub(crate) fn phase(rates: &[f64], interval_s: f64) -> Vec<f64> {
    phase_of(rates.len(), |row| rates[row], interval_s)
}

fn phase_of(count: usize, rate: impl Fn(usize) -> f64, interval_s: f64) -> Vec<f64> {
    let mean = (0..count).map(&rate).sum::<f64>() / count as f64;
    let mut sum = 0.0;
    let sums = (0..count).map(|row| {
        sum += rate(row) - mean;
        sum * interval_s
    });
    core::iter::once(0.0).chain(sums).collect()
}

/// The overlapping Allan variance of a phase for the averaging factor m; NaN without two neighbouring averages.
#[must_use]
pub(crate) fn variance(phase: &[f64], m: usize, interval_s: f64) -> f64 {
    variance_of(phase, m, interval_s, |_, x| x)
}

/// The same of a phase that is computed from one that is kept, by index and value.
pub(super) fn variance_of(phase: &[f64], m: usize, interval_s: f64, value: impl Fn(usize, f64) -> f64) -> f64 {
    checkpoint();
    let tau = m as f64 * interval_s;
    let (first, middle) = (phase.get(m..).unwrap_or_default(), phase.get(2 * m..).unwrap_or_default());
    let terms = phase.iter().zip(first).zip(middle).enumerate();
    let (squares, count) = terms.fold((0.0, 0_usize), |(squares, count), (k, ((a, b), c))| {
        let difference = value(k + 2 * m, *c) - 2.0 * value(k + m, *b) + value(k, *a);
        (squares + difference * difference, count + 1)
    });
    squares / (2.0 * count as f64 * tau * tau)
}

/// The averaging factors of n rates: thirds of octaves from 1 to n/3, rounded, each once.
#[must_use]
pub(crate) fn factors(n: usize) -> Vec<usize> {
    let thirds = (0..).map(|third| libm::pow(2_f64, f64::from(third) / 3.0).round() as usize);
    let mut factors: Vec<_> = thirds.take_while(|m| *m <= n / 3).collect();
    factors.dedup();
    factors
}
