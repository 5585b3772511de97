//! The loop that gives the machine its observations and executes its actions.
//!
//! One thread talks to both instruments, one request at a time, so that nothing is commanded while a reply is
//! outstanding. Another thread takes the samples off the stream. Every command is checked against the limits before it
//! is sent, and every reading when it arrives. Whichever way the loop ends, the runner brings the instruments into the
//! safe state.

mod batch;
mod pause;
mod view;

use super::control::{REQUESTED, answer_stop, snapshot};
use super::journal::{Entry, History, Journal, KeptStep, TurnReadBacks};
use super::machine::{Action, CampaignMachine, Halt, Observation};
use super::page::{self, LivePage};
use super::plan::Plan;
use super::progress::{CampaignProgress, DroppedImu, Snapshot};
use super::samples::{LaboratoryClock, SampleSources};
use super::stability::{RateWindow, Trends};
use super::stamp::Stamp;
use super::station::{Station, StationError};
use super::step::CampaignStep;
use super::streams::Streams;
use super::timeline::{duration, units};
use isotherm_instruments::{ChamberReading, Moment, Surroundings, TurntableReading};
use isotherm_support::failure::{Exit, Failure};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;

/// Lower bound of every time-out in real time, at any speed of the laboratory.
const MIN_TIMEOUT: Duration = Duration::from_secs(10);
/// Period of the chamber's readings: in laboratory time, and at least this in real time \[s\].
const CHAMBER_PERIOD_S: [f64; 2] = [5.0, 0.05];
/// Period of the turntable's readings in laboratory time \[s\]: while it moves or settles, and at rest.
const TURNTABLE_PERIOD_S: [f64; 2] = [0.5, 2.0];
/// Longest pause of the loop between two turns.
const MAX_LOOP_PAUSE: Duration = Duration::from_millis(100);
/// Shortest pause of the loop between two turns.
const MIN_LOOP_PAUSE: Duration = Duration::from_millis(2);
/// First pause between two attempts to reach an instrument; each pause is twice the one before.
const FIRST_RETRY_PAUSE: Duration = Duration::from_millis(100);
/// Longest pause between two attempts to reach an instrument.
const MAX_RETRY_PAUSE: Duration = Duration::from_secs(5);
/// Window over which the air's rate of change is compared with the ramp's limit, in laboratory time \[s\].
const RAMP_WINDOW_S: f64 = 300.0;
/// Why the loop has stopped before the campaign is complete.
pub enum RunnerError {
    /// Pause, and go on when all is well again.
    Interrupted(String),
    /// End the campaign in the safe state.
    GivenUp(Failure),
    /// The same, because somebody has asked for it.
    Stopped(String),
}

impl RunnerError {
    /// Ends the campaign in the safe state for this reason.
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

/// A running campaign. Times without a unit in their name are laboratory time \[s\].
pub struct Runner<'p> {
    plan: &'p Plan,
    clock: LaboratoryClock,
    machine: CampaignMachine<'p>,
    station: Station<'p>,
    streams: Streams<'p>,
    journal: Journal,
    progress: CampaignProgress,
    trends: Trends,
    ramp: RateWindow,
    chamber: (ChamberReading, f64),
    turntable: (TurntableReading, f64),
    /// The IMUs of a batch that are dropped.
    dropped: Vec<DroppedImu>,
    /// Whether an IMU of a batch may be dropped: before anything has moved, what is missing ends the campaign instead.
    may_drop: bool,
    page: LivePage,
    /// When the live page was last written, and how often it is.
    page_written: Option<Moment>,
    page_period: Duration,
    around: Surroundings,
    /// The last time that all was well.
    well_at: f64,
    /// The same as a stamp.
    well: Stamp,
    /// Whether the journal's last entry about the set point says that it is reached.
    reached_in_journal: bool,
    /// Number of complete units in the journal.
    units_kept: usize,
    /// When an earlier runner had reached the present set point; negative, because laboratory time 0 is this runner's
    /// start.
    reached: Option<f64>,
    /// Time from the last moment that all was well with an earlier runner until this runner's start.
    interruption_s: f64,
    /// The cause of the pause; `None` outside a pause.
    paused: Option<String>,
}

