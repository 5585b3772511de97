//! What set points, ramps and verification runs of a plan have in common: the limits of the air, an attitude, and a way
//! there and back.

use super::model::ThereAndBack;
use super::number::{not_negative, positive};
use crate::limits::Limits;
use isotherm_campaign::{Position, specific_force};
use isotherm_shared::document::Section;
use nalgebra::{Matrix3, Vector3};

/// The limits of the chamber's air, for the check of a set point.
pub(super) struct AirLimits<'l> {
    pub limits: &'l Limits,
    /// The air may differ from a set point by this without an alarm \[degC\].
    pub tolerance_c: f64,
}

impl AirLimits<'_> {
    /// The fault of a set point \[degC\]; `None` if it is valid.
    pub(super) fn set_point(&self, celsius: f64) -> Option<String> {
        let limits = self.limits;
        limits.chamber(celsius).or_else(|| {
            let ends = [celsius - self.tolerance_c, celsius + self.tolerance_c];
            let fault = ends.into_iter().find_map(|air| limits.chamber(air));
            fault.map(|fault| format!("{celsius:?} degC, within chamber.tolerance_c: {fault}"))
        })
    }
}

/// The position at these angles of the turntable \[deg\]. Without a label it is named after the axis that points up, or
/// after its angles.
pub(super) fn position_at(number: u32, label: &str, [outer, inner]: [f64; 2], mounting: &Matrix3<f64>) -> Position {
    let force = mounted(mounting, [outer, inner]);
    let up = force.iter().position(|f| (f.abs() - 1.0).abs() < 1e-9);
    let named = up.map_or_else(
        || format!("{outer}/{inner}"),
        |axis| format!("{}{}", if force[axis] > 0.0 { '+' } else { '-' }, ["x", "y", "z"][axis]),
    );
    let label = if label.is_empty() { named } else { label.to_owned() };
    Position { number, label, angles: Some([outer, inner]), specific_force: force }
}

/// Direction of the specific force along A1, A2, A3 at these angles of the turntable \[deg\].
fn mounted(mounting: &Matrix3<f64>, [outer, inner]: [f64; 2]) -> [f64; 3] {
    // Adding 0 turns -0 into 0.
    (mounting * Vector3::from(specific_force(outer, inner))).map(|f| f + 0.0).into()
}

/// The chamber's way there and back in a ramp or a verification run.
pub(super) fn way(section: &Section<'_, '_>, air: &AirLimits<'_>) -> Option<ThereAndBack> {
    let temperature = |key, right| {
        let celsius = section.number(key, right);
        section.refuse(key, celsius.and_then(|celsius| air.set_point(celsius)));
        celsius
    };
    let from_c = temperature("from_c", "the chamber's temperature at the beginning and at the end in degC");
    let to_c = temperature("to_c", "the chamber's temperature at the other end in degC");
    let ramp_c_per_h = positive(section, "ramp_c_per_h", 20.0);
    section.refuse("ramp_c_per_h", air.limits.ramp(ramp_c_per_h / 60.0));
    let hold_s = not_negative(section, "hold_s", 1800.0);
    Some(ThereAndBack { from_c: from_c?, to_c: to_c?, ramp_c_per_s: ramp_c_per_h / 3600.0, hold_s })
}
