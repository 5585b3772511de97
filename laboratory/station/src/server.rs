//! The process of a device: it answers requests on its port, with the injected faults.

use super::faults::{FaultSchedule, InjectedFault};
use super::link::{DeviceReply, LinkServer};
use super::port::SimulatedPort;
use super::station::{SimulatedStation, StationProcess};
use super::wire::{BABBLE, BABBLE_INTERVAL, LATE_REPLY, Wire};
use isotherm_support::failure::{Exit, Failure};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::fs::OpenOptions;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How often the faults are checked while nothing happens.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Name of the file in a station's folder that gets all requests, if it exists.
const REQUESTS: &str = "requests";

/// Serves until the IMU's process has ended.
///
/// # Errors
/// If the port cannot be created or used.
pub(crate) fn serve(
    process: StationProcess,
    wire: Box<dyn Wire>,
    station: &SimulatedStation,
    port: &str,
    folder: &Path,
) -> Result<(), Failure> {
    let failed = |error: io::Error| {
        Failure::new(Exit::Io, format!("the simulated {} at {port}: {error}", <&str>::from(process)))
    };
    let mut server = ProtocolServer {
        wire,
        name: process.into(),
        station,
        requests: folder.join(REQUESTS),
        state: LineState::Normal,
        port: SimulatedPort::new(port).map_err(failed)?,
        link: LinkServer::new(io::stdin()).map_err(failed)?,
        faults: FaultSchedule::new(folder, process),
        delayed: Vec::new(),
    };
    while server.poll_once().map_err(failed)? {}
    Ok(())
}

/// What the faults make of the line itself.
#[derive(Clone, Copy, Eq, PartialEq)]
enum LineState {
    Normal,
    Babble,
    Dead,
    Lost,
}

struct ProtocolServer<'a> {
    wire: Box<dyn Wire>,
    name: &'static str,
    station: &'a SimulatedStation,
    /// The file that gets the requests.
    requests: PathBuf,
    state: LineState,
    port: SimulatedPort,
    link: LinkServer,
    faults: FaultSchedule,
    /// Delayed replies, with the time at which they are sent.
    delayed: Vec<(Instant, Vec<u8>)>,
}

impl ProtocolServer<'_> {
    /// Waits for input, a question of the IMU or a time-out, and handles it. Returns `false` if the IMU's process has
    /// ended.
    fn poll_once(&mut self) -> io::Result<bool> {
        let [query_waits, input_waits] = self.wait()?;
        let (_, active) = self.advance();
        self.change_state(&active)?;
        if matches!(self.state, LineState::Normal | LineState::Babble) {
            if input_waits {
                self.port.read(self.wire.input())?;
            }
            while let Some(request) = self.wire.take_request() {
                self.reply(&request);
            }
        }
        if self.state == LineState::Babble {
            self.port.write(BABBLE);
        }
        for (due, reply) in std::mem::take(&mut self.delayed) {
            if due > Instant::now() {
                self.delayed.push((due, reply));
            } else {
                self.port.write(&reply);
            }
        }
        if query_waits {
            // The answer comes last, so that all later events have later times.
            let (now_s, _) = self.advance();
            return self.link.answer(&DeviceReply { now_s, events: self.wire.events() });
        }
        Ok(true)
    }

    /// Waits for a question of the IMU, for input or for the next moment at which something is to be done. Returns
    /// whether a question waits, and whether input does.
    fn wait(&self) -> io::Result<[bool; 2]> {
        let next = self.delayed.iter().map(|(due, _)| due.saturating_duration_since(Instant::now())).min();
        let limit = if self.state == LineState::Babble { BABBLE_INTERVAL } else { POLL_INTERVAL };
        let timeout = Timespec::try_from(next.unwrap_or(limit).min(limit)).map_err(io::Error::other)?;
        let mut ready = vec![PollFd::new(&self.link.0, PollFlags::IN)];
        // Nobody looks at a dead port.
        let port = self.port.readable().filter(|_| self.state != LineState::Dead);
        ready.extend(port.as_ref().map(|port| PollFd::new(port, PollFlags::IN)));
        match poll(&mut ready, Some(&timeout)) {
            Ok(_) | Err(rustix::io::Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
        Ok([0, 1].map(|index| ready.get(index).is_some_and(|ready| !ready.revents().is_empty())))
    }

    /// Loses the port, makes it dead, or brings it back.
    fn change_state(&mut self, active: &[InjectedFault]) -> io::Result<()> {
        let before = self.state;
        let states = [
            (InjectedFault::PortLoss, LineState::Lost),
            (InjectedFault::Dead, LineState::Dead),
            (InjectedFault::Babble, LineState::Babble),
        ];
        let state = states.iter().find(|(fault, _)| active.contains(fault));
        self.state = state.map_or(LineState::Normal, |(_, state)| *state);
        if matches!(self.state, LineState::Lost | LineState::Dead) {
            self.wire.input().clear();
            self.delayed.clear();
        }
        if self.state == LineState::Lost {
            self.port.lose();
            return Ok(());
        }
        self.port.restore()?;
        if (self.state == LineState::Dead) != (before == LineState::Dead) {
            self.port.set_dead(self.state == LineState::Dead)?;
        }
        Ok(())
    }

    /// Brings the device to the present. Returns the simulated time and the faults that are active.
    fn advance(&mut self) -> (f64, Vec<InjectedFault>) {
        let now_s = self.station.now_s();
        let active = self.faults.active(now_s);
        self.wire.advance(now_s, &active);
        (now_s, active)
    }

    /// Appends a request to the file of requests, if somebody has made one.
    fn note(&self, request: &[u8]) {
        if let Ok(mut file) = OpenOptions::new().append(true).open(&self.requests) {
            let line = format!("{:.3} {} {}\n", self.station.now_s(), self.name, request.escape_ascii());
            // A full disk does not stop the laboratory.
            let _ = file.write_all(line.as_bytes());
        }
    }

    fn reply(&mut self, request: &[u8]) {
        self.faults.count_request();
        let (_, active) = self.advance();
        self.note(request);
        let reply = self.wire.answer(request, &active);
        if active.contains(&InjectedFault::Late) {
            self.delayed.push((Instant::now() + LATE_REPLY, reply));
        } else {
            self.port.write(&reply);
        }
    }
}
