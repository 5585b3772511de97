//! The turns of a campaign file: `[[turn]]`, from rest to rest about one axis of the turntable.

use crate::geometry::{outer_axis, specific_force};
use crate::position::{Position, SAME_DIRECTION, angles};
use isotherm_shared::document::Section;
use isotherm_shared::wire::AXES;
use nalgebra::{Matrix3, Vector3};

/// The axis of the turntable that a turn goes about.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum TableAxis {
    /// The horizontal one, laboratory X.
    Outer,
    /// The one that the outer axis carries.
    Inner,
}

/// One turn.
#[derive(Clone, Debug, PartialEq)]
pub struct Turn {
    /// Where it begins; the number is the one in the column `position`.
    pub start: Position,
    /// Unit vector of the axis in IMU coordinates.
    pub axis: [f64; AXES],
    /// Angle, right-handed about the axis \[deg\].
    pub angle_deg: f64,
    /// The turntable's axis, and 1 or -1 if `axis` has its direction or the opposite one; `None` without angles.
    pub about: Option<(TableAxis, f64)>,
}

impl Turn {
    /// The angle times the axis \[arcsec\].
    #[must_use]
    pub fn turned(&self) -> Vector3<f64> {
        Vector3::from(self.axis) * (self.angle_deg * 3600.0)
    }

    /// The `[[turn]]` of a campaign file, with the angles where it begins; without angles the specific force there.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let Self { start: Position { number, angles, specific_force, .. }, axis, angle_deg, .. } = self;
        let vector = |vector: &[f64; AXES]| format!("[{}, {}, {}]", vector[0] + 0.0, vector[1] + 0.0, vector[2] + 0.0);
        let begin = match angles {
            Some([outer, inner]) => format!("outer_deg = {outer}   # where it begins\ninner_deg = {inner}"),
            None => format!("specific_force = {}   # where it begins", vector(specific_force)),
        };
        format!(
            "[[turn]]\nnumber = {number}\naxis = {}   # in IMU coordinates\nangle_deg = {angle_deg}   # right-handed about axis\n{begin}\n",
            vector(axis)
        )
    }
}

/// A gyroscope counts for K+ or K- in turns of at least this about its own axis \[arcsec\]: 90 deg.
pub const LEAST_TURN: f64 = 90.0 * 3600.0;
/// Most turns, and most positions next to them: a list by hand has some tens, and the equations grow with the square.
const MOST: usize = 100;
/// Largest angle \[deg\].
const LARGEST_ANGLE: f64 = 36_000.0;

const AXIS: &str = "the unit vector of the axis in IMU coordinates, for example [0, 0, 1]";
const FORCE: &str =
    "the direction of the specific force along A1, A2, A3 at the start, in units of the local gravity, length 1";

/// Reads the turns of a campaign file, or of the plan of one; `None` if one of them is wrong. `positions` is `None` if
/// they are wrong themselves.
pub fn turns(
    root: &Section<'_, '_>,
    positions: Option<&Vec<Position>>,
    mount: Option<Matrix3<f64>>,
    latitude_deg: Option<f64>,
) -> Option<Vec<Turn>> {
    let sections = root.list("turn");
    if !sections.is_empty() && latitude_deg.is_none() && !root.has("latitude_deg") {
        let message = "missing; give the latitude of the station in degrees, north positive: Earth's rate is a part of every turn";
        root.fault("latitude_deg", message);
    }
    if sections.len() > MOST || (!sections.is_empty() && positions.is_some_and(|positions| positions.len() > MOST)) {
        root.fault("turn", format!("a campaign with turns has at most {MOST} of them and {MOST} positions"));
        return None;
    }
    let known = positions.map_or(&[][..], Vec::as_slice);
    let with_angles = known.first().is_some_and(|position| position.angles.is_some());
    let mixed = known.iter().any(|position| position.angles.is_some() != with_angles);
    if !sections.is_empty() && mixed {
        root.fault(
            "position",
            "some have outer_deg and inner_deg, others have not; with turns give them everywhere or nowhere",
        );
    }
    let mut turns: Vec<Turn> = Vec::new();
    let mut complete = true;
    for section in sections {
        let angles_wanted = (positions.is_some() && !mixed).then_some(with_angles);
        match turn(&section, angles_wanted, mount) {
            Some(turn) if known.iter().any(|position| position.number == turn.start.number) => {
                section.fault("number", format!("{} is the number of a position; give another", turn.start.number));
            }
            Some(turn) if turns.iter().any(|other| other.start.number == turn.start.number) => {
                section.fault("number", format!("{} is there twice", turn.start.number));
            }
            Some(turn) => turns.push(turn),
            None => complete = false,
        }
        section.finish();
    }
    complete.then_some(turns)
}

