//! A simulated station: chamber, turntable and IMU, each in its own process, with the same simulated physics.
//!
//! # Time
//! All processes use one clock: simulated time is `speed` times CLOCK_MONOTONIC since the station's start. Chamber and turntable
//! (the devices) advance to the current time at each request. The IMU advances in whole control periods. It asks both devices up
//! to which time it knows all their events (module `link`), and does not simulate beyond it. So a process that stalls delays the
//! others, but no event is missed.
//!
//! # Processes
//! ```text
//! isotherm simulate station ----+-- chamber   DIR/chamber or TCP, byte by byte    | events: new targets of the chamber
//!    writes DIR, supervises     +-- table     DIR/table or TCP, byte by byte      | ... and of the axes
//!                               +-- imu       raw samples to the service   <------+
//! ```
//! The faults that DIR/faults lists are injected into the devices and their replies (module `faults`).

mod chamber;
mod faults;
mod imu;
mod launch;
mod link;
mod plan;
mod port;
mod protocol;
mod server;
mod turntable;

pub use faults::Injection;
pub use launch::{end_with_parent, free_port};
pub use protocol::{ChamberProtocol, TurntableProtocol};

use isotherm_calibration::simulate::{Chain, Noise};
use isotherm_client::{Domain, ImuId, monotonic_ns};
use isotherm_failure::{Exit, Failure};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A station, as described in its file DIR/station.json.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct SimulatedStation {
    /// The IMU whose samples are published.
    pub imu: String,
    /// Protocol of the chamber.
    pub chamber: ChamberProtocol,
    /// Port of the chamber: a symbolic link to a pseudo-terminal, or `tcp://127.0.0.1:port`.
    pub chamber_port: String,
    /// Protocol of the turntable.
    pub table: TurntableProtocol,
    /// Port of the turntable.
    pub table_port: String,
    /// Simulated seconds per second.
    pub speed: f64,
    /// CLOCK_MONOTONIC at simulated time 0 \[ns\].
    pub origin_ns: u64,
    /// Control period of the IMU \[ns\].
    pub interval_ns: u64,
    /// Seed of the noise and of the phase of the chamber's oscillation.
    pub seed: u64,
    /// Temperature of the laboratory, and of the chamber at the beginning \[degC\].
    pub ambient_c: f64,
    /// The chamber's fastest ramp \[degC/s\].
    pub ramp_c_per_s: f64,
    /// Tilt of the turntable's base \[rad\].
    pub tilt_rad: [f64; 2],
    /// Local gravity \[m/s2\].
    pub gravity_local: f64,
    /// The IMU's measurement chain.
    pub chain: Chain,
    /// The random errors.
    pub noise: Noise,
}

/// One process of a station.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum StationProcess {
    /// The chamber.
    Chamber,
    /// The turntable.
    Turntable,
    /// The IMU.
    Imu,
}

impl StationProcess {
    /// Every process with its name.
    pub const NAMES: [(Self, &'static str); 3] =
        [(Self::Chamber, "chamber"), (Self::Turntable, "table"), (Self::Imu, "imu")];

    /// The name, as in file names and messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Chamber => "chamber",
            Self::Turntable => "table",
            Self::Imu => "imu",
        }
    }
}

impl SimulatedStation {
    /// Simulated time \[s\].
    fn now_s(&self) -> f64 {
        monotonic_ns().saturating_sub(self.origin_ns) as f64 / 1e9 * self.speed
    }

    /// Runs one process of the station in `folder`, until it receives a signal or another process of the station has ended.
    ///
    /// # Errors
    /// If a file of the station cannot be read, or the port cannot be created or used.
    pub fn run_process(process: StationProcess, folder: &Path, domain: Domain) -> Result<(), Failure> {
        let path = folder.join(launch::DESCRIPTION);
        let text = std::fs::read_to_string(&path).map_err(|error| Failure::io("reading", &path, &error))?;
        let station: Self = serde_json::from_str(&text)
            .map_err(|error| Failure::new(Exit::Config, format!("reading {}: {error}", path.display())))?;
        match process {
            StationProcess::Chamber => {
                let device = chamber::ChamberDevice::new(&station);
                let protocol = station.chamber.implementation();
                server::serve(process, device, protocol, &station, &station.chamber_port, folder)
            }
            StationProcess::Turntable => {
                let tcp = station.table_port.starts_with("tcp://");
                let (device, protocol) = (turntable::TurntableDevice::default(), station.table.implementation(tcp));
                server::serve(process, device, protocol, &station, &station.table_port, folder)
            }
            StationProcess::Imu => {
                let imu: ImuId = station.imu.parse().map_err(|error| Failure::new(Exit::Config, format!("{error}")))?;
                imu::run(&station, &imu, folder, domain)
            }
        }
    }
}
