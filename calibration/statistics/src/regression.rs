//! Polynomial regression of one quantity on another: equations (3) to (16) of the source paper, to full precision.
//!
//! # Definition
//! y = a0 + a1 x + ... + am x^m over n points with weights w, the inverse variances up to a common factor (1 unless
//! given). A point of weight 2 has half the variance; it is one point still, and n is the number of points. A common
//! factor changes neither coefficients, F, p nor standard errors; Q, U and the residual standard deviation are those of
//! a point of weight 1. With means and sums weighted by w, and S_yy = sum w (y - mean y)^2:
//!
//! ```text
//! Q = sum w (y - fit)^2        residual sum of squares          U = S_yy - Q    regression sum of squares  (9), (10)
//! F = (U/m) / (Q/(n-m-1))      (11), (13)                       R^2 = U/S_yy                                     (12)
//! R = sqrt(m F / (n-m-1 + m F)) = sqrt(R^2)                                                                      (14)
//! ```
//! The partial sum of squares of term j is Q(without the term) - Q, with a new fit without the term (15), (16). Its F
//! has 1 and n-m-1 degrees of freedom. For every term but the highest, it depends on the centring of x. Both are
//! therefore given: for the raw powers x^j, and for the powers of the centred (x - center)/scale. The errata of the
//! printed equations are in docs/paper.md.
//!
//! Other columns z1 ... zq may enter linearly in addition to the polynomial:
//! `y = a0 + a1 x + ... + am x^m + b1 z1 + ... + bq zq`. Then m is still the order of the polynomial, and the degrees
//! of freedom of the regression are m + q in the place of m.
//!
//! # Algorithm
//! The equations are only the definition: solving the normal equations (7) would lose half the digits. x is centred and
//! scaled to -1..1, as is each z. Givens rotations reduce `[1 z1 ... zq x x^2 .. x^M | y]` row by row to its upper
//! triangle R. This one factorisation serves every order up to M. The factorisation and the expansion to powers of the
//! raw x use double-double arithmetic, on data read as decimals. No refinement is needed: of 32 digits, the worst data
//! sets lose about 15.

use crate::double_double::DoubleDouble;
use crate::tails::f_tail;
use core::cmp::Ordering;
use linear::{CentredColumn, check_rank, resolution};
use nalgebra::{DMatrix, DVector};
use points::center_and_scale;
use serde::Serialize;
use terms::Terms;

mod linear;
mod points;
mod terms;

pub use linear::LinearColumn;
pub(crate) use linear::LinearTerm;
pub use points::{DataPoint, MAX_ORDER, RegressionError};
pub use terms::TermTest;

/// The fit of one order. A figure that does not exist, such as F of a perfect fit, is `None`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fit {
    /// m.
    pub order: usize,
    /// Coefficients of the powers of the raw x, ascending.
    pub coefficients: Vec<f64>,
    /// Standard errors of the coefficients; none without degrees of freedom.
    pub standard_errors: Option<Vec<f64>>,
    /// Residual standard deviation sqrt(Q/(n-m-1)).
    pub residual_sd: Option<f64>,
    /// Q.
    pub sse: f64,
    /// U.
    pub ss_regression: f64,
    /// S_yy.
    pub ss_total: f64,
    /// Q/(n-m-1).
    pub ms_residual: Option<f64>,
    /// n-m-1.
    pub df_residual: usize,
    /// R^2; none if y is constant.
    pub r_squared: Option<f64>,
    /// 1 - R^2 = Q/S_yy, without the cancellation for R^2 close to 1.
    pub one_minus_r_squared: Option<f64>,
    /// R^2 adjusted for the degrees of freedom.
    pub adj_r_squared: Option<f64>,
    /// Multiple correlation coefficient R.
    pub r: Option<f64>,
    /// F of the whole regression, with m and n-m-1 degrees of freedom.
    pub f: Option<f64>,
    /// Probability of a larger F if no term had an effect.
    pub f_p: Option<f64>,
    /// Tests of the terms 1 to m as powers of the raw x.
    pub partial: Vec<TermTest>,
    /// Tests of the terms 1 to m as powers of the centred and scaled x.
    pub partial_centred: Vec<TermTest>,
    /// The terms of the linear columns.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub linear: Vec<LinearTerm>,
    /// Sequential sum of squares: Q of order m-1, minus Q.
    pub sequential_ss: f64,
    /// Largest difference from the curve of order m-1 at a point, in the unit of y.
    pub effect: f64,
    /// Rms of the leave-one-out errors: the error at each point of a fit without that point. None if a point cannot be
    /// left out.
    pub leave_one_out_rms: Option<f64>,
    /// Largest leave-one-out error.
    pub leave_one_out_max: Option<f64>,
}

