//! `isotherm simulate station`: makes the folder, starts the processes, watches over them and cleans up.

use super::simulate::{Common, write_text, write_truth};
use crate::failure::{Exit, Failure};
use crate::station::faults::Injection;
use crate::station::{ChamberProtocol, Part, Station as Parts, TableProtocol};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use isotherm_calibration::simulate::{Chain, Noise, Truth};
use isotherm_client::{Domain, monotonic_ns};
use rustix::process::{Pid, Signal, getppid, kill_process, set_parent_process_death_signal};
use serde::Serialize;
use std::fs;
use std::io::{self, BufRead as _, BufReader, Write as _};
use std::net::TcpListener;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// How long a process may take to be ready, and to end.
const START: Duration = Duration::from_secs(20);
const END: Duration = Duration::from_secs(5);
/// How often the processes are looked at.
const LOOK: Duration = Duration::from_millis(20);

/// A laboratory: chamber, table and IMU as processes of their own, until SIGTERM or SIGINT
///
/// Chamber and table speak their protocols on pseudo-terminals DIR/chamber and DIR/table, or over TCP; the IMU publishes to the running
/// service. DIR/plan.toml is a campaign plan for it, DIR/truth.toml the IMU's coefficients. Write faults into DIR/faults to have them.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm simulate station -o station --imu imu-a --speed 100\n  isotherm simulate station -o station --imu imu-a --chamber watlow-f4t --table aerosmith --tcp\n  isotherm simulate station -o station --imu imu-a --fault late:table@3-5 --fault never-there@7200s-9000s\n  echo port-loss:chamber > station/faults"
)]
pub struct Station {
    #[command(flatten)]
    common: Common,
    /// What the chamber speaks
    #[arg(long, value_name = "DRIVER", default_value = ChamberProtocol::NAMES[0].1, value_parser = PossibleValuesParser::new(ChamberProtocol::NAMES.map(|(_, name)| name)).map(|name| named(&ChamberProtocol::NAMES, &name)))]
    chamber: ChamberProtocol,
    /// What the table speaks
    #[arg(long, value_name = "DRIVER", default_value = TableProtocol::NAMES[0].1, value_parser = PossibleValuesParser::new(TableProtocol::NAMES.map(|(_, name)| name)).map(|name| named(&TableProtocol::NAMES, &name)))]
    table: TableProtocol,
    /// Ports on 127.0.0.1 instead of pseudo-terminals
    #[arg(long)]
    tcp: bool,
    /// Simulated seconds in a second
    #[arg(long, value_name = "N", default_value_t = 1.0, value_parser = speed)]
    speed: f64,
    /// Control period of the IMU, simulated [s]
    #[arg(long, value_name = "S", default_value = "1", value_parser = super::parse::interval)]
    interval: Duration,
    /// The telemetry is read so often, simulated [s]; 0 for every sample
    #[arg(long, value_name = "S", default_value_t = 10.0, value_parser = super::parse::size)]
    telemetry_every: f64,
    /// Error of the table's angles after each move, one sigma [arcsec]
    #[arg(long, value_name = "ARCSEC", default_value_t = 1.0, value_parser = super::parse::size)]
    positioning: f64,
    /// Temperature of the laboratory, and of everything at the beginning [degC]
    #[arg(long, value_name = "DEGC", default_value_t = 20.0, allow_hyphen_values = true)]
    ambient: f64,
    /// The chamber's fastest ramp [degC/min]
    #[arg(long, value_name = "DEGC/MIN", default_value_t = 3.0, value_parser = ramp)]
    chamber_ramp: f64,
    /// A fault, WHAT[:chamber|:table][@WHEN]
    ///
    /// WHAT is garbled, late, missing, duplicated, na, alarm, port-loss, no-settle, overshoot or never-there; WHEN is 3 for the third
    /// request, 3-5 for the third to the fifth, 100s-200s for simulated seconds, always unless given
    #[arg(long, value_name = "WHAT@WHEN", value_parser = fault)]
    fault: Vec<String>,
}

