//! The estimated duration of a plan: its own times, and the times that turntable and chamber need for their motions and ramps.

use super::machine::Unit;
use super::plan::Plan;

/// Assumed temperature of the chamber at the beginning \[degC\].
const ROOM_C: f64 = 20.0;

/// An entry of the time line.
#[derive(Clone, Debug, PartialEq)]
pub struct Moment {
    /// Time since the beginning of the campaign \[s\].
    pub at_s: f64,
    /// What begins then, as the time line shows it.
    pub event: String,
}

/// Time from the command of a motion until the turntable has settled \[s\].
fn travel_s(plan: &Plan, from: [f64; 2], to: [f64; 2]) -> f64 {
    let motion = &plan.motion;
    let distance = (to[0] - from[0]).abs().max((to[1] - from[1]).abs());
    // The rate is a trapezoid over time, or a triangle if the motion is short.
    let ramp = motion.rate_deg_s / motion.acceleration_deg_s2;
    let cruise = distance / motion.rate_deg_s;
    let turn = if cruise > ramp { cruise + ramp } else { 2.0 * (distance / motion.acceleration_deg_s2).sqrt() };
    turn + motion.settle_s
}

/// Duration of the unit of index `unit`, including its approach and motion \[s\]; `None` after the last.
pub fn unit_s(plan: &Plan, unit: usize) -> Option<f64> {
    let this = Unit::of(plan, unit)?;
    let before = unit.checked_sub(1).and_then(|before| Unit::of(plan, before));
    let angles = before.map_or([0.0; 2], |before| before.angles_deg(plan));
    let travel = travel_s(plan, angles, this.angles_deg(plan));
    let from_c = match before {
        None => ROOM_C,
        Some(Unit::Run(_)) => plan.verify.as_ref().map_or(ROOM_C, |verify| verify.to_c),
        Some(before) => before.set_point_c(plan),
    };
    let approach = (this.set_point_c(plan) - from_c).abs() / plan.ramp_c_per_s + plan.soak.time_s;
    Some(match this {
        Unit::Dwell { position, .. } => {
            let row = if plan.dwell.row_s > 0.0 { plan.dwell.row_s } else { 0.0 };
            let dwell = travel + plan.dwell.time_s + row;
            let last = position + 1 == plan.positions.len();
            // The shortest time at the set point may be longer than soak and dwells together.
            let done = plan.soak.time_s + plan.positions.len() as f64 * dwell;
            let stay = if last { (plan.soak.stay_s - done).max(0.0) } else { 0.0 };
            dwell + stay + if position == 0 { approach } else { 0.0 }
        }
        Unit::Run(_) => {
            let sweep = plan
                .verify
                .as_ref()
                .map_or(0.0, |verify| (verify.to_c - verify.from_c).abs() / verify.ramp_c_per_s + 2.0 * verify.hold_s);
            approach + travel + sweep
        }
    })
}

/// Duration of all units from index `unit` on \[s\].
pub fn left_s(plan: &Plan, unit: usize) -> f64 {
    (unit..).map_while(|unit| unit_s(plan, unit)).sum()
}

/// Number of units of the plan.
pub fn units(plan: &Plan) -> usize {
    plan.set_points_c.len() * plan.positions.len() + plan.verify.as_ref().map_or(0, |verify| verify.runs as usize)
}

/// The time line: one entry for each set point and each verification run, and the end.
pub fn moments(plan: &Plan) -> Vec<Moment> {
    let mut at_s = 0.0;
    let mut moments = Vec::new();
    for unit in 0..units(plan) {
        let Some(this) = Unit::of(plan, unit) else { break };
        let event = match this {
            Unit::Dwell { visit, position: 0 } => {
                let [first, last] = [plan.positions.first(), plan.positions.last()];
                let numbers = first.zip(last).map_or([0; 2], |(first, last)| [first.number, last.number]);
                let set_point = plan.set_points_c[visit];
                Some(format!("to {set_point} degC, soak, positions {} to {}", numbers[0], numbers[1]))
            }
            Unit::Dwell { .. } => None,
            Unit::Run(_) => plan.verify.as_ref().map(|verify| {
                let [outer, inner] = this.angles_deg(plan);
                let (from_c, to_c) = (verify.from_c, verify.to_c);
                format!("{}: {from_c} to {to_c} degC at rest, at {outer}/{inner} deg", this.name(plan))
            }),
        };
        moments.extend(event.map(|event| Moment { at_s, event }));
        at_s += unit_s(plan, unit).unwrap_or_default();
    }
    moments.push(Moment { at_s, event: "safe state".to_owned() });
    moments
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
