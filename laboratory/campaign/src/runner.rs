//! The loop that lets the machine see, and does what it orders.
//!
//! One thread talks to both instruments, so that no table moves while a reply is outstanding; another takes the samples off the stream.
//! Every command is held to the limits before it is sent and every reading when it is there. Whatever ends the loop ends in the safe
//! state.

use super::journal::{Entry, History, Journal};
use super::machine::{Action, Halt, Machine, Observation, Phase, Unit};
use super::page;
use super::plan::Plan;
use super::progress::{Progress, Snapshot};
use super::readbacks::Readbacks;
use super::samples::{LaboratoryClock, SampleRecorder, SampleTap, file_of};
use super::stability::{Trend, Trends};
use super::station::{Station, Watch};
use super::timeline::{left_s, unit_s, units};
use isotherm_client::{Options, unix_s};
use isotherm_failure::{Exit, Failure};
use isotherm_instruments::{ChamberReading, TurntableReading};
use isotherm_shared::wire::AXES;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

/// No wait that gives up is shorter in real time, however fast the laboratory is.
const FLOOR: Duration = Duration::from_secs(10);
/// How often the chamber is read, in laboratory and at most in real time \[s\].
const CHAMBER_EVERY_S: [f64; 2] = [5.0, 0.05];
/// How often the table is read \[s\]: on its way and settling, and at rest.
const TABLE_EVERY_S: [f64; 2] = [0.5, 2.0];
/// Longest and shortest pause of the loop.
const PAUSES: [Duration; 2] = [Duration::from_millis(100), Duration::from_millis(2)];
/// Pauses between two attempts to reach an instrument: the first, and the longest.
const RETRIES: [Duration; 2] = [Duration::from_millis(100), Duration::from_secs(5)];
/// The air's rate is watched over this \[s\].
const RAMP_WINDOW_S: f64 = 300.0;

/// Why the loop has ended before the campaign has.
pub enum RunnerError {
    /// Look again, and go on if all is well.
    Interrupted(String),
    /// Into the safe state.
    GivenUp(Failure),
}

impl RunnerError {
    /// Into the safe state, for this reason.
    pub fn given_up(message: impl Into<String>) -> Self {
        Self::GivenUp(Failure::new(Exit::Failed, message))
    }
}

impl From<Failure> for RunnerError {
    fn from(failure: Failure) -> Self {
        Self::GivenUp(failure)
    }
}

impl From<Halt> for RunnerError {
    fn from(halt: Halt) -> Self {
        match halt {
            Halt::Interrupted(cause) => Self::Interrupted(cause),
            Halt::GivenUp(reason) => Self::given_up(reason),
        }
    }
}

/// A running campaign.
pub struct Runner<'p> {
    plan: &'p Plan,
    clock: LaboratoryClock,
    machine: Machine<'p>,
    station: Station<'p>,
    tap: SampleTap,
    recorder: SampleRecorder<'p>,
    journal: Journal,
    readbacks: Readbacks,
    progress: Progress,
    trends: Trends,
    ramp: Trend,
    chamber: (ChamberReading, f64),
    table: (TurntableReading, f64),
    /// Head and board of each accelerometer, as last read.
    telemetry: [[f64; 2]; AXES],
    /// When the live page was written.
    page: Option<Instant>,
    /// Ends of the samples' file and of nothing else: what is kept.
    kept: u64,
    /// Why the stream has nothing, as the transport says it.
    stream_error: Option<String>,
    /// Name of the service's domain.
    domain: String,
    ended: Arc<AtomicUsize>,
    /// The last time that all was well: laboratory time, and seconds since 1970.
    well_at: f64,
    well_unix_s: f64,
    /// Whether the journal says that the set point is reached.
    told_reached: bool,
    /// Units that the journal lists.
    units_kept: usize,
    /// When the set point had been reached when an earlier runner ended, and how long ago that was.
    reached: Option<f64>,
    away_s: f64,
    paused: Option<String>,
}

