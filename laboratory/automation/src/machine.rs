//! The campaign's state machine: it decides the next action from time, readings and samples. It does no input or
//! output.
//!
//! ```text
//! approach -> soak -> [ travel -> settle -> dwell ] for each position and turn -> stay -> the next set point
//!    ^          |            ^_______________| the turntable left its position
//!    `----------'____________________________| the chamber left its set point, or an interruption
//! ```
//! In a turn the phase `turn` takes the place of `dwell`: samples are taken while the turntable rests, turns and rests
//! again. In a ramp or a verification run it is `sweep`: samples are taken while the chamber goes there and back. A
//! dwell, a turn, a ramp or a verification run is a unit. A unit is kept whole or not at all.
//!
//! The transitions within a turn are in [`turn`].

mod phase;
mod turn;

pub(crate) use phase::Halt;
pub(crate) use phase::{Action, Leg, Observation, Phase, TurnStage, TurnState};

use super::plan::Plan;
use super::step::CampaignStep;
use isotherm_instruments::{ChamberReading, TurntableReading, turn_deg};

/// Smallest step of a set point that ramps \[degC\]: some controllers store every set point in a memory that wears out.
const MIN_STEP_C: f64 = 0.5;
/// Two set points that differ by at most this are the same \[degC\]: some controllers store tenths of a degree.
const SAME_SET_POINT_C: f64 = 0.11;
/// Hysteresis: a set point counts as reached within this fraction of the tolerance and as left beyond the whole
/// tolerance.
const REACHED_FRACTION: f64 = 0.8;
/// After a delay of the loop, the set point catches up with its ramp for at most this time, or by one step \[s\].
const MAX_CATCH_UP_S: f64 = 60.0;
/// A dwell without enough usable samples is interrupted after this multiple of its length and the stream's patience.
const MAX_DWELL_FACTOR: f64 = 1.5;

/// The state machine: [`step`](Self::step) gives one action at a time.
#[derive(Clone, Debug)]
pub(crate) struct CampaignMachine<'p> {
    plan: &'p Plan,
    /// Lower bound of every time-out \[s\].
    min_timeout_s: f64,
    /// Number of complete units.
    completed: usize,
    phase: Phase,
    /// The chamber's commanded set point \[degC\], and the time from which its next step is computed \[s\].
    commanded: Option<(f64, f64)>,
    /// Whether the chamber has been commanded to run.
    chamber_started: bool,
    /// When the last command went to the chamber, and to the turntable \[s\].
    last_command: [f64; 2],
    /// When the set point was reached \[s\].
    reached: Option<f64>,
    attempts: u32,
    interruptions: u32,
}

impl<'p> CampaignMachine<'p> {
    /// Goes on after `completed` units. `min_timeout_s` is the lower bound of every time-out: a fast simulated
    /// laboratory needs some real time too.
    pub(crate) const fn new(plan: &'p Plan, completed: usize, min_timeout_s: f64) -> Self {
        Self {
            plan,
            min_timeout_s,
            completed,
            phase: Phase::Begin,
            commanded: None,
            chamber_started: false,
            last_command: [f64::NEG_INFINITY; 2],
            reached: None,
            attempts: 0,
            interruptions: 0,
        }
    }

    /// The present phase.
    pub(crate) const fn phase(&self) -> Phase {
        self.phase
    }

    /// Number of complete units.
    pub(crate) const fn completed(&self) -> usize {
        self.completed
    }

    /// The unit in progress; `None` when all are complete.
    pub(crate) fn unit(&self) -> Option<CampaignStep> {
        CampaignStep::of(self.plan, self.completed)
    }

    /// Whether the unit in progress is attempted for the last time.
    pub(crate) const fn is_last_attempt(&self) -> bool {
        self.attempts + 1 >= self.plan.patience.attempts
    }

    /// Counts the attempts at the unit in progress anew: an IMU is dropped, and the earlier ones were those of other
    /// IMUs.
    pub(crate) const fn renew_attempts(&mut self) {
        self.attempts = 0;
    }

    /// When the set point was reached \[s\]; `None` if it has not been.
    pub(crate) const fn reached(&self) -> Option<f64> {
        self.reached
    }

    /// The chamber's commanded set point \[degC\].
    pub(crate) fn commanded_c(&self) -> Option<f64> {
        self.commanded.map(|(commanded_c, _)| commanded_c)
    }