/// One process of a station
#[derive(Debug, Args)]
pub struct StationPart {
    /// Which
    #[arg(value_parser = PossibleValuesParser::new(Part::NAMES.map(|(_, name)| name)).map(|name| named(&Part::NAMES, &name)))]
    part: Part,
    /// The station's folder
    folder: PathBuf,
    /// The station's process
    #[arg(long)]
    parent: u32,
}

fn named<T: Copy>(names: &[(T, &str)], name: &str) -> T {
    names.iter().find(|(_, n)| *n == name).map_or(names[0].0, |(value, _)| *value)
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
    pub fn run(self, domain: Domain) -> Result<(), Failure> {
        let alone = set_parent_process_death_signal(Some(Signal::TERM));
        alone.map_err(|error| Failure::new(Exit::Failed, format!("following the station's process: {error}")))?;
        // It may have gone before that.
        if getppid().map(|pid| pid.as_raw_nonzero().get().cast_unsigned()) != Some(self.parent) {
            return Ok(());
        }
        Parts::run(self.part, &self.folder, domain)
    }
}

impl Station {
    pub fn run(self, domain: &Domain) -> Result<(), Failure> {
        let ended = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP] {
            let handled = signal_hook::flag::register(signal, Arc::clone(&ended));
            handled.map_err(|error| Failure::new(Exit::Failed, format!("handling signals: {error}")))?;
        }
        let folder = self.folder()?;
        let truth = self.common.truth()?;
        let (chain, noise) = self.common.chain_and_noise(&truth, self.telemetry_every)?;
        let noise = Noise { positioning_rad: (self.positioning / 3600.0).to_radians(), ..noise };
        let [chamber_port, table_port] = if self.tcp {
            [free_port()?, free_port()?]
        } else {
            ["chamber", "table"].map(|name| folder.join(name).display().to_string())
        };
        let station = Parts {
            imu: truth.table.content().imu.to_string(),
            chamber: self.chamber,
            chamber_port,
            table: self.table,
            table_port,
            speed: self.speed,
            origin_ns: monotonic_ns(),
            interval_ns: self.interval.as_nanos() as u64,
            seed: self.common.seed,
            ambient_c: self.ambient,
            ramp_c_per_s: self.chamber_ramp / 60.0,
            tilt_rad: truth.tilt_rad,
            gravity_local: truth.gravity_local,
            chain,
            noise,
        };
        #[derive(Serialize)]
        struct Schedule {
            interval_ns: u64,
            ambient_c: f64,
            ramp_c_per_s: f64,
            chain: Chain,
            noise: Noise,
        }
        let Parts { interval_ns, ambient_c, ramp_c_per_s, .. } = station;
        let schedule = Schedule { interval_ns, ambient_c, ramp_c_per_s, chain, noise };
        write_truth(&folder, &truth, "isotherm simulate station", self.common.seed, &schedule)?;
        write_text(&folder, "plan.toml", &plan(&station, &truth))?;
        let json = serde_json::to_string_pretty(&station).unwrap_or_default();
        write_text(&folder, "station.json", &(json + "\n"))?;
        let faults: String = self.fault.iter().map(|fault| format!("{fault}\n")).collect();
        let faults_path = folder.join("faults");
        fs::write(&faults_path, faults).map_err(|error| Failure::io("writing", &faults_path, &error))?;

        let result = Processes::start(&folder, domain).and_then(|mut processes| {
            processes.ready(&station, &ended)?;
            tell(&station, &folder)?;
            processes.watch(&ended)
        });
        for name in ["chamber", "table", "faults", "station.json"] {
            // Over TCP there are no links.
            let _ = fs::remove_file(folder.join(name));
        }
        result
    }

    /// Made if it is not there; as an absolute path, for links and plans.
    fn folder(&self) -> Result<PathBuf, Failure> {
        let folder = &self.common.output;
        fs::create_dir_all(folder).map_err(|error| Failure::io("making", folder, &error))?;
        fs::canonicalize(folder).map_err(|error| Failure::io("making", folder, &error))
    }
}

