//! A simulated station: chamber, table and IMU as processes of their own, coupled through the physics of the simulation.
//!
//! # Time
//! One clock for all: simulated time is `speed` times CLOCK_MONOTONIC since the station's start. Chamber and table act in it when they are
//! asked or told; the IMU works it off in whole control periods. It asks both machines up to when they have told everything
//! ([`link`]), and goes no further: a process that stalls delays the others, but nobody skips physics.
//!
//! # Processes
//! ```text
//! isotherm simulate station ----+-- chamber   DIR/chamber or TCP, byte by byte    ^ events: where the chamber makes for
//!    writes DIR, supervises     +-- table     DIR/table or TCP, byte by byte      | ... and the axes
//!                               +-- imu       raw samples to the service   <------+
//! ```
//! A machine's reply passes through the [`faults`] that DIR/faults asks for.

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
pub use launch::{follow, free_port};
pub use protocol::{ChamberProtocol, TurntableProtocol};

use isotherm_calibration::simulate::{Chain, Noise};
use isotherm_client::{Domain, ImuId, monotonic_ns};
use isotherm_failure::{Exit, Failure};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A station: what its file DIR/station.json says.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct SimulatedStation {
    /// The IMU whose samples are published.
    pub imu: String,
    /// What the chamber speaks.
    pub chamber: ChamberProtocol,
    /// Its port: a symbolic link to a pseudo-terminal, or `tcp://127.0.0.1:port`.
    pub chamber_port: String,
    /// What the table speaks.
    pub table: TurntableProtocol,
    /// Its port.
    pub table_port: String,
    /// Simulated seconds in a second.
    pub speed: f64,
    /// CLOCK_MONOTONIC at simulated time 0 \[ns\].
    pub origin_ns: u64,
    /// Control period of the IMU \[ns\].
    pub interval_ns: u64,
    /// Noise, and the phase of the chamber's oscillation.
    pub seed: u64,
    /// The laboratory, and the chamber at the beginning \[degC\].
    pub ambient_c: f64,
    /// The chamber's fastest ramp \[degC/s\].
    pub ramp_c_per_s: f64,
    /// Tilt of the table's base \[rad\].
    pub tilt_rad: [f64; 2],
    /// \[m/s2\]
    pub gravity_local: f64,
    /// The IMU's hardware.
    pub chain: Chain,
    /// What differs each time.
    pub noise: Noise,
}

/// One process of a station.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Part {
    /// The chamber.
    Chamber,
    /// The turntable.
    Turntable,
    /// The IMU.
    Imu,
}

impl Part {
    /// Every part with its name.
    pub const NAMES: [(Self, &'static str); 3] =
        [(Self::Chamber, "chamber"), (Self::Turntable, "table"), (Self::Imu, "imu")];

    /// Its name.
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

    /// Is a part of the station in `folder` until it is ended.
    ///
    /// # Errors
    /// If the port cannot be made or another process of the station has gone.
    pub fn run_part(part: Part, folder: &Path, domain: Domain) -> Result<(), Failure> {
        let path = folder.join(launch::DESCRIPTION);
        let text = std::fs::read_to_string(&path).map_err(|error| Failure::io("reading", &path, &error))?;
        let station: Self = serde_json::from_str(&text)
            .map_err(|error| Failure::new(Exit::Config, format!("reading {}: {error}", path.display())))?;
        match part {
            Part::Chamber => {
                let machine = chamber::ChamberMachine::new(&station);
                server::serve(part, machine, station.chamber.speaker(), &station, &station.chamber_port, folder)
            }
            Part::Turntable => {
                let tcp = station.table_port.starts_with("tcp://");
                let speaker = station.table.speaker(tcp);
                server::serve(
                    part,
                    turntable::TurntableMachine::default(),
                    speaker,
                    &station,
                    &station.table_port,
                    folder,
                )
            }
            Part::Imu => {
                let imu: ImuId = station.imu.parse().map_err(|error| Failure::new(Exit::Config, format!("{error}")))?;
                imu::run(&station, &imu, folder, domain)
            }
        }
    }
}
