//! What a table is worth on a recording that it was not made from: the stability of its output, what that allows to be claimed, what is
//! required, and the gate that decides whether a new table replaces the one in force.
//!
//! This crate opens no file: a caller gives rows and tables.

mod gate;
mod lengths;
mod requirement;
mod stability;
mod verdict;
mod window;

pub use gate::exercised::DRIVEN;
pub use gate::exercised::{Exercised, undriven};
pub use gate::{GATE_FLOOR, Gate, Refusal};
pub use lengths::{Length, Lengths, LengthsError};
pub use requirement::{Judgement, Requirement};
pub use stability::Window;
pub use stability::{
    AxisStability, Collector, Coverage, EarthRate, Force, GyroscopeStability, LeftOut, LocalGravity, LoopBand, Loops,
    Setup, Stability, StabilityError,
};
pub use verdict::{Errors, Estimate, arcsec};
