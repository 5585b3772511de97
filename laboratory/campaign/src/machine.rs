//! What comes next: a state machine over time and readings, without any input or output of its own.
//!
//! ```text
//! approach -> soak -> [ travel -> settle -> dwell ] for each position -> stay -> the next set point
//!    ^          |            ^_______________| the table left its place
//!    `----------'____________________________| the chamber left its set point, an interruption
//! ```
//! A verification run is a dwell in which the chamber is swept. A unit, which is a dwell or a run, is kept whole or not at all.

use super::plan::Plan;
use super::stability::Trends;
use isotherm_instruments::{ChamberReading, TurntableReading, turn_deg};

/// Steps that the chamber's set point is led in \[degC\]: some controllers keep every set point in a memory that wears.
const STEP_C: f64 = 0.5;
/// Set points as a controller keeps them agree to this \[degC\].
const SAME_C: f64 = 0.11;
/// Reached is this part of the tolerance, left is all of it: noise at the edge is neither.
const REACHED: f64 = 0.8;
/// However long nobody looked, the set point is led on by a step or by what this time allows \[s\].
const LEAD_S: f64 = 60.0;
/// Without enough samples a dwell may take so many times its length.
const LONG: f64 = 1.5;

/// A unit of the data.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Unit {
    /// A dwell: indices of set point and position.
    Dwell {
        /// Index of the set point.
        visit: usize,
        /// Index of the position.
        position: usize,
    },
    /// A verification run, from 0.
    Run(usize),
}

impl Unit {
    /// The unit of this number, from 0; `None` after the last.
    pub fn of(plan: &Plan, unit: usize) -> Option<Self> {
        let positions = plan.positions.len();
        let dwells = plan.set_points_c.len() * positions;
        if unit < dwells {
            return Some(Self::Dwell { visit: unit / positions, position: unit % positions });
        }
        let runs = plan.verify.map_or(0, |verify| verify.runs as usize);
        (unit < dwells + runs).then(|| Self::Run(unit - dwells))
    }

    /// Chamber at its beginning \[degC\].
    pub fn set_point_c(self, plan: &Plan) -> f64 {
        match self {
            Self::Dwell { visit, .. } => plan.set_points_c[visit],
            Self::Run(_) => plan.verify.map_or(0.0, |verify| verify.from_c),
        }
    }

    /// The table's angles \[deg\].
    pub fn angles_deg(self, plan: &Plan) -> [f64; 2] {
        match self {
            Self::Dwell { position, .. } => plan.positions[position].angles.unwrap_or_default(),
            Self::Run(_) => plan.verify.map_or([0.0; 2], |verify| verify.angles_deg),
        }
    }

    /// For people.
    pub fn name(self, plan: &Plan) -> String {
        match self {
            Self::Dwell { visit, position } => {
                let there = &plan.positions[position];
                format!("{} degC, position {} ({})", plan.set_points_c[visit], there.number, there.label)
            }
            Self::Run(run) => format!("verification run {}", run + 1),
        }
    }
}

/// What the machine looks at. Times are the laboratory's \[s\].
#[derive(Clone, Copy, Debug)]
pub struct Observation<'a> {
    /// Now.
    pub now: f64,
    /// The last reading of the chamber, and when it was there.
    pub chamber: (&'a ChamberReading, f64),
    /// The last reading of the table, and when it was there.
    pub table: (&'a TurntableReading, f64),
    /// Rates of change.
    pub trends: &'a Trends,
    /// Counted time of the unit in progress \[s\].
    pub collected_s: f64,
    /// Whether that is all of a dwell.
    pub complete: bool,
    /// Why the unit in progress cannot be used.
    pub spoiled: Option<&'a str>,
}

/// What is to be done now. One at a time; an order that fails is an interruption.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Nothing.
    Wait,
    /// Set the chamber's set point \[degC\].
    SetPoint(f64),
    /// Let the chamber run.
    Run,
    /// Move the table to these angles \[deg\].
    Move([f64; 2]),
    /// The set point has been reached.
    Reached(f64),
    /// The table has settled: take samples from now on.
    Collect(Unit),
    /// Once more, because of this: throw away what was taken of the unit in progress.
    Discard(String),
    /// The unit in progress is complete.
    Keep(Unit),
    /// There is nothing left to do.
    Done,
}

