//! Starts a station, its files and its processes, and supervises them.

use crate::faults::FAULTS;
use crate::station::{SimulatedStation, StationProcess};
use isotherm_files::replace;
use isotherm_support::failure::{Exit, Failure};
use rustix::process::{Pid, Signal, getppid, kill_process, set_parent_process_death_signal};
use std::io::{self, BufRead as _, BufReader};
use std::net::TcpListener;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use std::{fs, process, thread};

/// Longest time until the processes are ready, and until they have ended.
const START: Duration = Duration::from_secs(20);
const END: Duration = Duration::from_secs(5);
/// How often the processes are checked.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// TCP ports of stations, in pairs.
const FIRST_PORT: u32 = 10_000;
const PORT_PAIRS: u32 = 10_000;
/// The file that describes a station, in its folder.
pub(crate) const DESCRIPTION: &str = "station.json";

impl SimulatedStation {
    /// Runs the station in `folder` until `ended` is set or one of its processes ends.
    ///
    /// `command_of` returns the command of a process of the station. That process calls [`end_with_parent`], then
    /// [`SimulatedStation::run_process`]. `ready` is called when both ports exist.
    ///
    /// # Errors
    /// If the station cannot start, or one of its processes has ended.
    pub fn run(
        &self,
        folder: &Path,
        faults: &[String],
        ended: &AtomicBool,
        command_of: impl Fn(StationProcess) -> Command,
        ready: impl FnOnce() -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let write = |name: &str, text: &str| {
            let path = folder.join(name);
            replace(&path, text).map_err(|error| Failure::io("writing", &path, &error))
        };
        write(DESCRIPTION, &(serde_json::to_string_pretty(self).unwrap_or_default() + "\n"))?;
        write(FAULTS, &faults.iter().map(|fault| format!("{fault}\n")).collect::<String>())?;
        let result = Processes::start(command_of).and_then(|mut processes| {
            if processes.wait_for_ports(self, ended)? {
                ready()?;
            }
            processes.watch(ended)
        });
        for name in ["chamber", "table", FAULTS, DESCRIPTION] {
            // Fails for the links if the ports are TCP.
            let _ = fs::remove_file(folder.join(name));
        }
        result
    }
}

/// Makes this process end when its parent ends. Returns false if the parent, with the process id `parent`, has already
/// ended.
///
/// # Errors
/// If the operating system refuses.
pub fn end_with_parent(parent: u32) -> Result<bool, Failure> {
    let result = set_parent_process_death_signal(Some(Signal::TERM));
    result.map_err(|error| Failure::new(Exit::Failed, format!("following the station's process: {error}")))?;
    // The parent may have ended before the call.
    Ok(getppid().map(|pid| pid.as_raw_nonzero().get().cast_unsigned()) == Some(parent))
}

/// Two free TCP ports of this machine for a station, as `tcp://127.0.0.1:port`.
///
/// The kernel gives ports from 32 768 upwards to every program that asks for none by number. These are below, another
/// pair for each process id: no other program takes a port while its simulated device is away.
///
/// # Errors
/// If no pair is free.
pub fn free_ports() -> Result<[String; 2], Failure> {
    let free = |port: u32| TcpListener::bind(format!("127.0.0.1:{port}")).is_ok();
    let mut pairs = (0..PORT_PAIRS).map(|step| FIRST_PORT + (process::id() % PORT_PAIRS + step) % PORT_PAIRS * 2);
    let Some(port) = pairs.find(|port| free(*port) && free(port + 1)) else {
        return Err(Failure::new(Exit::Io, "no two TCP ports from 10000 to 29999 are free"));
    };
    Ok([port, port + 1].map(|port| format!("tcp://127.0.0.1:{port}")))
}

/// The processes of a station. Dropping this ends them.
struct Processes(Vec<(StationProcess, Child)>);

impl Processes {
    /// Starts them. The IMU's standard input and output are sockets to the two devices.
    fn start(command_of: impl Fn(StationProcess) -> Command) -> Result<Self, Failure> {
        let failed =
            |error: io::Error| Failure::new(Exit::Failed, format!("starting the station's processes: {error}"));
        let ((to_chamber, chamber), (to_table, table)) = (pair().map_err(failed)?, pair().map_err(failed)?);
        let mut processes = Self(Vec::new());
        for (process, input, output) in [
            (StationProcess::Chamber, chamber, None),
            (StationProcess::Turntable, table, None),
            (StationProcess::Imu, to_chamber, Some(to_table)),
        ] {
            let mut command = command_of(process);
            command.stdin(input).stdout(output.map_or_else(Stdio::null, Stdio::from));
            processes.0.push((process, command.spawn().map_err(failed)?));
        }
        Ok(processes)
    }

    /// Waits until both ports exist. Returns false if `ended` is set before.
    fn wait_for_ports(&mut self, station: &SimulatedStation, ended: &AtomicBool) -> Result<bool, Failure> {
        let begun = Instant::now();
        let exists = |port: &String| match port.strip_prefix("tcp://") {
            Some(address) => listens(address),
            None => Path::new(port).exists(),
        };
        while ![&station.chamber_port, &station.table_port].into_iter().all(exists) {
            self.check()?;
            if begun.elapsed() > START {
                return Err(Failure::new(
                    Exit::Failed,
                    "the station's ports were not created in time; the machine may be overloaded",
                ));
            }
            if ended.load(Ordering::Relaxed) {
                return Ok(false);
            }
            thread::sleep(POLL_INTERVAL);
        }
        Ok(true)
    }

    /// Waits until `ended` is set; an error if one of the processes has ended.
    fn watch(&mut self, ended: &AtomicBool) -> Result<(), Failure> {
        while !ended.load(Ordering::Relaxed) {
            self.check()?;
            thread::sleep(POLL_INTERVAL);
        }
        Ok(())
    }

    fn check(&mut self) -> Result<(), Failure> {
        for (process, child) in &mut self.0 {
            if let Ok(Some(status)) = child.try_wait() {
                return Err(Failure::new(
                    Exit::Failed,
                    format!("the simulated {} has ended, {status}", <&str>::from(*process)),
                ));
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
                thread::sleep(POLL_INTERVAL);
            }
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn pair() -> io::Result<(OwnedFd, OwnedFd)> {
    let (first, second) = UnixStream::pair()?;
    Ok((first.into(), second.into()))
}

/// Whether a process listens on this address, from the kernel's table. A test connection would occupy the only one that
/// a device accepts.
fn listens(address: &str) -> bool {
    let Some(port) = address.rsplit_once(':').and_then(|(_, port)| port.parse::<u16>().ok()) else { return false };
    let Ok(file) = fs::File::open("/proc/net/tcp") else { return true };
    // Port of the local address, remote address, state 0A (listening).
    let local = format!(":{port:04X} 00000000:0000 0A");
    BufReader::new(file).lines().map_while(Result::ok).any(|line| line.contains(&local))
}
