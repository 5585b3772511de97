//! Figures that are judged: what is not a number stays none, where `f64::max` would drop it.

/// The largest of sizes, 0 if there are none. If one is not a number, nor is the result: what could not be computed is
/// not small.
///
/// ```
/// use isotherm_statistics::largest;
///
/// assert_eq!(largest([0.5, 2.0, 1.0]), 2.0);
/// assert!(largest([0.5, f64::NAN, 1.0]).is_nan());
/// assert_eq!(largest([]), 0.0);
/// ```
#[must_use]
pub fn largest(sizes: impl IntoIterator<Item = f64>) -> f64 {
    let larger = |most: f64, size: f64| if most.is_nan() || size.is_nan() { f64::NAN } else { most.max(size) };
    sizes.into_iter().fold(0.0, larger)
}

/// The root of a variance, which rounding may have made negative. If it is not a number, nor is the result.
///
/// ```
/// use isotherm_statistics::root;
///
/// assert_eq!((root(4.0), root(-1e-30)), (2.0, 0.0));
/// assert!(root(f64::NAN).is_nan());
/// ```
#[must_use]
pub fn root(variance: f64) -> f64 {
    if variance < 0.0 { 0.0 } else { variance.sqrt() }
}
