//! What an IMU at rest feels at stated angles of the turntable that its table was measured on.
//!
//! Specific force and Earth's rate are constant in base coordinates (X along the outer axis, Z up at outer 0). With
//! `R = Rx(outer) Rz(inner)`, the mounting Q, the tilt (tx, ty) and Earth's rate (w_X, w_Y, w_Z) of the table's
//! provenance, they are in IMU coordinates
//!
//! ```text
//! f = Q R' (-ty, tx, 1)' / |(-ty, tx, 1)|          w = Q R' (w_X, w_Y, w_Z)'
//! ```
//! w_X and w_Y have been estimated, with standard errors; w_Z follows from the stated latitude. So the standard error
//! of w along axis i is the root of `((Q R')_iX e_X)^2 + ((Q R')_iY e_Y)^2`. An error of the stated latitude is not in
//! it.

use core::fmt;
use isotherm_campaign::base_axes;
use isotherm_shared::table::Turntable;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{CONFIDENCE, student_quantile};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Earth's rate along the axes of an IMU at rest \[deg/h\].
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct EarthRate {
    /// Along each axis of the IMU.
    pub rate: [f64; AXES],
    /// Half width of the 95 % interval of each component; `None` if the errors are not known.
    pub interval: Option<[f64; AXES]>,
}

impl EarthRate {
    /// At the angles `outer` and `inner` \[deg\].
    #[must_use]
    pub fn at(turntable: &Turntable, [outer, inner]: [f64; 2]) -> Self {
        let to_imu = turntable.mounting * base_axes(outer, inner);
        let interval = half_widths(turntable)
            .map(|[x, y]| [0, 1, 2].map(|axis| libm::hypot(to_imu[(axis, 0)] * x, to_imu[(axis, 1)] * y)));
        Self { rate: (to_imu * Vector3::from(turntable.earth_rate_deg_h)).into(), interval }
    }

    /// Half width of the 95 % interval of the rate along a level axis, for the worst heading; `None` if the errors are
    /// not known.
    #[must_use]
    pub fn largest_interval(turntable: &Turntable) -> Option<f64> {
        half_widths(turntable).map(|[x, y]| x.max(y))
    }
}

/// Half widths of the 95 % intervals of the components along X and Y \[deg/h\].
fn half_widths(turntable: &Turntable) -> Option<[f64; 2]> {
    let quantile = student_quantile(CONFIDENCE, turntable.freedom);
    turntable.earth_rate_standard_error.map(|errors| errors.map(|error| error * quantile))
}

/// The components with their intervals.
impl fmt::Display for EarthRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.rate.map(|rate| rate + 0.0);
        match self.interval {
            Some([ex, ey, ez]) => write!(f, "({x:.4} +- {ex:.4}, {y:.4} +- {ey:.4}, {z:.4} +- {ez:.4}) deg/h"),
            None => write!(f, "({x:.4}, {y:.4}, {z:.4}) deg/h, taken as exact: no errors of it are known"),
        }
    }
}

/// The direction of the specific force along A1, A2, A3 at the angles `outer` and `inner` \[deg\], a unit vector.
#[must_use]
pub(crate) fn attitude(turntable: &Turntable, [outer, inner]: [f64; 2]) -> [f64; AXES] {
    let [tx, ty] = turntable.tilt_rad;
    (turntable.mounting * base_axes(outer, inner) * Vector3::new(-ty, tx, 1.0).normalize()).into()
}