/// Why the machine does not go on.
#[derive(Clone, Debug, PartialEq)]
pub enum Halt {
    /// Look again, and go on if all is well: a pause.
    Interrupted(String),
    /// Into the safe state.
    GivenUp(String),
}

/// Where in the sequence it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Phase {
    /// Before anything.
    Begin,
    /// The chamber goes to the set point.
    Approach {
        /// When all of the way was commanded.
        led: Option<f64>,
    },
    /// At the set point, until time and rates are right.
    Soak {
        /// Since when it is watched.
        since: f64,
    },
    /// The table moves.
    Travel {
        /// When it was told to; `None` if it has not been.
        begun: Option<f64>,
    },
    /// The table is there.
    Settle {
        /// When it was told to move.
        begun: f64,
        /// Since when it is there.
        since: f64,
    },
    /// Samples are taken.
    Dwell {
        /// Since when.
        begun: f64,
        /// When all of them were there; the table must be in its place after that.
        complete: Option<f64>,
    },
    /// Samples are taken while the chamber goes.
    Sweep {
        /// Since when.
        begun: f64,
        /// Since when it is at the other end.
        arrived: Option<f64>,
    },
    /// All positions are done, the least time at the set point is not over.
    Stay,
    /// Everything is done.
    Done,
}

impl Phase {
    /// For people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Begin | Self::Approach { .. } => "approach",
            Self::Soak { .. } => "soak",
            Self::Travel { .. } => "travel",
            Self::Settle { .. } => "settle",
            Self::Dwell { .. } => "dwell",
            Self::Sweep { .. } => "sweep",
            Self::Stay => "stay",
            Self::Done => "done",
        }
    }
}

/// The state machine.
#[derive(Clone, Debug)]
pub struct Machine<'p> {
    plan: &'p Plan,
    /// No wait that gives up is shorter \[s\].
    floor_s: f64,
    unit: usize,
    phase: Phase,
    /// The chamber's commanded set point \[degC\], and when it was led on last.
    lead: Option<(f64, f64)>,
    /// Whether the chamber has been told to run.
    running: bool,
    /// When the last order went to the chamber, and to the table.
    ordered: [f64; 2],
    reached: Option<f64>,
    attempts: u32,
    interruptions: u32,
}

impl<'p> Machine<'p> {
    /// Goes on with `unit`. `floor_s` bounds every wait that gives up from below: at a high speed of a simulated laboratory the
    /// machine that simulates it needs some real time.
    pub const fn new(plan: &'p Plan, unit: usize, floor_s: f64) -> Self {
        Self {
            plan,
            floor_s,
            unit,
            phase: Phase::Begin,
            lead: None,
            running: false,
            ordered: [f64::NEG_INFINITY; 2],
            reached: None,
            attempts: 0,
            interruptions: 0,
        }
    }

    /// Where it is.
    pub const fn phase(&self) -> Phase {
        self.phase
    }

    /// Units that are complete.
    pub const fn unit(&self) -> usize {
        self.unit
    }

    /// The unit that it works on.
    pub fn place(&self) -> Option<Unit> {
        Unit::of(self.plan, self.unit)
    }

    /// When the set point was reached.
    pub const fn reached(&self) -> Option<f64> {
        self.reached
    }

    /// The chamber's commanded set point \[degC\].
    pub fn commanded_c(&self) -> Option<f64> {
        self.lead.map(|(commanded_c, _)| commanded_c)
    }

    /// After an interruption of `away_s`: where to go on. The unit in progress is lost. `reached` is when the set point had been
    /// reached, if it had.
    ///
    /// # Errors
    /// [`Halt::GivenUp`] after too many without a unit completed.
    pub fn resume(
        &mut self,
        now: f64,
        away_s: f64,
        reached: Option<f64>,
        chamber: &ChamberReading,
    ) -> Result<(), Halt> {
        self.interruptions += 1;
        if self.interruptions > self.plan.patience.attempts {
            let message = format!("{} interruptions without a dwell completed", self.interruptions);
            return Err(Halt::GivenUp(message));
        }
        let Some(place) = self.place() else {
            self.phase = Phase::Done;
            return Ok(());
        };
        let target = place.set_point_c(self.plan);
        let near = |value: f64, within: f64| (value - target).abs() <= within;
        let held =
            chamber.running && near(chamber.set_point_c, SAME_C) && near(chamber.air_c, self.plan.soak.tolerance_c);
        self.reached = reached.filter(|_| held && away_s <= self.plan.patience.resoak_s.max(self.floor_s));
        self.running = false;
        self.phase = Phase::Begin;
        if self.reached.is_some() {
            (self.phase, self.running, self.lead) = (Phase::Soak { since: now }, true, Some((target, now)));
            self.ordered[0] = now;
        }
        Ok(())
    }

