//! How long a plan takes: what it asks for, and what table and chamber need to follow.

use super::machine::Unit;
use super::plan::Plan;

/// Where a chamber is taken to begin \[degC\].
const ROOM_C: f64 = 20.0;

/// A moment of the campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct Moment {
    /// Since the beginning \[s\].
    pub at_s: f64,
    /// What happens then.
    pub what: String,
}

/// From commanding a way of the table until it has settled \[s\].
fn travel_s(plan: &Plan, from: [f64; 2], to: [f64; 2]) -> f64 {
    let motion = &plan.motion;
    let way = (to[0] - from[0]).abs().max((to[1] - from[1]).abs());
    // Up to the rate, and down again.
    let ramp = motion.rate_deg_s / motion.acceleration_deg_s2;
    let cruise = way / motion.rate_deg_s;
    let turn = if cruise > ramp { cruise + ramp } else { 2.0 * (way / motion.acceleration_deg_s2).sqrt() };
    turn + motion.settle_s
}

/// What unit `unit` takes, with the way to it \[s\]; `None` after the last.
pub fn unit_s(plan: &Plan, unit: usize) -> Option<f64> {
    let place = Unit::of(plan, unit)?;
    let before = unit.checked_sub(1).and_then(|before| Unit::of(plan, before));
    let angles = before.map_or([0.0; 2], |before| before.angles_deg(plan));
    let travel = travel_s(plan, angles, place.angles_deg(plan));
    let from_c = match before {
        None => ROOM_C,
        Some(Unit::Run(_)) => plan.verify.map_or(ROOM_C, |verify| verify.to_c),
        Some(before) => before.set_point_c(plan),
    };
    let approach = (place.set_point_c(plan) - from_c).abs() / plan.ramp_c_per_s + plan.soak.time_s;
    Some(match place {
        Unit::Dwell { position, .. } => {
            let row = if plan.dwell.row_s > 0.0 { plan.dwell.row_s } else { 0.0 };
            let dwell = travel + plan.dwell.time_s + row;
            let last = position + 1 == plan.positions.len();
            // The least time at the set point may be longer than what is done there.
            let done = plan.soak.time_s + plan.positions.len() as f64 * dwell;
            let stay = if last { (plan.soak.stay_s - done).max(0.0) } else { 0.0 };
            dwell + stay + if position == 0 { approach } else { 0.0 }
        }
        Unit::Run(_) => {
            let sweep = plan
                .verify
                .map_or(0.0, |verify| (verify.to_c - verify.from_c).abs() / verify.ramp_c_per_s + 2.0 * verify.hold_s);
            approach + travel + sweep
        }
    })
}

/// What is left from `unit` on \[s\].
pub fn left_s(plan: &Plan, unit: usize) -> f64 {
    (unit..).map_while(|unit| unit_s(plan, unit)).sum()
}

/// How many units there are.
pub fn units(plan: &Plan) -> usize {
    plan.set_points_c.len() * plan.positions.len() + plan.verify.map_or(0, |verify| verify.runs as usize)
}

/// The time line: set points and runs.
pub fn moments(plan: &Plan) -> Vec<Moment> {
    let mut at_s = 0.0;
    let mut moments = Vec::new();
    for unit in 0..units(plan) {
        let Some(place) = Unit::of(plan, unit) else { break };
        let takes = unit_s(plan, unit).unwrap_or_default();
        let what = match place {
            Unit::Dwell { visit, position: 0 } => {
                let [first, last] = [plan.positions.first(), plan.positions.last()];
                let numbers = first.zip(last).map_or([0; 2], |(first, last)| [first.number, last.number]);
                let set_point = plan.set_points_c[visit];
                Some(format!("to {set_point} degC, soak, positions {} to {}", numbers[0], numbers[1]))
            }
            Unit::Dwell { .. } => None,
            Unit::Run(_) => plan
                .verify
                .map(|verify| format!("{}: {} to {} degC at rest", place.name(plan), verify.from_c, verify.to_c)),
        };
        moments.extend(what.map(|what| Moment { at_s, what }));
        at_s += takes;
    }
    moments.push(Moment { at_s, what: "safe state".to_owned() });
    moments
}

/// Hours and minutes, or what is left of them.
pub fn duration(seconds: f64) -> String {
    let minutes = (seconds / 60.0).round() as u64;
    match minutes {
        0 => format!("{} s", seconds.round() as u64),
        1..60 => format!("{minutes} min"),
        _ => format!("{} h {:02} min", minutes / 60, minutes % 60),
    }
}