    /// Chooses the phase to go on with after an interruption of `interruption_s`. The unit in progress is lost.
    /// `reached` is when the set point had been reached, if it had.
    ///
    /// # Errors
    /// [`Halt::GivenUp`] after too many interruptions without a complete unit between them.
    pub(crate) fn resume(
        &mut self,
        now: f64,
        interruption_s: f64,
        reached: Option<f64>,
        chamber: &ChamberReading,
    ) -> Result<(), Halt> {
        self.interruptions += 1;
        if self.interruptions > self.plan.patience.attempts {
            let message = format!("{} interruptions without a dwell completed", self.interruptions);
            return Err(Halt::GivenUp(message));
        }
        let Some(unit) = self.unit() else {
            self.phase = Phase::Done;
            return Ok(());
        };
        let target = unit.set_point_c(self.plan);
        let near = |value: f64, tolerance: f64| (value - target).abs() <= tolerance;
        let held = chamber.running
            && near(chamber.set_point_c, SAME_SET_POINT_C)
            && near(chamber.air_c, self.plan.soak.tolerance_c);
        self.reached =
            reached.filter(|_| held && interruption_s <= self.plan.patience.resoak_s.max(self.min_timeout_s));
        self.chamber_started = false;
        self.phase = Phase::Begin;
        if self.reached.is_some() {
            (self.phase, self.chamber_started, self.commanded) =
                (Phase::Soak { since: now }, true, Some((target, now)));
            self.last_command[0] = now;
        }
        Ok(())
    }

    /// Decides the next action. It must be done before the next step.
    ///
    /// # Errors
    /// [`Halt`] if it cannot go on.
    pub(crate) fn step(&mut self, observation: &Observation<'_>) -> Result<Action, Halt> {
        let Some(unit) = self.unit() else {
            self.phase = Phase::Done;
            return Ok(Action::Done);
        };
        self.check_chamber_follows(observation)?;
        match self.phase {
            Phase::Begin => {
                self.phase = Phase::Approach { commanded_at: None };
                self.reached = None;
                let air_c = self.plan.limits.clamp_chamber(observation.chamber.0.air_c);
                self.commanded = Some((to_tenths(air_c), observation.now));
                self.command_set_point(observation)
            }
            Phase::Approach { commanded_at } => self.approach(unit, observation, commanded_at),
            Phase::Soak { since } => self.soak(unit, observation, since),
            Phase::Travel { begun } => self.travel(unit, observation, begun),
            Phase::Settle { begun, since } => self.settle(unit, observation, begun, since),
            Phase::Dwell { begun, complete } => self.dwell(unit, observation, begun, complete),
            Phase::Turn(state) => self.turn(unit, observation, state),
            Phase::Sweep { leg, held } => self.sweep(unit, observation, leg, held),
            Phase::Stay => {
                let left_at = self.reached.unwrap_or(observation.now) + self.plan.soak.stay_s;
                if observation.now >= left_at {
                    self.leave_set_point(observation);
                }
                Ok(Action::Wait)
            }
            Phase::Done => Ok(Action::Done),
        }
    }

    /// Checks that the chamber runs at the commanded set point. If not, an operator has changed it, or it has stopped
    /// by itself: then the campaign ends instead of commanding it again.
    fn check_chamber_follows(&self, observation: &Observation<'_>) -> Result<(), Halt> {
        let (chamber, at) = observation.chamber;
        let Some((commanded, _)) = self.commanded.filter(|_| self.chamber_started && at > self.last_command[0]) else {
            return Ok(());
        };
        let wrong = if let Some(mode) = &chamber.other_mode {
            format!("it was changed to {mode} by someone else")
        } else if !chamber.running {
            "it has stopped".to_owned()
        } else if (chamber.set_point_c - commanded).abs() > SAME_SET_POINT_C {
            format!("its set point is {:?} degC, commanded was {commanded:?}", chamber.set_point_c)
        } else {
            return Ok(());
        };
        Err(Halt::GivenUp(format!(
            "the chamber does not follow its orders, {wrong}; run the campaign again to \
            continue"
        )))
    }

    fn command_set_point(&mut self, observation: &Observation<'_>) -> Result<Action, Halt> {
        self.last_command[0] = observation.now;
        Ok(self.commanded_c().map_or(Action::Wait, Action::SetPoint))
    }

    /// Advances the set point towards `target` along the ramp; `None` when no new set point is due.
    fn advance_set_point(&mut self, target: f64, ramp_c_per_s: f64, observation: &Observation<'_>) -> Option<f64> {
        let (commanded, at) = self.commanded?;
        let remaining = target - commanded;
        // At a high speed, one turn of the loop takes long in laboratory time; therefore the bound grows with the
        // speed.
        let max_step = MIN_STEP_C.max(ramp_c_per_s * MAX_CATCH_UP_S.max(self.min_timeout_s / 50.0));
        let allowed = (ramp_c_per_s * (observation.now - at)).min(max_step);
        if remaining == 0.0 || allowed < remaining.abs().min(MIN_STEP_C) {
            return None;
        }
        let next = if allowed >= remaining.abs() { target } else { commanded + allowed.copysign(remaining) };
        let next = if next == target { next } else { to_tenths(next) };
        self.commanded = Some((next, observation.now));
        Some(next)
    }