    /// What is to be done, seen all this.
    ///
    /// # Errors
    /// [`Halt`] if it cannot go on.
    pub fn step(&mut self, seen: &Observation<'_>) -> Result<Action, Halt> {
        let Some(place) = self.place() else {
            self.phase = Phase::Done;
            return Ok(Action::Done);
        };
        self.obeyed(seen)?;
        match self.phase {
            Phase::Begin => {
                self.phase = Phase::Approach { led: None };
                self.reached = None;
                let air_c = self.plan.limits.clamp_chamber(seen.chamber.0.air_c);
                self.lead = Some((to_tenths(air_c), seen.now));
                self.order_set_point(seen)
            }
            Phase::Approach { led } => self.approach(place, seen, led),
            Phase::Soak { since } => self.soak(place, seen, since),
            Phase::Travel { begun } => self.travel(place, seen, begun),
            Phase::Settle { begun, since } => self.settle(place, seen, begun, since),
            Phase::Dwell { begun, complete } => self.dwell(place, seen, begun, complete),
            Phase::Sweep { begun, arrived } => self.sweep(place, seen, begun, arrived),
            Phase::Stay => {
                let left_at = self.reached.unwrap_or(seen.now) + self.plan.soak.stay_s;
                if seen.now >= left_at {
                    self.next_place(seen);
                }
                Ok(Action::Wait)
            }
            Phase::Done => Ok(Action::Done),
        }
    }

    /// Whether the chamber does what it was told. If not, somebody has gone to it, or it has stopped by itself: nothing is commanded
    /// against that.
    fn obeyed(&self, seen: &Observation<'_>) -> Result<(), Halt> {
        let (chamber, at) = seen.chamber;
        let Some((commanded, _)) = self.lead.filter(|_| self.running && at > self.ordered[0]) else { return Ok(()) };
        let wrong = if !chamber.running {
            "it has stopped".to_owned()
        } else if (chamber.set_point_c - commanded).abs() > SAME_C {
            format!("its set point is {:?} degC, commanded was {commanded:?}", chamber.set_point_c)
        } else {
            return Ok(());
        };
        Err(Halt::GivenUp(format!(
            "the chamber does not do what it was told, {wrong}; run the campaign again to go on"
        )))
    }

    fn order_set_point(&mut self, seen: &Observation<'_>) -> Result<Action, Halt> {
        self.ordered[0] = seen.now;
        Ok(self.commanded_c().map_or(Action::Wait, Action::SetPoint))
    }

    /// Leads the set point on towards `target`; `None` when nothing is to be commanded now.
    fn led(&mut self, target: f64, ramp_c_per_s: f64, seen: &Observation<'_>) -> Option<f64> {
        let (commanded, at) = self.lead?;
        let left = target - commanded;
        let most = STEP_C.max(ramp_c_per_s * LEAD_S.max(self.floor_s / 50.0));
        let allowed = (ramp_c_per_s * (seen.now - at)).min(most);
        if left == 0.0 || allowed < left.abs().min(STEP_C) {
            return None;
        }
        let next = if allowed >= left.abs() { target } else { commanded + allowed.copysign(left) };
        let next = if next == target { next } else { to_tenths(next) };
        self.lead = Some((next, seen.now));
        Some(next)
    }

    fn approach(&mut self, place: Unit, seen: &Observation<'_>, led: Option<f64>) -> Result<Action, Halt> {
        if !self.running {
            self.running = true;
            self.ordered[0] = seen.now;
            return Ok(Action::Run);
        }
        let target = place.set_point_c(self.plan);
        if self.led(target, self.plan.ramp_c_per_s, seen).is_some() {
            return self.order_set_point(seen);
        }
        if self.commanded_c() != Some(target) {
            return Ok(Action::Wait);
        }
        let since = led.unwrap_or(seen.now);
        self.phase = Phase::Approach { led: Some(since) };
        let (chamber, at) = seen.chamber;
        if at > self.ordered[0] && (chamber.air_c - target).abs() <= REACHED * self.plan.soak.tolerance_c {
            self.reached = Some(seen.now);
            self.phase = Phase::Soak { since: seen.now };
            return Ok(Action::Reached(target));
        }
        self.on_its_way(target, since, seen)
    }

