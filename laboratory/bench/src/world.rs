//! The clock, the lines, the devices behind them and the IMU's stream.

use crate::faults::{Fault, FaultPlan};
use isotherm_automation::samples::{SampleSource, SampleSources};
use isotherm_instruments::{LineConfig, Moment, Opening, Port, Ports, Surroundings, Time};
use isotherm_shared::stream::ImuId;
use isotherm_shared::wire::RawSample;
use isotherm_simulation::Truth;
use isotherm_simulator::wire::{BABBLE, BABBLE_INTERVAL, LATE_REPLY, Wire};
use isotherm_simulator::{DeviceEvent, InjectedFault, MountedImu, SimulatedStation};
use std::io;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The clock's reading at the begin: no time of the tests is before 0.
const BEGIN: Moment = Moment::of_ns(1_000_000_000_000);
/// Unix time at the begin \[s\].
const BEGIN_UNIX_S: f64 = 1.8e9;
/// What a look at the clock takes: no loop turns without time passing.
const LOOK: Duration = Duration::from_micros(1);
/// From a request to its reply.
const REPLY: Duration = Duration::from_millis(5);
/// From the end of a sample to its reception.
const TRANSIT: Duration = Duration::from_millis(1);
/// What somebody else orders for [`Fault::RunAway`].
const RUN_AWAY: &[u8] = b":demand:position 1,500.0\r\n:mode:position 1\r\n";
/// What an operator orders after that.
const BRING_BACK: &[u8] = b":interlock:close 1\r\n:demand:position 1,0.0\r\n:mode:position 1\r\n";
/// The signal of [`Fault::Signal`]: SIGTERM.
const SIGTERM: usize = 15;

type AtKill = Box<dyn FnOnce() -> io::Result<()> + Send>;

/// Bytes that the runner has given to a line.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// When \[s\].
    pub at_s: f64,
    /// Whether to the turntable, not the chamber.
    pub to_turntable: bool,
    /// The bytes.
    pub bytes: Vec<u8>,
}

/// Where the turntable is and what the air is, at the end of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    pub end_s: f64,
    pub sequence: u64,
    pub session: u64,
    pub angles_deg: [f64; 2],
    pub air_c: f64,
}

/// A station on a virtual clock.
#[derive(Clone)]
pub struct VirtualWorld(Arc<Mutex<State>>);

struct State {
    now: Moment,
    faults: FaultPlan,
    lines: [VirtualLine; 2],
    imu: MountedImu<'static>,
    stop_signal: Arc<AtomicUsize>,
    /// Whether the runner has been killed: nothing that it does has an effect.
    is_killed: bool,
    /// What is done at the moment of SIGKILL.
    at_kill: Option<AtKill>,
    requests: Vec<Request>,
    events: Vec<(f64, DeviceEvent)>,
    places: Vec<Place>,
}

struct VirtualLine {
    wire: Box<dyn Wire>,
    /// What is on its way to the runner, with the time at which it arrives.
    replies: Vec<(Moment, Vec<u8>)>,
}

impl VirtualWorld {
    /// The station, in equilibrium with the laboratory.
    #[must_use]
    pub fn new(station: &SimulatedStation, truth: &Truth, faults: FaultPlan) -> Self {
        let truth: &'static Truth = Box::leak(Box::new(truth.clone()));
        let imu = MountedImu::new(station, &station.imus[0], truth);
        let lines =
            [station.chamber_wire(), station.turntable_wire()].map(|wire| VirtualLine { wire, replies: Vec::new() });
        Self(Arc::new(Mutex::new(State {
            now: BEGIN,
            faults,
            lines,
            imu,
            stop_signal: Arc::default(),
            is_killed: false,
            at_kill: None,
            requests: Vec::new(),
            events: Vec::new(),
            places: Vec::new(),
        })))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // A panic of the runner is a result.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What a new runner needs. The signal of an earlier one is forgotten.
    #[must_use]
    pub fn surroundings(&self) -> Surroundings {
        let mut state = self.state();
        (state.stop_signal, state.is_killed) = (Arc::default(), false);
        let stop_signal = Arc::clone(&state.stop_signal);
        Surroundings { time: Arc::new(self.clone()), ports: Arc::new(self.clone()), stop_signal }
    }

    /// The time since the begin \[s\].
    #[must_use]
    pub fn now_s(&self) -> f64 {
        self.state().now_s()
    }

    /// Whether the runner has been killed.
    #[must_use]
    pub fn is_killed(&self) -> bool {
        self.state().is_killed
    }

    /// What is done at the moment of the runner's SIGKILL.
    pub(crate) fn at_kill(&self, done: impl FnOnce() -> io::Result<()> + Send + 'static) {
        self.state().at_kill = Some(Box::new(done));
    }

    /// Somebody brings the turntable back to 0, where it left its limits.
    pub(crate) fn bring_back(&self) {
        self.state().order(1, BRING_BACK);
    }

    /// Lets time pass without a runner \[s\].
    pub fn wait(&self, seconds: f64) {
        let mut state = self.state();
        let until = state.now + Duration::from_secs_f64(seconds);
        state.pass(until);
    }

    /// All requests so far.
    #[must_use]
    pub fn requests(&self) -> Vec<Request> {
        self.state().requests.clone()
    }

    pub(crate) fn faults(&self) -> FaultPlan {
        self.state().faults.clone()
    }

    /// What the devices have begun, in order of time, and where they were at the end of each sample.
    pub(crate) fn course(&self) -> (Vec<(f64, DeviceEvent)>, Vec<Place>) {
        let mut state = self.state();
        state.advance_imu(false);
        let mut events = state.events.clone();
        events.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        (events, state.places.clone())
    }
}

impl State {
    fn now_s(&self) -> f64 {
        self.now.since(BEGIN).as_secs_f64()
    }