    fn approach(
        &mut self,
        unit: CampaignStep,
        observation: &Observation<'_>,
        commanded_at: Option<f64>,
    ) -> Result<Action, Halt> {
        if !self.chamber_started {
            self.chamber_started = true;
            self.last_command[0] = observation.now;
            return Ok(Action::StartChamber);
        }
        let target = unit.set_point_c(self.plan);
        if self.advance_set_point(target, self.plan.ramp_c_per_s, observation).is_some() {
            return self.command_set_point(observation);
        }
        if self.commanded_c() != Some(target) {
            return Ok(Action::Wait);
        }
        let since = commanded_at.unwrap_or(observation.now);
        self.phase = Phase::Approach { commanded_at: Some(since) };
        let (chamber, at) = observation.chamber;
        if at > self.last_command[0] && (chamber.air_c - target).abs() <= REACHED_FRACTION * self.plan.soak.tolerance_c
        {
            self.reached = Some(observation.now);
            self.phase = Phase::Soak { since: observation.now };
            return Ok(Action::Reached(target));
        }
        self.wait_for_chamber(target, since, observation)
    }

    /// Waits for the chamber's air to reach `target`, which was commanded at `since`; gives up after the patience of
    /// the plan.
    fn wait_for_chamber(&self, target: f64, since: f64, observation: &Observation<'_>) -> Result<Action, Halt> {
        let patience = self.plan.patience.approach_s.max(self.min_timeout_s);
        if observation.now - since <= patience {
            return Ok(Action::Wait);
        }
        let air_c = observation.chamber.0.air_c;
        let message = format!(
            "the chamber does not get to {target:?} degC: {air_c:?} degC {patience:.0} s after it was ordered to"
        );
        Err(Halt::GivenUp(message))
    }

    fn soak(&mut self, unit: CampaignStep, observation: &Observation<'_>, since: f64) -> Result<Action, Halt> {
        if let Some(reason) = self.chamber_deviation(unit, observation) {
            return self.retry_from(Phase::Approach { commanded_at: None }, reason);
        }
        let soak = &self.plan.soak;
        let soaked = observation.now - self.reached.unwrap_or(observation.now);
        if soaked < soak.time_s {
            return Ok(Action::Wait);
        }
        let Some(unsettled) = observation.trends.unsettled(soak) else {
            self.phase = Phase::Travel { begun: None };
            return Ok(Action::Wait);
        };
        // An interruption empties the windows of the rates; therefore it also restarts this time-out.
        let measured = (observation.now - since).min(soaked - soak.time_s);
        if measured > soak.window_s + self.plan.patience.stable_s.max(self.min_timeout_s) {
            let message = format!(
                "not settled {soaked:.0} s after {:?} degC was reached: {unsettled}",
                unit.set_point_c(self.plan)
            );
            return Err(Halt::GivenUp(message));
        }
        Ok(Action::Wait)
    }

    /// Why the chamber is not at the set point of `unit`; `None` if it is.
    fn chamber_deviation(&self, unit: CampaignStep, observation: &Observation<'_>) -> Option<String> {
        let target = unit.set_point_c(self.plan);
        let air = observation.chamber.0.air_c;
        let outside = (air - target).abs() > self.plan.soak.tolerance_c;
        outside.then(|| format!("the chamber left its set point: air at {air:?} degC instead of {target:?}"))
    }

    /// Why the turntable is not at rest at the angles of `unit`; `None` if it is.
    fn turntable_deviation(&self, unit: CampaignStep, observation: &Observation<'_>) -> Option<String> {
        self.deviation_from(unit.angles_deg(self.plan), observation)
    }

    /// Why the turntable is not at rest at `target_deg`; `None` if it is.
    fn deviation_from(&self, target_deg: [f64; 2], observation: &Observation<'_>) -> Option<String> {
        let ([outer, inner], motion) = (target_deg, &self.plan.motion);
        let TurntableReading { angles_deg, rates_deg_s, .. } = observation.turntable.0;
        let off = self.rotation_deg(target_deg, *angles_deg);
        let near = off.iter().all(|off| off.abs() <= motion.tolerance_deg);
        let still = rates_deg_s.iter().all(|rate| rate.abs() <= motion.still_deg_s);
        // Whole turns off, and still.
        let wraps = still && off.iter().any(|off| off.abs() > 180.0);
        let hint = if wraps { "; a controller that counts angles modulo 360 degrees needs wrap = true" } else { "" };
        (!(near && still)).then(|| {
            format!(
                "the turntable is {:.4} and {:.4} deg off {outer:?}/{inner:?}, at {:.4} and {:.4} deg/s{hint}",
                off[0], off[1], rates_deg_s[0], rates_deg_s[1]
            )
        })
    }

