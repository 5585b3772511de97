//! The turns of a plan: `[turns]` and `[[turn]]`, and how the turntable takes them within its limits.

use super::model::{PlannedTurn, TurnPlan};
use super::number::at_most;
use crate::limits::Limits;
use isotherm_campaign::{Position, TableAxis, Turn, outer_axis, specific_force, turns as listed_turns};
use isotherm_shared::document::Section;
use nalgebra::{Matrix3, Vector3};

/// Angles of the turns that a plan has if it lists none \[deg\]: the first that the limits allow. A longer turn halves
/// the error of K.
const WHOLE_TURNS_DEG: [f64; 2] = [720.0, 360.0];
/// Where those turns begin, in pairs that turn and unwind: outer and inner angle \[deg\], and the axis.
const PAIRS: [([f64; 2], TableAxis); 3] =
    [([0.0, 0.0], TableAxis::Outer), ([0.0, 90.0], TableAxis::Outer), ([0.0, 0.0], TableAxis::Inner)];
/// Largest angle of a row at the commanded rate \[deg\]: `calibrate` refuses rows over 30 degrees, and a servo
/// overshoots.
pub const MAX_ROW_DEG: f64 = 29.0;
/// A turn may begin this many whole turns off its stated angle: from one end of the absolute limits to the other.
const MAX_WHOLE_TURNS: i32 = 4;
/// Longest rest before and after a turn \[s\].
const MAX_REST_S: f64 = 3600.0;

/// A turn of the campaign file, and how the turntable takes it.
pub(super) type PlanTurn = (Turn, PlannedTurn);

/// The turns at each set point: those that the plan lists, or whole turns about both axes if it has `[turns]`. `None`
/// if they are wrong.
pub(super) fn turns(
    root: &Section<'_, '_>,
    positions: Option<&Vec<Position>>,
    mounting: &Matrix3<f64>,
    latitude_deg: Option<f64>,
    limits: &Limits,
) -> Option<Vec<PlanTurn>> {
    let listed = listed_turns(root, positions, Some(*mounting), latitude_deg)?;
    if listed.is_empty() && !root.has("turn") {
        if !root.has("turns") {
            return Some(Vec::new());
        }
        if !root.has("latitude_deg") {
            root.fault("latitude_deg", "missing; turns need it for Earth's rate".to_owned());
            return None;
        }
        let positions = positions?;
        let whole = whole_turns(positions, mounting, latitude_deg, limits);
        return whole
            .map_err(|fault| {
                let remedy =
                    "list each [[turn]] within the limits, or leave [turns] out to calibrate only the accelerometers";
                root.fault("turns", format!("the turntable takes whole turns: {fault}; {remedy}"));
            })
            .ok();
    }
    let mut planned: Vec<PlanTurn> = Vec::new();
    let mut complete = true;
    for (section, turn) in root.list("turn").iter().zip(listed) {
        match within(&turn, planned.last(), limits) {
            Ok(way) => planned.push((turn, way)),
            Err(fault) => {
                section.fault("angle_deg", fault);
                complete = false;
            }
        }
    }
    complete.then_some(planned)
}

/// Whole turns in both directions: about the outer axis at two inner angles, and about the inner axis; none without a
/// latitude.
///
/// # Errors
/// The limit that they exceed.
pub(super) fn whole_turns(
    positions: &[Position],
    mounting: &Matrix3<f64>,
    latitude_deg: Option<f64>,
    limits: &Limits,
) -> Result<Vec<PlanTurn>, String> {
    let mut turns: Vec<PlanTurn> = Vec::new();
    let mut numbers = (1..).filter(|number| !positions.iter().any(|position| position.number == *number));
    for (angles, table_axis) in PAIRS.into_iter().filter(|_| latitude_deg.is_some()) {
        let [outer, inner] = angles;
        let axis = match table_axis {
            TableAxis::Outer => mounting * outer_axis(inner),
            TableAxis::Inner => mounting * Vector3::z(),
        };
        let force = mounting * Vector3::from(specific_force(outer, inner));
        let pair_numbers = [numbers.next(), numbers.next()].map(Option::unwrap_or_default);
        let pair = |size: f64, before: Option<&PlanTurn>| -> Result<[PlanTurn; 2], String> {
            let turn = |number: u32, angle_deg: f64| {
                let start =
                    Position { number, label: String::new(), angles: Some(angles), specific_force: force.into() };
                Turn { start, axis: axis.into(), angle_deg, about: Some((table_axis, 1.0)) }
            };
            let planned =
                |turn: Turn, before: Option<&PlanTurn>| within(&turn, before, limits).map(|planned| (turn, planned));
            let there = planned(turn(pair_numbers[0], size), before)?;
            let back = planned(turn(pair_numbers[1], -size), Some(&there))?;
            Ok([there, back])
        };
        let longest = pair(WHOLE_TURNS_DEG[0], turns.last());
        turns.extend(longest.or_else(|_| pair(WHOLE_TURNS_DEG[1], turns.last()))?);
    }
    Ok(turns)
}