    /// The chamber may take its time to `target`, all of which was commanded at `since`, but not for ever.
    fn on_its_way(&self, target: f64, since: f64, seen: &Observation<'_>) -> Result<Action, Halt> {
        let patience = self.plan.patience.approach_s.max(self.floor_s);
        if seen.now - since <= patience {
            return Ok(Action::Wait);
        }
        let air_c = seen.chamber.0.air_c;
        let message =
            format!("the chamber does not get to {target:?} degC: {air_c:?} degC {patience:.0} s after it was told to");
        Err(Halt::GivenUp(message))
    }

    fn soak(&mut self, place: Unit, seen: &Observation<'_>, since: f64) -> Result<Action, Halt> {
        if let Some(reason) = self.left_set_point(place, seen) {
            return self.again(Phase::Approach { led: None }, reason);
        }
        let soak = &self.plan.soak;
        let soaked = seen.now - self.reached.unwrap_or(seen.now);
        if soaked < soak.time_s {
            return Ok(Action::Wait);
        }
        let Some(unsettled) = seen.trends.unsettled(soak) else {
            self.phase = Phase::Travel { begun: None };
            return Ok(Action::Wait);
        };
        // After an interruption the rates are watched anew, however long ago the soak was over.
        let watched = (seen.now - since).min(soaked - soak.time_s);
        if watched > soak.window_s + self.plan.patience.stable_s.max(self.floor_s) {
            let message = format!(
                "not settled {soaked:.0} s after {:?} degC was reached: {unsettled}",
                place.set_point_c(self.plan)
            );
            return Err(Halt::GivenUp(message));
        }
        Ok(Action::Wait)
    }

    fn left_set_point(&self, place: Unit, seen: &Observation<'_>) -> Option<String> {
        let target = place.set_point_c(self.plan);
        let air = seen.chamber.0.air_c;
        let off = (air - target).abs() > self.plan.soak.tolerance_c;
        off.then(|| format!("the chamber left its set point: air at {air:?} degC instead of {target:?}"))
    }

    fn left_place(&self, place: Unit, seen: &Observation<'_>) -> Option<String> {
        let ([outer, inner], motion) = (place.angles_deg(self.plan), &self.plan.motion);
        let TurntableReading { angles_deg, rates_deg_s, .. } = seen.table.0;
        let off = [turn_deg(outer, angles_deg[0]), turn_deg(inner, angles_deg[1])];
        let near = off.iter().all(|off| off.abs() <= motion.tolerance_deg);
        let still = rates_deg_s.iter().all(|rate| rate.abs() <= motion.still_deg_s);
        (!(near && still)).then(|| {
            format!(
                "the table is {:.4} and {:.4} deg off {outer:?}/{inner:?}, at {:.4} and {:.4} deg/s",
                off[0], off[1], rates_deg_s[0], rates_deg_s[1]
            )
        })
    }