    /// The rotation of both axes from `from_deg` to `to_deg` \[deg\]. In a turn whole turns count, unless the
    /// controller counts modulo 360 degrees.
    fn rotation_deg(&self, from_deg: [f64; 2], to_deg: [f64; 2]) -> [f64; 2] {
        let counted = matches!(self.unit(), Some(CampaignStep::Turn { .. })) && !self.plan.turntable.wraps();
        let rotation = |from: f64, to: f64| if counted { to - from } else { turn_deg(from, to) };
        [0, 1].map(|axis| rotation(from_deg[axis], to_deg[axis]))
    }

    /// Attempts the unit again from `phase` on.
    fn retry_from(&mut self, phase: Phase, reason: String) -> Result<Action, Halt> {
        self.attempts += 1;
        if self.attempts >= self.plan.patience.attempts {
            return Err(Halt::GivenUp(format!("{reason}; {} attempts", self.attempts)));
        }
        if matches!(phase, Phase::Approach { .. }) {
            self.reached = None;
        }
        self.phase = phase;
        Ok(Action::Discard(reason))
    }

    fn travel(
        &mut self,
        unit: CampaignStep,
        observation: &Observation<'_>,
        begun: Option<f64>,
    ) -> Result<Action, Halt> {
        if let Some(reason) = self.chamber_deviation(unit, observation) {
            return self.retry_from(Phase::Approach { commanded_at: None }, reason);
        }
        let Some(begun) = begun else {
            self.last_command[1] = observation.now;
            self.phase = Phase::Travel { begun: Some(observation.now) };
            return Ok(Action::Move(unit.angles_deg(self.plan)));
        };
        let at = observation.turntable.1;
        if at <= self.last_command[1] {
            return Ok(Action::Wait);
        }
        let Some(deviation) = self.turntable_deviation(unit, observation) else {
            self.phase = Phase::Settle { begun, since: at };
            return Ok(Action::Wait);
        };
        let motion = &self.plan.motion;
        // The longest motion: one turn, or back from the end of a turn, and twice the time to accelerate.
        let farthest_deg = self.plan.turns.iter().map(|turn| turn.angle_deg().abs()).fold(360.0, f64::max);
        let longest = farthest_deg / motion.rate_deg_s + 2.0 * motion.rate_deg_s / motion.acceleration_deg_s2;
        if observation.now - begun > longest + motion.settle_s + self.plan.patience.settle_s.max(self.min_timeout_s) {
            return self
                .retry_from(Phase::Travel { begun: None }, format!("the turntable does not settle: {deviation}"));
        }
        Ok(Action::Wait)
    }

    fn settle(
        &mut self,
        unit: CampaignStep,
        observation: &Observation<'_>,
        begun: f64,
        since: f64,
    ) -> Result<Action, Halt> {
        if self.turntable_deviation(unit, observation).is_some() {
            self.phase = Phase::Travel { begun: Some(begun) };
        } else if observation.clocks_known
            && observation.turntable.1 - since >= self.plan.motion.settle_s
            && observation.turntable.1 > since
        {
            self.phase = match unit {
                CampaignStep::Dwell { .. } => Phase::Dwell { begun: observation.now, complete: None },
                CampaignStep::Turn { .. } => Phase::Turn(TurnState {
                    begun: observation.now,
                    before_deg: [f64::NAN; 2],
                    stage: TurnStage::Before { complete: None },
                }),
                CampaignStep::Ramp(_) | CampaignStep::Run(_) => {
                    Phase::Sweep { leg: Leg::Begin, held: Some(observation.now) }
                }
            };
            return Ok(Action::Collect(unit));
        }
        Ok(Action::Wait)
    }

