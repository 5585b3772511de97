//! Tails of the distributions of tests.

use statrs::function::beta::beta_reg;

/// Probability that an F variable with `d1` and `d2` degrees of freedom is larger than `f`.
///
/// ```
/// use isotherm_statistics::f_tail;
///
/// // The printed 5 % limit of F with 2 and 10 degrees of freedom is 4.10.
/// assert!((f_tail(4.1028, 2.0, 10.0) - 0.05).abs() < 1e-5);
/// ```
#[must_use]
pub fn f_tail(f: f64, d1: f64, d2: f64) -> f64 {
    if f.is_nan() || f <= 0.0 {
        return if f.is_nan() { f64::NAN } else { 1.0 };
    }
    beta_reg(d2 / 2.0, d1 / 2.0, d2 / (d2 + d1 * f))
}

/// The probability that a variable of the beta distribution with the shapes `a` and `b` exceeds `x`.
#[must_use]
pub fn beta_tail(x: f64, a: f64, b: f64) -> f64 {
    if !(a > 0.0 && b > 0.0) || x.is_nan() { f64::NAN } else { 1.0 - beta_reg(a, b, x.clamp(0.0, 1.0)) }
}

/// The value that an F variable with `d1` and `d2` degrees of freedom exceeds with probability `p`.
///
/// ```
/// use isotherm_statistics::f_limit;
///
/// assert!((f_limit(0.05, 2.0, 10.0) - 4.1028).abs() < 1e-4);
/// ```
#[must_use]
pub fn f_limit(p: f64, d1: f64, d2: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    while f_tail(high, d1, d2) > p && high < 1e300 {
        high *= 2.0;
    }
    // Bisection, until `low` and `high` are neighbouring doubles.
    while let middle = low + (high - low) / 2.0
        && middle > low
        && middle < high
    {
        if f_tail(middle, d1, d2) > p { low = middle } else { high = middle }
    }
    high
}
