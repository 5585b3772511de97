//! How stable the output is over temperature, without and with compensation: the paper's table 4 and figure 6.
//!
//! # Definition
//! The paper prints no definition; this one is ours. The IMU is held still at a stated attitude while the temperature
//! runs or steps through its range. The output is averaged over windows (10 s), and the specific force of the attitude
//! is subtracted, in g0. Each accelerometer has a standard deviation (about the mean) and an rms (about zero), which
//! also shows a constant error.
//!
//! - **before**: with the coefficients frozen at the run's mid temperature,
//! - **after**: with the full model,
//! - **factor**: standard deviation before over after.
//!
//! If no attitude is stated, the median of the compensated output is used as the specific force. A constant error then
//! does not show.
//!
//! If local gravity is unknown, the length of that median is used in its place. An error along the specific force then
//! does not show.
//!
//! # The length
//! This check needs no turntable: at rest, at any attitude, the vector of the three outputs must have the length of
//! local gravity. Without an alignment matrix, misalignments appear in it fully (3e-4 rad: up to 3e-4 g0). With one,
//! only errors of bias and scale factor remain.
//!
//! # The gyroscopes
//! Where table and recording have gyroscopes, they have the same figures in deg/h, see [`gyroscopes`].
//!

mod collector;
mod coverage;
pub(crate) mod earth_rate;
mod error;
mod figures;
pub(crate) mod gyroscopes;
mod loops;
mod result;
mod setup;
mod stillness;

pub use collector::Collector;
pub(crate) use coverage::hole;
pub use coverage::{Coverage, DRIVEN};
pub use earth_rate::EarthRate;
pub(crate) use earth_rate::attitude as turntable_attitude;
pub use error::{Force, StabilityError};
pub use figures::AxisStability;
pub use gyroscopes::GyroscopeStability;
pub use loops::{LoopBand, Loops};
pub use result::Stability;
pub use setup::{LocalGravity, Setup};
pub use stillness::LeftOut;

pub use crate::window::Window;
