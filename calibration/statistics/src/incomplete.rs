//! The regularised incomplete beta and gamma functions.
//!
//! # Method
//! Both are a density times a sum. The density is that of the binomial and of the Poisson distribution, of a number of
//! events that need not be whole. It is computed from the error of Stirling's formula and from deviances, which are
//! small where the density is not, so that nothing cancels for large parameters (C. Loader, Fast and accurate
//! computation of binomial probabilities, 2000). The sums are the continued fractions 8.17.22, in the even part that
//! Didonato and Morris use (ACM Transactions on Mathematical Software 18, 1992), and 8.9.2, and the series 8.11.4 of
//! the Digital Library of Mathematical Functions (NIST). The fractions are evaluated by Lentz's method.

use core::f64::consts::TAU;

/// Most terms of a sum. A parameter of 1e8 takes 2e4.
const MAX_TERMS: u32 = 1_000_000;

/// The beta function I with argument `x` and parameters `a` and `b`, which must be over 0; `y` is 1 - `x`.
pub(crate) fn incomplete_beta(a: f64, b: f64, [x, y]: [f64; 2]) -> f64 {
    let sum = a + b;
    if x * (sum + 2.0) > a + 1.0 {
        return 1.0 - beta_fraction(b, a, [y, x]);
    }
    beta_fraction(a, b, [x, y])
}

/// The same, for x up to its mean or little more.
fn beta_fraction(a: f64, b: f64, [x, y]: [f64; 2]) -> f64 {
    let sum = a + b;
    let stirling = stirling_error(sum) - stirling_error(a) - stirling_error(b);
    let density = (a * (b / sum) / TAU).sqrt() * libm::exp(stirling - deviance(a, sum * x) - deviance(b, sum * y));
    // Every second term of the fraction: no number near 1 is subtracted from 1.
    let past = a * y - b * x + 1.0;
    let term = |n: f64| {
        let (of_b, end) = (n * (b - n) * x, a + 2.0 * n - 1.0);
        let above = (a + n - 1.0) * (sum + n - 1.0) * of_b * x / (end * end);
        (above, n + of_b / end + (a + n) / (end + 2.0) * (past + n * (1.0 + y)))
    };
    density / fraction(a / (a + 1.0) * past, term)
}

/// The upper gamma function Q with the parameter `a`, which must be over 0, and the argument `x`.
pub(crate) fn upper_gamma(a: f64, x: f64) -> f64 {
    let density = libm::exp(-stirling_error(a) - deviance(a, x)) / (TAU * a).sqrt();
    if x > a + 1.0 {
        return density * a / fraction(x + 1.0 - a, |n| (n * (a - n), x + 1.0 - a + 2.0 * n));
    }
    let (mut sum, mut term) = (1.0, 1.0);
    for n in 1..MAX_TERMS {
        term *= x / (a + f64::from(n));
        sum += term;
        if term <= 1e-17 * sum {
            break;
        }
    }
    1.0 - density * sum
}

/// `first + a1/(b1 + a2/(b2 + ..))`, where `term(n)` is an and bn.
fn fraction(first: f64, term: impl Fn(f64) -> (f64, f64)) -> f64 {
    let not_zero = |value: f64| if value.abs() < 1e-300 { 1e-300 } else { value };
    let (mut value, mut above, mut below) = (first, first, 0.0);
    for n in 1..MAX_TERMS {
        let (a, b) = term(f64::from(n));
        below = 1.0 / not_zero(b + a * below);
        above = not_zero(b + a / above);
        let step = above * below;
        value *= step;
        if (step - 1.0).abs() <= f64::EPSILON {
            break;
        }
    }
    value
}

/// Stirling's series: B(2k)/(2k (2k - 1)) with Bernoulli's numbers.
const STIRLING: [f64; 9] = [
    1.0 / 12.0,
    -1.0 / 360.0,
    1.0 / 1260.0,
    -1.0 / 1680.0,
    1.0 / 1188.0,
    -691.0 / 360_360.0,
    1.0 / 156.0,
    -3617.0 / 122_400.0,
    43_867.0 / 244_188.0,
];

/// The error of Stirling's formula: ln z! - (z + 1/2) ln z + z - ln(2 pi)/2.
fn stirling_error(mut z: f64) -> f64 {
    let mut sum = 0.0;
    // The series needs a large z. The error of z less that of z + 1 has no factorial.
    while z < 8.0 {
        sum += (z + 0.5) * libm::log1p(1.0 / z) - 1.0;
        z += 1.0;
    }
    let square = 1.0 / (z * z);
    sum + STIRLING.iter().rev().fold(0.0, |sum, term| sum * square + term) / z
}

/// `events ln(events/mean) + mean - events`.
fn deviance(events: f64, mean: f64) -> f64 {
    let off = (mean - events) / events;
    if off.abs() > 0.5 {
        return events * (off - libm::log(mean / events));
    }
    // With ln(1 + off) = 2 artanh r.
    let r = off / (2.0 + off);
    let powers = (1..20).rev().fold(0.0, |sum, k| (sum + 1.0 / f64::from(2 * k + 1)) * r * r);
    events * r * (off - 2.0 * powers)
}
