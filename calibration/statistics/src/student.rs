//! Quantiles of Student's t.

use crate::tails::f_limit;

/// Two-sided quantile of Student's t: |t| with `freedom` degrees of freedom is below it with probability `confidence`.
///
/// ```
/// use isotherm_statistics::student_quantile;
///
/// assert!((student_quantile(0.95, 11) - 2.201).abs() < 1e-3);
/// ```
#[must_use]
pub fn student_quantile(confidence: f64, freedom: usize) -> f64 {
    student_quantile_of(confidence, freedom as f64)
}

/// The same for degrees of freedom that are not a whole number; not a number without any.
pub fn student_quantile_of(confidence: f64, n: f64) -> f64 {
    if !n.is_finite() || n <= 0.0 {
        return f64::NAN;
    }
    // t^2 is F with 1 and n degrees of freedom.
    f_limit(1.0 - confidence, 1.0, n).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn student_quantile_matches_printed_tables() {
        for (freedom, right) in [(1, 12.706_205), (11, 2.200_985), (100, 1.983_972)] {
            assert!((student_quantile(0.95, freedom) - right).abs() < 1e-5, "{}", student_quantile(0.95, freedom));
        }
        assert!((student_quantile(0.682_689_492, 10) - 1.0526).abs() < 1e-3);
    }
}
