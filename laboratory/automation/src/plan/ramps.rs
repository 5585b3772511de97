//! The ramps of a plan: `[[ramp]]`, each a stay at one attitude in which the chamber goes there and back.

use super::model::RampPlan;
use super::stay::{AirLimits, position_at, way};
use isotherm_shared::document::Section;
use nalgebra::Matrix3;

/// Largest number of ramps of a plan.
const MAX_RAMPS: usize = 100;

/// The ramps that the plan lists; `None` if one of them is wrong.
pub(super) fn ramps(root: &Section<'_, '_>, mounting: &Matrix3<f64>, air: &AirLimits<'_>) -> Option<Vec<RampPlan>> {
    let sections = root.list("ramp");
    if sections.len() > MAX_RAMPS {
        root.fault("ramp", format!("there are {}, give at most {MAX_RAMPS}", sections.len()));
    }
    // All of them are read before the first that is wrong ends this function.
    let ramps: Vec<_> = sections.into_iter().map(|section| ramp(section, mounting, air)).collect();
    ramps.into_iter().collect()
}

fn ramp(section: Section<'_, '_>, mounting: &Matrix3<f64>, air: &AirLimits<'_>) -> Option<RampPlan> {
    let way = way(&section, air);
    // The air would have arrived before it has begun to ramp.
    let none = way.filter(|way| (way.to_c - way.from_c).abs() <= 2.0 * air.tolerance_c);
    section.refuse(
        "to_c",
        none.map(|way| format!("is {:?}, as from_c within chamber.tolerance_c: a ramp warms and cools", way.to_c)),
    );
    let angles = ["outer_deg", "inner_deg"].map(|key| section.optional_number(key).unwrap_or(0.0));
    section.refuse("", air.limits.angles(angles));
    section.finish();
    Some(RampPlan { way: way?, attitude: position_at(0, "", angles, mounting) })
}