    /// Once more, from `phase` on.
    fn again(&mut self, phase: Phase, reason: String) -> Result<Action, Halt> {
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

    fn travel(&mut self, place: Unit, seen: &Observation<'_>, begun: Option<f64>) -> Result<Action, Halt> {
        if let Some(reason) = self.left_set_point(place, seen) {
            return self.again(Phase::Approach { led: None }, reason);
        }
        let Some(begun) = begun else {
            self.ordered[1] = seen.now;
            self.phase = Phase::Travel { begun: Some(seen.now) };
            return Ok(Action::Move(place.angles_deg(self.plan)));
        };
        let at = seen.table.1;
        if at <= self.ordered[1] {
            return Ok(Action::Wait);
        }
        let Some(off) = self.left_place(place, seen) else {
            self.phase = Phase::Settle { begun, since: at };
            return Ok(Action::Wait);
        };
        let motion = &self.plan.motion;
        let way = 360.0 / motion.rate_deg_s + 2.0 * motion.rate_deg_s / motion.acceleration_deg_s2;
        if seen.now - begun > way + motion.settle_s + self.plan.patience.settle_s.max(self.floor_s) {
            return self.again(Phase::Travel { begun: None }, format!("the table does not settle: {off}"));
        }
        Ok(Action::Wait)
    }

    fn settle(&mut self, place: Unit, seen: &Observation<'_>, begun: f64, since: f64) -> Result<Action, Halt> {
        if self.left_place(place, seen).is_some() {
            self.phase = Phase::Travel { begun: Some(begun) };
        } else if seen.table.1 - since >= self.plan.motion.settle_s && seen.table.1 > since {
            self.phase = match place {
                Unit::Dwell { .. } => Phase::Dwell { begun: seen.now, complete: None },
                Unit::Run(_) => Phase::Sweep { begun: seen.now, arrived: None },
            };
            return Ok(Action::Collect(place));
        }
        Ok(Action::Wait)
    }

    fn dwell(
        &mut self,
        place: Unit,
        seen: &Observation<'_>,
        begun: f64,
        complete: Option<f64>,
    ) -> Result<Action, Halt> {
        let moved = self.left_place(place, seen).or_else(|| seen.spoiled.map(str::to_owned));
        if let Some(reason) = moved {
            return self.again(Phase::Travel { begun: None }, reason);
        }
        if let Some(reason) = self.left_set_point(place, seen) {
            return self.again(Phase::Approach { led: None }, reason);
        }
        if seen.complete {
            let complete = complete.unwrap_or(seen.now);
            self.phase = Phase::Dwell { begun, complete: Some(complete) };
            if seen.table.1 > complete {
                self.kept(seen);
                return Ok(Action::Keep(place));
            }
            return Ok(Action::Wait);
        }
        let patience = LONG * self.plan.dwell.time_s + self.plan.patience.stream_s.max(self.floor_s);
        if seen.now - begun > patience {
            let message = format!("only {:.1} s of usable samples in {patience:.0} s", seen.collected_s);
            return Err(Halt::Interrupted(message));
        }
        Ok(Action::Wait)
    }

    fn sweep(&mut self, place: Unit, seen: &Observation<'_>, begun: f64, arrived: Option<f64>) -> Result<Action, Halt> {
        if let Some(reason) = self.left_place(place, seen).or_else(|| seen.spoiled.map(str::to_owned)) {
            // From the beginning: the chamber is on its way.
            return self.again(Phase::Approach { led: None }, reason);
        }
        let Some(verify) = self.plan.verify else { return Ok(Action::Wait) };
        if seen.now - begun < verify.hold_s {
            return match self.left_set_point(place, seen) {
                Some(reason) => self.again(Phase::Approach { led: None }, reason),
                None => Ok(Action::Wait),
            };
        }
        if arrived.is_none() && seen.now - begun - verify.hold_s < LEAD_S.max(self.floor_s / 50.0) {
            // The ramp begins now, not when the set point was reached.
            self.lead = self.lead.map(|(commanded, at)| (commanded, at.max(begun + verify.hold_s)));
        }
        if self.led(verify.to_c, verify.ramp_c_per_s, seen).is_some() {
            return self.order_set_point(seen);
        }
        if self.commanded_c() != Some(verify.to_c) {
            return Ok(Action::Wait);
        }
        if arrived.is_none() && (seen.chamber.0.air_c - verify.to_c).abs() > self.plan.soak.tolerance_c {
            let commanded_at = self.lead.map_or(seen.now, |(_, at)| at);
            return self.on_its_way(verify.to_c, commanded_at, seen);
        }
        let arrived = arrived.unwrap_or(seen.now);
        self.phase = Phase::Sweep { begun, arrived: Some(arrived) };
        if seen.now - arrived < verify.hold_s {
            return Ok(Action::Wait);
        }
        self.kept(seen);
        Ok(Action::Keep(place))
    }

    /// The unit in progress is complete.
    fn kept(&mut self, seen: &Observation<'_>) {
        let before = self.place();
        self.unit += 1;
        (self.attempts, self.interruptions) = (0, 0);
        match (before, self.place()) {
            (Some(Unit::Dwell { visit, .. }), Some(Unit::Dwell { visit: next, .. })) if visit == next => {
                self.phase = Phase::Travel { begun: None };
            }
            (Some(Unit::Dwell { .. }), Some(_)) => self.phase = Phase::Stay,
            _ => self.next_place(seen),
        }
    }

    /// Leaves the set point.
    fn next_place(&mut self, seen: &Observation<'_>) {
        self.reached = None;
        self.phase = Phase::Approach { led: None };
        self.lead = self.lead.map(|(commanded, _)| (commanded, seen.now));
    }
}

/// What every controller can keep \[degC\].
fn to_tenths(celsius: f64) -> f64 {
    (celsius * 10.0).round() / 10.0
}

#[cfg(test)]
mod tests;
