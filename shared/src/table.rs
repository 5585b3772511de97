//! The coefficient table of one IMU. Only valid tables can exist: every one is made by [`CoefficientTable::new`], directly
//! or from a file's text.

mod checks;
mod model;
mod toml;

pub use checks::{GRAVITY_RANGE, MAX_BIAS_G0, MIN_SCALE_FACTOR};
pub use model::{AXIS_NAMES, Axis, CoefficientTable, Content, Digest, OutOfRange, Refusal};
pub use toml::Seal;
