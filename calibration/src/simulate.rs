//! Simulated campaigns, runs and ramps of the [simulated IMU](isotherm_simulation): [`campaign`], [`run`] and [`ramp`] drive it through a
//! schedule. The same seed gives the same data, on the same machine to the byte.

mod campaign;
mod ramp;
mod run;

pub use campaign::{CampaignSchedule, SimulatedCampaign, SimulatedRow, TurnSchedule, campaign, campaign_toml};
pub use isotherm_simulation::{
    Chain, GYROSCOPE_MISALIGNMENT, HEADING_DEG, InertialMotion, LATITUDE_DEG, MISALIGNMENT, Noise, Play,
    RandomGenerator, SimulatedChamber, SimulatedGyroscopes, SimulatedImu, SimulatedTriad, SimulatedTurntable, TILT_RAD,
    Truth, specific_force, typical_gyroscopes, worst_errors, worst_gyroscope_errors,
};
pub use ramp::{RampSchedule, ramp, ramp_seed, ramps_toml};
pub use run::{RunSamples, RunSchedule, run};

#[cfg(test)]
mod tests;
