//! Starting a station: its files, its processes, and the watch over them.

use crate::faults::FAULTS;
use crate::{Part, SimulatedStation};
use isotherm_failure::{Exit, Failure};
use isotherm_files::replace;
use rustix::process::{Pid, Signal, getppid, kill_process, set_parent_process_death_signal};
use std::fs;
use std::io::{self, BufRead as _, BufReader};
use std::net::TcpListener;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// How long a process may take to be ready, and to end.
const START: Duration = Duration::from_secs(20);
const END: Duration = Duration::from_secs(5);
/// How often the processes are looked at.
const LOOK: Duration = Duration::from_millis(20);
/// The file that describes a station, in its folder.
pub(crate) const DESCRIPTION: &str = "station.json";

impl SimulatedStation {
    /// Runs the station in `folder` until `ended` is set, one of its processes ends, or starting fails.
    ///
    /// `part` gives the command that is one process of the station: [`follow`] and then [`SimulatedStation::run_part`]. `ready` is called when both
    /// ports are there.
    ///
    /// # Errors
    /// Why it could not start or go on.
    pub fn run(
        &self,
        folder: &Path,
        faults: &[String],
        ended: &AtomicBool,
        part: impl Fn(Part) -> Command,
        ready: impl FnOnce() -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let write = |name: &str, text: &str| {
            let path = folder.join(name);
            replace(&path, text).map_err(|error| Failure::io("writing", &path, &error))
        };
        write(DESCRIPTION, &(serde_json::to_string_pretty(self).unwrap_or_default() + "\n"))?;
        write(FAULTS, &faults.iter().map(|fault| format!("{fault}\n")).collect::<String>())?;
        let result = Processes::start(part).and_then(|mut processes| {
            if processes.wait_for_ports(self, ended)? {
                ready()?;
            }
            processes.watch(ended)
        });
        for name in ["chamber", "table", FAULTS, DESCRIPTION] {
            // Over TCP there are no links.
            let _ = fs::remove_file(folder.join(name));
        }
        result
    }
}

/// Ends this process with its parent, which has the process id `parent`; false if that has gone already.
///
/// # Errors
/// If the operating system refuses.
pub fn follow(parent: u32) -> Result<bool, Failure> {
    let alone = set_parent_process_death_signal(Some(Signal::TERM));
    alone.map_err(|error| Failure::new(Exit::Failed, format!("following the station's process: {error}")))?;
    // It may have gone before that.
    Ok(getppid().map(|pid| pid.as_raw_nonzero().get().cast_unsigned()) == Some(parent))
}

/// A TCP port of this machine that nobody has now, as `tcp://127.0.0.1:port`.
///
/// # Errors
/// If there is none.
pub fn free_port() -> Result<String, Failure> {
    let bound = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
    let address = bound.map_err(|error| Failure::new(Exit::Io, format!("finding a free TCP port: {error}")))?;
    Ok(format!("tcp://{address}"))
}

/// The processes of a station; ended with it.
struct Processes(Vec<(Part, Child)>);

impl Processes {
    /// The IMU has a socket to each machine as its standard input and output.
    fn start(part: impl Fn(Part) -> Command) -> Result<Self, Failure> {
        let failed =
            |error: io::Error| Failure::new(Exit::Failed, format!("starting the station's processes: {error}"));
        let ((to_chamber, chamber), (to_table, table)) = (pair().map_err(failed)?, pair().map_err(failed)?);
        let mut processes = Self(Vec::new());
        for (which, input, output) in
            [(Part::Chamber, chamber, None), (Part::Turntable, table, None), (Part::Imu, to_chamber, Some(to_table))]
        {
            let mut command = part(which);
            command.stdin(input).stdout(output.map_or_else(Stdio::null, Stdio::from));
            processes.0.push((which, command.spawn().map_err(failed)?));
        }
        Ok(processes)
    }

    /// Waits until both ports are there; false if it is to end before.
    fn wait_for_ports(&mut self, station: &SimulatedStation, ended: &AtomicBool) -> Result<bool, Failure> {
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
                return Ok(false);
            }
            thread::sleep(LOOK);
        }
        Ok(true)
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
