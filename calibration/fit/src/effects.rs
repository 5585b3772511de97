//! Which change of a curve justifies a higher order.

/// Smallest change of D that justifies a higher order \[deg/h\].
pub(crate) const GYROSCOPE_BIAS_EFFECT: f64 = 1e-3;

/// Smallest relative change of a scale factor that justifies a higher order.
pub(crate) const GYROSCOPE_SCALE_FACTOR_EFFECT: f64 = 0.5e-6;

/// Smallest change of the bias that justifies a higher order \[g0\].
pub(crate) const BIAS_EFFECT: f64 = 0.1e-6;

/// Smallest relative change of a scale factor that justifies a higher order.
pub(crate) const SCALE_FACTOR_EFFECT: f64 = 0.5e-6;
