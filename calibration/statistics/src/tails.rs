//! Tails of the distributions of tests, and the values that are exceeded with a given probability.

use crate::incomplete::{incomplete_beta, upper_gamma};

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
    if !is_positive([d1, d2]) || f.is_nan() || f <= 0.0 {
        return if f <= 0.0 { 1.0 } else { f64::NAN };
    }
    let odds = d1 * f / d2;
    incomplete_beta(d2 / 2.0, d1 / 2.0, [1.0 / (1.0 + odds), 1.0 / (1.0 + 1.0 / odds)])
}

/// The probability that a variable of the beta distribution with the shapes `a` and `b` exceeds `x`.
#[must_use]
pub fn beta_tail(x: f64, a: f64, b: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    if is_positive([a, b]) && !x.is_nan() { incomplete_beta(b, a, [1.0 - x, x]) } else { f64::NAN }
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
    exceeded(p, |f| f_tail(f, d1, d2))
}

/// The value that a chi-square variable with `freedom` degrees of freedom exceeds with probability `p`; not a number
/// without any.
///
/// ```
/// use isotherm_statistics::chi_square_limit;
///
/// // The printed 5 % limit with 10 degrees of freedom.
/// assert!((chi_square_limit(0.05, 10.0) - 18.307).abs() < 1e-3);
/// ```
#[must_use]
pub fn chi_square_limit(p: f64, freedom: f64) -> f64 {
    if is_positive([freedom]) { exceeded(p, |value| upper_gamma(freedom / 2.0, value / 2.0)) } else { f64::NAN }
}

fn is_positive<const N: usize>(parameters: [f64; N]) -> bool {
    parameters.iter().all(|value| *value > 0.0 && value.is_finite())
}

/// Where `tail`, which falls from 1 at 0, is `p`.
fn exceeded(p: f64, tail: impl Fn(f64) -> f64) -> f64 {
    if p <= 0.0 || p >= 1.0 {
        return if p <= 0.0 { f64::INFINITY } else { 0.0 };
    }
    let (mut low, mut high) = (1.0, 1.0);
    while tail(high) > p && high < 1e300 {
        (low, high) = (high, 2.0 * high);
    }
    while tail(low) <= p && low > 1e-300 {
        (low, high) = (0.5 * low, low);
    }
    falling_to(p, [low, high], tail)
}

/// Where `tail` falls to `p` between two values, to the last digits: by secants of its logarithm, with half the weight
/// for an end that stays (the Illinois method).
pub(crate) fn falling_to(p: f64, [mut low, mut high]: [f64; 2], tail: impl Fn(f64) -> f64) -> f64 {
    const MAX_STEPS: u32 = 200;
    let over = |value: f64| libm::log(tail(value) / p);
    let [mut at_low, mut at_high] = [over(low), over(high)];
    let mut low_stays = None;
    for _ in 0..MAX_STEPS {
        let secant = low + (high - low) * (at_low / (at_low - at_high));
        let next = if secant > low && secant < high { secant } else { low.midpoint(high) };
        if next <= low || next >= high {
            break;
        }
        let at_next = over(next);
        if at_next > 0.0 {
            (low, at_low) = (next, at_next);
            at_high *= if low_stays == Some(false) { 0.5 } else { 1.0 };
        } else {
            (high, at_high) = (next, at_next);
            at_low *= if low_stays == Some(true) { 0.5 } else { 1.0 };
        }
        low_stays = Some(at_next <= 0.0);
    }
    high
}
