//! A simulated station: chamber, turntable and IMU, each in its own process, with the same simulated physics. Several
//! IMUs on the turntable share one process.
//!
//! A fault to inject is a line of text: what, in which process, and when.
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_station::Injection;
//!
//! let silence: Injection = "silent:imu-b@100s-2000s".parse()?;
//! assert_ne!(silence, "silent:imu-a@100s-2000s".parse()?);
//! assert!("unknown".parse::<Injection>().is_err_and(|message| message.contains("port-loss")));
//! # Ok(())
//! # }
//! ```
//!
//! # Time
//! All processes use one clock: simulated time is `speed` times CLOCK_MONOTONIC since the station's start. Chamber and
//! turntable (the devices) advance to the current time at each request. The IMU advances in whole control periods. It
//! asks both devices up to which time it knows all their events (module `link`), and does not simulate beyond it. So a
//! process that stalls delays the others, but no event is missed.
//!
//! # Processes
//! ```text
//! isotherm simulate station ----+-- chamber   DIR/chamber or TCP, byte by byte    | events: new targets of the chamber
//!    writes DIR, supervises     +-- table     DIR/table or TCP, byte by byte      | ... and of the axes
//!                               +-- imu       raw samples to the service   <------+
//! ```
//! The faults that DIR/faults lists are injected into the devices and their replies, and into the streams of the IMUs
//! (module `faults`).

mod chamber;
mod faults;
mod imu;
mod launch;
mod link;
mod plan;
mod port;
mod positioning;
mod process;
mod protocol;
mod server;
mod station;
mod turntable;
pub mod wire;

pub use faults::{InjectedFault, Injection};
pub use imu::MountedImu;
pub use launch::{end_with_parent, free_ports};
pub use link::DeviceEvent;
pub use station::{ChamberProtocol, SimulatedStation, StationImu, StationProcess, TurntableProtocol};
