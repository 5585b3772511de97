//! A fitted polynomial of temperature, with the covariance of its coefficients.

use crate::curve_band;
use crate::double_double::DoubleDouble;
use crate::largest::root;
use crate::regression::{Regression, expansion};
use crate::stored;
use crate::student::student_quantile_of;
use isotherm_shared::polynomial::Polynomial;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Largest acceptable rounding error of a table's polynomial, relative to its largest value.
const MAX_ROUNDING: f64 = 1e-11;
/// The rounding error is checked at the ends of this many equal steps over the range.
const CHECK_POINTS: u32 = 64;

/// A polynomial of (U - center)/scale with the covariance of its coefficients.
///
/// A curve is fitted, judged where it is used, and becomes a polynomial of a table:
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_statistics::{CONFIDENCE, Curve, DataPoint, Regression};
///
/// let points = [(1.0, 4.9), (2.0, 7.1), (3.0, 9.0), (4.0, 11.1), (5.0, 12.9)].map(|(x, y)| DataPoint::new(x, y));
/// let curve = Curve::of(&Regression::new(points.to_vec(), 1)?, 1, [1.0, 5.0]);
/// assert!((curve.slope(3.0) - 2.0).abs() < 1e-12); // per volt of temperature
/// assert!(curve.interval(3.0, CONFIDENCE) < curve.interval(5.0, CONFIDENCE)); // best in the middle
/// assert!(curve.interval(3.0, CONFIDENCE) < curve.band(3.0, CONFIDENCE)); // the whole curve at once
/// // Fitted in ug0, written in g0.
/// let polynomial = curve.polynomial(1e-6).ok_or("the order is too high for a table")?;
/// assert!((polynomial.at(3.0) - 9e-6).abs() < 1e-17);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Curve {
    center: f64,
    scale: f64,
    #[serde(with = "stored::vector")]
    coefficients: DVector<f64>,
    #[serde(with = "stored::square")]
    covariance: Option<DMatrix<f64>>,
    freedom: f64,
    range: [f64; 2],
    measured: [f64; 2],
    slope: Option<SlopeError>,
    resolution: f64,
}

/// What a slope that a curve lacks adds to its interval: `per_unit` times the distance from `about`.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct SlopeError {
    /// Half width of the 95 % interval per unit of temperature, in the value's unit.
    pub per_unit: f64,
    /// Temperature at which it adds nothing.
    pub about: f64,
}

impl Curve {
    /// A curve from coefficients of the centred and scaled temperature, ascending. Without degrees of freedom, the
    /// covariance is dropped.
    #[must_use]
    pub fn new(
        [center, scale]: [f64; 2],
        coefficients: DVector<f64>,
        covariance: Option<DMatrix<f64>>,
        freedom: f64,
        range: [f64; 2],
    ) -> Self {
        let covariance = covariance.filter(|_| freedom > 0.0);
        Self { center, scale, coefficients, covariance, freedom, range, measured: range, slope: None, resolution: 0.0 }
    }

    /// The curve with what is known of its error: the temperature that was measured, out of which no interval is known,
    /// and what a slope that it lacks adds.
    #[must_use]
    pub fn known(self, measured: [f64; 2], slope: Option<SlopeError>) -> Self {
        Self { measured, slope, ..self }
    }

    /// The curve of temperature that is read in steps of `resolution`, 0 if it has none: the error of such a reading
    /// goes into the interval.
    #[must_use]
    pub fn read_in_steps(self, resolution: f64) -> Self {
        Self { resolution, ..self }
    }

    /// The curve of the fit of `order`.
    #[must_use]
    pub fn of(regression: &Regression, order: usize, range: [f64; 2]) -> Self {
        let (coefficients, covariance) = regression.centred(order);
        let freedom = regression.fits()[order].df_residual as f64;
        Self::new([regression.center(), regression.scale()], coefficients, covariance, freedom, range)
    }

    /// The curve whose errors are not known.
    #[must_use]
    pub fn without_errors(self) -> Self {
        Self { covariance: None, ..self }
    }

    /// Order of the polynomial.
    #[must_use]
    pub fn order(&self) -> usize {
        self.coefficients.len() - 1
    }

    /// Lowest and highest temperature of the curve.
    #[must_use]
    pub const fn range(&self) -> [f64; 2] {
        self.range
    }

    /// Lowest and highest temperature of the data: in it the interval is known. It is the range, unless a wider one was
    /// stated.
    #[must_use]
    pub const fn measured(&self) -> [f64; 2] {
        self.measured
    }

    /// What a slope that the curve lacks adds to its interval.
    #[must_use]
    pub const fn slope_error(&self) -> Option<SlopeError> {
        self.slope
    }

