//! The process of a machine: requests in, replies out, with the faults that are asked for.

use super::faults::{Faults, What};
use super::link::{Answer, Answering, Event};
use super::port::Port;
use super::{Part, SimulatedStation};
use isotherm_failure::{Exit, Failure};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::io;
use std::path::Path;
use std::time::{Duration, Instant};

/// A late reply comes after the time-out of the station's plan, and before the line would be quiet.
pub const LATE: Duration = Duration::from_millis(1500);
/// How often the faults are looked at while nothing happens.
const LOOK: Duration = Duration::from_millis(20);
/// Longest input that is no request.
const MAX_INPUT: usize = 4096;

/// The physics of a machine.
pub trait Machine {
    /// Goes on to `now_s`; `active` is what goes wrong.
    fn advance(&mut self, now_s: f64, active: &[What]);
    /// What it has begun to do since it was last asked.
    fn events(&mut self) -> Vec<(f64, Event)>;
}

/// What a machine speaks.
pub trait Speaker<M> {
    /// Takes the first whole request out of the input.
    fn take(&mut self, input: &mut Vec<u8>) -> Option<Vec<u8>>;
    /// Does what a request asks for; the reply's bytes, none for none.
    fn answer(&mut self, request: &[u8], machine: &mut M) -> Vec<u8>;
    /// Refuses a request; none if the protocol has no way to.
    fn refuse(&self, request: &[u8]) -> Vec<u8>;
}

/// Serves until the IMU's process has gone.
///
/// # Errors
/// If the port cannot be made.
pub fn serve<M: Machine>(
    part: Part,
    machine: M,
    speaker: Box<dyn Speaker<M>>,
    station: &SimulatedStation,
    port: &str,
    folder: &Path,
) -> Result<(), Failure> {
    let failed = |error: io::Error| Failure::new(Exit::Io, format!("the simulated {} at {port}: {error}", part.name()));
    let mut server = Server {
        machine,
        speaker,
        station,
        port: Port::new(port).map_err(failed)?,
        link: Answering::new(io::stdin()).map_err(failed)?,
        faults: Faults::new(folder, part),
        input: Vec::new(),
        late: Vec::new(),
    };
    while server.turn().map_err(failed)? {}
    Ok(())
}

struct Server<'a, M> {
    machine: M,
    speaker: Box<dyn Speaker<M>>,
    station: &'a SimulatedStation,
    port: Port,
    link: Answering,
    faults: Faults,
    input: Vec<u8>,
    /// Replies that wait, with their time.
    late: Vec<(Instant, Vec<u8>)>,
}

impl<M: Machine> Server<'_, M> {
    /// Waits for something and does it. `false` if the IMU has gone.
    fn turn(&mut self) -> io::Result<bool> {
        let next = self.late.iter().map(|(due, _)| due.saturating_duration_since(Instant::now())).min();
        let timeout = Timespec::try_from(next.unwrap_or(LOOK).min(LOOK)).map_err(io::Error::other)?;
        let mut ready = vec![PollFd::new(&self.link.0, PollFlags::IN)];
        let port = self.port.readable();
        ready.extend(port.as_ref().map(|port| PollFd::new(port, PollFlags::IN)));
        match poll(&mut ready, Some(&timeout)) {
            Ok(_) | Err(rustix::io::Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
        let asked = !ready[0].revents().is_empty();
        let came = ready.get(1).is_some_and(|port| !port.revents().is_empty());

        let active = self.advance();
        if active.contains(&What::PortLoss) {
            self.port.lose();
            self.input.clear();
            self.late.clear();
        } else {
            self.port.restore()?;
            if came {
                self.port.read(&mut self.input)?;
            }
            while let Some(request) = self.speaker.take(&mut self.input) {
                self.reply(&request);
            }
            if self.input.len() > MAX_INPUT {
                self.input.clear();
            }
        }
        for (due, reply) in std::mem::take(&mut self.late) {
            if due > Instant::now() {
                self.late.push((due, reply));
            } else {
                self.port.write(&reply);
            }
        }
        if asked {
            // After all else, so that what happens from here on happens later.
            let now_s = self.station.now_s();
            let active = self.faults.active(now_s);
            self.machine.advance(now_s, &active);
            return self.link.answer(&Answer { now_s, events: self.machine.events() });
        }
        Ok(true)
    }

    fn advance(&mut self) -> Vec<What> {
        let now_s = self.station.now_s();
        let active = self.faults.active(now_s);
        self.machine.advance(now_s, &active);
        active
    }

    fn reply(&mut self, request: &[u8]) {
        self.faults.count();
        let active = self.advance();
        let is = |what| active.contains(&what);
        let mut reply =
            if is(What::Na) { self.speaker.refuse(request) } else { self.speaker.answer(request, &mut self.machine) };
        if is(What::Missing) {
            return;
        }
        if is(What::Garbled) {
            // Line ends are left, so that a reply is still one.
            let bytes = reply.iter_mut().filter(|byte| !matches!(**byte, b'\r' | b'\n'));
            bytes.step_by(3).for_each(|byte| *byte = 0xff);
        }
        if is(What::Duplicated) {
            reply.extend_from_within(..);
        }
        if is(What::Late) {
            self.late.push((Instant::now() + LATE, reply));
        } else {
            self.port.write(&reply);
        }
    }
}
