//! The automatic campaign: chamber and table are led through a plan while the IMU's samples are taken.
//!
//! ```text
//! plan.toml -> plan -> machine (what next?) <- readings and samples
//!                         | orders              ^
//!                      runner: station (limits, instruments), recorder (samples), journal, progress
//! ```
//! The machine decides and does nothing; the runner does and decides nothing; the journal says what lasts.

pub mod control;
mod curves;
pub mod finish;
pub mod journal;
mod limits;
mod machine;
mod page;
pub mod plan;
pub mod progress;
mod readbacks;
pub mod runner;
pub mod samples;
mod stability;
pub mod station;
pub mod timeline;