    /// Degrees of freedom of the covariance.
    #[must_use]
    pub const fn freedom(&self) -> f64 {
        self.freedom
    }

    /// Centre and scale of the temperature.
    #[must_use]
    pub const fn basis(&self) -> [f64; 2] {
        [self.center, self.scale]
    }

    /// Coefficients of the powers of the centred and scaled temperature, ascending.
    #[must_use]
    pub const fn coefficients(&self) -> &DVector<f64> {
        &self.coefficients
    }

    /// Powers of the centred and scaled temperature, ascending.
    #[must_use]
    pub fn powers(&self, temperature: f64) -> DVector<f64> {
        let x = self.scaled(temperature);
        DVector::from_fn(self.coefficients.len(), |k, _| x.powi(k as i32))
    }

    fn scaled(&self, temperature: f64) -> f64 {
        (temperature - self.center) / self.scale
    }

    /// The value at `temperature`.
    #[must_use]
    pub fn at(&self, temperature: f64) -> f64 {
        self.powers(temperature).dot(&self.coefficients)
    }

    /// Slope at `temperature`, in the value's unit per unit of temperature.
    #[must_use]
    pub fn slope(&self, temperature: f64) -> f64 {
        let powers = self.powers(temperature);
        let terms = (1..self.coefficients.len()).map(|k| k as f64 * self.coefficients[k] * powers[k - 1]);
        terms.sum::<f64>() / self.scale
    }

    /// Standard error of the value at `temperature`.
    #[must_use]
    pub fn standard_error(&self, temperature: f64) -> Option<f64> {
        let powers = self.powers(temperature);
        self.covariance.as_ref().map(|covariance| root(powers.dot(&(covariance * &powers))))
    }

    /// Half width of the confidence interval of the value at only `temperature`, at `confidence`, 0 to 1; a slope that
    /// the curve lacks adds its 95 %. A reading in steps has a standard error of a step over sqrt(12), that the curve's
    /// slope makes one of the value. `None` without errors, and where nothing was measured.
    #[must_use]
    pub fn interval(&self, temperature: f64, confidence: f64) -> Option<f64> {
        self.half_width(temperature, self.point_quantile(confidence)?)
    }

    /// Half width at `temperature` of the band that holds for the whole curve: with probability `confidence` the truth
    /// is within it at all of the measured temperature at once. [`interval`](Self::interval) is what holds at a
    /// temperature that was chosen before. `None` as there.
    #[must_use]
    pub fn band(&self, temperature: f64, confidence: f64) -> Option<f64> {
        self.half_width(temperature, self.band_quantile(confidence)?)
    }

    /// How many standard errors an interval at one temperature is wide to either side; `None` without errors.
    #[must_use]
    pub fn point_quantile(&self, confidence: f64) -> Option<f64> {
        self.covariance.as_ref().map(|_| student_quantile_of(confidence, self.freedom))
    }

    /// The same of the band that holds for the whole curve.
    #[must_use]
    pub fn band_quantile(&self, confidence: f64) -> Option<f64> {
        let length = curve_band::length(self.covariance.as_ref()?, self.measured.map(|u| self.scaled(u)));
        Some(curve_band::quantile(length, self.coefficients.len(), self.freedom, confidence))
    }

    /// Half width at `temperature` of so many standard errors; `None` as [`interval`](Self::interval).
    #[must_use]
    pub fn half_width(&self, temperature: f64, quantile: f64) -> Option<f64> {
        let [low, high] = self.measured;
        // A point that was computed from the ends may lie beyond by rounding.
        let rounding = 1e-9 * (high - low).max(high.abs());
        let known = (low - rounding..=high + rounding).contains(&temperature);
        let slope = self.slope.map_or(0.0, |slope| slope.per_unit * (temperature - slope.about).abs());
        let error = self.standard_error(temperature).filter(|_| known)?;
        let of_reading = self.slope(temperature) * self.resolution / 12.0_f64.sqrt();
        Some(libm::hypot(error, of_reading) * quantile + slope)
    }

    /// Coefficients of the powers of the raw temperature, ascending; expanded in double-double, then rounded once.
    #[must_use]
    pub fn raw(&self) -> Vec<f64> {
        let count = self.coefficients.len();
        let matrix = expansion(self.center.into(), self.scale.into(), count);
        let raw = |row: &Vec<DoubleDouble>| {
            let terms = row.iter().zip(&self.coefficients).map(|(&factor, &c)| factor * DoubleDouble::from(c));
            terms.sum::<DoubleDouble>().value()
        };
        matrix.iter().map(raw).collect()
    }

