//! Means of values.

/// The mean; not a number for none.
///
/// ```
/// assert_eq!(isotherm_statistics::mean(&[1.0, 2.0, 6.0]), 3.0);
/// ```
#[must_use]
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The root mean square; not a number for none.
///
/// ```
/// assert_eq!(isotherm_statistics::rms(&[1.0, -1.0]), 1.0);
/// ```
#[must_use]
pub fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}
