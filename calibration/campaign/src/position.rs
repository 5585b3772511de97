//! One position of the turntable.

use crate::geometry::{laboratory_axes, specific_force};
use isotherm_shared::document::Section;
use isotherm_shared::wire::AXES;

/// One position of the turntable.
#[derive(Clone, Debug, PartialEq)]
pub struct Position {
    /// Its number in the samples.
    pub number: u32,
    /// Its name for the user; may be empty.
    pub label: String,
    /// Outer and inner angle \[deg\], if stated.
    pub angles: Option<[f64; 2]>,
    /// Direction of the specific force along A1, A2, A3; a unit vector.
    pub specific_force: [f64; AXES],
}

impl Position {
    /// The position at the angles `outer` and `inner` \[deg\].
    ///
    /// ```
    /// use isotherm_campaign::Position;
    ///
    /// let position = Position::at(3, 180.0, 0.0);
    /// assert_eq!((position.label.as_str(), position.specific_force), ("-z", [0.0, 0.0, -1.0]));
    /// ```
    #[must_use]
    pub fn at(number: u32, outer: f64, inner: f64) -> Self {
        let specific_force = specific_force(outer, inner);
        let label = match specific_force.iter().position(|f| f.abs() == 1.0) {
            Some(axis) => format!("{}{}", if specific_force[axis] > 0.0 { '+' } else { '-' }, ["x", "y", "z"][axis]),
            None => format!("{outer}/{inner}"),
        };
        Self { number, label, angles: Some([outer, inner]), specific_force }
    }

    /// Derivative of the specific force along A1, A2, A3 by the base's tilt (tx, ty) \[1/rad\]; `None` without angles.
    #[must_use]
    pub fn by_tilt(&self) -> Option<[[f64; 2]; AXES]> {
        let [outer, inner] = self.angles?;
        let [x, y, _] = laboratory_axes(outer, inner);
        Some(core::array::from_fn(|i| [y[i], -x[i]]))
    }
}

/// Two directions are the same if all components agree within this: a few digits are enough to state a direction.
pub const SAME_DIRECTION: f64 = 2e-3;

/// Outer and inner angle of the turntable, if both are stated; and whether neither is.
pub(crate) fn angles(section: &Section<'_, '_>) -> (Option<[f64; 2]>, bool) {
    let (outer, inner) = (section.optional_number("outer_deg"), section.optional_number("inner_deg"));
    section.fault_if(outer.is_some() != inner.is_some(), "", "give both outer_deg and inner_deg, or neither");
    (outer.zip(inner).map(|(outer, inner)| [outer, inner]), outer.is_none() && inner.is_none())
}
