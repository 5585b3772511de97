//! Conditions that invalidate F and the standard errors: residuals that are not independent, a difference between
//! heating and cooling, outliers.

use crate::regression::Regression;
use crate::tails::f_tail;
use core::cmp::Ordering;
use serde::Serialize;

/// A warning is given if the probability of the statistic by chance is below this.
const SIGNIFICANCE: f64 = 0.01;
/// Fewest points of a leg, and of all legs of one direction, for the comparison of heating and cooling.
const MIN_LEG: usize = 4;
/// A reversal of x by less than this part of its range is noise.
const MIN_TURN: f64 = 0.1;
/// A variance inflation factor over this leaves under 1 % of a column's scatter to its coefficient.
const INFLATED: f64 = 1e4;
/// A residual over this many robust standard deviations is an outlier.
const OUTLIER: f64 = 6.0;

/// The diagnostics of a fit's residuals.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Diagnostics {
    /// Lag-1 correlation of the residuals in the order of the data.
    pub lag1: Option<Test>,
    /// Runs of equal sign along x, as a normal deviate; negative for too few runs.
    pub runs: Option<Test>,
    /// Mean residual while x rises minus mean residual while it falls, in the unit of y.
    pub heating_cooling: Option<Test>,
    /// Indices of points whose residuals are outliers.
    pub outliers: Vec<usize>,
    /// A message for each significant statistic.
    #[serde(skip)]
    pub warnings: Vec<String>,
}

/// A test: a statistic and its probability by chance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Test {
    /// The statistic.
    pub value: f64,
    /// Probability of a statistic at least as extreme by chance.
    pub p: f64,
}

impl Diagnostics {
    /// The diagnostics of the fit of `order`; empty for a perfect fit.
    #[must_use]
    pub fn of(regression: &Regression, order: usize) -> Self {
        if regression.fits()[order].sse == 0.0 {
            return Self::default();
        }
        let residuals = regression.residuals(order);
        let scaled = |(residual, weight): (&f64, f64)| residual * weight.sqrt();
        let weights = regression.points().iter().map(|point| point.weight.value());
        let scaled: Vec<f64> = residuals.iter().zip(weights).map(scaled).collect();
        let x: Vec<f64> = regression.points().iter().map(|point| point.x.value()).collect();
        let (lag1, runs) = (lag1(&scaled), runs(&x, &scaled, order));
        let heating_cooling = heating_cooling(&x, &residuals);
        let outliers = outliers(&scaled);
        let mut warnings = Vec::new();
        if let Some(test) = lag1.filter(|test| test.p < SIGNIFICANCE && test.value > 0.0) {
            warnings.push(format!(
                "neighbouring residuals are correlated (lag-1 correlation {:.2}, p {:.1e}): F and the standard errors are \
                 too favourable; fit means over whole dwells instead of single samples",
                test.value, test.p
            ));
        }
        if let Some(test) = runs.filter(|test| test.p < SIGNIFICANCE && test.value < 0.0) {
            warnings.push(format!(
                "the residuals keep their sign along x (runs test: deviate {:.1}, p {:.1e}): the order is too low, or the \
                 points share errors; F and the standard errors are too favourable",
                test.value, test.p
            ));
        }
        if let Some(test) = heating_cooling.filter(|test| test.p < SIGNIFICANCE) {
            warnings.push(format!(
                "heating and cooling differ by {:.3e} (mean residual while x rises less that while it falls, p {:.1e}): \
                 hysteresis or thermal lag, which no polynomial of x removes and F does not see; soak longer, or give \
                 each direction the same weight",
                test.value, test.p
            ));
        }
        for term in regression.fits()[order].linear.iter().filter(|term| term.variance_inflation > INFLATED) {
            warnings.push(format!(
                "{} follows from the other columns except for {:.2} % of its scatter (variance inflation factor {:.1e}): its \
                 coefficient rests on this rest; look whether the rest is more than rounding",
                term.column,
                100.0 / term.variance_inflation.sqrt(),
                term.variance_inflation
            ));
        }
        Self { lag1, runs, heating_cooling, outliers, warnings }
    }
}

