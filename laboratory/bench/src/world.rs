//! The clock, the lines, the devices behind them and the IMU's stream.

use crate::faults::{DrawnFault, FaultPlan, SeededRandom};
use crate::script::{Script, ScriptAction, ScriptStep};
use isotherm_automation::samples::{SampleSource, SampleSources};
use isotherm_instruments::{LineConfig, Moment, PendingPort, Port, Ports, Surroundings, Time};
use isotherm_shared::names::ImuId;
use isotherm_shared::wire::RawSample;
use isotherm_simulation::Truth;
use isotherm_station::wire::{BABBLE, BABBLE_INTERVAL, LATE_REPLY, Wire};
use isotherm_station::{DeviceEvent, InjectedFault, MountedImu, SimulatedStation, StationImu};
use std::io;
use std::path::Path;
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
/// Longer than any campaign.
const FAR: Duration = Duration::from_secs(1_000_000);
/// From a request to its reply.
const REPLY: Duration = Duration::from_millis(5);
/// The same of [`DrawnFault::Slow`], at most: more than the time-out of the plan and the quiet time after it.
const SLOW_REPLY: Duration = Duration::from_millis(2_500);
/// The part of the replies that [`DrawnFault::CutReply`] cuts.
const CUT: f64 = 0.3;
/// From the end of a sample to its reception.
const TRANSIT: Duration = Duration::from_millis(1);
/// What asks for an angle of the turntable.
const ANGLE: &[u8] = b":read:position?";
/// What somebody else orders for [`DrawnFault::RunAway`].
const RUN_AWAY: &[u8] = b":demand:position 1,500.0\r\n:mode:position 1\r\n";
/// What an operator orders after that.
const BRING_BACK: &[u8] = b":interlock:close 1\r\n:demand:position 1,0.0\r\n:mode:position 1\r\n";
/// The signal of [`DrawnFault::Signal`]: SIGTERM.
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
pub(crate) struct SampleState {
    pub end_s: f64,
    pub sequence: u64,
    pub session: u64,
    pub angles_deg: [f64; 2],
    pub air_c: f64,
}

/// A station on a virtual clock.
#[derive(Clone)]
pub struct VirtualWorld(Arc<Mutex<WorldState>>);

struct WorldState {
    now: Moment,
    faults: FaultPlan,
    /// Those that are there until the next step.
    standing: Vec<DrawnFault>,
    script: Script,
    /// Until then nothing happens by itself.
    quiet_until: Moment,
    /// Number of times that the acquisition was started again by a step, with the time of each \[s\].
    restarts_s: Vec<f64>,
    /// By how much steps have set the time of day forward \[s\].
    clock_set_s: f64,
    lines: [VirtualLine; 2],
    imus: Vec<(ImuId, MountedImu<'static>)>,
    stop_signal: Arc<AtomicUsize>,
    /// Whether the runner has been killed: nothing that it does has an effect.
    is_killed: bool,
    /// Whether that was a loss of power; and how many there were.
    is_power_lost: bool,
    power_losses: usize,
    /// What is done at the moment of SIGKILL.
    at_kill: Option<AtKill>,
    requests: Vec<Request>,
    events: Vec<(f64, DeviceEvent)>,
    places: Vec<SampleState>,
    /// Number of angles that were misread.
    misread: usize,
}

struct VirtualLine {
    wire: Box<dyn Wire>,
    /// What is on its way to the runner, with the time at which it arrives.
    replies: Vec<(Moment, Vec<u8>)>,
}

impl VirtualWorld {
    /// The station, in equilibrium with the laboratory. `folder` is that of its campaign.
    #[must_use]
    pub fn new(station: &SimulatedStation, truths: &[Truth], faults: FaultPlan, folder: &Path) -> Self {
        let imu = |(imu, truth): (&StationImu, &Truth)| {
            let truth: &'static Truth = Box::leak(Box::new(truth.clone()));
            Some((ImuId::new(&imu.id)?, MountedImu::new(station, imu, truth)))
        };
        let lines =
            [station.chamber_wire(), station.turntable_wire()].map(|wire| VirtualLine { wire, replies: Vec::new() });
        Self(Arc::new(Mutex::new(WorldState {
            now: BEGIN,
            faults,
            standing: Vec::new(),
            script: Script::new(folder, BEGIN),
            quiet_until: BEGIN,
            restarts_s: Vec::new(),
            clock_set_s: 0.0,
            lines,
            imus: station.imus.iter().zip(truths).filter_map(imu).collect(),
            stop_signal: Arc::default(),
            is_killed: false,
            is_power_lost: false,
            power_losses: 0,
            at_kill: None,
            requests: Vec::new(),
            events: Vec::new(),
            places: Vec::new(),
            misread: 0,
        })))
    }