    fn dwell(
        &mut self,
        unit: CampaignStep,
        observation: &Observation<'_>,
        begun: f64,
        complete: Option<f64>,
    ) -> Result<Action, Halt> {
        let moved = self.turntable_deviation(unit, observation).or_else(|| observation.spoiled.map(str::to_owned));
        if let Some(reason) = moved {
            return self.retry_from(Phase::Travel { begun: None }, reason);
        }
        if let Some(reason) = self.chamber_deviation(unit, observation) {
            return self.retry_from(Phase::Approach { commanded_at: None }, reason);
        }
        if observation.complete {
            let complete = complete.unwrap_or(observation.now);
            self.phase = Phase::Dwell { begun, complete: Some(complete) };
            if observation.turntable.1 > complete {
                return Ok(self.complete_unit(unit, None, observation));
            }
            return Ok(Action::Wait);
        }
        self.wait_for_samples(self.plan.dwell.time_s, begun, observation)
    }

    /// Waits for `time_s` of samples since `since`; an interruption after the patience of the plan.
    fn wait_for_samples(&self, time_s: f64, since: f64, observation: &Observation<'_>) -> Result<Action, Halt> {
        let patience = MAX_DWELL_FACTOR * time_s + self.plan.patience.stream_s.max(self.min_timeout_s);
        if observation.now - since <= patience {
            return Ok(Action::Wait);
        }
        let message = format!("only {:.1} s of usable samples in {patience:.0} s", observation.collected_s);
        Err(Halt::Interrupted(message))
    }

    fn sweep(
        &mut self,
        unit: CampaignStep,
        observation: &Observation<'_>,
        leg: Leg,
        held: Option<f64>,
    ) -> Result<Action, Halt> {
        if let Some(reason) =
            self.turntable_deviation(unit, observation).or_else(|| observation.spoiled.map(str::to_owned))
        {
            // The chamber is on its way; therefore the whole unit begins again.
            return self.retry_from(Phase::Approach { commanded_at: None }, reason);
        }
        let Some(way) = unit.way(self.plan) else { return Ok(Action::Wait) };
        let Some(since) = held else { return self.ramp(leg, leg.end_c(way), way.ramp_c_per_s, observation) };
        if observation.now - since < way.hold_s {
            return match self.chamber_deviation(unit, observation).filter(|_| leg == Leg::Begin) {
                Some(reason) => self.retry_from(Phase::Approach { commanded_at: None }, reason),
                None => Ok(Action::Wait),
            };
        }
        let leg = match leg {
            Leg::Begin => Leg::There,
            Leg::There => Leg::Back,
            Leg::Back => return Ok(self.complete_unit(unit, None, observation)),
        };
        // The ramp begins at the end of the hold, not at the last command.
        self.commanded = self.commanded.map(|(commanded, at)| (commanded, at.max(since + way.hold_s)));
        // It leaves the set point: a unit that is interrupted from now on is soaked anew.
        self.reached = None;
        self.phase = Phase::Sweep { leg, held: None };
        Ok(Action::Wait)
    }

    /// The ramp of a leg, until the chamber's air is at its end.
    fn ramp(&mut self, leg: Leg, end_c: f64, ramp_c_per_s: f64, observation: &Observation<'_>) -> Result<Action, Halt> {
        if self.advance_set_point(end_c, ramp_c_per_s, observation).is_some() {
            return self.command_set_point(observation);
        }
        if self.commanded_c() != Some(end_c) {
            return Ok(Action::Wait);
        }
        if (observation.chamber.0.air_c - end_c).abs() > self.plan.soak.tolerance_c {
            let commanded_at = self.commanded.map_or(observation.now, |(_, at)| at);
            return self.wait_for_chamber(end_c, commanded_at, observation);
        }
        self.phase = Phase::Sweep { leg, held: Some(observation.now) };
        Ok(Action::Wait)
    }

    /// Counts `unit`, the one in progress, as complete, and chooses the next phase.
    fn complete_unit(
        &mut self,
        unit: CampaignStep,
        turned_deg: Option<[[f64; 2]; 2]>,
        observation: &Observation<'_>,
    ) -> Action {
        self.completed += 1;
        (self.attempts, self.interruptions) = (0, 0);
        match (unit.visit(), self.unit()) {
            (Some(visit), Some(next)) if next.visit() == Some(visit) => self.phase = Phase::Travel { begun: None },
            (Some(_), Some(_)) => self.phase = Phase::Stay,
            _ => self.leave_set_point(observation),
        }
        Action::Keep { unit, turned_deg }
    }

    /// Begins the way to the next set point.
    fn leave_set_point(&mut self, observation: &Observation<'_>) {
        self.reached = None;
        self.phase = Phase::Approach { commanded_at: None };
        self.commanded = self.commanded.map(|(commanded, _)| (commanded, observation.now));
    }
}

/// Rounds to a set point that every controller can store \[degC\].
fn to_tenths(celsius: f64) -> f64 {
    (celsius * 10.0).round() / 10.0
}

#[cfg(test)]
mod tests;
