//! `simulate station`: a laboratory in processes of its own.

use super::options::{SimulatedFiles, SimulatedImuOptions, arcsec, truth_toml};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use isotherm_client::{Domain, monotonic_ns};
use isotherm_files::{create_own_folder, print};
use isotherm_offline::parse::{interval, size};
use isotherm_simulation::{Chain, Noise};
use isotherm_station::{
    ChamberProtocol, Injection, SimulatedStation, StationImu, StationProcess, TurntableProtocol, end_with_parent,
    free_ports,
};
use isotherm_support::failure::{Exit, Failure, shown};
use serde::Serialize;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use std::{fs, io};
use strum::VariantNames;

/// Run a simulated laboratory until SIGTERM or SIGINT
///
/// Chamber, turntable and IMU are processes of their own.
///
/// Chamber and turntable speak their protocols on the pseudo-terminals DIR/chamber and DIR/table, or over TCP. The IMU
/// publishes to the running service. DIR/plan.toml is a campaign plan for this laboratory, and DIR/truth.toml has the
/// coefficients of the IMU. Several IMUs share the turntable, each with another mounting, and their coefficients are in
/// DIR/truth-ID.toml. To inject faults, write them into DIR/faults.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm simulate station -o station --imu imu-a --speed 100\n  isotherm simulate station -o station --imu imu-a --chamber watlow-f4t --table aerosmith --tcp\n  isotherm simulate station -o station --imu imu-a --fault late:table@3-5 --fault never-there@7200s-9000s\n  echo port-loss:chamber > station/faults"
)]
pub(super) struct SimulateStation {
    #[command(flatten)]
    imu: SimulatedImuOptions,
    /// Choose the protocol of the chamber
    #[arg(long, value_name = "DRIVER", default_value = ChamberProtocol::VARIANTS[0], value_parser = named::<ChamberProtocol>())]
    chamber: ChamberProtocol,
    /// Choose the protocol of the turntable
    #[arg(long, value_name = "DRIVER", default_value = TurntableProtocol::VARIANTS[0], value_parser = named::<TurntableProtocol>())]
    table: TurntableProtocol,
    /// Simulate a turntable without end stops
    ///
    /// The turntable takes angles modulo 360 degrees and moves the shorter way.
    #[arg(long)]
    wrap: bool,
    /// Use ports on 127.0.0.1 instead of pseudo-terminals
    #[arg(long)]
    tcp: bool,
    /// Set the number of simulated seconds per second
    #[arg(long, value_name = "N", default_value_t = 1.0, value_parser = speed)]
    speed: f64,
    /// Set the control period in simulated time [s]
    #[arg(long, value_name = "S", default_value = "1", value_parser = interval)]
    interval: Duration,
    /// Set the interval of temperature readings [s]
    ///
    /// In simulated seconds. 0 gives a reading in every sample.
    #[arg(long, value_name = "S", default_value_t = 10.0, value_parser = size)]
    temperature_every: f64,
    /// Set the error of the angles [arcsec]
    ///
    /// One sigma, drawn after each move
    #[arg(long, value_name = "ARCSEC", default_value_t = 1.0, value_parser = size)]
    positioning: f64,
    /// Set the temperature of the laboratory [degC]
    ///
    /// Everything has this temperature at the beginning
    #[arg(long, value_name = "DEGC", default_value_t = 20.0, allow_hyphen_values = true)]
    ambient: f64,
    /// Set the chamber's fastest ramp [degC/min]
    #[arg(long, value_name = "DEGC/MIN", default_value_t = 3.0, value_parser = ramp)]
    chamber_ramp: f64,
    /// Inject a fault, WHAT[:chamber|:table|:IMU][@WHEN]
    ///
    /// WHAT is garbled, late, missing, duplicated, na, alarm, port-loss, babble, dead, no-settle, overshoot or
    /// never-there, or silent for an IMU. WHEN is 3 for the third request, 3-5 for the third to the fifth, or 100s-200s
    /// for simulated seconds. Without WHEN the fault is permanent
    #[arg(long, value_name = "WHAT@WHEN", value_parser = fault)]
    fault: Vec<String>,
}

/// One process of a station
#[derive(Debug, Args)]
pub(super) struct StationPart {
    /// Which process
    #[arg(value_parser = named::<StationProcess>())]
    part: StationProcess,
    /// The station's folder
    folder: PathBuf,
    /// Process id of the station
    #[arg(long)]
    parent: u32,
}

/// Parses the name of a variant.
fn named<T: FromStr<Err = strum::ParseError> + VariantNames + Clone + Send + Sync + 'static>()
-> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(T::VARIANTS).try_map(|name| name.parse::<T>())
}

fn speed(text: &str) -> Result<f64, String> {
    let speed: f64 = text.parse().map_err(|_| "give a number".to_owned())?;
    if (0.1..=20_000.0).contains(&speed) { Ok(speed) } else { Err("give a speed from 0.1 to 20000".to_owned()) }
}

