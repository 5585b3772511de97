//! A quantity over the dates of several tables.

use super::table::FormCurve;
use isotherm_shared::table::difference::{unit, unit_factor};
use isotherm_shared::units::SensorKind;
use isotherm_statistics::{QUANTITIES, f_tail};

/// A Julian year \[s\].
pub const YEAR_S: f64 = 365.25 * 86_400.0;

/// A straight line through a quantity at mid range, over the dates of the tables.
#[derive(Clone, Debug, PartialEq)]
pub struct Trend {
    /// A1 to G3.
    pub sensor: &'static str,
    /// `bias`, `positive_scale_factor` or `negative_scale_factor`.
    pub quantity: &'static str,
    /// Unit of the values; the slope is per year.
    pub unit: &'static str,
    /// Temperature of the values: the middle of the range that all tables have.
    pub temperature: f64,
    /// Time of each table since the first one \[years of 365.25 days\].
    pub years: Vec<f64>,
    /// Value of each table less that of the first one.
    pub values: Vec<f64>,
    /// Standard errors of the values, if all tables have them. Then each value weighs by its error; otherwise all weigh
    /// the same.
    pub standard_errors: Option<Vec<f64>>,
    /// Value of the line at the first table.
    pub intercept: f64,
    /// Slope a year.
    pub slope: f64,
    /// Its standard error: that which the values' errors give, or that of the scatter about the line if it is larger.
    pub slope_error: f64,
    /// Sum of the squared residuals over their standard errors, if these are known.
    pub chi2: Option<f64>,
    /// Degrees of freedom: tables less 2.
    pub freedom: usize,
    /// Two-sided probability of a slope as large as this where there is none, by Student's t; `None` if the error is 0.
    pub p: Option<f64>,
}

impl Trend {
    /// The line through a quantity of a sensor. `years` has at least three values, not all the same.
    pub(super) fn of(
        (kind, axis, quantity): (SensorKind, usize, usize),
        curves: &[&FormCurve],
        temperature: f64,
        years: &[f64],
    ) -> Self {
        let first = curves.first().map_or(f64::NAN, |curve| curve.at(temperature));
        let factor = unit_factor(kind, quantity, first);
        let values: Vec<f64> = curves.iter().map(|curve| (curve.at(temperature) - first) * factor).collect();
        let error = |curve: &&FormCurve| Some(curve.variance(temperature)?.sqrt() * factor.abs());
        let standard_errors: Option<Vec<f64>> = curves.iter().map(error).collect();
        let weights: Vec<f64> = match &standard_errors {
            Some(errors) => errors.iter().map(|error| 1.0 / (error * error)).collect(),
            None => vec![1.0; values.len()],
        };
        let total: f64 = weights.iter().sum();
        let mean = |values: &[f64]| values.iter().zip(&weights).map(|(v, w)| v * w).sum::<f64>() / total;
        let (x, y) = (mean(years), mean(&values));
        let rows = || years.iter().zip(&values).zip(&weights).map(|((t, v), w)| (t - x, v - y, *w));
        let sxx: f64 = rows().map(|(t, _, w)| w * t * t).sum();
        let slope = rows().map(|(t, v, w)| w * t * v).sum::<f64>() / sxx;
        let scatter: f64 = rows().map(|(t, v, w)| w * (v - slope * t).powi(2)).sum();
        let freedom = values.len().saturating_sub(2);
        let excess = scatter / freedom as f64;
        let variance = if standard_errors.is_some() { excess.max(1.0) } else { excess } / sxx;
        let f = slope * slope / variance;
        Self {
            sensor: kind.names()[axis],
            quantity: QUANTITIES[quantity],
            unit: unit(kind, quantity),
            temperature,
            years: years.to_vec(),
            values,
            chi2: standard_errors.is_some().then_some(scatter),
            standard_errors,
            intercept: y - slope * x,
            slope,
            slope_error: variance.sqrt(),
            freedom,
            // t squared is F with 1 and n degrees of freedom.
            p: (variance > 0.0).then(|| f_tail(f, 1.0, freedom as f64)),
        }
    }

    /// Sensor and quantity, as `A1 bias`.
    #[must_use]
    pub fn name(&self) -> String {
        format!("{} {}", self.sensor, self.quantity)
    }
}
