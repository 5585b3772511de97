//! Simulated data from a known truth, computed along the physical chain.
//!
//! # Chain
//! ```text
//! chamber -> head, board          first-order lags; the board is warmer by its own heat                   [degC]
//!         -> telemetry            U = U0 + s T, plus noise, quantised, read at an interval                [V]
//! table   -> specific force f     local gravity along the input axes: tilt of the base, positioning error [g0]
//!         -> indicated x          M f + A(U_head), plus an offset for each visit of a set point and noise [g0]
//!         -> pulses N+, N-        charge balance with K+(U_board), K-(U_board); the remainder is kept     [pulse]
//! ```
//! The truth is a [`CoefficientTable`] with a misalignment M. Compensation with this table gives f, except for noise and
//! the charge that has not made a pulse yet. [`SimulatedImu`] is heads, boards and converters. [`campaign`] and [`run`]
//! drive it through a schedule. [`SimulatedChamber`] and [`SimulatedTurntable`] are the chamber and the turntable alone.
//! The same seed gives the same data, on the same machine to the byte.
//!
//! [`CoefficientTable`]: isotherm_shared::table::CoefficientTable

mod campaign;
mod chamber;
mod imu;
mod model;
mod motion;
mod random;
mod triad;
mod turntable;

pub use campaign::{
    CampaignSchedule, RunSamples, RunSchedule, SimulatedCampaign, SimulatedRow, campaign, campaign_toml, run,
};
pub use chamber::SimulatedChamber;
pub use imu::SimulatedImu;
pub use model::{Chain, HEADING_DEG, LATITUDE_DEG, MISALIGNMENT, Noise, TILT_RAD, Truth, worst_errors};
pub use motion::Motion;
pub use random::RandomGenerator;
pub use triad::{SimulatedGyroscopes, SimulatedTriad};
pub use turntable::{SimulatedTurntable, specific_force};

#[cfg(test)]
mod tests;