/// A port that nobody has now.
fn free_port() -> Result<String, Failure> {
    let bound = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
    let address = bound.map_err(|error| Failure::new(Exit::Io, format!("finding a free TCP port: {error}")))?;
    Ok(format!("tcp://{address}"))
}

/// The plan of a whole campaign at this station.
fn plan(station: &Parts, truth: &Truth) -> String {
    let content = truth.table.content();
    let quoted = |text: &str| toml::Value::from(text).to_string();
    let chamber = named_as(&ChamberProtocol::NAMES, station.chamber);
    let table = named_as(&TableProtocol::NAMES, station.table);
    let table_keys = match station.table {
        TableProtocol::Acutrol if station.table_port.starts_with("tcp://") => "gap_s = 0.005\n",
        TableProtocol::Acutrol => "",
        TableProtocol::Aerosmith => "fault_mask = 4\n",
    };
    let chamber_keys = match station.chamber {
        ChamberProtocol::Espec => "",
        // A simulated line needs no pause.
        ChamberProtocol::WatlowF4t => "pause_s = 0\n",
        ChamberProtocol::Ascii2 => "alarm_bit = 2\n",
    };
    let telemetry = station.chain.telemetry_slope.abs();
    format!(
        "# The campaign at this simulated station: isotherm campaign run --speed {} plan.toml\n\
         format = 1\nimu = \"{}\"\noutput = \"campaign\"\n\
         gravity_reference = {:?}\ngravity_local = {:?}\ntemperature_unit = {}\n\
         positions = \"six-faces-two-headings\"\ninstall = \"{}.toml\"\n\n\
         [set_points]\nstart_c = -25\nstop_c = 45\nstep_c = 5\n\n\
         [soak]\ntime_s = 3600\nstay_s = 4200\nwindow_s = 900\nchamber_c_per_h = 2\ntelemetry_per_h = {:?}\n\n\
         [dwell]\ntime_s = 300\nrow_s = 10\n\n\
         [chamber]\ndriver = \"{chamber}\"\nport = {}\n{chamber_keys}ramp_c_per_min = 1\ntolerance_c = 0.5\n\n\
         [table]\ndriver = \"{table}\"\nport = {}\n{table_keys}rate_deg_s = 10\nacceleration_deg_s2 = 10\n\
         tolerance_deg = 0.005\nstill_deg_s = 0.01\nsettle_s = 10\n\n\
         [limits]\nchamber_c = [-30, 50]\nouter_deg = [-5, 365]\ninner_deg = [-5, 365]\n\n\
         [safe]\nchamber = \"standby\"\n\n\
         [verify]\nruns = 3\nfrom_c = -25\nto_c = 45\nramp_c_per_h = 20\nhold_s = 1800\n",
        station.speed,
        station.imu,
        content.gravity,
        station.gravity_local,
        quoted(&content.temperature_unit),
        station.imu,
        // 0.75 degC/h.
        (telemetry * 750.0).round() / 1000.0,
        quoted(&station.chamber_port),
        quoted(&station.table_port),
    )
}