impl<'p> Runner<'p> {
    /// Goes on where `history` ends. The signal of `around` asks the runner to end in the safe state.
    ///
    /// # Errors
    /// If a file or a thread cannot be created.
    pub fn new(
        plan: &'p Plan,
        (journal, history): (Journal, &History),
        sources: &dyn SampleSources,
        speed: f64,
        around: Surroundings,
    ) -> Result<Self, Failure> {
        let clock = LaboratoryClock::new(Arc::clone(&around.time), speed);
        let min_timeout_s = MIN_TIMEOUT.as_secs_f64() * speed;
        let ago_s = |stamp: &Stamp| stamp.age_s(around.time.as_ref()).map(|age_s| age_s * speed);
        let well = snapshot(&plan.output)?.map(|shown| Stamp { unix_s: shown.well_unix_s, up: shown.well_up });
        let target = CampaignStep::of(plan, history.kept.len()).map(|unit| unit.set_point_c(plan));
        // If the machine was started again, nobody knows for how long it is reached: the soak begins anew.
        let reached = history.reached.as_ref().filter(|(set_point_c, _)| Some(*set_point_c) == target);
        let reached = reached.and_then(|(_, at)| ago_s(at));
        let mut trends = Trends::new(plan);
        for (imu, _) in plan.each().iter().enumerate().filter(|(_, plan)| history.reason_dropped(&plan.imu).is_some()) {
            trends.leave_out(imu);
        }
        // All was well too when the journal recorded a reached set point or a complete unit.
        let last_well = [history.reached.as_ref().map(|(_, at)| at), history.kept_at.as_ref(), well.as_ref()];
        let interruption_s = last_well.into_iter().flatten().filter_map(ago_s).fold(f64::INFINITY, f64::min);
        Ok(Self {
            plan,
            clock: clock.clone(),
            machine: CampaignMachine::new(plan, history.kept.len(), min_timeout_s),
            station: Station::new(plan, history.begun && !history.safe, around.clone()),
            streams: Streams::start(plan, history, clock, sources)?,
            journal,
            progress: CampaignProgress::new(&plan.output, units(plan), Arc::clone(&around.time)),
            trends,
            ramp: RateWindow::new(RAMP_WINDOW_S.max(0.1 * speed)),
            chamber: (ChamberReading::default(), f64::NEG_INFINITY),
            turntable: (TurntableReading::default(), f64::NEG_INFINITY),
            dropped: history.dropped.iter().cloned().map(|(imu, reason)| DroppedImu { imu, reason }).collect(),
            may_drop: !history.kept.is_empty(),
            page: LivePage::default(),
            page_written: None,
            page_period: Duration::from_secs(page::PERIOD_S.into()),
            well_at: 0.0,
            reached_in_journal: reached.is_some(),
            units_kept: history.kept.len(),
            well: well.unwrap_or_default(),
            reached: reached.map(|ago_s| -ago_s),
            interruption_s,
            around,
            paused: None,
        })
    }

    /// Takes samples of another device than the plan's, if `accepts`.
    #[must_use]
    pub fn with_other_device(self, accepts: bool) -> Self {
        Self { streams: self.streams.with_other_device(accepts), ..self }
    }

    /// Writes status file and live page only this often, and when something changes: nobody watches.
    #[must_use]
    pub fn with_period(self, period: Duration) -> Self {
        Self { page_period: period, progress: self.progress.with_period(period), ..self }
    }

    /// Takes all missing units, and ends in the safe state.
    ///
    /// # Errors
    /// Why the campaign is not complete, or why the safe state is not certain.
    pub fn run(mut self) -> Result<(), Failure> {
        // Every end passes through the safe state, a panic included.
        let result = catch_unwind(AssertUnwindSafe(|| {
            self.journal_start().and_then(|()| self.connect()).and_then(|()| self.run_loop())
        }));
        let stopped = matches!(result, Ok(Err(RunnerError::Stopped(_))));
        let failure = match result {
            Ok(Ok(())) => None,
            Ok(Err(RunnerError::GivenUp(failure))) => Some(failure),
            Ok(Err(RunnerError::Interrupted(cause) | RunnerError::Stopped(cause))) => {
                Some(Failure::new(Exit::Failed, cause))
            }
            Err(_) => Some(Failure::new(Exit::Failed, "the program has failed; its message is above")),
        };
        answer_stop(&self.plan.output);
        let (turntable, chamber) = self.station.enter_safe_state();
        self.streams.discard();
        let all = if self.dropped.is_empty() {
            "all data are taken".to_owned()
        } else {
            let dropped: Vec<_> = self.dropped.iter().map(|dropped| dropped.imu.as_str()).collect();
            format!("all data are taken, without {}", dropped.join(", "))
        };
        let reason = failure.as_ref().map_or(all, ToString::to_string);
        let message = format!("{reason}\nsafe state: {turntable}; {chamber}");
        if failure.is_none() {
            self.progress.event(&message.replace('\n', "; "));
        }
        self.progress.finish();
        let certain = turntable.is_reached() && chamber.is_reached();
        let (turntable, chamber) = (turntable.to_string(), chamber.to_string());
        let safe = self.journal.write_synced(Entry::Safe { reason, stopped, turntable, chamber, certain });
        let end = Snapshot { ended: Some(message.clone()), paused: None, safe: certain, ..self.snapshot() };
        self.progress.write(&end);
        self.write_page(&end);
        match failure {
            None if certain => safe,
            None => Err(Failure::new(Exit::Unavailable, message)),
            Some(failure) => {
                let message = format!(
                    "{message}\n{} units are complete; `isotherm campaign run` continues with the next",
                    self.units_kept
                );
                Err(Failure::new(if certain { failure.exit } else { Exit::Unavailable }, message))
            }
        }
    }

