//! What a table is worth on a recording that it was not made from: the stability of its output, what that allows to be
//! claimed, what is required, and the gate that decides whether a new table replaces the one in force.
//!
//! This crate opens no file: a caller gives rows and tables.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_shared::table::CoefficientTable;
//! use isotherm_simulation::{RunSchedule, Truth, run};
//! use isotherm_verification::{Collector, LocalGravity, Requirement, Setup};
//!
//! // A simulated IMU at rest goes from -25 to 45 degC; the table is the true one.
//! let table = CoefficientTable::from_toml(include_str!("../../../tests/data/imu-a.toml"), None)?;
//! let truth = Truth::of(table);
//! let schedule = RunSchedule { interval_ns: 1_000_000_000, ..RunSchedule::default() };
//! let mut collector = Collector::new(&truth.table, 10.0); // windows of 10 s
//! run(&truth, &schedule, 1).for_each(|raw| collector.add(&raw));
//! let stability = collector.finish(&Setup::new(Some(schedule.direction), LocalGravity::Stated(9.8015)))?;
//! let requirement: Requirement = "bias=20ug0".parse()?;
//! requirement.check(&stability)?;
//! # Ok(())
//! # }
//! ```

mod attitude;
mod evidence;
mod gate;
mod magnitudes;
mod occupancy;
mod requirement;
mod stability;
mod verdict;
mod window;

pub use attitude::Attitude;
pub use evidence::{OWN_RECORDING, own_recording};
pub use gate::exercised::DRIVEN;
pub use gate::exercised::{ExercisedChannels, undriven};
pub use gate::{GATE_FLOOR, Gate, GateRefusal};
pub use magnitudes::{Magnitude, Magnitudes, MagnitudesError, TableCoverage};
pub use occupancy::{Bins, Occupancy};
pub use requirement::{Judgement, Requirement};
pub use stability::Window;
pub use stability::{
    AxisStability, Collector, Coverage, EarthRate, Force, GyroscopeStability, LeftOut, LocalGravity, LoopBand, Loops,
    Setup, Stability, StabilityError,
};
pub use verdict::{Errors, Estimate, arcsec};
