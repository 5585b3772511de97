//! Least squares and polynomial regression with their diagnostics: what every fit of Isotherm is made of. Regression is
//! in double-double from the decimals on, so that order 7 over a wide range loses no digit of a double.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_statistics::{DataPoint, OrderTable, Regression, Rule};
//!
//! // A bias [ug0] that is quadratic in the temperature [V], with a disturbance of 0.02 ug0.
//! let points = (0..12).map(|i| (1.0 + 0.2 * f64::from(i), [0.02, -0.02, 0.01][i as usize % 3]));
//! let points = points.map(|(x, noise)| DataPoint::new(x, 900.0 - 40.0 * x + 5.0 * x * x + noise));
//! let table = OrderTable::choose(Regression::new(points.collect(), 5)?, &Rule::default());
//! assert_eq!(table.choice.order, 2);
//! assert!((table.regression.at(2, 2.0).0 - 840.0).abs() < 0.02);
//! # Ok(())
//! # }
//! ```

mod curve;
mod curve_band;
mod diagnostics;
mod double_double;
mod hysteresis;
mod incomplete;
mod largest;
mod least_squares;
mod mean;
mod order;
mod regression;
mod stored;
mod student;
mod sweep_band;
mod tails;

pub use curve::{CONFIDENCE, Curve, NORMAL_QUANTILE, SlopeError};
pub use diagnostics::{Diagnostics, Test, greatest_divisor, median, robust_sd};
pub use double_double::DoubleDouble;
pub use hysteresis::{BINS, LoopPoint, Sweep, band, shared_bins, sweeps};
pub use largest::{largest, root};
pub use least_squares::{LeastSquares, MAX_SVD_STEPS, least_squares, pseudo_inverse};
pub use mean::{mean, rms};
pub use order::{OrderTable, PureError, QUANTITIES, Rule, choose, default_order};
pub use regression::{DataPoint, Fit, LinearColumn, MAX_ORDER, Regression, RegressionError, TermTest};
pub use student::{student_quantile, student_quantile_of};
pub use sweep_band::{Disagreement, SweepBand, SweepValues, sweep_band};
pub use tails::{beta_tail, chi_square_limit, f_limit, f_tail};