impl<'p> Runner<'p> {
    /// Goes on where `history` ends. A signal's number in `ended` asks it to end in the safe state.
    ///
    /// # Errors
    /// If a file or thread cannot be made.
    pub fn new(
        plan: &'p Plan,
        (journal, history): (Journal, &History),
        options: Options,
        speed: f64,
        ended: Arc<AtomicUsize>,
    ) -> Result<Self, Failure> {
        let clock = LaboratoryClock::new(speed);
        let floor_s = FLOOR.as_secs_f64() * speed;
        let ago_s = |unix: f64| (unix_s() - unix).max(0.0) * speed;
        let well_unix_s = super::control::snapshot(&plan.output)?.map_or(0.0, |snapshot| snapshot.well_unix_s);
        let target = Unit::of(plan, history.kept.len()).map(|place| place.set_point_c(plan));
        let reached = history.reached.filter(|(set_point_c, _)| Some(*set_point_c) == target);
        let last_dwell = history.kept.iter().rfind(|kept| kept.file == super::plan::SAMPLES);
        let domain = options.domain.name().to_owned();
        let tap = SampleTap::start(plan.imu.clone(), options);
        let tap = tap.map_err(|error| Failure::new(Exit::Failed, format!("starting a thread: {error}")))?;
        // All was well when something was journalled as taken or reached, too.
        let last_well = history.reached.map_or(0.0, |(_, unix)| unix).max(history.kept_unix_s).max(well_unix_s);
        let away_s = ago_s(last_well);
        Ok(Self {
            plan,
            clock,
            machine: Machine::new(plan, history.kept.len(), floor_s),
            station: Station::new(plan, history.begun && !history.safe),
            tap,
            recorder: SampleRecorder::new(plan, clock, history.kept.last(), ago_s(history.kept_unix_s)),
            journal,
            readbacks: Readbacks::open(&plan.output)?,
            progress: Progress::new(&plan.output, units(plan)),
            trends: Trends::new(plan.soak.window_s),
            ramp: Trend::new(RAMP_WINDOW_S.max(0.1 * speed)),
            chamber: (ChamberReading::default(), f64::NEG_INFINITY),
            table: (TurntableReading::default(), f64::NEG_INFINITY),
            telemetry: [[f64::NAN; 2]; AXES],
            page: None,
            kept: last_dwell.map_or(0, |kept| kept.to),
            stream_error: None,
            domain,
            ended,
            well_at: 0.0,
            told_reached: reached.is_some(),
            units_kept: history.kept.len(),
            well_unix_s,
            reached: reached.map(|(_, unix)| -ago_s(unix)),
            away_s,
            paused: None,
        })
    }

    /// Takes everything that is missing, and ends in the safe state.
    ///
    /// # Errors
    /// Why it could not, with the safe state that was reached.
    pub fn run(mut self) -> Result<(), Failure> {
        // Whatever happens, a defect of the program included, passes through the safe state.
        let result =
            catch_unwind(AssertUnwindSafe(|| self.begin().and_then(|()| self.connect()).and_then(|()| self.all())));
        let failure = match result {
            Ok(Ok(())) => None,
            Ok(Err(RunnerError::GivenUp(failure))) => Some(failure),
            Ok(Err(RunnerError::Interrupted(cause))) => Some(Failure::new(Exit::Failed, cause)),
            Err(_) => Some(Failure::new(Exit::Failed, "the program has failed; its message is above")),
        };
        let (table, chamber) = self.station.safe();
        self.recorder.discard();
        let reason = failure.as_ref().map_or_else(|| "all data are taken".to_owned(), ToString::to_string);
        let words = format!("{reason}\nsafe state: {table}; {chamber}");
        if failure.is_none() {
            self.progress.event(&words.replace('\n', "; "));
        }
        self.progress.finish();
        let certain = table.is_reached() && chamber.is_reached();
        let (table, chamber) = (table.to_string(), chamber.to_string());
        let safe = self.journal.lasting(Entry::Safe { reason, table, chamber, certain });
        let end = Snapshot { ended: Some(words.clone()), paused: None, safe: certain, ..self.snapshot() };
        self.progress.write(&end);
        self.draw(&end);
        match failure {
            None if certain => safe,
            None => Err(Failure::new(Exit::Unavailable, words)),
            Some(failure) => {
                let message = format!(
                    "{words}\n{} units are complete; `isotherm campaign run` goes on with the next",
                    self.units_kept
                );
                Err(Failure::new(if certain { failure.exit } else { Exit::Unavailable }, message))
            }
        }
    }

    fn begin(&mut self) -> Result<(), RunnerError> {
        let (unit, speed) = (self.machine.unit(), self.clock.speed);
        self.journal.lasting(Entry::Started { pid: std::process::id(), speed, unit })?;
        let left = super::timeline::duration(self.left_s() / speed);
        self.progress.event(&format!("{unit} of {} units are complete; about {left} to go", units(self.plan)));
        Ok(())
    }

    fn all(&mut self) -> Result<(), RunnerError> {
        loop {
            match self.turn() {
                Ok(true) => return Ok(()),
                Ok(false) => {}
                Err(RunnerError::Interrupted(cause)) => self.pause(cause)?,
                Err(given_up) => return Err(given_up),
            }
        }
    }