/// Two-sided probability of a normal deviate.
fn normal_p(z: f64) -> f64 {
    libm::erfc(z.abs() / core::f64::consts::SQRT_2)
}

fn lag1(residuals: &[f64]) -> Option<Test> {
    let n = residuals.len();
    let total: f64 = residuals.iter().map(|r| r * r).sum();
    if n < 8 || total == 0.0 {
        return None;
    }
    let value = residuals.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / total;
    Some(Test { value, p: normal_p(value * (n as f64).sqrt()) })
}

/// Wald and Wolfowitz: the number of runs of equal sign along x.
///
/// The residuals of a fitted polynomial of order m change their sign at least m + 1 times, so only too few runs are
/// significant.
fn runs(x: &[f64], residuals: &[f64], order: usize) -> Option<Test> {
    let mut along: Vec<_> = (0..x.len()).filter(|&i| residuals[i] != 0.0).collect();
    along.sort_by(|&a, &b| x[a].partial_cmp(&x[b]).unwrap_or(Ordering::Equal));
    let positive = along.iter().filter(|&&i| residuals[i] > 0.0).count() as f64;
    let n = along.len() as f64;
    let negative = n - positive;
    if along.len() < 8 + order || positive < 2.0 || negative < 2.0 {
        return None;
    }
    let runs = 1.0 + along.windows(2).filter(|w| (residuals[w[0]] > 0.0) != (residuals[w[1]] > 0.0)).count() as f64;
    let mean = 1.0 + 2.0 * positive * negative / n;
    let variance = (mean - 1.0) * (mean - 2.0) / (n - 1.0);
    let value = (runs - mean) / variance.sqrt();
    Some(Test { value, p: normal_p(value) })
}

/// Splits the data, in their order, into legs where x reverses by at least [`MIN_TURN`] of its range; `true` for a
/// rising leg.
fn legs(x: &[f64]) -> Vec<(bool, core::ops::Range<usize>)> {
    let (low, high) = x.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)));
    let turn = MIN_TURN * (high - low);
    let (mut legs, mut start, mut extreme, mut rising) = (Vec::new(), 0, 0, None);
    for i in 1..x.len() {
        match rising {
            None if (x[i] - x[start]).abs() >= turn => (rising, extreme) = (Some(x[i] > x[start]), i),
            Some(up) if (x[i] - x[extreme]) * if up { 1.0 } else { -1.0 } >= 0.0 => extreme = i,
            Some(up) if (x[i] - x[extreme]).abs() >= turn => {
                legs.push((up, start..extreme + 1));
                (start, extreme, rising) = (extreme + 1, i, Some(!up));
            }
            _ => {}
        }
    }
    if let Some(up) = rising {
        legs.push((up, start..x.len()));
    }
    legs
}

/// Mean residual on rising legs minus mean residual on falling legs. `None` without both, or if such legs have under 80
/// % of the points.
fn heating_cooling(x: &[f64], residuals: &[f64]) -> Option<Test> {
    let legs: Vec<_> = legs(x).into_iter().filter(|(_, leg)| leg.len() >= MIN_LEG).collect();
    let count: usize = legs.iter().map(|(_, leg)| leg.len()).sum();
    if 5 * count < 4 * x.len() {
        return None;
    }
    let of = |direction: bool| -> Vec<f64> {
        let legs = legs.iter().filter(|(up, _)| *up == direction);
        legs.flat_map(|(_, leg)| residuals[leg.clone()].iter().copied()).collect()
    };
    let (up, down) = (of(true), of(false));
    if up.len() < MIN_LEG || down.len() < MIN_LEG {
        return None;
    }
    let (up_mean, up_variance) = mean_variance(&up);
    let (down_mean, down_variance) = mean_variance(&down);
    let variance = up_variance / up.len() as f64 + down_variance / down.len() as f64;
    let value = up_mean - down_mean;
    let freedom = (up.len() + down.len() - 2) as f64;
    Some(Test { value, p: f_tail(value * value / variance, 1.0, freedom) })
}

fn mean_variance(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0))
}