fn named_as<T: Copy + PartialEq>(names: &[(T, &'static str)], value: T) -> &'static str {
    names.iter().find(|(v, _)| *v == value).map_or("", |(_, name)| *name)
}

/// Says what to do next.
fn tell(station: &Parts, folder: &Path) -> Result<(), Failure> {
    let (imu, folder) = (&station.imu, folder.display());
    let text = format!(
        "chamber {}\ntable {}\n\
         next: isotherm serve --allow-uncalibrated --imu {imu}={folder}/{imu}.toml\n\
         and:  isotherm campaign run --speed {} {folder}/plan.toml\n\
         ready\n",
        station.chamber_port, station.table_port, station.speed
    );
    let mut stdout = io::stdout();
    super::written(None, stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()))
}

/// The processes of a station; ended with it.
struct Processes(Vec<(Part, Child)>);

impl Processes {
    /// The IMU has a socket to each machine as its standard input and output.
    fn start(folder: &Path, domain: &Domain) -> Result<Self, Failure> {
        let failed =
            |error: io::Error| Failure::new(Exit::Failed, format!("starting the station's processes: {error}"));
        let program = std::env::current_exe().map_err(failed)?;
        let ((to_chamber, chamber), (to_table, table)) = (pair().map_err(failed)?, pair().map_err(failed)?);
        let mut processes = Self(Vec::new());
        for (part, input, output) in
            [(Part::Chamber, chamber, None), (Part::Table, table, None), (Part::Imu, to_chamber, Some(to_table))]
        {
            let mut command = Command::new(&program);
            command.args(["--domain", domain.name(), "simulate", "station-part", part.name()]);
            command.arg(folder).args(["--parent", &std::process::id().to_string()]);
            command.stdin(input).stdout(output.map_or_else(Stdio::null, Stdio::from));
            processes.0.push((part, command.spawn().map_err(failed)?));
        }
        Ok(processes)
    }

    /// Waits until both ports are there.
    fn ready(&mut self, station: &Parts, ended: &AtomicBool) -> Result<(), Failure> {
        let begun = Instant::now();
        let there = |port: &String| match port.strip_prefix("tcp://") {
            Some(address) => listens(address),
            None => Path::new(port).exists(),
        };
        while ![&station.chamber_port, &station.table_port].into_iter().all(there) {
            self.look()?;
            if begun.elapsed() > START {
                return Err(Failure::new(
                    Exit::Failed,
                    "the station's ports did not come to be; the machine may be overloaded",
                ));
            }
            if ended.load(Ordering::Relaxed) {
                return Ok(());
            }
            thread::sleep(LOOK);
        }
        Ok(())
    }

    /// Until it is to end, or one of the processes has ended.
    fn watch(&mut self, ended: &AtomicBool) -> Result<(), Failure> {
        while !ended.load(Ordering::Relaxed) {
            self.look()?;
            thread::sleep(LOOK);
        }
        Ok(())
    }

    fn look(&mut self) -> Result<(), Failure> {
        for (part, child) in &mut self.0 {
            if let Ok(Some(status)) = child.try_wait() {
                return Err(Failure::new(Exit::Failed, format!("the simulated {} has ended, {status}", part.name())));
            }
        }
        Ok(())
    }
}

impl Drop for Processes {
    fn drop(&mut self) {
        for (_, child) in &self.0 {
            if let Some(pid) = Pid::from_raw(child.id().cast_signed()) {
                // Fails if it has ended already.
                let _ = kill_process(pid, Signal::TERM);
            }
        }
        let begun = Instant::now();
        for (_, child) in &mut self.0 {
            while begun.elapsed() < END && matches!(child.try_wait(), Ok(None)) {
                thread::sleep(LOOK);
            }
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn pair() -> io::Result<(OwnedFd, OwnedFd)> {
    let (ours, theirs) = UnixStream::pair()?;
    Ok((ours.into(), theirs.into()))
}

/// Whether somebody listens: asked of the system, a connection would be one of the few that a machine takes.
fn listens(address: &str) -> bool {
    let Some(port) = address.rsplit_once(':').and_then(|(_, port)| port.parse::<u16>().ok()) else { return false };
    let Ok(file) = fs::File::open("/proc/net/tcp") else { return true };
    // local address, remote address, state 0A: listening.
    let local = format!(":{port:04X} 00000000:0000 0A");
    BufReader::new(file).lines().map_while(Result::ok).any(|line| line.contains(&local))
}