    /// One turn of the loop; whether everything is done.
    fn turn(&mut self) -> Result<bool, RunnerError> {
        let begun = Instant::now();
        self.asked_to_end()?;
        self.drain()?;
        self.stream_is_alive()?;
        let now = self.clock.now();
        if now - self.chamber.1 >= CHAMBER_EVERY_S[0].max(CHAMBER_EVERY_S[1] * self.clock.speed) {
            self.read_chamber()?;
        }
        let moving = matches!(self.machine.phase(), Phase::Travel { .. } | Phase::Settle { .. });
        if now - self.table.1 >= TABLE_EVERY_S[usize::from(!moving)] {
            self.read_table()?;
        }
        // What has been sent while the table was read was taken while it was there.
        self.drain()?;
        loop {
            let seen = Observation {
                now: self.clock.now(),
                chamber: (&self.chamber.0, self.chamber.1),
                table: (&self.table.0, self.table.1),
                trends: &self.trends,
                collected_s: self.recorder.collected_s(),
                complete: self.recorder.complete(),
                spoiled: self.recorder.spoiled(),
            };
            match self.machine.step(&seen)? {
                Action::Wait => break,
                Action::Done => return Ok(true),
                order => self.obey(order)?,
            }
        }
        if self.told_reached && self.machine.reached().is_none() {
            self.told_reached = false;
            self.journal.write(Entry::Left)?;
        }
        (self.well_at, self.well_unix_s) = (self.clock.now(), unix_s());
        self.tell();
        let pause = Duration::from_secs_f64(TABLE_EVERY_S[usize::from(!moving)] / self.clock.speed);
        let pause = pause.clamp(PAUSES[1], PAUSES[0]);
        thread::sleep(pause.saturating_sub(begun.elapsed()));
        Ok(false)
    }

    fn obey(&mut self, order: Action) -> Result<(), RunnerError> {
        match order {
            Action::Wait | Action::Done => {}
            Action::SetPoint(celsius) => self.station.set_point(celsius)?,
            Action::Run => self.station.run()?,
            Action::Move(angles) => self.station.move_to(angles)?,
            Action::Reached(set_point_c) => {
                self.journal.write(Entry::Reached { set_point_c })?;
                self.told_reached = true;
                self.progress.event(&format!("{set_point_c} degC reached"));
            }
            Action::Collect(place) => {
                let kept = if matches!(place, Unit::Dwell { .. }) { self.kept } else { 0 };
                self.recorder.begin(place, self.clock.now(), kept)?;
            }
            Action::Discard(reason) => self.discard(reason)?,
            Action::Keep(place) => self.keep(place)?,
        }
        Ok(())
    }

    fn keep(&mut self, place: Unit) -> Result<(), Failure> {
        let number = self.machine.unit() - 1;
        let Some(kept) = self.recorder.keep(number)? else { return Ok(()) };
        if matches!(place, Unit::Dwell { .. }) {
            self.kept = kept.to;
        }
        let mut words = format!("{} complete: {} rows, {:.0} s", kept.name, kept.rows, kept.seconds);
        for (count, what) in [(kept.gaps, "gaps"), (kept.left_out, "samples left out")] {
            if count > 0 {
                words += &format!(", {count} {what}");
            }
        }
        self.journal.lasting(Entry::Kept(kept))?;
        self.units_kept += 1;
        self.progress.event(&words);
        Ok(())
    }

    fn discard(&mut self, reason: String) -> Result<(), Failure> {
        self.recorder.discard();
        self.progress.event(&format!("{} is begun again: {reason}", self.place_name()));
        self.journal.write(Entry::Discarded { reason })
    }

    fn asked_to_end(&self) -> Result<(), RunnerError> {
        stopped_by(&self.ended).map_or(Ok(()), |signal| Err(RunnerError::given_up(signal)))
    }

    fn drain(&mut self) -> Result<(), Failure> {
        while let Some(next) = self.tap.take_sample() {
            match next {
                Ok((sample, received_ns)) => {
                    self.stream_error = None;
                    if self.recorder.take(&sample, received_ns)? {
                        self.trends.sample(&sample);
                        self.telemetry = [0, 1, 2].map(|i| [sample.head_temperature[i], sample.board_temperature[i]]);
                    }
                }
                Err(error) => self.stream_error = Some(error),
            }
        }
        Ok(())
    }

