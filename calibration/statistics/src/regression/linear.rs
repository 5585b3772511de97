//! Columns that enter a regression linearly, and the test for columns that say the same.

use super::points::{DataPoint, RegressionError, center_and_scale};
use crate::double_double::DoubleDouble;
use serde::Serialize;

/// A range of fewer devices of the last digit than this is that of exact numbers, such as 0 and 1, and not of rounded
/// ones.
const COARSE: f64 = 100.0;

/// A column that enters linearly, in addition to the polynomial of x.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearColumn {
    /// Its name.
    pub name: String,
    /// Its value at each point, in the order of the points.
    pub values: Vec<DoubleDouble>,
}

/// The term of a linear column in a fit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LinearTerm {
    /// Name of the column.
    pub column: String,
    /// Its coefficient, in the unit of y divided by that of the column.
    pub coefficient: f64,
    /// Standard error of the coefficient; none without degrees of freedom.
    pub standard_error: Option<f64>,
    /// Partial sum of squares: Q(without the term) - Q, eq. (16).
    pub sum_of_squares: f64,
    /// F with 1 and n-m-q-1 degrees of freedom; none for a perfect fit.
    pub f: Option<f64>,
    /// Probability of a larger F if the term had no effect.
    pub p: Option<f64>,
    /// Variance inflation factor: 1/(1 - R^2) of the regression of this column on all others. 1 for a column that has
    /// nothing in common with the others.
    pub variance_inflation: f64,
}

/// A linear column, centred and scaled to -1..1.
#[derive(Clone, Debug)]
pub(super) struct CentredColumn {
    pub name: String,
    pub center: DoubleDouble,
    pub scale: DoubleDouble,
    pub values: Vec<DoubleDouble>,
    /// Weighted sum of squares of `values` about their mean.
    pub sum_of_squares: DoubleDouble,
    /// See [`resolution`], in units of `scale`.
    resolution: f64,
}

impl CentredColumn {
    pub(super) fn new(column: LinearColumn, points: &[DataPoint]) -> Self {
        let LinearColumn { name, mut values } = column;
        let (center, scale) = center_and_scale(values.iter().copied());
        let resolution = resolution(values.iter().map(|value| value.value())) / scale.value();
        values.iter_mut().for_each(|value| *value = (*value - center) / scale);
        let weighted = |of: &dyn Fn(DoubleDouble) -> DoubleDouble| -> DoubleDouble {
            values.iter().zip(points).map(|(value, point)| point.weight * of(*value)).sum()
        };
        let mean = weighted(&|value| value) / weighted(&|_| DoubleDouble::ONE);
        let sum_of_squares = weighted(&|value| (value - mean) * (value - mean));
        Self { name, center, scale, values, sum_of_squares, resolution }
    }
}

/// The unit of the last decimal digit in which all values are written, but at least the spacing of doubles. Values with
/// a range of few such units are taken to be exact.
pub(super) fn resolution(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let size = values.clone().fold(0.0, |size: f64, value| size.max(value.abs()));
    let (low, high) = (values.clone().fold(f64::INFINITY, f64::min), values.clone().fold(f64::NEG_INFINITY, f64::max));
    let spacing = f64::EPSILON * size;
    let is_multiple = |unit: f64| {
        values
            .clone()
            .map(|value| value / unit)
            .all(|count| (count - count.round()).abs() <= 4.0 * f64::EPSILON * count.abs())
    };
    let first = if size > 0.0 { libm::log10(size).floor() as i32 } else { 0 };
    let units = (0..17).map(|digit| 10_f64.powi(first - digit));
    let unit = units.clone().find(|unit| is_multiple(*unit)).unwrap_or(0.0);
    if unit * COARSE > high - low { spacing } else { unit.max(spacing) }
}

/// Refuses columns of `linear` that are constant, or that follow from other columns to within their last digits.
///
/// R has the columns in the order 1, z1 ... zq, x, x^2, ... Without pivoting its diagonal element j, divided by R_00 =
/// sqrt(sum w), is the rms of what remains of column j after its regression on the columns before it. The coefficients
/// of this regression show which columns it follows from; `resolution_of_x` is that of the centred and scaled x. Powers
/// of x that follow only from lower powers are not refused here, as without linear columns.
pub(super) fn check_rank(
    linear: &[CentredColumn],
    x: &str,
    resolution_of_x: f64,
    triangle: &[Vec<DoubleDouble>],
    max_order: usize,
) -> Result<(), RegressionError> {
    if linear.is_empty() {
        return Ok(());
    }
    // The derivative of the k-th power of a value within -1..1 is at most k.
    let resolutions = core::iter::once(0.0).chain(linear.iter().map(|column| column.resolution));
    let resolutions: Vec<_> = resolutions.chain((1..=max_order).map(|power| power as f64 * resolution_of_x)).collect();
    let root = triangle[0][0].value();
    for column in 1..resolutions.len() {
        let others = solve(triangle, column);
        let noise = |k: usize| others[k] * resolutions[k];
        let tolerance = (1..column).map(noise).chain([resolutions[column]]).map(|n| n * n).sum::<f64>().sqrt();
        let follows = triangle[column][column].value().abs() / root <= tolerance;
        if !follows {
            continue;
        }
        let scatter = |k: usize| (1..=k).map(|i| triangle[i][k].value().powi(2)).sum::<f64>().sqrt() / root;
        let involved = (1..column).filter(|&k| others[k].abs() * scatter(k) > 3.0 * tolerance).chain([column]);
        let involved: Vec<_> = involved.collect();
        let power = involved.iter().filter_map(|k| k.checked_sub(linear.len())).max().unwrap_or(0);
        match involved.as_slice() {
            _ if involved.iter().all(|&k| k > linear.len()) => {}
            &[only] => return Err(RegressionError::Constant(linear[only - 1].name.clone())),
            several => {
                // Lower powers depend on the centring.
                let listed = several.iter().filter(|&&k| k <= linear.len() || k == column);
                let name = |&k: &usize| match k.checked_sub(linear.len()) {
                    None | Some(0) => linear[k - 1].name.clone(),
                    Some(1) => x.to_owned(),
                    Some(power) => format!("{x}^{power}"),
                };
                return Err(RegressionError::Dependent { columns: listed.map(name).collect(), power });
            }
        }
    }
    Ok(())
}

/// The coefficients of the regression of a column of R on those before it.
fn solve(triangle: &[Vec<DoubleDouble>], column: usize) -> Vec<f64> {
    let mut solution = vec![DoubleDouble::ZERO; column];
    for i in (0..column).rev() {
        let sum: DoubleDouble = (i + 1..column).map(|k| triangle[i][k] * solution[k]).sum();
        solution[i] = (triangle[i][column] - sum) / triangle[i][i];
    }
    solution.into_iter().map(DoubleDouble::value).collect()
}
