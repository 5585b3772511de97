//! How many attitudes there are, and which are missing.

use super::model::{Ellipsoid, ellipsoid};
use super::reading::Reading;
use isotherm_shared::wire::AXES;
use nalgebra::Vector3;
use std::fmt;

/// Attitudes closer than this are one [cos of 8 degrees].
const SAME: f64 = 0.990_268;
/// An attitude is there if one is as close [cos of 35 degrees].
const NEAR: f64 = 0.819_152;
/// Condition number of the ellipsoid up to which its centre is believed.
const MAX_CONDITION: f64 = 30.0;
/// Most attitudes that are named.
const NAMED: usize = 6;

/// The attitudes of some static poses.
pub(super) struct Attitudes {
    /// One direction for each.
    directions: Vec<Vector3<f64>>,
}

impl Attitudes {
    /// Finds them, about the centre of the ellipsoid where the static poses show it. The effort is linear in the number
    /// of static poses, as a sphere has room for some 500 attitudes.
    pub(super) fn of(readings: &[Reading], gravity: f64) -> Self {
        let known = ellipsoid(readings, gravity).filter(|found| found.is_closed && found.condition < MAX_CONDITION);
        let direction = |reading: &Reading| {
            let net = Vector3::from_fn(|axis, _| reading.net(axis));
            match &known {
                Some(Ellipsoid { bias, scale_factor, .. }) => {
                    Vector3::from_fn(|axis, _| net[axis] / scale_factor[axis] - bias[axis])
                }
                None => net,
            }
        };
        let mut directions: Vec<Vector3<f64>> = Vec::new();
        for direction in readings.iter().filter_map(|reading| direction(reading).try_normalize(0.0)) {
            if directions.iter().all(|other| other.dot(&direction) < SAME) {
                directions.push(direction);
            }
        }
        Self { directions }
    }

    /// The faces that no attitude is near, or the corners and edges if there is one near every face.
    fn missing(&self) -> Vec<String> {
        let mut all: Vec<Vector3<f64>> = directions().collect();
        let faces = |direction: &Vector3<f64>| direction.amax() > 0.9;
        let is_missing = |direction: &Vector3<f64>| self.directions.iter().all(|other| other.dot(direction) < NEAR);
        all.retain(is_missing);
        if all.iter().any(faces) {
            all.retain(faces);
        }
        all.iter().take(NAMED).map(up).collect()
    }
}

/// Their number, and which are missing.
impl fmt::Display for Attitudes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = self.directions.len();
        write!(f, "the static poses have {count} {}", if count == 1 { "attitude" } else { "attitudes" })?;
        match self.missing().as_slice() {
            [] => Ok(()),
            missing => write!(f, ", without {}", missing.join(", ")),
        }
    }
}

/// The 26 directions of the faces, edges and corners of a cube.
pub(super) fn directions() -> impl Iterator<Item = Vector3<f64>> {
    let signs = [0.0, 1.0, -1.0];
    let all =
        signs.into_iter().flat_map(move |a| signs.into_iter().flat_map(move |b| signs.map(|c| Vector3::new(a, b, c))));
    all.filter(|direction| *direction != Vector3::zeros()).map(|direction| direction.normalize())
}

/// How one puts an IMU down so that a direction of the 26 is up, after "with".
pub(super) fn up(direction: &Vector3<f64>) -> String {
    let names: Vec<String> = (0..AXES)
        .filter(|axis| direction[*axis] != 0.0)
        .map(|axis| format!("{}A{}", if direction[axis] < 0.0 { "-" } else { "+" }, axis + 1))
        .collect();
    match names.as_slice() {
        [one] => format!("{one} up"),
        [one, two] => format!("the edge between {one} and {two} up"),
        _ => format!("the corner between {} up", names.join(", ")),
    }
}