    /// Journals and logs that this runner begins.
    fn journal_start(&mut self) -> Result<(), RunnerError> {
        let (unit, speed) = (self.machine.completed(), self.clock.speed);
        self.journal.write_synced(Entry::Started { pid: std::process::id(), speed, unit })?;
        let left = duration(self.left_s() / speed);
        self.progress.event(&format!("{unit} of {} units are complete; about {left} to go", units(self.plan)));
        Ok(())
    }

    /// Runs until the campaign is complete. An interruption becomes a pause.
    fn run_loop(&mut self) -> Result<(), RunnerError> {
        loop {
            match self.run_once() {
                Ok(true) => return Ok(()),
                Ok(false) => {}
                Err(RunnerError::Interrupted(cause)) => {
                    // A signal ends the waits for the instruments: that is no cause for a pause.
                    self.check_stop_signal()?;
                    self.pause(cause)?;
                }
                Err(given_up) => return Err(given_up),
            }
        }
    }

    /// One turn of the loop. Returns whether the campaign is complete.
    fn run_once(&mut self) -> Result<bool, RunnerError> {
        let begun = self.around.time.now();
        self.check_stop_signal()?;
        self.drain()?;
        self.check_streams()?;
        let now = self.clock.now();
        if now - self.chamber.1 >= CHAMBER_PERIOD_S[0].max(CHAMBER_PERIOD_S[1] * self.clock.speed) {
            self.read_chamber()?;
        }
        let moving = self.machine.phase().is_moving();
        if now - self.turntable.1 >= TURNTABLE_PERIOD_S[usize::from(!moving)] {
            self.read_turntable()?;
        }
        // Samples that arrived during the reading were taken while the turntable was at the measured angles.
        self.drain()?;
        loop {
            self.drop_spoilers()?;
            let spoiled = self.streams.spoiled();
            let observation = Observation {
                now: self.clock.now(),
                chamber: (&self.chamber.0, self.chamber.1),
                turntable: (&self.turntable.0, self.turntable.1),
                trends: &self.trends,
                clocks_known: self.streams.know_clocks(),
                collected_s: self.streams.collected_s(),
                complete: self.streams.complete(),
                spoiled: spoiled.as_deref(),
            };
            match self.machine.step(&observation) {
                Ok(Action::Wait) => break,
                Ok(Action::Done) => return Ok(true),
                Ok(action) => self.execute(action)?,
                // Samples are missing: of all IMUs, or of some of a batch.
                Err(Halt::Interrupted(cause)) => {
                    let slow = |unit| self.streams.slow(unit, &cause, self.stream_patience_s());
                    let slow = self.machine.unit().map(slow).unwrap_or_default();
                    if slow.is_empty() || !self.drop_all(slow)? {
                        return Err(RunnerError::Interrupted(cause));
                    }
                }
                Err(halt) => return Err(halt.into()),
            }
        }
        if self.reached_in_journal && self.machine.reached().is_none() {
            self.reached_in_journal = false;
            self.journal.write(Entry::Left)?;
        }
        (self.well_at, self.well) = (self.clock.now(), Stamp::now(self.around.time.as_ref()));
        self.update_progress();
        let pause = Duration::from_secs_f64(TURNTABLE_PERIOD_S[usize::from(!moving)] / self.clock.speed);
        let pause = pause.clamp(MIN_LOOP_PAUSE, MAX_LOOP_PAUSE);
        self.around.time.sleep_until(begun + pause);
        Ok(false)
    }

    fn execute(&mut self, action: Action) -> Result<(), RunnerError> {
        match action {
            Action::Wait | Action::Done => {}
            Action::SetPoint(celsius) => self.station.set_point(celsius)?,
            Action::StartChamber => self.station.start_chamber()?,
            Action::Move(angles) => self.station.move_to(angles)?,
            Action::Turn(angles) => self.station.turn_to(angles)?,
            Action::Reached(set_point_c) => {
                self.journal.write(Entry::Reached { set_point_c })?;
                self.reached_in_journal = true;
                self.progress.event(&format!("{set_point_c} degC reached"));
            }
            Action::Collect(unit) => {
                self.streams.begin(unit)?;
            }
            Action::Discard(reason) => self.discard(reason)?,
            Action::Keep { unit, turned_deg } => self.keep(unit, turned_deg)?,
        }
        Ok(())
    }