    /// Whether usable samples come.
    fn stream_is_alive(&self) -> Result<(), RunnerError> {
        let patience = self.plan.patience.stream_s.max(FLOOR.as_secs_f64() * self.clock.speed);
        let age = self.clock.now() - self.recorder.usable_at().unwrap_or(f64::NEG_INFINITY);
        if age <= patience {
            return Ok(());
        }
        let imu = &self.plan.imu;
        let since = match self.recorder.usable_at() {
            Some(_) => format!("for {age:.0} s"),
            None => "yet".to_owned(),
        };
        let cause = self.stream_error.clone().unwrap_or_else(|| {
            let domain = &self.domain;
            format!("see with `isotherm status` whether a service serves {imu} in domain {domain:?} and its acquisition runs")
        });
        Err(RunnerError::Interrupted(format!("no usable sample of {imu} {since}; {cause}")))
    }

    fn read_chamber(&mut self) -> Result<(), RunnerError> {
        let reading = self.station.read_chamber()?;
        let now = self.clock.now();
        self.chamber = (reading, now);
        self.trends.chamber(now, self.chamber.0.air_c);
        self.ramp.add(now, self.chamber.0.air_c);
        let phase = self.machine.phase().name();
        self.readbacks.write(&self.chamber.0, &self.table.0, self.telemetry, phase, now)?;
        self.station.watch_ramp(self.ramp.per_h())?;
        Ok(())
    }

    fn read_table(&mut self) -> Result<(), RunnerError> {
        self.table = (self.station.read_table()?, self.clock.now());
        Ok(())
    }

    /// The beginning: everything must be there before anything is commanded.
    fn connect(&mut self) -> Result<(), RunnerError> {
        let reached = self.reached;
        self.until_well(FLOOR.as_secs_f64() * self.clock.speed + self.plan.patience.stream_s)?;
        let names = self.station.names();
        self.progress.event(&format!("chamber: {}; table: {}", names[0], names[1]));
        let [chamber, table] = names;
        self.journal.write(Entry::Connected { chamber, table })?;
        let now = self.clock.now();
        if self.reached.is_some() || self.machine.unit() > 0 {
            self.machine.resume(now, self.away_s + now, reached, &self.chamber.0)?;
        }
        Ok(())
    }

    /// Nothing is commanded until all is well again; the unit in progress is lost.
    fn pause(&mut self, cause: String) -> Result<(), RunnerError> {
        self.progress.event(&format!("paused: {cause}"));
        self.journal.write(Entry::Paused { cause: cause.clone() })?;
        self.recorder.discard();
        self.recorder.forget();
        let reached = self.machine.reached();
        let away = self.well_at;
        if matches!(self.machine.phase(), Phase::Travel { .. } | Phase::Settle { .. }) {
            self.station.stop_table();
        }
        self.paused = Some(cause);
        self.until_well(self.plan.patience.pause_s.max(FLOOR.as_secs_f64() * self.clock.speed))?;
        let now = self.clock.now();
        self.journal.write(Entry::Resumed { after_s: now - away })?;
        self.progress.event("all is well again");
        self.trends.clear();
        self.ramp.clear();
        self.machine.resume(now, now - away, reached, &self.chamber.0)?;
        Ok(())
    }

    /// Until both instruments answer and samples come, for at most `patience_s`.
    fn until_well(&mut self, patience_s: f64) -> Result<(), RunnerError> {
        let begun = self.clock.now();
        let mut retry = RETRIES[0];
        loop {
            let attempt = self.attempt();
            let cause = match attempt {
                Ok(()) => {
                    self.paused = None;
                    return Ok(());
                }
                Err(RunnerError::Interrupted(cause)) => cause,
                Err(given_up) => return Err(given_up),
            };
            if self.clock.now() - begun > patience_s {
                return Err(RunnerError::GivenUp(Failure::new(Exit::Unavailable, cause)));
            }
            self.paused.get_or_insert_with(|| cause.clone());
            let waited = Instant::now();
            while waited.elapsed() < retry {
                self.asked_to_end()?;
                self.drain()?;
                self.tell();
                thread::sleep(PAUSES[0].min(retry));
            }
            retry = (retry * 2).min(RETRIES[1]);
        }
    }

    fn attempt(&mut self) -> Result<(), RunnerError> {
        self.asked_to_end()?;
        // An alarm of one of them is not overheard because the other one is away.
        let chamber = self.station.connect_chamber().map_err(RunnerError::from).and_then(|()| self.read_chamber());
        if let Err(RunnerError::GivenUp(failure)) = chamber {
            return Err(RunnerError::GivenUp(failure));
        }
        let table = self.station.connect_table().map_err(RunnerError::from).and_then(|()| self.read_table());
        if let Err(RunnerError::GivenUp(failure)) = table {
            return Err(RunnerError::GivenUp(failure));
        }
        chamber.and(table)?;
        self.drain()?;
        self.stream_is_alive()
    }

