//! Earth's rate: where it is known, how it is checked, and what becomes of it at a station without angles.

use super::fit::{RateInput, effects};
use super::input::GyroscopeRun;
use super::runs::{FittedRun, RunPlace};
use super::solution::TriadSolution;
use isotherm_campaign::{Campaign, EARTH_RATE, Position, SAME_DIRECTION, horizontal_rate, vertical_rate};
use isotherm_shared::wire::AXES;
use isotherm_support::finding::{Finding, Severity, name};
use nalgebra::{Matrix3x2, Vector2, Vector3};
use std::collections::BTreeMap;

/// The horizontal rate may differ by this from that of the latitude \[deg/h\].
const HORIZONTAL_TOLERANCE: f64 = 0.02;
/// And by this many of its standard errors.
const HORIZONTAL_ERRORS: f64 = 5.0;
/// g-sensitivities this near to -2 w_Z, as a part of it, look like the wrong hemisphere.
const HEMISPHERE: f64 = 0.2;

/// Specific force and Earth's rate at a position, in IMU coordinates.
pub(super) struct Start {
    /// Specific force \[g0\].
    pub force: Vector3<f64>,
    /// The known part of Earth's rate \[deg/h\]: with angles that along the base's Z, without that along the vertical.
    pub earth: Vector3<f64>,
    /// Derivatives of Earth's rate by its components along the base's X and Y; 0 without angles.
    pub by_horizontal: [Vector3<f64>; 2],
}

impl Start {
    pub(super) fn of(campaign: &Campaign, position: &Position, tilt: Option<[f64; 2]>) -> Self {
        let known = vertical_rate(campaign.latitude_deg.unwrap_or_default());
        let force = Vector3::from(campaign.force(position, tilt).0);
        let level = Vector3::from(position.specific_force);
        let (Some(mount), Some(by_tilt)) = (campaign.mount, position.by_tilt()) else {
            return Self { force, earth: level * known, by_horizontal: [Vector3::zeros(); 2] };
        };
        // The tilt (tx, ty) turns (0, 0, 1) into (-ty, tx, 1), so that the derivatives are the base's Y and -X.
        let by_tilt = mount * Matrix3x2::from_fn(|i, j| by_tilt[i][j]);
        let (x, y, z) = (-by_tilt.column(1), by_tilt.column(0).into_owned(), level);
        let [tx, ty] = tilt.unwrap_or_default();
        let up = Vector3::new(-ty, tx, 1.0).normalize();
        Self { force, earth: z * (known / up.z), by_horizontal: [x - z * (up.x / up.z), y - z * (up.y / up.z)] }
    }
}

/// Earth's horizontal rate as it was found, compared with that of the stated latitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EarthCheck {
    /// Found \[deg/h\].
    pub found: f64,
    /// Its standard error \[deg/h\].
    pub error: Option<f64>,
    /// At the stated latitude \[deg/h\].
    pub expected: f64,
    /// The component along the base's Z \[deg/h\].
    pub along_z: f64,
}

impl EarthCheck {
    pub(super) fn of(campaign: &Campaign, tilt: Option<[f64; 2]>, solution: &TriadSolution) -> Option<Self> {
        let latitude = campaign.latitude_deg?;
        let [x, y] = solution.earth?;
        let [tx, ty] = tilt.unwrap_or_default();
        let up = Vector3::new(-ty, tx, 1.0).normalize();
        let along_z = (vertical_rate(latitude) - up.x * x - up.y * y) / up.z;
        let rate = Vector3::new(x, y, along_z);
        let found = (rate - up * up.dot(&rate)).norm();
        let error =
            solution.earth_error.map(|[ex, ey]| Vector2::new(x * ex, y * ey).norm() / Vector2::new(x, y).norm());
        Some(Self { found, error, expected: horizontal_rate(latitude), along_z })
    }

    /// A fault if the latitude cannot be right.
    pub(super) fn finding(&self, campaign: &Campaign) -> Option<Finding> {
        let off = (self.found - self.expected).abs();
        if off <= HORIZONTAL_TOLERANCE.max(HORIZONTAL_ERRORS * self.error.unwrap_or(0.0)) {
            return None;
        }
        let latitude = campaign.latitude_deg?;
        let looks = match libm::acos(self.found / EARTH_RATE).to_degrees() {
            other if other.is_finite() => format!("looks like {:.2} or {:.2} degrees", other, -other),
            _ => "is more than the whole of Earth's rate".to_owned(),
        };
        let message = format!(
            "latitude_deg = {latitude}: Earth's horizontal rate is {:.4} deg/h in the dwells and {:.4} deg/h there, {:.4} deg/h apart; it {looks}; \
             state the station's latitude; if it is right, every scale factor is wrong by as much: is angle_deg of every turn right, and were the converters full in the turns?",
            self.found, self.expected, off
        );
        Some(Finding::whole(Severity::Fault, name::LATITUDE, message))
    }
}

