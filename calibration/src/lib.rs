//! From measurements of an IMU to a coefficient table, and back: campaigns on a two-axis turntable in a temperature chamber, and an IMU that is put
//! down by hand; the noise of a recording, and the comparison of tables.
//!
//! This crate opens no file and starts no thread. It reads the clock only for the time in a table's provenance.

pub mod accuracy;
pub mod alignment;
pub mod allan;
pub mod batch;
pub mod calibrate;
pub mod campaign;
pub mod checks;
pub mod compare;
pub mod curve;
pub mod diagnosis;
pub mod diagnostics;
pub mod double_double;
pub mod gate;
pub mod gravity;
pub mod gravity_only;
pub mod gyroscopes;
pub mod hysteresis;
mod least_squares;
mod noise;
pub mod one_stage;
pub mod order;
pub mod positions;
pub mod provenance;
mod quality;
pub mod ramps;
pub mod reduce;
pub mod regression;
pub mod report;
pub mod requirement;
pub mod simulate;
pub mod stability;
pub mod standstill;
pub mod transients;
mod triad;
pub mod verdict;
pub mod window;