fn ramp(text: &str) -> Result<f64, String> {
    let ramp: f64 = text.parse().map_err(|_| "give a number of degC/min".to_owned())?;
    if (0.01..=60.0).contains(&ramp) { Ok(ramp) } else { Err("give a ramp from 0.01 to 60 degC/min".to_owned()) }
}

fn fault(text: &str) -> Result<String, String> {
    text.parse::<Injection>().map(|_| text.to_owned())
}

impl StationPart {
    pub(super) fn run(self, domain: Domain) -> Result<(), Failure> {
        if end_with_parent(self.parent)? {
            SimulatedStation::run_process(self.part, &self.folder, domain)
        } else {
            Ok(())
        }
    }
}

impl SimulateStation {
    pub(super) fn run(self, domain: &Domain) -> Result<(), Failure> {
        let ended = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            let handled = signal_hook::flag::register(signal, Arc::clone(&ended));
            handled.map_err(|error| Failure::new(Exit::Failed, format!("handling signals: {error}")))?;
        }
        let folder = self.folder()?;
        let truths = self.imu.truths()?;
        let Some(truth) = truths.first() else { return Ok(()) };
        let (chain, noise) = self.imu.chain_and_noise(truth, self.temperature_every)?;
        let positioning_rad = arcsec(self.positioning);
        // An exact turntable repeats exactly.
        let noise = Noise { positioning_rad, turn_rad: noise.turn_rad.min(positioning_rad), ..noise };
        let [chamber_port, table_port] = if self.tcp {
            free_ports()?
        } else {
            ["chamber", "table"].map(|name| folder.join(name).display().to_string())
        };
        let station = SimulatedStation {
            imus: (0..)
                .zip(&truths)
                .map(|(number, truth)| {
                    StationImu::new(truth.table.content().imu.as_str(), number, truths.len(), self.imu.seed)
                })
                .collect(),
            chamber: self.chamber,
            chamber_port,
            table: self.table,
            table_port,
            wrap: self.wrap,
            speed: self.speed,
            origin_ns: monotonic_ns(),
            interval_ns: self.interval.as_nanos() as u64,
            seed: self.imu.seed,
            ambient_c: self.ambient,
            ramp_c_per_s: self.chamber_ramp / 60.0,
            tilt_rad: truth.tilt_rad,
            gravity_local: truth.gravity_local,
            latitude_deg: truth.latitude_deg,
            heading_deg: truth.heading_deg,
            chain,
            noise,
            plays: truth.plays.clone(),
        };
        #[derive(Serialize)]
        struct StationSchedule {
            interval_ns: u64,
            ambient_c: f64,
            ramp_c_per_s: f64,
            chain: Chain,
            noise: Noise,
        }
        let SimulatedStation { interval_ns, ambient_c, ramp_c_per_s, .. } = station;
        let schedule = StationSchedule { interval_ns, ambient_c, ramp_c_per_s, chain, noise };
        let mut files = SimulatedFiles::default();
        for (imu, truth) in station.imus.iter().zip(&truths) {
            let text = truth_toml(truth, "isotherm simulate station", imu.seed, &schedule)?;
            files.add(folder.join(&imu.truth), &text)?;
        }
        files.add(folder.join("plan.toml"), &station.plan_toml(&truths).unwrap_or_default())?;
        files.finish()?;
        let program = std::env::current_exe();
        let program = program
            .map_err(|error| Failure::new(Exit::Failed, format!("starting the station's processes: {error}")))?;
        let part = |part: StationProcess| {
            let mut command = Command::new(&program);
            command.args(["--domain", domain.name(), "simulate", "station-part", part.into()]);
            command.arg(&folder).args(["--parent", &std::process::id().to_string()]);
            command
        };
        station.run(&folder, &self.fault, &ended, part, || announce(&station, &folder))
    }

    /// Creates the output folder if it is not there. Returns its absolute path, for links and plans.
    fn folder(&self) -> Result<PathBuf, Failure> {
        let folder = &self.imu.output;
        let failed = |error: io::Error| Failure::io("making", folder, &error);
        create_own_folder(folder).and_then(|()| fs::canonicalize(folder)).map_err(failed)
    }
}

/// Prints the ports and the next commands.
fn announce(station: &SimulatedStation, folder: &Path) -> Result<(), Failure> {
    let folder = shown(folder);
    let imus = station.imus.iter().map(|StationImu { id, .. }| format!(" --imu {id}={folder}/{id}.toml"));
    let imus: String = imus.collect();
    print(&format!(
        "chamber {}\ntable {}\n\
         next: isotherm serve --allow-uncalibrated{imus}\n\
         and:  isotherm campaign run --speed {} {folder}/plan.toml\n\
         ready\n",
        station.chamber_port, station.table_port, station.speed
    ))
}
