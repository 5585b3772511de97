//! The turntable that a table was measured on, as far as the table's provenance says: how its base stood, how the IMU
//! sat on it, and Earth's rate there.

use crate::document::LenientSection;
use crate::wire::AXES;
use nalgebra::Matrix3;

/// More than Earth's rate \[deg/h\]: 15.041.
const MAX_EARTH_RATE: f64 = 15.1;
/// Largest tilt of a base that counts as level \[rad\].
const MAX_TILT: f64 = 0.1;
/// A mounting may differ by this from a rotation, or from a reflection.
const MOUNTING_TOLERANCE: f64 = 1e-3;

/// The turntable that a table was measured on. Base coordinates: X along the outer axis, Z up at outer 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turntable {
    /// Earth's rate in base coordinates \[deg/h\].
    pub earth_rate_deg_h: [f64; AXES],
    /// Standard errors of the components along X and Y \[deg/h\]; `None` if they are not known.
    pub earth_rate_standard_error: Option<[f64; 2]>,
    /// Degrees of freedom of these errors: the number of set points minus 1.
    pub freedom: usize,
    /// The tilt of the base about X and Y \[rad\].
    pub tilt_rad: [f64; 2],
    /// The rotation from the direction that the angles give to that in IMU coordinates.
    pub mounting: Matrix3<f64>,
}

impl Turntable {
    /// Reads it from the keys `earth_rate_deg_h`, `earth_rate_standard_error`, `set_points`, `tilt_rad` and `mounting`
    /// of the provenance. `None` if Earth's rate is not there, or if one of them cannot be right.
    pub(super) fn read(provenance: LenientSection<'_, '_>) -> Option<Self> {
        let within = |values: &[f64], most: f64| values.iter().map(|v| v * v).sum::<f64>().sqrt() <= most;
        let earth_rate_deg_h = <[f64; AXES]>::try_from(provenance.numbers("earth_rate_deg_h")?).ok()?;
        let pair = |key: &str| <[f64; 2]>::try_from(provenance.numbers(key)?).ok();
        // What is there must be right.
        let optional_pair = |key: &str| if provenance.has(key) { pair(key).map(Some) } else { Some(None) };
        let earth_rate_standard_error = optional_pair("earth_rate_standard_error")?;
        let tilt_rad = optional_pair("tilt_rad")?.unwrap_or_default();
        let mounting = if provenance.has("mounting") {
            let rows = provenance.matrix("mounting")?;
            let square = rows.len() == AXES && rows.iter().all(|row| row.len() == AXES);
            square.then(|| Matrix3::from_row_iterator(rows.into_iter().flatten()))?
        } else {
            Matrix3::identity()
        };
        let right = within(&earth_rate_deg_h, MAX_EARTH_RATE)
            && within(&tilt_rad, MAX_TILT)
            && earth_rate_standard_error.iter().flatten().all(|error| (0.0..=MAX_EARTH_RATE).contains(error))
            && (mounting * mounting.transpose() - Matrix3::identity()).amax() < MOUNTING_TOLERANCE;
        let set_points = provenance.number("set_points").map_or(0, |count| count as usize);
        let freedom = set_points.saturating_sub(1).max(1);
        right.then_some(Self { earth_rate_deg_h, earth_rate_standard_error, freedom, tilt_rad, mounting })
    }
}