/// A turn; `angles_wanted` says whether the positions have angles, if that is known.
fn turn(section: &Section<'_, '_>, angles_wanted: Option<bool>, mount: Option<Matrix3<f64>>) -> Option<Turn> {
    let number =
        section.integer("number", 0..=i64::from(u32::MAX), "the number that the samples carry in the column position");
    let axis = unit(section, "axis", section.numbers("axis", AXIS), AXIS);
    let angle_deg = angle_of_turn(section);
    let angles = angles_at_start(section, angles_wanted);
    let stated = if section.has("specific_force") {
        Some(unit(section, "specific_force", section.numbers("specific_force", FORCE), FORCE)?)
    } else {
        None
    };
    if stated.is_none() && angles.is_none() {
        section.fault("specific_force", format!("missing; give {FORCE}"));
    }
    let (axis, force, about) = match angles {
        None => (axis?, stated?, None),
        Some(angles) => on_the_table(section, axis?, angles, stated, angles_wanted, mount)?,
    };
    let number = u32::try_from(number?).ok()?;
    let start = Position { number, label: String::new(), angles, specific_force: force.into() };
    Some(Turn { start, axis: axis.into(), angle_deg: angle_deg?, about })
}

/// The angle of the turn \[deg\].
fn angle_of_turn(section: &Section<'_, '_>) -> Option<f64> {
    let angle = section.number("angle_deg", "the angle in degrees, right-handed about the axis, signed")?;
    let fault = match angle.abs() {
        0.0 => Some("is 0; give the angle of the turn".to_owned()),
        size if size > LARGEST_ANGLE => Some(format!("is {angle:?}, give at most {LARGEST_ANGLE} degrees")),
        _ => None,
    };
    let right = fault.is_none();
    section.refuse("angle_deg", fault);
    right.then_some(angle)
}

/// The angles at which the turn begins.
fn angles_at_start(section: &Section<'_, '_>, angles_wanted: Option<bool>) -> Option<[f64; 2]> {
    let (angles, neither) = angles(section);
    match (angles_wanted, angles) {
        (Some(true), None) if neither => {
            section.fault("", "give outer_deg and inner_deg, where the turn begins: the positions have them too");
        }
        (Some(false), Some(_)) => {
            section
                .fault("outer_deg", "the positions have no angles; give outer_deg and inner_deg everywhere or nowhere");
        }
        _ => {}
    }
    angles
}

type OnTheTable = (Vector3<f64>, Vector3<f64>, Option<(TableAxis, f64)>);

/// Axis, specific force and the turntable's axis, computed from the angles; a fault if they do not agree with what is
/// stated.
fn on_the_table(
    section: &Section<'_, '_>,
    axis: Vector3<f64>,
    [outer, inner]: [f64; 2],
    stated: Option<Vector3<f64>>,
    angles_wanted: Option<bool>,
    mount: Option<Matrix3<f64>>,
) -> Option<OnTheTable> {
    let Some(mount) = mount else {
        if angles_wanted == Some(true) {
            let message = "the positions' angles and specific forces do not show how the IMU is mounted, so that the axis cannot be checked; \
                           correct the positions";
            section.fault("axis", message);
        }
        return None;
    };
    let force = mount * Vector3::from(specific_force(outer, inner));
    if stated.is_some_and(|stated| (stated - force).amax() > SAME_DIRECTION) {
        let message = format!("contradicts outer_deg and inner_deg, at which it is {}", vector_words(force));
        section.fault("specific_force", message);
        return None;
    }
    // Laboratory X is the specific force that a quarter of a turn later would be, see `specific_force`.
    let [outer_axis, inner_axis] = [mount * outer_axis(inner), mount * Vector3::z()];
    let choices = [(TableAxis::Outer, outer_axis), (TableAxis::Inner, inner_axis)];
    let found = choices.into_iter().find_map(|(table_axis, direction)| {
        let sign = axis.dot(&direction).signum();
        ((direction * sign - axis).amax() < SAME_DIRECTION).then_some((direction * sign, (table_axis, sign)))
    });
    let Some((exact, about)) = found else {
        let message = format!(
            "is {}, which is not an axis of the turntable there; give the outer axis, {}, or the inner one, {}, or \
             the opposite of one",
            vector_words(axis),
            vector_words(outer_axis),
            vector_words(inner_axis)
        );
        section.fault("axis", message);
        return None;
    };
    Some((exact.map(|component| component + 0.0), force.map(|component| component + 0.0), Some(about)))
}

/// A vector as in a campaign file.
pub fn vector_words(vector: Vector3<f64>) -> String {
    let number = |component: &f64| {
        let text = format!("{:.4}", component + 0.0);
        let text = text.trim_end_matches('0').trim_end_matches('.');
        if text == "-0" { "0".to_owned() } else { text.to_owned() }
    };
    format!("[{}]", vector.iter().map(number).collect::<Vec<_>>().join(", "))
}

/// A vector of length 1; a few digits are enough.
fn unit(
    section: &Section<'_, '_>,
    key: &'static str,
    numbers: Option<Vec<f64>>,
    expected: &str,
) -> Option<Vector3<f64>> {
    let vector = <[f64; AXES]>::try_from(numbers?).ok().map(Vector3::from);
    let unit = vector.filter(|vector| (vector.norm() - 1.0).abs() < SAME_DIRECTION).map(|vector| vector.normalize());
    if unit.is_none() {
        section.fault(key, format!("give {expected}: three numbers, length 1"));
    }
    unit
}