    /// Time passes until this moment.
    fn pass(&mut self, until: Moment) {
        let before_s = self.now_s();
        self.now = self.now.max(until);
        let times = before_s..self.now_s();
        let happens = |event| self.faults.events(event).any(|at_s| times.contains(&at_s));
        let (signalled, killed) = (happens(Fault::Signal), happens(Fault::Killed));
        let runs_away = happens(Fault::RunAway);
        if runs_away {
            self.order(1, RUN_AWAY);
        }
        if signalled {
            self.stop_signal.store(SIGTERM, Relaxed);
        }
        if killed && let Some(at_kill) = self.at_kill.take() {
            at_kill().unwrap_or_else(|error| panic!("keeping the folder: {error}"));
            // It is not asked: what it does from now on has no effect.
            self.is_killed = true;
            self.stop_signal.store(SIGTERM, Relaxed);
        }
    }

    /// The faults of a line that are active now.
    fn active(&self, line: usize) -> Vec<InjectedFault> {
        let of_line = |fault: Fault| match (fault, line) {
            (Fault::Chamber(fault), 0) | (Fault::Turntable(fault), 1) => Some(fault),
            _ => None,
        };
        self.faults.active(self.now_s()).filter_map(of_line).collect()
    }

    fn has(&self, line: usize, fault: InjectedFault) -> bool {
        self.is_killed || self.active(line).contains(&fault)
    }

    fn advance_line(&mut self, line: usize) -> Vec<InjectedFault> {
        let (now_s, active) = (self.now_s(), self.active(line));
        let wire = &mut self.lines[line].wire;
        wire.advance(now_s, &active);
        let events = wire.events();
        self.imu.take_events(events.iter().copied());
        self.events.extend(events);
        active
    }

    fn write(&mut self, line: usize, bytes: &[u8], deadline: Moment) -> io::Result<usize> {
        if !self.is_killed {
            self.requests.push(Request { at_s: self.now_s(), to_turntable: line == 1, bytes: bytes.to_vec() });
        }
        if self.has(line, InjectedFault::PortLoss) {
            self.lines[line].replies.clear();
            return Err(io::ErrorKind::BrokenPipe.into());
        }
        if self.has(line, InjectedFault::Dead) {
            self.lines[line].replies.clear();
            self.pass(deadline);
            return Ok(0);
        }
        let active = self.advance_line(line);
        let is_cut = line == 1 && self.faults.active(self.now_s()).any(|fault| fault == Fault::CutReply);
        let due = self.now + REPLY + if active.contains(&InjectedFault::Late) { LATE_REPLY } else { Duration::ZERO };
        let VirtualLine { wire, replies } = &mut self.lines[line];
        wire.input().extend_from_slice(bytes);
        while let Some(request) = wire.take_request() {
            let mut reply = wire.answer(&request, &active);
            if is_cut {
                reply.truncate(reply.len() / 2);
            }
            replies.push((due, reply));
        }
        // What a request has begun has its time.
        self.advance_line(line);
        Ok(bytes.len())
    }

