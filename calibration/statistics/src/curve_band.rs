//! The band that holds for a whole curve at once.
//!
//! The error of a fitted polynomial in standard errors, T(x) = p(x)'(b - beta) / |L'p(x)| with covariance LL', is a
//! Student's t at each x. How far its largest absolute value goes over a range depends on the path that the direction
//! L'p(x)/|L'p(x)| takes on the sphere, only by its length k:
//!
//! ```text
//! P(max |T| > c)  <=  k/pi (1 + c^2/n)^(-n/2) + P(|t| > c)          n: degrees of freedom
//! ```
//! The bound is nearly exact where it matters, and it is a bound for every curve. A band by Scheffe, for all
//! polynomials of the order at once, is wider; where few degrees of freedom make the bound wider, Scheffe's is taken.
//!
//! Sources: D. Q. Naiman, Conservative confidence bands in curvilinear regression, 1986; J. Sun, C. R. Loader,
//! Simultaneous confidence bands for linear regression and smoothing, 1994.

use crate::student::student_quantile_of;
use crate::tails::{f_limit, f_tail, falling_to};
use nalgebra::{DMatrix, DVector};

/// Parts of the range whose lengths are added; a cubic's path is known to 1e-4 then.
const PARTS: u32 = 200;

/// Length of the path of the direction over `range`, in the scaled temperature that the covariance's powers are of.
pub(crate) fn length(covariance: &DMatrix<f64>, [low, high]: [f64; 2]) -> f64 {
    let step = (high - low) / f64::from(PARTS);
    // By the middles of the parts.
    let speeds = (0..PARTS).map(|part| speed(covariance, low + (f64::from(part) + 0.5) * step));
    speeds.sum::<f64>() * step
}

/// How fast the direction turns at `x` \[rad per unit\].
fn speed(covariance: &DMatrix<f64>, x: f64) -> f64 {
    let count = covariance.nrows();
    let powers = DVector::from_fn(count, |k, _| x.powi(k as i32));
    let slopes = DVector::from_fn(count, |k, _| if k == 0 { 0.0 } else { k as f64 * x.powi(k as i32 - 1) });
    let of_powers = covariance * &powers;
    let size = powers.dot(&of_powers);
    let along = slopes.dot(&of_powers);
    let across = slopes.dot(&(covariance * &slopes)) * size - along * along;
    // A covariance of 0 has no direction.
    if size > 0.0 { across.max(0.0).sqrt() / size } else { 0.0 }
}

/// The c of the module's header, of a polynomial with `count` coefficients.
pub(crate) fn quantile(length: f64, count: usize, freedom: f64, confidence: f64) -> f64 {
    let chance = 1.0 - confidence;
    let beyond = |c: f64| {
        let of_path = length / core::f64::consts::PI * libm::pow(1.0 + c * c / freedom, -freedom / 2.0);
        of_path + f_tail(c * c, 1.0, freedom)
    };
    let scheffe = (count as f64 * f_limit(chance, count as f64, freedom)).sqrt();
    let (low, high) = (student_quantile_of(confidence, freedom), scheffe);
    if beyond(low) <= chance || low >= high {
        return low;
    }
    if beyond(high) >= chance {
        return high;
    }
    falling_to(chance, [low, high], beyond)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_has_the_quantile_of_a_point_and_a_line_less_than_scheffe() {
        let student = student_quantile_of(0.95, 9.0);
        assert!((quantile(0.0, 1, 9.0, 0.95) - student).abs() < 1e-9);
        // A line through even points: the direction turns by nearly half a turn over a very wide range.
        let covariance = DMatrix::from_diagonal(&DVector::from_vec(vec![1.0, 1.0]));
        let wide = length(&covariance, [-1.0, 1.0]);
        assert!((wide - core::f64::consts::FRAC_PI_2).abs() < 1e-4, "{wide}");
        let scheffe = (2.0 * f_limit(0.05, 2.0, 9.0)).sqrt();
        let found = quantile(wide, 2, 9.0, 0.95);
        assert!(student < found && found < scheffe, "{student} {found} {scheffe}");
        // A whole half turn and no more is Scheffe's own case: to either side lies the other half.
        let half = quantile(core::f64::consts::PI, 2, 9.0, 0.95);
        assert!(half >= found && (half - scheffe).abs() < 0.1, "{half} {scheffe}");
    }
}
