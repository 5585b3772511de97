//! Least squares and polynomial regression with their diagnostics: what every fit of Isotherm is made of. Regression is in double-double
//! from the decimals on, so that order 7 over a wide range loses no digit of a double.

mod curve;
mod diagnostics;
mod double_double;
mod hysteresis;
mod least_squares;
mod order;
mod regression;

pub use curve::{CONFIDENCE, Curve, student_quantile, student_quantile_of};
pub use diagnostics::{Test, median, robust_sd};
pub use double_double::DoubleDouble;
pub use hysteresis::{BINS, LoopPoint, Sweep, band, shared_bins, sweeps};
pub use least_squares::{LeastSquares, MAX_SVD_STEPS, least_squares};
pub use order::{OrderTable, QUANTITIES, Rule, choose, default_order};
pub use regression::{DataPoint, Fit, LinearColumn, MAX_ORDER, Partial, Regression, RegressionError, f_limit, f_tail};
