//! The process of a device: it answers requests on its port, with the injected faults.

use super::faults::{FaultSchedule, InjectedFault};
use super::link::{Answer, DeviceEvent, LinkServer};
use super::port::SimulatedPort;
use super::station::{SimulatedStation, StationProcess};
use isotherm_failure::{Exit, Failure};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::fs::OpenOptions;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Delay of a late reply: more than the plan's time-out, less than time-out plus `quiet_s`.
pub(crate) const LATE_REPLY: Duration = Duration::from_millis(1500);
/// How often the faults are checked while nothing happens.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// How often a device that babbles sends, and what.
const BABBLE_INTERVAL: Duration = Duration::from_millis(2);
const BABBLE: &[u8] = b"27182818284590452353602874713526";
/// Name of the file in a station's folder that gets all requests, if it exists.
const REQUESTS: &str = "requests";
/// Longest input without a complete request \[bytes\].
const MAX_INPUT: usize = 4096;

/// The physics of a device.
pub(crate) trait SimulatedDevice {
    /// Advances to `now_s`; `active` has the faults that are active.
    fn advance(&mut self, now_s: f64, active: &[InjectedFault]);
    /// Takes the events since the last call.
    fn events(&mut self) -> Vec<(f64, DeviceEvent)>;
}

/// The protocol of a device.
pub(crate) trait Protocol<M> {
    /// Takes the first complete request out of the input: a line, without its end `\r`, `\n` or `\r\n`.
    fn take_request(&mut self, input: &mut Vec<u8>) -> Option<Vec<u8>> {
        let blank = input.iter().take_while(|byte| matches!(byte, b'\r' | b'\n')).count();
        input.drain(..blank);
        let end = input.iter().position(|byte| matches!(byte, b'\r' | b'\n'))?;
        Some(input.drain(..=end).take(end).collect())
    }
    /// Executes a request and returns the reply; empty if there is no reply.
    fn answer(&mut self, request: &[u8], device: &mut M) -> Vec<u8>;
    /// The reply that refuses a request; empty if the protocol has none.
    fn refuse(&self, request: &[u8]) -> Vec<u8>;
}

/// Serves until the IMU's process has ended.
///
/// # Errors
/// If the port cannot be created or used.
pub(crate) fn serve<M: SimulatedDevice>(
    process: StationProcess,
    device: M,
    protocol: Box<dyn Protocol<M>>,
    station: &SimulatedStation,
    port: &str,
    folder: &Path,
) -> Result<(), Failure> {
    let failed =
        |error: io::Error| Failure::new(Exit::Io, format!("the simulated {} at {port}: {error}", process.name()));
    let mut server = ProtocolServer {
        device,
        protocol,
        name: process.name(),
        station,
        requests: folder.join(REQUESTS),
        state: LineState::Normal,
        port: SimulatedPort::new(port).map_err(failed)?,
        link: LinkServer::new(io::stdin()).map_err(failed)?,
        faults: FaultSchedule::new(folder, process),
        input: Vec::new(),
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

struct ProtocolServer<'a, M> {
    device: M,
    protocol: Box<dyn Protocol<M>>,
    name: &'static str,
    station: &'a SimulatedStation,
    /// The file that gets the requests.
    requests: PathBuf,
    state: LineState,
    port: SimulatedPort,
    link: LinkServer,
    faults: FaultSchedule,
    input: Vec<u8>,
    /// Delayed replies, with the time at which they are sent.
    delayed: Vec<(Instant, Vec<u8>)>,
}

impl<M: SimulatedDevice> ProtocolServer<'_, M> {
    /// Waits for input, a question of the IMU or a time-out, and handles it. Returns `false` if the IMU's process has
    /// ended.
    fn poll_once(&mut self) -> io::Result<bool> {
        let [query_waits, input_waits] = self.wait()?;
        let (_, active) = self.advance();
        self.change_state(&active)?;
        if matches!(self.state, LineState::Normal | LineState::Babble) {
            if input_waits {
                self.port.read(&mut self.input)?;
            }
            while let Some(request) = self.protocol.take_request(&mut self.input) {
                self.reply(&request);
            }
            if self.input.len() > MAX_INPUT {
                self.input.clear();
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
            return self.link.answer(&Answer { now_s, events: self.device.events() });
        }
        Ok(true)
    }

    /// Waits for a question of the IMU, for input or for the next moment at which something is to be done. Returns
    /// whether a question waits, and whether input does.
    fn wait(&self) -> io::Result<[bool; 2]> {
        let next = self.delayed.iter().map(|(due, _)| due.saturating_duration_since(Instant::now())).min();
        let most = if self.state == LineState::Babble { BABBLE_INTERVAL } else { POLL_INTERVAL };
        let timeout = Timespec::try_from(next.unwrap_or(most).min(most)).map_err(io::Error::other)?;
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
            self.input.clear();
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
        self.device.advance(now_s, &active);
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
        let is = |fault| active.contains(&fault);
        let mut reply = if is(InjectedFault::Na) {
            self.protocol.refuse(request)
        } else {
            self.protocol.answer(request, &mut self.device)
        };
        if is(InjectedFault::Missing) || is(InjectedFault::Babble) {
            return;
        }
        if is(InjectedFault::Garbled) {
            // Line ends are kept, so that it is still one reply.
            let bytes = reply.iter_mut().filter(|byte| !matches!(**byte, b'\r' | b'\n'));
            bytes.step_by(3).for_each(|byte| *byte = 0xff);
        }
        if is(InjectedFault::Duplicated) {
            reply.extend_from_within(..);
        }
        if is(InjectedFault::Late) {
            self.delayed.push((Instant::now() + LATE_REPLY, reply));
        } else {
            self.port.write(&reply);
        }
    }
}