    fn place_name(&self) -> String {
        self.machine.place().map_or_else(|| "end".to_owned(), |place| place.name(self.plan))
    }

    /// How much of the unit in progress is taken, 0 to 1.
    fn part(&self) -> f64 {
        match self.machine.place() {
            Some(Unit::Dwell { .. }) => (self.recorder.collected_s() / self.plan.dwell.time_s).min(1.0),
            _ => 0.0,
        }
    }

    fn left_s(&self) -> f64 {
        let unit = self.machine.unit();
        let begun = unit_s(self.plan, unit).unwrap_or_default();
        let soaked =
            self.machine.reached().map_or(0.0, |reached| (self.clock.now() - reached).min(self.plan.soak.time_s));
        let first = matches!(self.machine.place(), Some(Unit::Dwell { position: 0, .. } | Unit::Run(_)));
        let done = self.recorder.collected_s() + if first { soaked } else { 0.0 };
        left_s(self.plan, unit) - done.min(begun)
    }

    fn tell(&mut self) {
        let now = self.clock.now();
        if self.progress.is_due(now, self.machine.phase().name()) {
            let snapshot = self.snapshot();
            self.progress.tell(now, self.part(), &snapshot);
            if self.page.is_none_or(|written| written.elapsed() >= Duration::from_secs(page::EVERY_S.into())) {
                self.page = Some(Instant::now());
                self.draw(&snapshot);
            }
        }
    }

    /// The live page. What cannot be written now is written the next time.
    fn draw(&self, snapshot: &Snapshot) {
        if let Err(error) = page::write(self.plan, snapshot, self.readbacks.curves()) {
            tracing::warn!("writing the live page: {error}");
        }
    }

    fn snapshot(&self) -> Snapshot {
        let waits_for = match self.machine.phase() {
            Phase::Soak { .. } => {
                let left = self.machine.reached().unwrap_or_default() + self.plan.soak.time_s - self.clock.now();
                if left > 0.0 {
                    format!("{} more", super::timeline::duration(left))
                } else {
                    self.trends.unsettled(&self.plan.soak).unwrap_or_default()
                }
            }
            Phase::Dwell { .. } | Phase::Sweep { .. } => format!("{:.0} s taken", self.recorder.collected_s()),
            _ => String::new(),
        };
        let read_at = |at: f64| at > f64::NEG_INFINITY;
        Snapshot {
            unix_s: unix_s(),
            speed: self.clock.speed,
            phase: self.machine.phase().name().to_owned(),
            place: self.place_name(),
            unit: self.units_kept,
            units: units(self.plan),
            waits_for,
            target_c: self.machine.place().map(|place| place.set_point_c(self.plan)),
            commanded_c: self.machine.commanded_c(),
            air_c: read_at(self.chamber.1).then_some(self.chamber.0.air_c),
            chamber_c_per_h: self.trends.chamber_c_per_h(),
            telemetry_per_h: self.trends.telemetry_per_h().map(|(rate, _)| rate),
            angles_deg: read_at(self.table.1).then_some(self.table.0.angles_deg),
            repeated: self.station.repeated(),
            collected_s: self.recorder.collected_s(),
            left_s: self.left_s(),
            paused: self.paused.clone(),
            well_unix_s: self.well_unix_s,
            ended: None,
            safe: false,
        }
    }
}

/// What a run's file is called, for the finish.
pub fn runs(plan: &Plan) -> Vec<String> {
    (0..plan.verify.map_or(0, |verify| verify.runs as usize)).map(|run| file_of(Unit::Run(run))).collect()
}

/// Which signal has asked to end, if one has.
pub fn stopped_by(ended: &AtomicUsize) -> Option<String> {
    let signal = ended.load(Relaxed) as i32;
    let name = signal_hook::low_level::signal_name(signal).unwrap_or("a signal");
    // What `campaign stop` sends is what the system sends too.
    let who = if signal == signal_hook::consts::SIGTERM { ", as by campaign stop" } else { "" };
    (signal != 0).then(|| format!("stopped by {name}{who}"))
}

/// A word about what is watched.
impl From<Watch> for RunnerError {
    fn from(watch: Watch) -> Self {
        match watch {
            Watch::Lost(cause) => Self::Interrupted(cause),
            Watch::Alarm(reason) => Self::given_up(reason),
        }
    }
}
