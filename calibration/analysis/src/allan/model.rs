//! The fit of Q, N, B and K to an Allan variance.
//!
//! # Method
//! The model is linear in the squares of the coefficients, which are not negative. Generalised least squares over
//! octaves of tau, with the exact [covariance](super::moments) of the estimates under the model itself: it is computed
//! anew with every fit until the squares stay. Points with fewer than 5 degrees of freedom are left out. Each of the 15
//! sets of coefficients is fitted; of those without a negative square the one with the least chi-square is the fit.

use super::moments::{Moments, autocovariance};
use isotherm_statistics::{NORMAL_QUANTILE, root};
use nalgebra::{DMatrix, DVector, Matrix4, Vector4};

/// The letters of the coefficients, in their order.
pub const COEFFICIENTS: [&str; 4] = ["Q", "N", "B", "K"];
/// Fewest degrees of freedom of a point that is fitted.
const MIN_FREEDOM: f64 = 5.0;
/// Above this chi-square a degree of freedom the model does not hold.
const MAX_CHI_SQUARE: f64 = 2.0;
/// Most blocks that weights are taken together in.
const BLOCKS: usize = 512;
/// Most iterations, and those after which the points that are fitted stay the same.
const ITERATIONS: usize = 50;
const SETTLED: usize = 10;

/// A coefficient of the model, in its own unit: that of the rate times s (Q), times the root of s (N), as it is (B),
/// over the root of s (K).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficient {
    /// The estimate; 0 if its square would be negative.
    pub value: f64,
    /// Ends of its 95 % range; `None` if the model does not hold.
    pub range: Option<[f64; 2]>,
}

impl Coefficient {
    /// Whether the range excludes 0.
    #[must_use]
    pub fn is_significant(&self) -> bool {
        self.range.is_some_and(|[low, _]| low > 0.0)
    }

    /// The upper end of the range of a coefficient that is not significant.
    #[must_use]
    pub fn below(&self) -> Option<f64> {
        self.range.filter(|_| !self.is_significant()).map(|[_, high]| high)
    }
}

/// The fitted model.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelFit {
    /// Q, N, B, K.
    pub coefficients: [Coefficient; 4],
    /// Weighted sum of the squared residuals.
    pub chi_square: f64,
    /// Points less coefficients that are not 0.
    pub freedom: usize,
    /// Averaging times of the points that were fitted: the first and the last \[s\].
    pub fitted_s: [f64; 2],
    /// Squares of the coefficients for Ts = 1.
    squares: Vector4<f64>,
}

/// AVAR of the model over the squares of its coefficients, for Ts = 1.
fn terms(m: usize) -> Vector4<f64> {
    let m = m as f64;
    Vector4::new(3.0 / (m * m), 1.0 / m, FLICKER_FLOOR * FLICKER_FLOOR, m / 3.0)
}

impl ModelFit {
    /// Fits Allan variances by averaging factor, of `rows` rates that are `interval_s` apart. `None` if a variance is
    /// 0, as that of counts that alternate, or if fewer than four points have enough degrees of freedom.
    #[must_use]
    pub fn of(variances: &[(usize, f64)], rows: usize, interval_s: f64) -> Option<Self> {
        let moments: Vec<Vec<_>> = (0..variances.len())
            .map(|i| (0..=i).map(|j| Moments::of([variances[i].0, variances[j].0], rows)).collect())
            .collect();
        // The first weights are those of independent estimates with rows/m degrees of freedom.
        let mut used: Vec<usize> = (0..variances.len()).collect();
        let start = |i: usize, j: usize| {
            let (m, variance) = variances[i];
            if i == j { variance * variance * 2.0 * m as f64 / rows as f64 } else { 0.0 }
        };
        let mut fit = WeightedFit::of(variances, &used, start)?;
        for iteration in 0..ITERATIONS {
            let squares = fit.squares;
            let covariance = |i: usize, j: usize| moments[i.max(j)][i.min(j)].covariance(&squares);
            if iteration < SETTLED {
                let freedom = |i: usize| 2.0 * terms(variances[i].0).dot(&squares).powi(2) / covariance(i, i);
                used = (0..variances.len()).filter(|i| freedom(*i) >= MIN_FREEDOM).collect();
            }
            fit = WeightedFit::of(variances, &used, covariance)?;
            let settled = (0..4).all(|k| (fit.squares[k] - squares[k]).abs() <= 1e-6 * fit.errors[k]);
            if settled && iteration >= SETTLED {
                break;
            }
        }
        let freedom = used.len().saturating_sub(fit.squares.iter().filter(|square| **square > 0.0).count());
        let holds = fit.chi_square <= MAX_CHI_SQUARE * freedom as f64;
        // The standard error of a square if it were `square`.
        let error = |k: usize, square: f64| {
            let mut squares = fit.squares;
            squares[k] = square;
            let covariance = |i: usize, j: usize| moments[i.max(j)][i.min(j)].covariance(&squares);
            WeightedFit::of(variances, &used, covariance).map_or(f64::INFINITY, |fit| fit.errors[k])
        };
        let units = [interval_s, interval_s.sqrt(), 1.0, 1.0 / interval_s.sqrt()];
        let coefficients = [0, 1, 2, 3].map(|k| {
            let root = |square: f64| square.max(0.0).sqrt() * units[k];
            let range = || range(fit.squares[k], fit.errors[k], |square| error(k, square)).map(root);
            Coefficient { value: root(fit.squares[k]), range: holds.then(range) }
        });
        let time = |index: &usize| variances[*index].0 as f64 * interval_s;
        let fitted_s = [time(used.first()?), time(used.last()?)];
        Some(Self { coefficients, chi_square: fit.chi_square, freedom, fitted_s, squares: fit.squares })
    }