    /// Covariance of the coefficients of the powers of the raw temperature.
    #[must_use]
    pub fn raw_covariance(&self) -> Option<DMatrix<f64>> {
        let count = self.coefficients.len();
        let matrix = expansion(self.center.into(), self.scale.into(), count);
        let matrix = DMatrix::from_fn(count, count, |i, j| matrix[i][j].value());
        self.covariance.as_ref().map(|covariance| &matrix * covariance * matrix.transpose())
    }

    /// The polynomial for a table, multiplied by `factor`. It has powers of the raw temperature, or of the centred and
    /// scaled temperature if cancellation between the raw powers would lose digits. `None` if the order is too high for
    /// a table.
    #[must_use]
    pub fn polynomial(&self, factor: f64) -> Option<Polynomial> {
        let scaled = |coefficients: &[f64]| coefficients.iter().map(|c| c * factor).collect::<Vec<_>>();
        if self.is_raw() {
            Polynomial::new(&scaled(&self.raw()), 0.0, 1.0, self.range)
        } else {
            Polynomial::new(&scaled(self.coefficients.as_slice()), self.center, self.scale, self.range)
        }
    }

    /// Whether the powers of the raw temperature are accurate enough for the table.
    #[must_use]
    pub fn is_raw(&self) -> bool {
        let Some(raw) = Polynomial::new(&self.raw(), 0.0, 1.0, self.range) else { return false };
        let [low, high] = self.range;
        let points = (0..=CHECK_POINTS).map(|i| low + (high - low) * f64::from(i) / f64::from(CHECK_POINTS));
        let (mut size, mut error) = (0.0_f64, 0.0_f64);
        for point in points {
            size = size.max(self.at(point).abs());
            error = error.max((raw.at(point) - self.at(point)).abs());
        }
        error <= MAX_ROUNDING * size
    }

    /// Covariance of the coefficients that [`polynomial`](Self::polynomial) gives, for a factor of 1.
    #[must_use]
    pub fn table_covariance(&self) -> Option<DMatrix<f64>> {
        if self.is_raw() { self.raw_covariance() } else { self.covariance.clone() }
    }
}

/// Confidence of every interval that is printed or judged.
pub const CONFIDENCE: f64 = 0.95;
/// A normal deviate is within so many standard deviations with that [`CONFIDENCE`].
pub const NORMAL_QUANTILE: f64 = 1.959_963_984_540_054;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::regression::DataPoint;

    #[test]
    fn tables_keep_their_digits_far_from_zero() {
        let points = (0..15).map(|i| 8e6 + 4e3 * f64::from(i)).map(|x| DataPoint::new(x, 9e4 + libm::sin(x / 7e3)));
        let regression = Regression::new(points.collect(), 7).unwrap();
        let curve = Curve::of(&regression, 7, [8e6, 8.056e6]);
        let table = curve.polynomial(1.0).unwrap();
        assert_ne!(table.center(), 0.0);
        for x in [8e6, 8.0123e6, 8.056e6] {
            assert!((table.at(x) - curve.at(x)).abs() < 1e-9, "{}", table.at(x) - curve.at(x));
        }
        assert_eq!(curve.table_covariance().unwrap().nrows(), 8);
    }

    #[test]
    fn raw_coefficients_and_errors_are_those_of_the_regression() {
        let points =
            (0..9).map(|i| f64::from(i) / 3.0 + 1.1).map(|x| DataPoint::new(x, 3.0 - x + 0.1 * libm::sin(9.0 * x)));
        let regression = Regression::new(points.collect(), 3).unwrap();
        let curve = Curve::of(&regression, 3, [1.1, 3.8]);
        let fit = &regression.fits()[3];
        for (a, b) in curve.raw().iter().zip(&fit.coefficients) {
            assert!((a - b).abs() < 1e-14 * b.abs(), "{a} {b}");
        }
        let covariance = curve.raw_covariance().unwrap();
        for (k, error) in fit.standard_errors.as_ref().unwrap().iter().enumerate() {
            assert!((covariance[(k, k)].sqrt() / error - 1.0).abs() < 1e-9);
        }
        let (value, error) = regression.at(3, 2.0);
        assert!((curve.at(2.0) - value).abs() < 1e-14);
        assert!((curve.standard_error(2.0).unwrap() / error.unwrap() - 1.0).abs() < 1e-12);
        assert!((curve.slope(2.0) - (curve.at(2.001) - curve.at(1.999)) / 0.002).abs() < 1e-5);
        assert!((curve.polynomial(1e6).unwrap().at(2.0) / (1e6 * value) - 1.0).abs() < 1e-13);
    }
}
