//! The automatic campaign: it drives chamber and turntable through a plan and takes the IMU's samples meanwhile.
//!
//! ```text
//! plan.toml -> plan -> machine (decides) <----- readings and samples
//!                         | actions             ^
//!                      runner: station (limits, instruments), recorder (samples), journal, progress
//! ```
//! The machine decides the next action and has no side effects. The runner executes it. The journal lists the complete
//! units.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_automation::plan::Plan;
//! use std::path::Path;
//!
//! let plan = Plan::from_toml(include_str!("../../../examples/plan.toml"), Path::new("/srv/laboratory"))?;
//! assert_eq!(plan.units_of_set_point(), 12); // dwells, one in each position
//! assert!(plan.size().contains("15"), "{}", plan.size()); // set points
//! # Ok(())
//! # }
//! ```

pub mod control;
mod curves;
mod events;
pub mod finish;
pub mod in_force;
pub mod journal;
mod limits;
mod machine;
pub mod outcome;
mod page;
pub mod plan;
pub mod progress;
mod readbacks;
pub mod runner;
mod safe_state;
pub mod samples;
mod stability;
pub mod stamp;
pub mod station;
mod step;
pub mod stop;
mod streams;
pub mod timeline;
