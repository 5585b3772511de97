//! The difference of two curves, with its band.

use super::requirement::Compliance;
use super::table::FormCurve;
use core::ops::Deref;
use isotherm_shared::table::difference::{CurveDifference, unit_factor};
use isotherm_shared::units::SensorKind;
use isotherm_statistics::{f_limit, largest, median};

/// Probability that any curve counts as changed where none has. It is shared among all curves.
const FALSE_ALARM: f64 = 0.05;

/// The band around the difference of two curves.
#[derive(Clone, Debug, PartialEq)]
pub struct Band {
    /// Standard error of the difference at each point, in its unit.
    pub standard_errors: Vec<f64>,
    /// Welch's degrees of freedom; the median over the points.
    pub freedom: f64,
    /// Half the width of the band over the standard error: sqrt(k F(k, freedom; 1 - 0.05/n)) with k coefficients, n the
    /// number of curves: 9, or 18 with gyroscopes. So the bands hold the whole differences of all true curves, at all
    /// temperatures at once, with 95 % (Scheffe).
    pub factor: f64,
}

/// The difference of one curve in two tables, new less old, with its band.
#[derive(Clone, Debug, PartialEq)]
pub struct CurveComparison {
    /// The difference itself.
    pub plain: CurveDifference,
    /// The band, if both tables have the errors of the curve.
    pub band: Option<Band>,
}

/// All that the difference has, this has.
impl Deref for CurveComparison {
    type Target = CurveDifference;
    fn deref(&self) -> &CurveDifference {
        &self.plain
    }
}

/// The common range of curves; `None` if there is none.
pub(crate) fn common_range<'a>(curves: impl IntoIterator<Item = &'a FormCurve>) -> Option<[f64; 2]> {
    let ends = |[low, high]: [f64; 2], curve: &FormCurve| {
        let [from, to] = curve.range();
        [low.max(from), high.min(to)]
    };
    let range = curves.into_iter().fold([f64::NEG_INFINITY, f64::INFINITY], ends);
    (range[0] < range[1]).then_some(range)
}

/// Welch's degrees of freedom of the sum of two variances, each with its own.
pub(super) fn welch(variances: [f64; 2], freedoms: [f64; 2]) -> f64 {
    let [a, b] = variances;
    (a + b).powi(2) / (a * a / freedoms[0] + b * b / freedoms[1])
}

impl CurveComparison {
    /// Compares a quantity of a sensor over the range that both curves have. It is one of `count` curves.
    pub(super) fn of(
        (kind, axis, quantity): (SensorKind, usize, usize),
        [old, new]: [&FormCurve; 2],
        range: [f64; 2],
        count: usize,
    ) -> Self {
        let plain = CurveDifference::of((kind, axis, quantity), [&old.curve, &new.curve], range);
        let temperature = &plain.temperature;
        let factors: Vec<f64> = temperature.iter().map(|u| unit_factor(kind, quantity, old.at(*u))).collect();
        let variances: Option<Vec<[f64; 2]>> =
            temperature.iter().map(|u| Some([old.variance(*u)?, new.variance(*u)?])).collect();
        let band = variances.zip(old.freedom().zip(new.freedom())).map(|(variances, (a, b))| {
            let freedom = median(variances.iter().map(|pair| welch(*pair, [a, b])));
            let k = old.coefficients().max(new.coefficients()) as f64;
            let error = |([a, b], factor): (&[f64; 2], &f64)| (a + b).sqrt() * factor.abs();
            Band {
                standard_errors: variances.iter().zip(&factors).map(error).collect(),
                freedom,
                factor: (k * f_limit(FALSE_ALARM / count as f64, k, freedom)).sqrt(),
            }
        });
        Self { plain, band }
    }

    /// Mean of the difference over the points.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.differences.iter().sum::<f64>() / self.differences.len() as f64
    }

    /// Half the width of the band at each point.
    pub fn half_widths(&self) -> Option<impl Iterator<Item = f64> + Clone> {
        self.band.as_ref().map(|band| band.standard_errors.iter().map(|error| error * band.factor))
    }

    /// Standard error of the difference; the median over the points.
    #[must_use]
    pub fn standard_error(&self) -> Option<f64> {
        self.band.as_ref().map(|band| median(band.standard_errors.iter().copied()))
    }

    /// The most that the difference can be anywhere, by its band.
    #[must_use]
    pub fn upper(&self) -> Option<f64> {
        let halves = self.half_widths()?;
        Some(largest(self.differences.iter().zip(halves).map(|(d, half)| d.abs() + half)))
    }

    /// What the difference is somewhere at least, by its band; 0 if it may be 0 everywhere.
    #[must_use]
    pub fn lower(&self) -> Option<f64> {
        let halves = self.half_widths()?;
        Some(largest(self.differences.iter().zip(halves).map(|(d, half)| d.abs() - half)))
    }

    /// Largest ratio of difference to standard error.
    #[must_use]
    pub fn worst_ratio(&self) -> Option<f64> {
        let band = self.band.as_ref()?;
        Some(largest(self.differences.iter().zip(&band.standard_errors).map(|(d, error)| d.abs() / error)))
    }

    /// Whether the difference is outside of its band anywhere; `None` without errors.
    #[must_use]
    pub fn is_changed(&self) -> Option<bool> {
        Some(self.worst_ratio()? > self.band.as_ref()?.factor)
    }

    /// Whether the difference is within a bound, in its unit. Without errors the values decide.
    #[must_use]
    pub fn verdict(&self, bound: f64) -> Compliance {
        let (largest, _) = self.largest();
        Compliance::of(self.lower().unwrap_or(largest), self.upper().unwrap_or(largest), bound)
    }
}
