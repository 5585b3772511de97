//! One process of a station: the chamber, the turntable or the IMU.

use crate::chamber::ChamberDevice;
use crate::station::{SimulatedStation, StationProcess};
use crate::turntable::TurntableDevice;
use crate::wire::Wire;
use crate::{imu, launch, server, wire};
use isotherm_client::Domain;
use isotherm_support::failure::{Exit, Failure, shown};
use std::path::Path;

impl SimulatedStation {
    /// Its chamber.
    #[must_use]
    pub fn chamber_wire(&self) -> Box<dyn Wire> {
        wire::of(ChamberDevice::new(self), self.chamber.implementation())
    }

    /// Its turntable.
    #[must_use]
    pub fn turntable_wire(&self) -> Box<dyn Wire> {
        let protocol = self.table.implementation(self.table_port.starts_with("tcp://"));
        wire::of(TurntableDevice::new(self.wrap), protocol)
    }

    /// Runs one process of the station in `folder`, until it receives a signal or another process of the station has
    /// ended.
    ///
    /// # Errors
    /// If a file of the station cannot be read, or the port cannot be created or used.
    pub fn run_process(process: StationProcess, folder: &Path, domain: Domain) -> Result<(), Failure> {
        let path = folder.join(launch::DESCRIPTION);
        let text = std::fs::read_to_string(&path).map_err(|error| Failure::io("reading", &path, &error))?;
        let station: Self = serde_json::from_str(&text)
            .map_err(|error| Failure::new(Exit::Config, format!("reading {}: {error}", shown(&path))))?;
        match process {
            StationProcess::Chamber => {
                server::serve(process, station.chamber_wire(), &station, &station.chamber_port, folder)
            }
            StationProcess::Turntable => {
                server::serve(process, station.turntable_wire(), &station, &station.table_port, folder)
            }
            StationProcess::Imu => imu::run(&station, folder, &domain),
        }
    }
}