/// A warning if the g-sensitivities look as they do when the sign of the latitude is wrong.
pub(super) fn hemisphere(campaign: &Campaign, solution: &TriadSolution) -> Option<Finding> {
    let latitude = campaign.latitude_deg?;
    let mirrored = -2.0 * vertical_rate(latitude);
    let own = [0, 1, 2].map(|axis| solution.gyroscopes[axis].g_sensitivity[axis]);
    own.iter().all(|s| (s - mirrored).abs() < HEMISPHERE * mirrored.abs()).then(|| {
        let message = format!(
            "the g-sensitivities of G1, G2 and G3 along their own axes, {:.2}, {:.2} and {:.2} deg/h/g0, are all near {mirrored:.2}, which is what the \
             other hemisphere would give; is latitude_deg = {latitude} meant, or {}?",
            own[0], own[1], own[2], -latitude
        );
        Finding::whole(Severity::Warning, name::LATITUDE, message)
    })
}

/// What Earth's horizontal rate leaves in the estimate at a station without angles, at most.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOver {
    /// In D \[deg/h\].
    pub bias: f64,
    /// In K+ and K-, relative.
    pub scale_factor: f64,
    /// In the g-sensitivities \[deg/h/g0\].
    pub g_sensitivity: f64,
    /// In the misalignments \[rad\].
    pub misalignment: f64,
    /// The positions and turns that it comes from, in words.
    pub from: Vec<String>,
}

