//! Checks of the parts of a table. `Some` says what is wrong, and what to write instead.

use crate::polynomial::{Polynomial, Violation};
use crate::units::{BiasUnit, SensorKind};
use nalgebra::Matrix3;

/// Accepted range of the value of 1 g0 \[m/s2\].
pub const GRAVITY_RANGE: [f64; 2] = [9.7, 9.9];

/// Accepted range of the nominal interval \[s\]: from the resolution of a sample's interval to the longest one.
pub const NOMINAL_INTERVAL_RANGE: [f64; 2] = [1e-9, 3600.0];

/// Accepted range of the time constant of the lagged temperature \[s\].
pub const LAG_RANGE: [f64; 2] = [0.1, 86_400.0];

/// Largest absolute value of a g-sensitivity \[deg/h/g0\].
pub const MAX_G_SENSITIVITY: f64 = 3600.0;

/// A transient term without a time constant.
pub(super) const NO_LAG: &str = "needs the time constant of the lagged temperature; give [lag] with time_constant_s";

pub(super) fn gravity_fault(gravity: f64) -> Option<String> {
    let [low, high] = GRAVITY_RANGE;
    (!(low..=high).contains(&gravity)).then(|| format!("is {gravity:?}, give the value of 1 g0, {low} to {high} m/s2"))
}

pub(super) fn nominal_interval_fault(interval: f64) -> Option<String> {
    let [low, high] = NOMINAL_INTERVAL_RANGE;
    (!(low..=high).contains(&interval))
        .then(|| format!("is {interval:?}, give the control period of the scale factors, {low:e} to {high} s"))
}

pub(super) fn max_age_fault(age: f64) -> Option<String> {
    (!(age.is_finite() && age > 0.0)).then(|| format!("is {age:?}, give a number of seconds over 0"))
}

pub(super) fn lag_fault(time_constant: f64) -> Option<String> {
    let [low, high] = LAG_RANGE;
    (!(low..=high).contains(&time_constant))
        .then(|| format!("is {time_constant:?}, give the time constant of the lagged temperature, {low} to {high} s"))
}

pub(super) fn max_rate_fault(rate: f64) -> Option<String> {
    (!(rate.is_finite() && rate > 0.0)).then(|| format!("is {rate:?}, give a number of pulses per second over 0"))
}

pub(super) fn bias_fault(kind: SensorKind, bias: &Polynomial, unit: BiasUnit) -> Option<String> {
    let limit = kind.max_bias() / unit.factor();
    let violation = bias.above(limit).or_else(|| bias.below(-limit))?;
    let (most, base) = (kind.max_bias(), kind.base_unit());
    Some(format!("{}; it must stay within +-{most} {base} over its range", describe(violation, unit.name())))
}

/// A transient term is at most as large as a bias may be, for a lag difference of the whole range.
pub(super) fn transient_fault(kind: SensorKind, transient: f64, bias: &Polynomial, unit: BiasUnit) -> Option<String> {
    let [low, high] = bias.range();
    let limit = kind.max_bias() / unit.factor() / (high - low);
    // NaN is not within the limit.
    let within = transient.abs() <= limit;
    (!within).then(|| format!("is {transient:?}, give at most +-{limit:?} {} per unit of temperature", unit.name()))
}

pub(super) fn positive_scale_factor_fault(kind: SensorKind, polynomial: &Polynomial) -> Option<String> {
    let violation = polynomial.below(kind.min_scale_factor())?;
    let (least, found) = (kind.min_scale_factor(), describe(violation, kind.scale_factor_unit()));
    Some(format!("{found}; it must be positive and at least {least} over its range"))
}

pub(super) fn negative_scale_factor_fault(kind: SensorKind, polynomial: &Polynomial) -> Option<String> {
    let violation = polynomial.above(-kind.min_scale_factor())?;
    let (least, found) = (kind.min_scale_factor(), describe(violation, kind.scale_factor_unit()));
    Some(format!("{found}; it must be negative and at most -{least} over its range"))
}

pub(super) fn g_sensitivity_fault(coefficient: f64) -> Option<String> {
    let within = coefficient.abs() <= MAX_G_SENSITIVITY;
    (!within).then(|| format!("is {coefficient:?}, give at most +-{MAX_G_SENSITIVITY} deg/h/g0"))
}

pub(super) fn alignment_fault(matrix: &Matrix3<f64>) -> Option<String> {
    let sizes = matrix.singular_values();
    // Entries that overflow give NaN; both comparisons are false then, so the matrix counts as singular.
    let invertible = sizes.max().is_finite() && sizes.min() > 1e-9 * sizes.max();
    (!invertible).then(|| "is singular; give an invertible 3x3 matrix, close to a rotation".to_owned())
}

fn describe(violation: Violation, unit: &str) -> String {
    format!("is {} {unit} at temperature {}", violation.value, violation.at)
}
