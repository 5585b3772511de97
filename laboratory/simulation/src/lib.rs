//! A simulated IMU, its chamber and its turntable: data from a known truth, computed along the physical chain.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_shared::{compensate::answer, table::CoefficientTable};
//! use isotherm_simulation::{Chain, InertialMotion, Noise, SimulatedImu, Truth};
//!
//! let table = CoefficientTable::from_toml(include_str!("../../../tests/data/imu-a.toml"), None)?;
//! let truth = Truth::of(table);
//! // At rest with A3 up, at 20 degC, for 10 s.
//! let mut imu = SimulatedImu::new(&truth, &Chain::default(), &Noise::NONE, 20.0, 1);
//! let raw = imu.step(&InertialMotion::at_rest(&truth, [0.0, 0.0], 10.0), 10_000_000_000);
//! // The true table gives the truth back: 10 s of 1 g0, to a pulse or two.
//! let [_, _, up] = answer(Some(&truth.table), &raw).velocity_increment;
//! assert!((up - 10.0 * 9.8015).abs() < 3e-4); // m/s
//! # Ok(())
//! # }
//! ```
//!
//! # Chain
//! ```text
//! chamber   -> head, board          first-order lags; the board is warmer by its own heat                   [degC]
//! head      -> sensing element L    a first-order lag, if the truth has a time constant                     [degC]
//!           -> temperature            U = U0 + s T, plus noise, quantised, read at an interval                [V]
//! turntable -> specific force f     local gravity along the input axes: tilt of the base, positioning error [g0]
//!           -> angle                its motion, and Earth's rate along the input axes                       [arcsec]
//!           -> indicated x          accelerometers: M f + A(U_head)                           [g0]
//!                                   gyroscopes: M angle + D(U_head) T + s f T                 [arcsec]
//!                                   plus transients t (L - U), plays, noise, an offset of each visit of a set point
//!           -> pulses N+, N-        charge balance with K+(U_board), K-(U_board); the remainder is kept     [pulse]
//! ```
//! The truth is a [`CoefficientTable`] with misalignments M, in a laboratory with a latitude. Compensation with this
//! table gives specific force and angle, except for noise and the charge that has not made a pulse yet.
//! [`SimulatedImu`] is heads, boards and converters; it feels a [`InertialMotion`]. [`SimulatedChamber`] and
//! [`SimulatedTurntable`] are the chamber and the turntable by themselves. The same seed gives the same data, on the
//! same machine to the byte.
//!
//! [`CoefficientTable`]: isotherm_shared::table::CoefficientTable

mod campaign;
mod chain;
mod chamber;
mod hysteresis;
mod imu;
mod model;
mod motion;
mod ramp;
mod random;
mod run;
mod triad;
mod turntable;

pub use campaign::{CampaignSchedule, SimulatedCampaign, SimulatedRow, TurnSchedule, campaign, campaign_toml};
pub use chain::{Chain, Noise, is_zero};
pub use chamber::SimulatedChamber;
pub use hysteresis::Play;
pub use imu::SimulatedImu;
pub use model::{
    GYROSCOPE_MISALIGNMENT, HEADING_DEG, LATITUDE_DEG, MISALIGNMENT, TILT_RAD, Truth, typical_gyroscopes, worst_errors,
    worst_gyroscope_errors,
};
pub use motion::InertialMotion;
pub use ramp::{RampSchedule, ramp, ramp_seed, ramps_toml};
pub use random::RandomGenerator;
pub use run::{RunSamples, RunSchedule, run};
pub use triad::{SimulatedGyroscopes, SimulatedTriad};
pub use turntable::{SimulatedTurntable, specific_force};

#[cfg(test)]
mod schedule_tests;