    fn read(&mut self, line: usize, buffer: &mut [u8], deadline: Moment) -> io::Result<usize> {
        if self.has(line, InjectedFault::PortLoss) {
            self.lines[line].replies.clear();
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        if self.has(line, InjectedFault::Babble) {
            let next = self.now + BABBLE_INTERVAL;
            self.pass(next.min(deadline));
            if next > deadline {
                return Ok(0);
            }
            let count = BABBLE.len().min(buffer.len());
            buffer[..count].copy_from_slice(&BABBLE[..count]);
            return Ok(count);
        }
        let replies = &self.lines[line].replies;
        let next = replies.iter().enumerate().min_by_key(|(_, (due, _))| *due);
        let next = next.filter(|(_, (due, bytes))| *due <= deadline && !bytes.is_empty());
        let Some((place, (due, _))) = next.map(|(place, reply)| (place, reply.clone())) else {
            self.lines[line].replies.retain(|(due, bytes)| *due > deadline || !bytes.is_empty());
            self.pass(deadline);
            return Ok(0);
        };
        self.pass(due);
        let bytes = &mut self.lines[line].replies[place].1;
        let count = bytes.len().min(buffer.len());
        buffer[..count].copy_from_slice(&bytes[..count]);
        bytes.drain(..count);
        if bytes.is_empty() {
            self.lines[line].replies.remove(place);
        }
        Ok(count)
    }

    /// Somebody else gives an order, at the instrument.
    fn order(&mut self, line: usize, requests: &[u8]) {
        self.advance_line(line);
        let wire = &mut self.lines[line].wire;
        let input = std::mem::replace(wire.input(), requests.to_vec());
        while let Some(request) = wire.take_request() {
            drop(wire.answer(&request, &[]));
        }
        *wire.input() = input;
        self.advance_line(line);
    }

    /// Simulates the IMU up to now. Returns the next sample, if one is wanted and there is one.
    fn advance_imu(&mut self, is_wanted: bool) -> Option<RawSample> {
        for line in [0, 1] {
            self.advance_line(line);
        }
        let known_s = self.now_s() - TRANSIT.as_secs_f64();
        while self.imu.end_s() <= known_s {
            let end_s = self.imu.end_s();
            let sample = self.imu.step();
            let (angles_deg, air_c) = self.imu.surroundings();
            let sessions = self.faults.events(Fault::Restarted).filter(|at_s| *at_s < end_s).count();
            let session = 1 + sessions as u64;
            self.places.push(Place { end_s, sequence: sample.sequence, session, angles_deg, air_c });
            let is_lost = self.faults.active(end_s).any(|fault| match fault {
                Fault::Silent => true,
                Fault::Gaps => sample.sequence.is_multiple_of(10),
                _ => false,
            });
            if is_wanted && !is_lost {
                let sent_ns = (BEGIN + Duration::from_secs_f64(end_s)).ns();
                return Some(RawSample { session, sent_ns, ..sample });
            }
        }
        None
    }
}

impl Time for VirtualWorld {
    fn now(&self) -> Moment {
        let mut state = self.state();
        let until = state.now + LOOK;
        state.pass(until);
        until
    }

    fn unix_s(&self) -> f64 {
        let state = self.state();
        let set_back = state.faults.events(Fault::ClockSetBack).filter(|at_s| *at_s < state.now_s()).count();
        BEGIN_UNIX_S + state.now_s() - 3600.0 * set_back as f64
    }

    fn sleep_until(&self, moment: Moment) {
        self.state().pass(moment);
    }

    fn both(&self, beside: &mut (dyn FnMut() + Send), here: &mut dyn FnMut()) {
        let begun = self.state().now;
        beside();
        let ended = std::mem::replace(&mut self.state().now, begun);
        here();
        let mut state = self.state();
        state.now = state.now.max(ended);
    }
}

impl Ports for VirtualWorld {
    fn open(&self, config: &LineConfig) -> io::Result<Box<dyn Opening>> {
        let line = usize::from(config.port.contains("table"));
        let is_serial = !config.port.starts_with("tcp://");
        Ok(Box::new(VirtualPort { world: self.clone(), line, is_serial }))
    }
}

/// A port of the world, and its opening.
struct VirtualPort {
    world: VirtualWorld,
    line: usize,
    is_serial: bool,
}

impl Opening for VirtualPort {
    fn wait(&mut self, _: Moment) -> Option<io::Result<Box<dyn Port>>> {
        if self.world.state().has(self.line, InjectedFault::PortLoss) {
            return Some(Err(io::ErrorKind::NotFound.into()));
        }
        Some(Ok(Box::new(Self { world: self.world.clone(), ..*self })))
    }
}

impl Port for VirtualPort {
    fn is_serial(&self) -> bool {
        self.is_serial
    }

    fn write(&self, bytes: &[u8], deadline: Moment) -> io::Result<usize> {
        self.world.state().write(self.line, bytes, deadline)
    }

    fn read(&self, buffer: &mut [u8], deadline: Moment) -> io::Result<usize> {
        self.world.state().read(self.line, buffer, deadline)
    }
}

impl SampleSources for VirtualWorld {
    fn start(&self, _: &ImuId) -> io::Result<Box<dyn SampleSource>> {
        // What was sent before is not received.
        self.state().advance_imu(false);
        Ok(Box::new(VirtualSource(self.clone())))
    }

    fn domain(&self) -> &str {
        "virtual"
    }
}

/// The IMU's stream.
struct VirtualSource(VirtualWorld);

impl SampleSource for VirtualSource {
    fn take_sample(&mut self) -> Option<Result<(RawSample, u64), String>> {
        let mut state = self.0.state();
        let sample = state.advance_imu(true)?;
        Some(Ok((sample, state.now.ns())))
    }
}