/// The greatest common divisor of two numbers; the other one if one is 0.
#[must_use]
pub const fn greatest_divisor(mut a: u64, mut b: u64) -> u64 {
    while b > 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// Median of the values that are not NaN; NaN if there are none.
///
/// ```
/// use isotherm_statistics::median;
///
/// assert_eq!(median([3.0, 1.0, f64::NAN, 2.0]), 2.0);
/// assert_eq!(median([1.0, 2.0]), 1.5);
/// assert!(median([]).is_nan());
/// ```
#[must_use]
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().filter(|v| !v.is_nan()).collect();
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => values[n / 2],
        n => 0.5 * (values[n / 2 - 1] + values[n / 2]),
    }
}

/// Estimate of a standard deviation from the median of the absolute values. A few outliers change it little.
///
/// ```
/// use isotherm_statistics::robust_sd;
///
/// let quiet = [0.7, -0.7, 0.6, -0.6, 0.7, -0.7];
/// let mut disturbed = quiet;
/// disturbed[5] = 1000.0;
/// assert!((robust_sd(&quiet) / robust_sd(&disturbed) - 1.0).abs() < 1e-12);
/// ```
#[must_use]
pub fn robust_sd(values: &[f64]) -> f64 {
    1.4826 * median(values.iter().map(|v| v.abs()))
}

fn outliers(residuals: &[f64]) -> Vec<usize> {
    let sd = robust_sd(residuals);
    if residuals.len() < 8 || sd == 0.0 {
        return Vec::new();
    }
    (0..residuals.len()).filter(|&i| residuals[i].abs() > OUTLIER * sd).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::regression::DataPoint;

    fn regression(points: impl Iterator<Item = (f64, f64)>, order: usize) -> Regression {
        Regression::new(points.map(|(x, y)| DataPoint::new(x, y)).collect(), order).unwrap()
    }

    /// Pseudo-random numbers, -0.5 to 0.5.
    fn noise(i: u32) -> f64 {
        let mut z = u64::from(i + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    }

    #[test]
    fn independent_residuals_raise_no_warning() {
        let fit = regression((0..60).map(|i| (f64::from(i), 3.0 + noise(i))), 2);
        assert_eq!(Diagnostics::of(&fit, 1).warnings, Vec::<String>::new());
        assert_eq!(Diagnostics::of(&fit, 1).outliers, Vec::<usize>::new());
    }

    #[test]
    fn a_slow_wave_is_correlated() {
        let fit = regression((0..60).map(|i| (f64::from(i), libm::sin(f64::from(i) / 4.0) + 0.1 * noise(i))), 2);
        let found = Diagnostics::of(&fit, 1);
        assert!(found.lag1.unwrap().value > 0.8 && found.runs.unwrap().value < -2.6);
        assert_eq!(found.warnings.len(), 2, "{:?}", found.warnings);
    }

    #[test]
    fn heating_and_cooling_are_compared() {
        // x rises from 0 to 29, then falls back; while it falls, y is lower by `size`.
        let x = |i: u32| if i < 30 { f64::from(i) } else { f64::from(59 - i) };
        let gap = |size: f64| {
            let fit = regression((0..60).map(|i| (x(i), noise(i) - if i < 30 { 0.0 } else { size })), 2);
            Diagnostics::of(&fit, 1)
        };
        assert!((gap(1.0).heating_cooling.unwrap().value - 1.0).abs() < 0.2);
        assert!(gap(1.0).warnings.iter().any(|warning| warning.starts_with("heating and cooling")));
        assert!(!gap(0.0).warnings.iter().any(|warning| warning.starts_with("heating and cooling")));
        // With one direction only, or without order, there is nothing to compare.
        let fit = regression((0..60).map(|i| (f64::from(i), noise(i))), 2);
        assert_eq!(Diagnostics::of(&fit, 1).heating_cooling, None);
        let fit = regression((0..60).map(|i| (f64::from(i * 37 % 61), noise(i))), 2);
        assert_eq!(Diagnostics::of(&fit, 1).heating_cooling, None);
    }

    #[test]
    fn an_outlier_is_named() {
        let y = |i: u32| noise(i) + if i == 17 { 9.0 } else { 0.0 };
        let fit = regression((0..60).map(|i| (f64::from(i), y(i))), 2);
        assert_eq!(Diagnostics::of(&fit, 1).outliers, [17]);
    }
}
