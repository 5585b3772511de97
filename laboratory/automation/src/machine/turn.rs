//! The transitions within a turn: rest, one motion or several, rest; and what makes a turn useless.

use super::{Action, CampaignMachine, Halt, Observation, Phase, TurnStage, TurnState};
use crate::plan::{PlannedTurn, TurnPlan};
use crate::step::CampaignStep;
use isotherm_instruments::TurntableReading;

/// The read-backs before and after a turn differ by its angle within this, or within two of their last digits
/// \[deg\]: 1.4 ppm of 360 deg.
const TURN_TOLERANCE_DEG: f64 = 0.0005;
/// While the turntable turns, its angles may be this far off the way \[deg\].
const WAY_MARGIN_DEG: f64 = 1.0;
/// Largest motion of a turn for a controller that counts angles modulo 360 degrees \[deg\]: it takes the shorter way.
const MAX_WRAPPED_MOVE_DEG: f64 = 120.0;

impl CampaignMachine<'_> {
    /// The phase of a turn: rest, motions, rest.
    pub(super) fn turn(
        &mut self,
        unit: CampaignStep,
        observation: &Observation<'_>,
        state: TurnState,
    ) -> Result<Action, Halt> {
        let CampaignStep::Turn { turn, .. } = unit else { return Ok(Action::Wait) };
        let turn = self.plan.turns[turn];
        let off = match state.stage {
            TurnStage::Before { .. } => self.deviation_from(turn.from_deg, observation),
            TurnStage::Turning { motion, .. } => self.off_the_way(&turn, motion, observation),
            TurnStage::After { .. } => self.deviation_from(turn.to_deg, observation),
        };
        if let Some(reason) = off.or_else(|| observation.spoiled.map(str::to_owned)) {
            return self.retry_from(Phase::Travel { begun: None }, reason);
        }
        if let Some(reason) = self.chamber_deviation(unit, observation) {
            return self.retry_from(Phase::Approach { commanded_at: None }, reason);
        }
        match state.stage {
            TurnStage::Before { complete } => self.rest_before(&turn, observation, state, complete),
            TurnStage::Turning { motion, commanded, arrived } => {
                self.turning(&turn, observation, state, (motion, commanded, arrived))
            }
            TurnStage::After { settled, complete } => {
                let Some(after) = self.rest_after(observation, state, settled, complete)? else {
                    return Ok(Action::Wait);
                };
                match self.wrong_angle(&turn, state.before_deg, after) {
                    Some(reason) => self.retry_from(Phase::Travel { begun: None }, reason),
                    None => Ok(self.complete_unit(unit, Some([state.before_deg, after.angles_deg]), observation)),
                }
            }
        }
    }

    /// The rest before a turn. The reading that follows its samples is the read-back before the turn.
    fn rest_before(
        &mut self,
        turn: &PlannedTurn,
        observation: &Observation<'_>,
        state: TurnState,
        complete: Option<f64>,
    ) -> Result<Action, Halt> {
        let rest_s = self.plan.turn.rest_s;
        if observation.collected_s < rest_s {
            return self.wait_for_samples(rest_s, state.begun, observation);
        }
        let (reading, at) = observation.turntable;
        let complete = complete.unwrap_or(observation.now);
        if at > complete {
            let state = TurnState { before_deg: reading.angles_deg, ..state };
            return Ok(self.command_motion(turn, 1, state, observation));
        }
        self.phase = Phase::Turn(TurnState { stage: TurnStage::Before { complete: Some(complete) }, ..state });
        Ok(Action::Wait)
    }

    /// A motion of a turn: its number, when it was commanded, and when the turntable arrived.
    fn turning(
        &mut self,
        turn: &PlannedTurn,
        observation: &Observation<'_>,
        state: TurnState,
        (motion, commanded, arrived): (u32, f64, Option<f64>),
    ) -> Result<Action, Halt> {
        let at = observation.turntable.1;
        if at <= self.last_command[1] {
            return Ok(Action::Wait);
        }
        let deviation = self.deviation_from(self.target_deg(turn, motion), observation);
        if deviation.is_none() && motion < self.motions(turn) {
            return Ok(self.command_motion(turn, motion + 1, state, observation));
        }
        let arrived = if deviation.is_none() { Some(arrived.unwrap_or(at)) } else { None };
        let has_settled = arrived.is_some_and(|arrived| at > arrived && at - arrived >= self.plan.motion.settle_s);
        let stage = if has_settled {
            TurnStage::After { settled: observation.now, complete: None }
        } else {
            TurnStage::Turning { motion, commanded, arrived }
        };
        self.phase = Phase::Turn(TurnState { stage, ..state });
        let TurnPlan { rate_deg_s, acceleration_deg_s2, .. } = self.plan.turn;
        let longest = turn.angle_deg().abs() / rate_deg_s + 2.0 * rate_deg_s / acceleration_deg_s2;
        let patience = self.plan.patience.settle_s.max(self.min_timeout_s);
        match deviation {
            Some(deviation) if observation.now - commanded > longest + self.plan.motion.settle_s + patience => {
                self.retry_from(Phase::Travel { begun: None }, format!("the turn does not end: {deviation}"))
            }
            _ => Ok(Action::Wait),
        }
    }

    /// The rest after a turn. Returns the reading that follows its samples, the read-back after the turn; `None` before
    /// that.
    fn rest_after<'o>(
        &mut self,
        observation: &Observation<'o>,
        state: TurnState,
        settled: f64,
        complete: Option<f64>,
    ) -> Result<Option<&'o TurntableReading>, Halt> {
        // No sample is missing since the begin; therefore so many seconds of them end after the rest.
        let rest_s = self.plan.turn.rest_s;
        if observation.collected_s < settled - state.begun + rest_s {
            self.wait_for_samples(rest_s, settled, observation)?;
            return Ok(None);
        }
        let (reading, at) = observation.turntable;
        let complete = complete.unwrap_or(observation.now);
        let stage = TurnStage::After { settled, complete: Some(complete) };
        self.phase = Phase::Turn(TurnState { stage, ..state });
        Ok((at > complete).then_some(reading))
    }

    /// Number of motions that a turn is commanded by.
    fn motions(&self, turn: &PlannedTurn) -> u32 {
        let motions = (turn.angle_deg().abs() / MAX_WRAPPED_MOVE_DEG).ceil();
        if self.plan.turntable.wraps() { motions.max(1.0) as u32 } else { 1 }
    }

    /// Angles after a motion of a turn, counted from 1; those where it begins for 0 \[deg\].
    fn target_deg(&self, turn: &PlannedTurn, motion: u32) -> [f64; 2] {
        let motions = self.motions(turn);
        if motion == motions {
            return turn.to_deg;
        }
        let mut target = turn.from_deg;
        target[turn.axis] += turn.angle_deg() * f64::from(motion) / f64::from(motions);
        target
    }

    fn command_motion(
        &mut self,
        turn: &PlannedTurn,
        motion: u32,
        state: TurnState,
        observation: &Observation<'_>,
    ) -> Action {
        self.last_command[1] = observation.now;
        let stage = TurnStage::Turning { motion, commanded: observation.now, arrived: None };
        self.phase = Phase::Turn(TurnState { stage, ..state });
        Action::Turn(self.target_deg(turn, motion))
    }

    /// Why the turntable is not on the way of a motion of a turn; `None` if it is.
    fn off_the_way(&self, turn: &PlannedTurn, motion: u32, observation: &Observation<'_>) -> Option<String> {
        let [from, to] = [motion - 1, motion].map(|motion| self.target_deg(turn, motion));
        let angles_deg = observation.turntable.0.angles_deg;
        let whole = to[turn.axis] - from[turn.axis];
        let turned = self.rotation_deg(from, angles_deg);
        let along = turned[turn.axis] * whole.signum();
        let on_the_way = (-WAY_MARGIN_DEG..=whole.abs() + WAY_MARGIN_DEG).contains(&along)
            && turned[1 - turn.axis].abs() <= WAY_MARGIN_DEG;
        (!on_the_way).then(|| {
            let [outer, inner] = angles_deg;
            format!("the turntable is at {outer:?}/{inner:?} deg, which is not on the way from {from:?} to {to:?}")
        })
    }

    /// Why the read-backs do not differ by the angle of a turn; `None` if they do.
    fn wrong_angle(&self, turn: &PlannedTurn, before: [f64; 2], after: &TurntableReading) -> Option<String> {
        let mut expected = before;
        expected[turn.axis] += turn.angle_deg();
        let off = self.rotation_deg(expected, after.angles_deg)[turn.axis];
        let tolerance = TURN_TOLERANCE_DEG.max(2.0 * after.resolution_deg);
        // The difference of decimal fractions is not exact.
        (off.abs() > tolerance + 1e-9).then(|| {
            let (angle, [before, after]) = (turn.angle_deg(), [before, after.angles_deg].map(|angles| angles[turn.axis]));
            format!(
                "the read-backs {before:?} and {after:?} deg differ by {off:.5} deg from {angle:?} deg, {tolerance:?} deg is allowed"
            )
        })
    }
}