/// The regressions of all orders from 0 to a given maximum.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_statistics::{DataPoint, Regression};
///
/// let points = [1.0, 2.0, 3.0, 4.0].map(|x| DataPoint::new(x, 7.0 - 2.0 * x));
/// let regression = Regression::new(points.to_vec(), 1)?;
/// let line = &regression.fits()[1];
/// assert!((line.coefficients[0] - 7.0).abs() < 1e-14 && (line.coefficients[1] + 2.0).abs() < 1e-14);
/// assert_eq!((line.sse, line.f), (0.0, None)); // a perfect fit has no F
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct Regression {
    points: Vec<DataPoint>,
    center: DoubleDouble,
    scale: DoubleDouble,
    linear: Vec<CentredColumn>,
    /// Inverse of the triangle R, row by row.
    inverse: Vec<Vec<DoubleDouble>>,
    /// Q'y.
    rotated: Vec<DoubleDouble>,
    fits: Vec<Fit>,
}

impl Regression {
    /// Fits every order from 0 to `max_order`.
    ///
    /// # Errors
    /// If `max_order` is over [`MAX_ORDER`] or not below the number of distinct x, or if the numbers leave the range of
    /// doubles.
    pub fn new(points: Vec<DataPoint>, max_order: usize) -> Result<Self, RegressionError> {
        Self::with_linear(points, "x", Vec::new(), max_order)
    }

    /// Fits every order from 0 to `max_order`, each in addition to the columns `linear`. `x` is the name of x, for
    /// messages.
    ///
    /// A rate that depends on the temperature \[V\] and on the supply voltage \[V\]:
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_statistics::{DataPoint, DoubleDouble, LinearColumn, Regression};
    ///
    /// let [temperature, supply] = [[1.0, 1.5, 2.0, 2.5, 3.0, 3.5], [14.9, 15.1, 15.0, 15.2, 14.8, 15.0]];
    /// let points = temperature.iter().zip(supply).map(|(&x, z)| DataPoint::new(x, 100.0 + 2.0 * x * x - 3.0 * z));
    /// let column = LinearColumn { name: "supply".to_owned(), values: supply.map(DoubleDouble::from).to_vec() };
    /// let regression = Regression::with_linear(points.collect(), "temperature", vec![column], 2)?;
    /// assert!((regression.fits()[2].linear[0].coefficient + 3.0).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As of [`new`](Self::new); or if a linear column has another length than the points, if there are fewer points
    /// than coefficients, or if columns are linearly dependent.
    pub fn with_linear(
        points: Vec<DataPoint>,
        x: &str,
        linear: Vec<LinearColumn>,
        max_order: usize,
    ) -> Result<Self, RegressionError> {
        if max_order > MAX_ORDER {
            return Err(RegressionError::OrderTooHigh(max_order));
        }
        let distinct = distinct(&points);
        if distinct <= max_order {
            return Err(RegressionError::TooFewPoints { order: max_order, distinct });
        }
        if let Some(LinearColumn { name, values }) = linear.iter().find(|column| column.values.len() != points.len()) {
            return Err(RegressionError::Length { column: name.clone(), values: values.len(), points: points.len() });
        }
        let count = max_order + linear.len() + 1;
        if points.len() < count {
            let (linear, points) = (linear.len(), points.len());
            return Err(RegressionError::TooFewRows { order: max_order, linear, points });
        }
        let (center, scale) = center_and_scale(points.iter().map(|point| point.x));
        let linear = linear.into_iter().map(|column| CentredColumn::new(column, &points)).collect();
        let mut regression =
            Self { points, center, scale, linear, inverse: Vec::new(), rotated: Vec::new(), fits: Vec::new() };
        let mut triangle = vec![vec![DoubleDouble::ZERO; count + 1]; count + 1];
        for (index, point) in regression.points.iter().enumerate() {
            let weight = point.weight.sqrt();
            let mut row = regression.row(point.x, regression.linear_values(index), max_order);
            row.push(point.y);
            rotate_in(&mut triangle, row.into_iter().map(|value| value * weight).collect());
        }
        let resolution = resolution(regression.points.iter().map(|point| point.x.value())) / scale.value();
        check_rank(&regression.linear, x, resolution, &triangle, max_order)?;
        regression.rotated = triangle.iter().map(|row| row[count]).collect();
        regression.inverse = invert(&triangle, count);
        regression.fits = regression.all_fits(max_order);
        let finite = |fit: &Fit| {
            let partial = fit.partial.iter().chain(&fit.partial_centred);
            let linear = fit.linear.iter().flat_map(|term| [term.coefficient, term.sum_of_squares]);
            let partial = partial.map(|partial| partial.sum_of_squares);
            let mut figures = fit.coefficients.iter().copied().chain(partial).chain(linear);
            fit.sse.is_finite() && figures.all(f64::is_finite)
        };
        if regression.fits.iter().all(finite) { Ok(regression) } else { Err(RegressionError::OutOfRange) }
    }