    /// Whether the model holds: chi-square is at most 2 a degree of freedom. Ranges are only given then.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.chi_square <= MAX_CHI_SQUARE * self.freedom as f64
    }

    /// The Allan deviation of the model at tau \[s\], and that of each single coefficient.
    #[must_use]
    pub fn deviation(&self, tau_s: f64) -> (f64, [f64; 4]) {
        let [q, n, b, k] = self.coefficients.map(|coefficient| coefficient.value);
        let parts = [3_f64.sqrt() * q / tau_s, n / tau_s.sqrt(), FLICKER_FLOOR * b, k * (tau_s / 3.0).sqrt()];
        (parts.iter().map(|part| part * part).sum::<f64>().sqrt(), parts)
    }

    /// The standard error of the sum of the rates times `weights`, whose sum is 0, under the model. Weights are taken
    /// together in blocks, in which they should change little.
    pub(super) fn standard_error(&self, count: usize, weight: impl Fn(usize) -> f64) -> f64 {
        let length = count.div_ceil(BLOCKS);
        let block = |first: usize| (first..count.min(first + length)).map(&weight).sum();
        let blocks: Vec<f64> = (0..count).step_by(length.max(1)).map(block).collect();
        let covariances: Vec<_> = (0..blocks.len()).map(|distance| self.of_means(length, distance)).collect();
        let rows = blocks
            .iter()
            .enumerate()
            .map(|(i, a)| a * blocks.iter().enumerate().map(|(j, b)| b * covariances[i.abs_diff(j)]).sum::<f64>());
        root(rows.sum::<f64>())
    }

    /// Generalised covariance of two means of `length` rates, this many lengths apart. A mean is a first difference of
    /// the phase, over its length. Only sums with weights whose sum is 0 are defined.
    pub(super) fn of_means(&self, length: usize, distance: usize) -> f64 {
        let step = length as f64;
        let t = distance as f64 * step;
        let parts = [t, t + step, t - step].map(autocovariance);
        (2.0 * parts[0] - parts[1] - parts[2]).dot(&self.squares) / (step * step)
    }

    /// Degrees of freedom of the estimate for the factor m with these moments.
    pub(super) fn freedom(&self, m: usize, moments: &Moments) -> f64 {
        2.0 * terms(m).dot(&self.squares).powi(2) / moments.covariance(&self.squares)
    }
}

/// The 95 % range of a square: the estimate less 1.96 times its standard error `first`, and the square that is over the
/// estimate by 1.96 times the standard error that it has itself. Standard errors rise with the square, so a range by
/// that of the estimate is too short above.
fn range(estimate: f64, first: f64, error: impl Fn(f64) -> f64) -> [f64; 2] {
    let mut high = estimate + NORMAL_QUANTILE * first;
    for _ in 0..ITERATIONS {
        let next = estimate + NORMAL_QUANTILE * error(high);
        let settled = (next - high).abs() <= 1e-3 * (next - estimate);
        high = next;
        if settled {
            break;
        }
    }
    [estimate - NORMAL_QUANTILE * first, high]
}

/// A fit with given weights.
struct WeightedFit {
    squares: Vector4<f64>,
    /// Standard errors of the squares.
    errors: Vector4<f64>,
    chi_square: f64,
}

impl WeightedFit {
    /// Fits the `used` variances with this covariance; `None` if it is not positive, or if there are too few variances.
    fn of(variances: &[(usize, f64)], used: &[usize], covariance: impl Fn(usize, usize) -> f64) -> Option<Self> {
        let count = used.len();
        if count < 4 {
            return None;
        }
        let covariance = DMatrix::from_fn(count, count, |i, j| covariance(used[i], used[j]));
        let factor = covariance.cholesky()?.l();
        let columns = DMatrix::from_fn(count, 4, |i, k| terms(variances[used[i]].0)[k]);
        let columns = factor.solve_lower_triangular(&columns)?;
        let values = factor.solve_lower_triangular(&DVector::from_fn(count, |i, _| variances[used[i]].1))?;
        let scales = Vector4::from_fn(|k, _| columns.column(k).norm());
        let scaled = DMatrix::from_fn(count, 4, |i, k| columns[(i, k)] / scales[k]);
        let inverse = Matrix4::from_fn(|i, j| scaled.column(i).dot(&scaled.column(j))).try_inverse()?;
        let errors = Vector4::from_fn(|k, _| root(inverse[(k, k)]) / scales[k]);
        let subsets = (1_u8..16).filter_map(|set| {
            let members: Vec<_> = (0..4).filter(|k| set & (1 << k) != 0).collect();
            let part = scaled.select_columns(&members);
            let found = part.clone().qr();
            let solution = found.r().solve_upper_triangular(&(found.q().transpose() * &values))?;
            let mut squares = Vector4::zeros();
            members.iter().zip(solution.iter()).for_each(|(k, value)| squares[*k] = value / scales[*k]);
            let chi_square = (&values - part * solution).norm_squared();
            squares.iter().all(|square| *square >= 0.0).then_some((squares, chi_square))
        });
        let (squares, chi_square) = subsets.min_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(Self { squares, errors, chi_square })
    }
}

/// ADEV of flicker noise over its coefficient B: sqrt(2 ln 2/pi).
pub const FLICKER_FLOOR: f64 = 0.664_282_470_268_448_3;
