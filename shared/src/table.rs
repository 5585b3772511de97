//! The coefficient table of one IMU. Only valid tables can exist: every one is made by [`CoefficientTable::new`],
//! directly or from a file's text.

mod checks;
pub(crate) mod content;
mod curves;
pub mod difference;
mod digest;
mod errors;
mod model;
mod nominal;
mod pulses;
mod stated;
mod toml;
mod turntable;

pub use checks::{GRAVITY_RANGE, LAG_RANGE, MAX_G_SENSITIVITY, NOMINAL_INTERVAL_RANGE};
pub use content::{
    AXIS_NAMES, Axis, Content, ContentFault, FORMAT, GRAVITY_ONLY, GYROSCOPE_NAMES, Gyroscopes, OutOfRange,
};
pub use digest::Digest;
pub use errors::StatedErrors;
pub use model::CoefficientTable;
pub use nominal::{Nominal, Refusals, STANDARD_GRAVITY, nominal_content, nominal_table};
pub use pulses::{PulseMismatch, PulseScale};
pub use toml::{MAX_TABLE_BYTES, Seal, UNSEALED, with_unchecked_digest};
pub use turntable::Turntable;
