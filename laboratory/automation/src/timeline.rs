//! The estimated duration of a plan: its own times, and the times that turntable and chamber need for their motions and
//! ramps.

use super::plan::{Plan, PlannedTurn, ThereAndBack};
use super::step::CampaignStep;

/// Assumed temperature of the chamber at the beginning \[degC\].
const ROOM_C: f64 = 20.0;

/// An entry of the time line.
#[derive(Clone, Debug, PartialEq)]
pub struct Milestone {
    /// Time since the beginning of the campaign \[s\].
    pub at_s: f64,
    /// What begins then, as the time line shows it.
    pub event: String,
}

/// Duration of a motion over `distance_deg` from rest to rest \[s\].
fn motion_s(distance_deg: f64, rate_deg_s: f64, acceleration_deg_s2: f64) -> f64 {
    // The rate is a trapezoid over time, or a triangle if the motion is short.
    let ramp = rate_deg_s / acceleration_deg_s2;
    let cruise = distance_deg / rate_deg_s;
    if cruise > ramp { cruise + ramp } else { 2.0 * (distance_deg / acceleration_deg_s2).sqrt() }
}

/// Time from the command of a motion until the turntable has settled \[s\].
fn travel_s(plan: &Plan, from: [f64; 2], to: [f64; 2]) -> f64 {
    let motion = &plan.motion;
    let distance = (to[0] - from[0]).abs().max((to[1] - from[1]).abs());
    motion_s(distance, motion.rate_deg_s, motion.acceleration_deg_s2) + motion.settle_s
}

/// Duration of the samples of a turn: the rests, the motion and its settling \[s\].
pub fn turn_s(plan: &Plan, turn: &PlannedTurn) -> f64 {
    let how = &plan.turn;
    let motion = motion_s(turn.angle_deg().abs(), how.rate_deg_s, how.acceleration_deg_s2);
    2.0 * how.rest_s + motion + plan.motion.settle_s
}

/// Duration of the unit of index `unit` and of the motion to it, without the approach of its set point \[s\]; `None`
/// after the last.
fn own_s(plan: &Plan, unit: usize) -> Option<f64> {
    let this = CampaignStep::of(plan, unit)?;
    let before = unit.checked_sub(1).and_then(|before| CampaignStep::of(plan, before));
    let angles = before.map_or([0.0; 2], |before| before.end_angles_deg(plan));
    let travel = travel_s(plan, angles, this.angles_deg(plan));
    Some(match this {
        CampaignStep::Dwell { .. } => travel + plan.dwell.time_s + plan.dwell.row_s.max(0.0),
        CampaignStep::Turn { turn, .. } => travel + turn_s(plan, &plan.turns[turn]),
        CampaignStep::Ramp(_) | CampaignStep::Run(_) => travel + this.way(plan).map_or(0.0, |way| way.time_s()),
    })
}

/// Duration of the unit of index `unit`, including its approach and motion \[s\]; `None` after the last.
pub fn unit_s(plan: &Plan, unit: usize) -> Option<f64> {
    let (this, own) = (CampaignStep::of(plan, unit)?, own_s(plan, unit)?);
    let (positions, each) = (plan.positions.len(), plan.units_of_set_point());
    let is_sweep = this.way(plan).is_some();
    let number = unit % each;
    let approach = if number == 0 || is_sweep {
        let from_c = match unit.checked_sub(1).and_then(|before| CampaignStep::of(plan, before)) {
            None => ROOM_C,
            // A ramp or a verification run ends where it began.
            Some(before) => before.set_point_c(plan),
        };
        (this.set_point_c(plan) - from_c).abs() / plan.ramp_c_per_s + plan.soak.time_s
    } else {
        0.0
    };
    let stay = if number + 1 == each && !is_sweep {
        // The shortest time at the set point may be longer than soak, dwells and turns together.
        let dwell = own_s(plan, unit - number + positions - 1)?;
        let turns: f64 = (unit - number + positions..=unit).filter_map(|unit| own_s(plan, unit)).sum();
        (plan.soak.stay_s - (plan.soak.time_s + positions as f64 * dwell + turns)).max(0.0)
    } else {
        0.0
    };
    Some(own + stay + approach)
}

/// Duration of all units from index `unit` on \[s\].
pub fn left_s(plan: &Plan, unit: usize) -> f64 {
    (unit..).map_while(|unit| unit_s(plan, unit)).sum()
}

/// Number of units of the plan.
pub fn units(plan: &Plan) -> usize {
    let runs = plan.verify.as_ref().map_or(0, |verify| verify.runs as usize);
    plan.set_points_c.len() * plan.units_of_set_point() + plan.ramps.len() + runs
}

/// The time line: one entry for each set point, each ramp and each verification run, and the end.
pub fn milestones(plan: &Plan) -> Vec<Milestone> {
    let mut at_s = 0.0;
    let mut milestones = Vec::new();
    for unit in 0..units(plan) {
        let Some(this) = CampaignStep::of(plan, unit) else { break };
        let event = match this {
            CampaignStep::Dwell { visit, position: 0 } => {
                let [first, last] = [plan.positions.first(), plan.positions.last()];
                let numbers = first.zip(last).map_or([0; 2], |(first, last)| [first.number, last.number]);
                let set_point = plan.set_points_c[visit];
                let turns = plan.turns.first().zip(plan.turns.last());
                let turns = turns.map_or_else(String::new, |(first, last)| {
                    if first == last {
                        format!(", turn {}", first.number)
                    } else {
                        format!(", turns {} to {}", first.number, last.number)
                    }
                });
                Some(format!("to {set_point} degC, soak, positions {} to {}{turns}", numbers[0], numbers[1]))
            }
            CampaignStep::Dwell { .. } | CampaignStep::Turn { .. } => None,
            CampaignStep::Ramp(_) | CampaignStep::Run(_) => {
                this.way(plan).map(|ThereAndBack { from_c, to_c, .. }| {
                    let [outer, inner] = this.angles_deg(plan);
                    format!("{}: {from_c} to {to_c} degC and back, at rest at {outer}/{inner} deg", this.name(plan))
                })
            }
        };
        milestones.extend(event.map(|event| Milestone { at_s, event }));
        at_s += unit_s(plan, unit).unwrap_or_default();
    }
    milestones.push(Milestone { at_s, event: "safe state".to_owned() });
    milestones
}

/// A duration as text: hours and minutes, only minutes below an hour, only seconds below half a minute.
pub fn duration(seconds: f64) -> String {
    let minutes = (seconds / 60.0).round() as u64;
    match minutes {
        0 => format!("{} s", seconds.round() as u64),
        1..60 => format!("{minutes} min"),
        _ => format!("{} h {:02} min", minutes / 60, minutes % 60),
    }
}