    /// Number of points, n.
    #[must_use]
    pub fn n(&self) -> usize {
        self.points.len()
    }

    /// The fits of order 0, 1, 2 and so on.
    #[must_use]
    pub fn fits(&self) -> &[Fit] {
        &self.fits
    }

    /// The points.
    #[must_use]
    pub fn points(&self) -> &[DataPoint] {
        &self.points
    }

    /// The names of the linear columns.
    pub fn linear(&self) -> impl Iterator<Item = &str> {
        self.linear.iter().map(|column| column.name.as_str())
    }

    /// The centre: it is subtracted from x in the centred basis.
    #[must_use]
    pub fn center(&self) -> f64 {
        self.center.value()
    }

    /// The scale: the centred x is divided by it.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.scale.value()
    }

    /// Index of the coefficient of x^`power` among all coefficients, in the order of the columns of R.
    fn term(&self, power: usize) -> usize {
        if power == 0 { 0 } else { self.linear.len() + power }
    }

    /// Number of coefficients of the fit of `order`.
    fn count(&self, order: usize) -> usize {
        self.linear.len() + order + 1
    }

    /// y - fit of `order` at every point.
    #[must_use]
    pub fn residuals(&self, order: usize) -> Vec<f64> {
        let residual = |(index, point): (usize, &DataPoint)| {
            let basis = self.basis(point.x, self.linear_values(index));
            let fitted: DoubleDouble =
                basis.iter().zip(&self.rotated).take(self.count(order)).map(|(&q, &z)| q * z).sum();
            (point.y - fitted).value()
        };
        self.points.iter().enumerate().map(residual).collect()
    }

    /// Value of the fit of `order` at `x` and its standard error (none without degrees of freedom), with every linear
    /// column in the middle of its range.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_statistics::{DataPoint, Regression};
    ///
    /// let points = [(1.0, 2.1), (2.0, 3.9), (3.0, 6.1), (4.0, 7.9)].map(|(x, y)| DataPoint::new(x, y));
    /// let (value, standard_error) = Regression::new(points.to_vec(), 1)?.at(1, 2.5);
    /// assert!((value - 5.0).abs() < 1e-12 && standard_error.is_some());
    /// # Ok(())
    /// # }
    /// ```
    #[must_use]
    pub fn at(&self, order: usize, x: f64) -> (f64, Option<f64>) {
        let basis = self.basis(x.into(), self.linear.iter().map(|_| DoubleDouble::ZERO));
        let value: DoubleDouble = basis.iter().zip(&self.rotated).take(self.count(order)).map(|(&q, &z)| q * z).sum();
        let size: DoubleDouble = basis.iter().take(self.count(order)).map(|&q| q * q).sum();
        let sd = self.fits.get(order).and_then(|fit| fit.residual_sd);
        (value.value(), sd.map(|sd| sd * size.sqrt().value()))
    }

    /// Coefficients of order `order` for the powers of the centred and scaled x, and their covariance; not those of
    /// linear columns.
    #[must_use]
    pub fn centred(&self, order: usize) -> (DVector<f64>, Option<DMatrix<f64>>) {
        let (count, term) = (order + 1, |power| self.term(power));
        let sum =
            |terms: &dyn Fn(usize) -> DoubleDouble| (0..self.count(order)).map(terms).sum::<DoubleDouble>().value();
        let coefficients = DVector::from_fn(count, |i, _| sum(&|k| self.inverse[term(i)][k] * self.rotated[k]));
        let entry = |i: usize, j: usize| sum(&|k| self.inverse[term(i)][k] * self.inverse[term(j)][k]);
        let covariance = self.fits[order].ms_residual.map(|ms| DMatrix::from_fn(count, count, |i, j| ms * entry(i, j)));
        (coefficients, covariance)
    }

    /// The centred and scaled values of the linear columns at a point.
    fn linear_values(&self, index: usize) -> impl Iterator<Item = DoubleDouble> {
        self.linear.iter().map(move |column| column.values[index])
    }

    /// The row (1, z1, ..., x, x^2, ...) of centred and scaled values, up to the power `max_order`.
    fn row(&self, x: DoubleDouble, linear: impl Iterator<Item = DoubleDouble>, max_order: usize) -> Vec<DoubleDouble> {
        let mut row = powers((x - self.center) / self.scale, max_order);
        row.splice(1..1, linear);
        row
    }

    /// The orthonormal functions in the order of the columns of R: R^-T (1, z1, ..., x, x^2, ...).
    fn basis(&self, x: DoubleDouble, linear: impl Iterator<Item = DoubleDouble>) -> Vec<DoubleDouble> {
        let count = self.inverse.len();
        let row = self.row(x, linear, count - 1 - self.linear.len());
        (0..count).map(|j| (0..=j).map(|i| self.inverse[i][j] * row[i]).sum()).collect()
    }

    fn all_fits(&self, max_order: usize) -> Vec<Fit> {
        let count = self.count(max_order);
        // Coefficients of the raw powers = expansion * centred coefficients; centred coefficients = R^-1 Q'y.
        let expansion = self.expansion(max_order);
        let product = |matrix: &[Vec<DoubleDouble>]| -> Vec<Vec<DoubleDouble>> {
            let entry = |i: usize, j: usize| (0..count).map(|k| matrix[i][k] * self.inverse[k][j]).sum();
            (0..count).map(|i| (0..count).map(|j| entry(i, j)).collect()).collect()
        };
        let raw = product(&expansion);
        let squares: Vec<_> = self.rotated.iter().map(|&z| z * z).collect();
        let sse = |order: usize| squares[self.count(order)..].iter().copied().sum::<DoubleDouble>();
        let rounding = self.rounding();
        let scans = self.point_scans(max_order);
        (0..=max_order)
            .map(|order| {
                let exact = sse(order) <= rounding;
                let residual = if exact { DoubleDouble::ZERO } else { sse(order) };
                let previous = if order == 0 { residual } else { sse(order - 1) };
                self.fit(order, residual, previous, &raw, &scans[order])
            })
            .collect()
    }

    /// The matrix that transforms the coefficients of centred and scaled columns into those of the raw ones.
    fn expansion(&self, max_order: usize) -> Vec<Vec<DoubleDouble>> {
        let count = self.count(max_order);
        let mut matrix = vec![vec![DoubleDouble::ZERO; count]; count];
        for (i, row) in expansion(self.center, self.scale, max_order + 1).into_iter().enumerate() {
            for (j, value) in row.into_iter().enumerate() {
                matrix[self.term(i)][self.term(j)] = value;
            }
        }
        for (column, k) in self.linear.iter().zip(1..) {
            matrix[k][k] = DoubleDouble::ONE / column.scale;
            matrix[0][k] = -column.center / column.scale;
        }
        matrix
    }

    /// Largest residual sum of squares that the rounding of y can explain; a fit at or below it is perfect. If every y
    /// is a double, or the shortest decimal form of one, y was rounded to doubles. Otherwise, it has the precision of a
    /// double-double.
    fn rounding(&self) -> DoubleDouble {
        let is_double = |point: &DataPoint| DoubleDouble::parse(&format!("{:e}", point.y.value())) == Some(point.y);
        let doubles = self.points.iter().all(|point| point.y == point.y.value().into() || is_double(point));
        let unit = DoubleDouble::from(if doubles { f64::EPSILON } else { f64::EPSILON * f64::EPSILON });
        let largest = self.points.iter().map(|p| (p.y * p.y * p.weight).value()).fold(0.0, f64::max);
        unit * unit * DoubleDouble::from(largest) * DoubleDouble::from(self.n() as f64)
    }

    fn fit(
        &self,
        order: usize,
        sse: DoubleDouble,
        previous: DoubleDouble,
        raw: &[Vec<DoubleDouble>],
        scan: &PointScan,
    ) -> Fit {
        let (count, n) = (self.count(order), self.n());
        let df = n - count;
        let total: DoubleDouble = self.rotated[1..].iter().map(|&z| z * z).sum();
        let explained = total - sse;
        let mean_square = (df > 0).then(|| sse / DoubleDouble::from(df as f64));
        let tested = mean_square.filter(|ms| *ms > DoubleDouble::ZERO);
        let terms = |matrix| Terms { matrix, rotated: &self.rotated, count, mean_square: tested, df_residual: df };
        let (raw, centred) = (terms(raw), terms(&self.inverse));
        let partial = |terms: &Terms<'_>| (1..=order).map(|power| terms.partial(power, self.term(power))).collect();
        let linear = |(column, term): (&CentredColumn, usize)| {
            raw.linear(term, &column.name, mean_square, centred.inflation(term, column.sum_of_squares))
        };
        let ratio = (total > DoubleDouble::ZERO).then(|| sse / total);
        let r_squared = ratio.map(|ratio| DoubleDouble::ONE - ratio);
        let free = (count - 1) as f64;
        let f = tested.filter(|_| count > 1).map(|ms| (explained / DoubleDouble::from(free) / ms).value());
        Fit {
            order,
            coefficients: (0..=order).map(|power| raw.coefficient(self.term(power)).value()).collect(),
            standard_errors: (0..=order).map(|power| raw.standard_error(self.term(power), mean_square)).collect(),
            residual_sd: mean_square.map(|ms| ms.sqrt().value()),
            sse: sse.value(),
            ss_regression: explained.value(),
            ss_total: total.value(),
            ms_residual: mean_square.map(DoubleDouble::value),
            df_residual: df,
            r_squared: r_squared.map(DoubleDouble::value),
            one_minus_r_squared: ratio.map(DoubleDouble::value),
            adj_r_squared: ratio.filter(|_| df > 0).map(|ratio| {
                let scaled = ratio * DoubleDouble::from((n - 1) as f64) / DoubleDouble::from(df as f64);
                (DoubleDouble::ONE - scaled).value()
            }),
            r: r_squared.map(|r_squared| r_squared.sqrt().value()),
            f,
            f_p: f.map(|f| f_tail(f, free, df as f64)),
            partial: partial(&raw),
            partial_centred: partial(&centred),
            linear: self.linear.iter().zip(1..).map(linear).collect(),
            sequential_ss: (previous - sse).value(),
            effect: scan.effect,
            leave_one_out_rms: scan.press.map(|press| (press / n as f64).sqrt()),
            leave_one_out_max: scan.press.map(|_| scan.worst),
        }
    }

    /// The figures of each order that need a pass over all points.
    fn point_scans(&self, max_order: usize) -> Vec<PointScan> {
        let mut scans = vec![PointScan { effect: 0.0, press: Some(0.0), worst: 0.0 }; max_order + 1];
        for (index, point) in self.points.iter().enumerate() {
            let (mut rest, mut leverage) = (point.y, DoubleDouble::ZERO);
            let basis = self.basis(point.x, self.linear_values(index));
            let mut next = 0;
            for (order, scan) in scans.iter_mut().enumerate() {
                for (&q, &z) in basis.iter().zip(&self.rotated).take(self.count(order)).skip(next) {
                    rest -= q * z;
                    leverage += q * q * point.weight;
                    scan.effect = scan.effect.max((q * z).value().abs());
                }
                next = self.count(order);
                let free = (DoubleDouble::ONE - leverage).value();
                let error = rest.value() / free;
                scan.press = scan.press.filter(|_| free > 1e-12).map(|press| press + error * error);
                scan.worst = scan.worst.max(error.abs());
            }
        }
        scans[0].effect = 0.0;
        scans
    }
}

