//! A direction of the specific force, as positions and ramps state it.

use crate::position::SAME_DIRECTION;
use isotherm_shared::document::Section;
use isotherm_shared::wire::AXES;

/// What the key `specific_force` has, for messages.
pub(crate) const DIRECTION: &str = "the direction of the specific force along A1, A2, A3 in units of the local gravity, length 1: \
                                    [0, 0, 1] where A3 points up";

/// The key `specific_force` of a section as a unit vector; `None`, and a fault, if it is not right.
pub(crate) fn direction(section: &Section<'_, '_>) -> Option<[f64; AXES]> {
    let force = section.numbers("specific_force", DIRECTION)?;
    let force = <[f64; AXES]>::try_from(force).ok();
    let length = force.map(|f| f.iter().map(|f| f * f).sum::<f64>().sqrt());
    match (force, length) {
        // A few digits are enough for a direction; it is scaled to length 1.
        (Some(force), Some(length)) if (length - 1.0).abs() < SAME_DIRECTION => Some(force.map(|f| f / length)),
        _ => {
            section.fault("specific_force", format!("give {DIRECTION}"));
            None
        }
    }
}