/// How the turntable takes a turn: from the angle, of those that differ by whole turns, that is within the limits at
/// both ends and nearest to the end of the turn before.
fn within(turn: &Turn, before: Option<&PlanTurn>, limits: &Limits) -> Result<PlannedTurn, String> {
    let angles = turn.start.angles.unwrap_or_default();
    let (table_axis, sign) = turn.about.unwrap_or((TableAxis::Inner, 1.0));
    let axis = match table_axis {
        TableAxis::Outer => 0,
        TableAxis::Inner => 1,
    };
    let begun_at = |whole_turns: i32| {
        let mut from_deg = angles;
        from_deg[axis] += 360.0 * f64::from(whole_turns);
        let mut to_deg = from_deg;
        to_deg[axis] += sign * turn.angle_deg;
        PlannedTurn { number: turn.start.number, axis, from_deg, to_deg }
    };
    let fault = |way: &PlannedTurn| limits.angles(way.from_deg).or_else(|| limits.angles(way.to_deg));
    let near = before.map_or(angles, |(_, before)| before.to_deg)[axis];
    let distance = |way: &PlannedTurn| (way.from_deg[axis] - near).abs();
    let possible = (-MAX_WHOLE_TURNS..=MAX_WHOLE_TURNS).map(begun_at).filter(|way| fault(way).is_none());
    possible.min_by(|a, b| distance(a).total_cmp(&distance(b))).ok_or_else(|| {
        let stated = begun_at(0);
        format!(
            "turn {} from {:?} to {:?} deg: {}, nor is it within them by whole turns",
            stated.number,
            stated.from_deg[axis],
            stated.to_deg[axis],
            fault(&stated).unwrap_or_default()
        )
    })
}

/// How a turn is taken: `[turns]`. `turns` is `None` if they are wrong themselves.
pub(super) fn turn_plan(root: &Section<'_, '_>, limits: &Limits, turns: Option<&[PlanTurn]>) -> TurnPlan {
    let mut plan = TurnPlan { rest_s: 5.0, rate_deg_s: 10.0, acceleration_deg_s2: 10.0, row_s: 1.0 };
    let section = root.optional_section("turns");
    if let Some(section) = &section {
        plan.rest_s = at_most(section, "rest_s", plan.rest_s, MAX_REST_S);
        plan.rate_deg_s = at_most(section, "rate_deg_s", plan.rate_deg_s, f64::INFINITY);
        plan.acceleration_deg_s2 = at_most(section, "acceleration_deg_s2", plan.acceleration_deg_s2, f64::INFINITY);
        // The first row and the last one must be at rest.
        plan.row_s = at_most(section, "row_s", plan.row_s.min(plan.rest_s), plan.rest_s);
    }
    let none = turns.is_some_and(<[_]>::is_empty);
    let row_deg = plan.row_s * plan.rate_deg_s;
    let long = (row_deg > MAX_ROW_DEG).then(|| {
        let limit = MAX_ROW_DEG / plan.rate_deg_s;
        format!(
            "at {:?} deg/s a row is {row_deg:?} deg long, give at most {limit:.3} s for {MAX_ROW_DEG:?} deg",
            plan.rate_deg_s
        )
    });
    let faults = [
        ("rate_deg_s", limits.rate(plan.rate_deg_s)),
        ("acceleration_deg_s2", limits.acceleration(plan.acceleration_deg_s2)),
        ("row_s", long),
    ];
    match &section {
        Some(section) => faults.into_iter().for_each(|(key, fault)| section.refuse(key, fault)),
        // The defaults.
        None if none => {}
        None => {
            let fault = faults.into_iter().find_map(|(key, fault)| Some(format!("give {key}: {}", fault?)));
            root.refuse("turns", fault);
        }
    }
    if let Some(section) = section {
        section.finish();
    }
    plan
}