/// See [`Fit::effect`] and the leave-one-out figures.
#[derive(Clone, Debug)]
struct PointScan {
    effect: f64,
    /// Sum of the squared leave-one-out errors.
    press: Option<f64>,
    /// Largest leave-one-out error.
    worst: f64,
}

fn distinct(points: &[DataPoint]) -> usize {
    let mut x: Vec<_> = points.iter().map(|point| point.x).collect();
    x.sort_by(|a, b| a.partial_cmp(b).unwrap_or(Ordering::Equal));
    x.dedup();
    x.len()
}

fn powers(x: DoubleDouble, order: usize) -> Vec<DoubleDouble> {
    core::iter::successors(Some(DoubleDouble::ONE), |&power| Some(power * x)).take(order + 1).collect()
}

/// Adds one row to the triangle by Givens rotations.
fn rotate_in(triangle: &mut [Vec<DoubleDouble>], mut row: Vec<DoubleDouble>) {
    for (j, pivot) in triangle.iter_mut().enumerate() {
        if row[j] == DoubleDouble::ZERO {
            continue;
        }
        let length = (pivot[j] * pivot[j] + row[j] * row[j]).sqrt();
        let (cosine, sine) = (pivot[j] / length, row[j] / length);
        for (above, below) in pivot.iter_mut().zip(row.iter_mut()).skip(j) {
            (*above, *below) = (cosine * *above + sine * *below, cosine * *below - sine * *above);
        }
    }
}

