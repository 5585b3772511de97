//! Checks of the parts of a table. `Some` says what is wrong, and what to write instead.

use crate::polynomial::{Polynomial, Violation};
use crate::units::{BiasUnit, SCALE_FACTOR_UNIT};
use nalgebra::Matrix3;

/// Accepted range of the value of 1 g0 \[m/s2\].
pub const GRAVITY_RANGE: [f64; 2] = [9.7, 9.9];

/// Smallest absolute value of a scale factor within its range \[pulse/(s*g0)\].
pub const MIN_SCALE_FACTOR: f64 = 1.0;

/// Largest absolute value of a bias within its range \[g0\].
pub const MAX_BIAS_G0: f64 = 1.0;

pub fn gravity_fault(gravity: f64) -> Option<String> {
    let [low, high] = GRAVITY_RANGE;
    (!(low..=high).contains(&gravity)).then(|| format!("is {gravity:?}, give the value of 1 g0, {low} to {high} m/s2"))
}

pub fn max_age_fault(age: f64) -> Option<String> {
    (!(age.is_finite() && age > 0.0)).then(|| format!("is {age:?}, give a number of seconds over 0"))
}

pub fn max_rate_fault(rate: f64) -> Option<String> {
    (!(rate.is_finite() && rate > 0.0)).then(|| format!("is {rate:?}, give a number of pulses per second over 0"))
}

pub fn bias_fault(bias: &Polynomial, unit: BiasUnit) -> Option<String> {
    let limit = MAX_BIAS_G0 / unit.in_g0();
    let violation = bias.above(limit).or_else(|| bias.below(-limit))?;
    Some(format!("{}; it must stay within +-1 g0 over its range", describe(violation, unit.name())))
}

pub fn positive_scale_factor_fault(polynomial: &Polynomial) -> Option<String> {
    let violation = polynomial.below(MIN_SCALE_FACTOR)?;
    Some(format!("{}; it must be positive and at least 1 over its range", describe(violation, SCALE_FACTOR_UNIT)))
}

pub fn negative_scale_factor_fault(polynomial: &Polynomial) -> Option<String> {
    let violation = polynomial.above(-MIN_SCALE_FACTOR)?;
    Some(format!("{}; it must be negative and at most -1 over its range", describe(violation, SCALE_FACTOR_UNIT)))
}

pub fn alignment_fault(matrix: &Matrix3<f64>) -> Option<String> {
    let sizes = matrix.singular_values();
    // Entries that overflow give NaN; both comparisons are false then, so the matrix counts as singular.
    let invertible = sizes.max().is_finite() && sizes.min() > 1e-9 * sizes.max();
    (!invertible).then(|| "is singular; give an invertible 3x3 matrix, close to a rotation".to_owned())
}

fn describe(violation: Violation, unit: &str) -> String {
    format!("is {} {unit} at telemetry {}", violation.value, violation.at)
}
