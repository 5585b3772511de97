//! From measurements of an IMU to a coefficient table, and back: campaigns on a two-axis turntable in a temperature chamber, and an IMU that is put
//! down by hand; the noise of a recording, and the comparison of tables.
//!
//! This crate opens no file and starts no thread. It reads the clock only for the time in a table's provenance.

pub mod accelerometers;
pub mod accuracy;
mod admit;
pub mod alignment;
pub mod calibrate;
pub mod checks;
pub mod diagnosis;
mod effects;
pub mod error;
pub mod gravity_only;
pub mod gyroscopes;
pub mod noise;
pub mod one_stage;
pub mod options;
mod orders;
pub mod provenance;
mod quality;
pub mod ramps;
pub mod reduce;
pub mod result;
mod table;
pub mod transients;
pub mod triad;