    /// Makes the unit last: its samples are synced, then it is journalled.
    fn keep(&mut self, unit: CampaignStep, turned_deg: Option<[[f64; 2]; 2]>) -> Result<(), Failure> {
        let number = self.machine.completed() - 1;
        let Some(kept) = self.streams.keep(unit, number)? else { return Ok(()) };
        let mut message = format!("{} complete: {} rows, {:.0} s", kept.name, kept.rows, kept.seconds);
        let turn = match (unit, turned_deg) {
            (CampaignStep::Turn { turn, .. }, Some([before_deg, after_deg])) => {
                let turn = self.plan.turns[turn];
                let [before, after] = [before_deg, after_deg].map(|angles| angles[turn.axis]);
                message += &format!(", read back {before:?} and {after:?} deg");
                Some(TurnReadBacks { angle_deg: turn.angle_deg(), before_deg, after_deg })
            }
            _ => None,
        };
        let kept = KeptStep { turn, ..kept };
        let sum = |of: fn(&KeptStep) -> u64| kept.each().map(of).sum::<u64>();
        for (count, name) in [(sum(|kept| kept.gaps), "gaps"), (sum(|kept| kept.left_out), "samples left out")] {
            if count > 0 {
                message += &format!(", {count} {name}");
            }
        }
        self.journal.write_synced(Entry::Kept(kept))?;
        self.units_kept += 1;
        self.progress.event(&message);
        Ok(())
    }

    fn discard(&mut self, reason: String) -> Result<(), Failure> {
        self.streams.discard();
        self.progress.event(&format!("{} is begun again: {reason}", self.unit_name()));
        self.journal.write(Entry::Discarded { reason })
    }

    fn check_stop_signal(&self) -> Result<(), RunnerError> {
        stopped_by(&self.around.stop_signal).map_or(Ok(()), |signal| Err(RunnerError::Stopped(signal)))
    }

    /// Longest time without a usable sample of an IMU \[s\].
    fn stream_patience_s(&self) -> f64 {
        self.plan.patience.stream_s.max(MIN_TIMEOUT.as_secs_f64() * self.clock.speed)
    }

    /// Gives all received samples to the recorders and the trends.
    fn drain(&mut self) -> Result<(), Failure> {
        let patience_s = self.stream_patience_s();
        while let Some(failed) = self.streams.drain(&mut self.trends, patience_s)? {
            let reason = failed.reason.clone();
            if !self.drop_all(vec![failed])? {
                return Err(Failure::new(Exit::Data, reason));
            }
        }
        Ok(())
    }

    /// Checks that the last usable sample of no IMU is too old. An IMU of a batch is dropped if others send.
    fn check_streams(&mut self) -> Result<(), RunnerError> {
        let patience_s = self.stream_patience_s();
        self.drop_all(self.streams.silent(patience_s, patience_s))?;
        self.streams.silence(patience_s).map_or(Ok(()), |cause| Err(RunnerError::Interrupted(cause)))
    }

    fn read_chamber(&mut self) -> Result<(), RunnerError> {
        let reading = self.station.read_chamber()?;
        let now = self.clock.now();
        self.chamber = (reading, now);
        self.trends.chamber(now, self.chamber.0.air_c);
        self.ramp.add(now, self.chamber.0.air_c);
        let phase = self.machine.phase().name();
        self.streams.write_readbacks(&self.chamber.0, &self.turntable.0, phase, now)?;
        self.station.check_ramp(self.ramp.per_h())?;
        Ok(())
    }

    fn read_turntable(&mut self) -> Result<(), RunnerError> {
        self.turntable = (self.station.read_turntable()?, self.clock.now());
        Ok(())
    }
}

/// The message for the signal that has asked to end; `None` before one.
pub fn stopped_by(stop_signal: &AtomicUsize) -> Option<String> {
    let signal = stop_signal.load(Relaxed);
    let name = match signal {
        REQUESTED => "campaign stop",
        signal => signal_hook::low_level::signal_name(signal as i32).unwrap_or("a signal"),
    };
    (signal != 0).then(|| format!("stopped by {name}"))
}

impl From<StationError> for RunnerError {
    fn from(error: StationError) -> Self {
        match error {
            StationError::Lost(cause) => Self::Interrupted(cause),
            StationError::Alarm(reason) => Self::given_up(reason),
        }
    }
}