/// Inverse of the leading block of an upper triangle.
fn invert(triangle: &[Vec<DoubleDouble>], count: usize) -> Vec<Vec<DoubleDouble>> {
    let mut inverse = vec![vec![DoubleDouble::ZERO; count]; count];
    for j in 0..count {
        inverse[j][j] = DoubleDouble::ONE / triangle[j][j];
        for i in (0..j).rev() {
            let sum: DoubleDouble = (i + 1..=j).map(|k| triangle[i][k] * inverse[k][j]).sum();
            inverse[i][j] = -sum / triangle[i][i];
        }
    }
    inverse
}

/// The matrix that transforms the coefficients of ((x - center)/scale)^k into those of x^j: C(k,j) (-center)^(k-j) /
/// scale^k.
#[must_use]
pub(crate) fn expansion(center: DoubleDouble, scale: DoubleDouble, count: usize) -> Vec<Vec<DoubleDouble>> {
    let mut matrix = vec![vec![DoubleDouble::ZERO; count]; count];
    // Column k holds ((x - center)/scale)^k, the previous column times (x - center)/scale.
    let (slope, offset) = (DoubleDouble::ONE / scale, -center / scale);
    let mut power = vec![DoubleDouble::ZERO; count];
    power[0] = DoubleDouble::ONE;
    for k in 0..count {
        for (row, &c) in matrix.iter_mut().zip(&power) {
            row[k] = c;
        }
        power = (0..count)
            .map(|j| offset * power[j] + if j > 0 { slope * power[j - 1] } else { DoubleDouble::ZERO })
            .collect();
    }
    matrix
}