impl LeftOver {
    /// `None` if everything cancels.
    pub(super) fn of(
        campaign: &Campaign,
        runs: &[GyroscopeRun<'_>],
        places: &[FittedRun],
        set_points: usize,
        solution: &TriadSolution,
    ) -> Option<Self> {
        let sources = Self::sources(runs, places);
        if sources.is_empty() {
            return None;
        }
        let name = |(is_turn, index): &(bool, usize)| {
            let place = if *is_turn { RunPlace::Turn(*index) } else { RunPlace::Position(*index) };
            place.number(campaign).to_string()
        };
        let from = sources.keys().map(name).collect();
        let flat: Vec<_> = sources.into_values().flatten().collect();
        let effects = effects(runs, set_points, solution, &flat)?;
        let rate = horizontal_rate(campaign.latitude_deg.unwrap_or_default());
        // The worst heading of each place, and all of them in one direction.
        let most = |axis: usize, k: usize| -> f64 {
            effects.chunks(2).map(|pair| libm::hypot(pair[0][axis][k], pair[1][axis][k])).sum::<f64>() * rate
        };
        let largest = |parameters: core::ops::Range<usize>| {
            let all = (0..AXES).flat_map(|axis| parameters.clone().map(move |k| (axis, k)));
            isotherm_statistics::largest(all.map(|(axis, k)| most(axis, k)))
        };
        Some(Self {
            bias: largest(0..1),
            scale_factor: largest(1..3),
            misalignment: largest(3..5),
            g_sensitivity: largest(5..8),
            from,
        })
    }

    /// The runs that see the unknown rate, by position or turn (then true). In each the heading is the same at every
    /// set point, but nobody knows it: two directions a place.
    fn sources(runs: &[GyroscopeRun<'_>], places: &[FittedRun]) -> BTreeMap<(bool, usize), [RateInput; 2]> {
        let mut sources: BTreeMap<(bool, usize), [RateInput; 2]> = BTreeMap::new();
        for (index, (run, place)) in runs.iter().zip(places).enumerate() {
            let directions = match (run.turn, run.group) {
                (Some(turn), _) => {
                    level_direction(turn.axis, run.force.normalize()).map(|along| [along, Vector3::zeros()])
                }
                (None, None) => Some(across(run.force.normalize())),
                (None, Some(_)) => None,
            };
            let key = match place.place {
                RunPlace::Position(position) => (false, position),
                RunPlace::Turn(turn) => (true, turn),
            };
            if let Some(directions) = directions {
                let of_place = sources.entry(key).or_default();
                (0..2).for_each(|k| of_place[k].push((index, directions[k])));
            }
        }
        sources
    }

    pub(super) fn finding(&self) -> Finding {
        let message = format!(
            "without angles, the horizontal part of Earth's rate is not known, and it does not cancel in {}: at the worst headings it leaves {:.3} deg/h \
             of bias, {:.0} ppm of scale factor, {:.3} deg/h/g0 of g-sensitivity and {:.1e} rad of misalignment; measure each direction in two headings \
             180 degrees apart, turn about the vertical, or state the angles",
            self.from.join(", "),
            self.bias,
            self.scale_factor * 1e6,
            self.g_sensitivity,
            self.misalignment
        );
        Finding::whole(Severity::Warning, name::EARTH_RATE, message)
    }
}

/// Two unit vectors across `direction`.
fn across(direction: Vector3<f64>) -> [Vector3<f64>; 2] {
    let smallest = direction.iamin();
    let mut other = Vector3::zeros();
    other[smallest] = 1.0;
    let first = direction.cross(&other).normalize();
    [first, direction.cross(&first)]
}

/// The direction of the horizontal part of a turn's axis; `None` if the axis is vertical.
fn level_direction(axis: Vector3<f64>, up: Vector3<f64>) -> Option<Vector3<f64>> {
    let level = axis - up * up.dot(&axis);
    (level.norm() > SAME_DIRECTION).then(|| level.normalize())
}

/// Without angles: gives the runs the components of Earth's rate that nobody knows and that cancel.
///
/// - Positions of a set point with the same specific force, if their number is even, are at headings 180 degrees apart:
///   whatever Earth's horizontal rate is in each, the sum is 0.
/// - Turns of a set point about the same axis, up or down, from the same specific force begin at the same heading. What
///   is across the axis is the same in all of them. What is along the axis, if it is not vertical, is left out.
pub(super) fn eliminate_horizontal(runs: &mut [GyroscopeRun<'_>], places: &[FittedRun]) {
    let (mut group, mut next) = (0, 0);
    let set_points = places.iter().map(|place| place.set_point + 1).max().unwrap_or(0);
    for set_point in 0..set_points {
        let here: Vec<usize> = (0..runs.len()).filter(|run| places[*run].set_point == set_point).collect();
        let mut done = vec![false; runs.len()];
        for &first in &here {
            if done[first] {
                continue;
            }
            let members: Vec<usize> = here.iter().copied().filter(|run| alike(&runs[first], &runs[*run])).collect();
            members.iter().for_each(|member| done[*member] = true);
            let unknowns = match runs[first].turn {
                Some(turn) => of_turns(runs, &members, turn.axis, runs[first].force.normalize(), next),
                None => of_positions(runs, &members, places, runs[first].force.normalize(), next),
            };
            let Some(unknowns) = unknowns else { continue };
            members.iter().for_each(|member| runs[*member].group = Some(group));
            next += unknowns;
            group += 1;
        }
    }
}

/// Whether two runs have the same specific force, and turns the same axis, up or down.
fn alike(first: &GyroscopeRun<'_>, other: &GyroscopeRun<'_>) -> bool {
    let same = |a: &Vector3<f64>, b: &Vector3<f64>| (a - b).amax() < SAME_DIRECTION;
    let axes = match (first.turn, other.turn) {
        (Some(first), Some(other)) => same(&first.axis, &other.axis) || same(&first.axis, &-other.axis),
        (None, None) => true,
        _ => false,
    };
    axes && same(&first.force.normalize(), &other.force.normalize())
}

/// Gives alike turns the unknowns from `next` on, and returns their number.
fn of_turns(
    runs: &mut [GyroscopeRun<'_>],
    members: &[usize],
    axis: Vector3<f64>,
    force: Vector3<f64>,
    next: usize,
) -> Option<usize> {
    let unknown = match level_direction(axis, force) {
        None => across(force).to_vec(),
        Some(along) => vec![force.cross(&along)],
    };
    for &member in members {
        runs[member].horizontal = (next..).zip(unknown.iter().copied()).collect();
    }
    Some(unknown.len())
}

/// Gives runs in alike positions the unknowns from `next` on, and returns their number: two for each position but the
/// last, which has the opposite of their sum. `None` if the number of positions is odd.
fn of_positions(
    runs: &mut [GyroscopeRun<'_>],
    members: &[usize],
    places: &[FittedRun],
    force: Vector3<f64>,
    next: usize,
) -> Option<usize> {
    let mut positions: Vec<usize> = members.iter().map(|member| place_number(places[*member].place)).collect();
    positions.sort_unstable();
    positions.dedup();
    if positions.len() % 2 == 1 {
        return None;
    }
    let (last, directions) = (positions.len() - 1, across(force));
    let component = |k: usize, sign: f64| {
        directions.iter().enumerate().map(move |(d, direction)| (next + 2 * k + d, direction * sign))
    };
    for &member in members {
        let number = positions.iter().position(|p| *p == place_number(places[member].place)).unwrap_or(last);
        runs[member].horizontal = if number == last {
            (0..last).flat_map(|k| component(k, -1.0)).collect()
        } else {
            component(number, 1.0).collect()
        };
    }
    Some(2 * last)
}

fn place_number(place: RunPlace) -> usize {
    match place {
        RunPlace::Position(index) | RunPlace::Turn(index) => index,
    }
}