    fn state(&self) -> MutexGuard<'_, WorldState> {
        // A panic of the runner is a result.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What a new runner needs. The signal of an earlier one is forgotten.
    #[must_use]
    pub fn surroundings(&self) -> Surroundings {
        let mut state = self.state();
        (state.stop_signal, state.is_killed, state.is_power_lost) = (Arc::default(), false, false);
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

    /// Whether the machine has lost its power under the runner.
    #[must_use]
    pub fn is_power_lost(&self) -> bool {
        self.state().is_power_lost
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

    pub(crate) fn script(&self, steps: Vec<ScriptStep>) {
        let mut state = self.state();
        let now = state.now;
        state.script.set(steps, now);
        state.quiet_until = now;
    }

    /// When each step was done \[s\].
    #[must_use]
    pub fn steps_s(&self) -> Vec<f64> {
        self.state().script.done.iter().map(|at| at.since(BEGIN).as_secs_f64()).collect()
    }

    /// The faults that are there from now on, until the next step.
    pub fn set_faults(&self, faults: &[DrawnFault]) {
        self.state().standing = faults.to_vec();
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
    pub(crate) fn course(&self) -> (Vec<(f64, DeviceEvent)>, Vec<SampleState>) {
        let mut state = self.state();
        state.advance_imu(0, false);
        let mut events = state.events.clone();
        events.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        (events, state.places.clone())
    }
}

impl WorldState {
    fn now_s(&self) -> f64 {
        self.now.since(BEGIN).as_secs_f64()
    }

    /// Time passes until this moment.
    fn pass(&mut self, until: Moment) {
        if until <= self.quiet_until {
            self.now = self.now.max(until);
            return;
        }
        // Step by step, so that each thing happens at its time.
        while self.now < until {
            let look = self.script.next_look().map_or(until, |look| look.max(self.now + LOOK));
            // What is due at a moment is found when time has passed beyond it.
            let event = self.next_event().map_or(until, |event| event + LOOK);
            self.pass_to(look.min(event).min(until));
            if self.script.next_look().is_some_and(|look| look <= self.now)
                && let Some(act) = self.script.due(self.now)
            {
                self.act(act);
            }
        }
        let next = self.next_event().into_iter().chain(self.script.next_look()).min();
        self.quiet_until = next.unwrap_or(self.now + FAR);
    }

    /// When something happens next.
    fn next_event(&self) -> Option<Moment> {
        let events = [DrawnFault::Signal, DrawnFault::Killed, DrawnFault::RunAway, DrawnFault::PowerLoss];
        let events = events.into_iter().flat_map(|event| self.faults.events(event));
        let next_s = events.filter(|at_s| *at_s >= self.now_s()).reduce(f64::min);
        next_s.map(|next_s| BEGIN + Duration::from_secs_f64(next_s))
    }

    fn pass_to(&mut self, until: Moment) {
        let before_s = self.now_s();
        self.now = self.now.max(until);
        let times = before_s..self.now_s();
        let happens = |event| self.faults.events(event).any(|at_s| times.contains(&at_s));
        let (signalled, killed) = (happens(DrawnFault::Signal), happens(DrawnFault::Killed));
        let (runs_away, power_lost) = (happens(DrawnFault::RunAway), happens(DrawnFault::PowerLoss));
        if runs_away {
            self.order(1, RUN_AWAY);
        }
        if signalled {
            self.stop_signal.store(SIGTERM, Relaxed);
        }
        if power_lost && self.at_kill.is_some() {
            self.is_power_lost = true;
            self.power_losses += 1;
        }
        if killed || power_lost {
            self.kill();
        }
    }

    fn kill(&mut self) {
        if let Some(at_kill) = self.at_kill.take() {
            at_kill().unwrap_or_else(|error| panic!("keeping the folder: {error}"));
            // It is not asked: what it does from now on has no effect.
            self.is_killed = true;
            self.stop_signal.store(SIGTERM, Relaxed);
        }
    }

    fn act(&mut self, act: ScriptAction) {
        match act {
            ScriptAction::Faults(faults) => self.standing = faults,
            ScriptAction::Signal(number) => self.stop_signal.store(number, Relaxed),
            ScriptAction::Kill => self.kill(),
            ScriptAction::Restart => self.restarts_s.push(self.now_s()),
            ScriptAction::SetClock(by_s) => self.clock_set_s += by_s,
            ScriptAction::OrderChamber(bytes) => self.order(0, &bytes),
            ScriptAction::Call(call) => call(&self.script.folder),
            ScriptAction::Note => {}
        }
    }

    /// All faults that are active at this time \[s\].
    fn active_at(&self, at_s: f64) -> impl Iterator<Item = DrawnFault> {
        self.faults.active(at_s).chain(self.standing.iter().copied())
    }

    /// The faults of a line that are active now.
    fn active(&self, line: usize) -> Vec<InjectedFault> {
        let of_line = |fault: DrawnFault| match (fault, line) {
            (DrawnFault::Chamber(fault), 0) | (DrawnFault::Turntable(fault), 1) => Some(fault),
            _ => None,
        };
        self.active_at(self.now_s()).filter_map(of_line).collect()
    }

    fn has(&self, line: usize, fault: InjectedFault) -> bool {
        let of_line = [DrawnFault::Chamber(fault), DrawnFault::Turntable(fault)][line];
        self.is_killed || self.active_at(self.now_s()).any(|active| active == of_line)
    }

    fn advance_line(&mut self, line: usize) -> Vec<InjectedFault> {
        let (now_s, active) = (self.now_s(), self.active(line));
        let wire = &mut self.lines[line].wire;
        wire.advance(now_s, &active);
        let events = wire.events();
        for (_, imu) in &mut self.imus {
            imu.take_events(events.iter().copied());
        }
        self.events.extend(events);
        active
    }

    fn write(&mut self, line: usize, bytes: &[u8], deadline: Moment, is_serial: bool) -> io::Result<usize> {
        if self.has(line, InjectedFault::PortLoss) {
            self.lines[line].replies.clear();
            return Err(io::ErrorKind::BrokenPipe.into());
        }
        let is_dead = self.has(line, InjectedFault::Dead);
        if !(is_dead && is_serial) {
            self.requests.push(Request { at_s: self.now_s(), to_turntable: line == 1, bytes: bytes.to_vec() });
        }
        if is_dead {
            self.lines[line].replies.clear();
            if is_serial {
                self.pass(deadline);
                return Ok(0);
            }
            // A connection takes what nobody reads.
            return Ok(bytes.len());
        }
        let active = self.advance_line(line);
        let is_cut = line == 1 && self.active_at(self.now_s()).any(|fault| fault == DrawnFault::CutReply);
        let is_slow = self.active_at(self.now_s()).any(|fault| fault == DrawnFault::Slow { turntable: line == 1 });
        let late = if active.contains(&InjectedFault::Late) { LATE_REPLY } else { Duration::ZERO };
        let mut random = SeededRandom(self.requests.len() as u64);
        let slow = if is_slow { SLOW_REPLY.mul_f64(random.uniform()) } else { Duration::ZERO };
        let begun = self.faults.events(DrawnFault::Misread).filter(|at_s| *at_s <= self.now_s()).count();
        let VirtualLine { wire, replies } = &mut self.lines[line];
        // A controller answers one request after the other.
        let due = replies.last().map_or(self.now, |(due, _)| *due).max(self.now + REPLY + late.max(slow));
        wire.input().extend_from_slice(bytes);
        while let Some(request) = wire.take_request() {
            let mut reply = wire.answer(&request, &active);
            if is_cut && random.uniform() < CUT {
                reply.truncate((random.uniform() * reply.len() as f64) as usize);
            }
            if self.misread < begun && request.starts_with(ANGLE) {
                self.misread += 1;
                reply = misread(&reply);
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

    /// Simulates an IMU up to now. Returns its next sample, if one is wanted and there is one.
    fn advance_imu(&mut self, number: usize, is_wanted: bool) -> Option<RawSample> {
        let known_s = self.now_s() - TRANSIT.as_secs_f64();
        if self.imus[number].1.end_s() > known_s {
            return None;
        }
        for line in [0, 1] {
            self.advance_line(line);
        }
        while self.imus[number].1.end_s() <= known_s {
            let end_s = self.imus[number].1.end_s();
            let sample = self.imus[number].1.step();
            let (angles_deg, air_c) = self.imus[number].1.surroundings();
            let drawn = self.faults.events(DrawnFault::Restarted).filter(|at_s| *at_s < end_s).count();
            let session = 1 + (drawn + self.restarts_s.iter().filter(|at_s| **at_s < end_s).count()) as u64;
            if number == 0 {
                self.places.push(SampleState { end_s, sequence: sample.sequence, session, angles_deg, air_c });
            }
            let is_lost = self.active_at(end_s).any(|fault| match fault {
                DrawnFault::Silent => true,
                DrawnFault::SilentImu(silent) => silent == number,
                DrawnFault::Gaps => sample.sequence.is_multiple_of(10),
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
        let set_back = state.faults.events(DrawnFault::ClockSetBack).filter(|at_s| *at_s < state.now_s()).count();
        BEGIN_UNIX_S + state.now_s() + state.clock_set_s - 3600.0 * set_back as f64
    }

    fn boot(&self) -> String {
        format!("virtual-{}", self.state().power_losses)
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
    fn open(&self, config: &LineConfig) -> io::Result<Box<dyn PendingPort>> {
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

impl PendingPort for VirtualPort {
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
        self.world.state().write(self.line, bytes, deadline, self.is_serial)
    }

    fn read(&self, buffer: &mut [u8], deadline: Moment) -> io::Result<usize> {
        self.world.state().read(self.line, buffer, deadline)
    }
}

impl SampleSources for VirtualWorld {
    fn start(&self, imu: &ImuId) -> io::Result<Box<dyn SampleSource>> {
        let mut state = self.state();
        let number = state.imus.iter().position(|(known, _)| known == imu).ok_or(io::ErrorKind::NotFound)?;
        // What was sent before is not received.
        state.advance_imu(number, false);
        Ok(Box::new(VirtualSource { world: self.clone(), number }))
    }

    fn domain(&self) -> &str {
        "virtual"
    }
}

/// The stream of an IMU.
struct VirtualSource {
    world: VirtualWorld,
    number: usize,
}

impl SampleSource for VirtualSource {
    fn take_sample(&mut self) -> Option<Result<(RawSample, u64), String>> {
        let mut state = self.world.state();
        let sample = state.advance_imu(self.number, true)?;
        Some(Ok((sample, state.now.ns())))
    }
}

/// A reply with an angle, with another one of as many digits: its header and its end stay.
fn misread(reply: &[u8]) -> Vec<u8> {
    let is_digit = |byte: &u8| byte.is_ascii_digit() || matches!(byte, b'.' | b'-');
    let begin = reply.iter().position(is_digit).unwrap_or(reply.len());
    let end = reply.iter().rposition(is_digit).map_or(begin, |last| last + 1);
    [&reply[..begin], b"498.12345", &reply[end..]].concat()
}
