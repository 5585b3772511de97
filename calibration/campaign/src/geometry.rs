//! Geometry of a two-axis turntable, and Earth's rate.
//!
//! # Convention
//! The outer axis is horizontal (laboratory X), the inner axis is carried by it and points up at outer = 0. At
//! outer = inner = 0 the input axes of A1, A2, A3 lie along the laboratory's X, Y, Z. Angles are right-handed, so that
//! body to laboratory is `R = Rx(outer) Rz(inner)`, and at rest, in units of the local gravity,
//!
//! ```text
//! f = R' (0, 0, 1)' = ( sin(outer) sin(inner),  sin(outer) cos(inner),  cos(outer) )
//! ```
//! An input axis that points up reads +1. If the base is tilted by the small angles (tx, ty) about the laboratory's X
//! and Y, `(0, 0, 1)` becomes `(-ty, tx, 1)`.

use isotherm_shared::units::ARCSEC;
use isotherm_shared::wire::AXES;
use nalgebra::{Matrix3, Vector3};

/// Earth's rate \[deg/h\]: 7.292115e-5 rad/s.
pub const EARTH_RATE: f64 = 7.292_115e-5 / ARCSEC;
/// Specific force along A1, A2, A3 at the angles \[deg\], in units of the local gravity.
///
/// ```
/// use isotherm_campaign::specific_force;
///
/// assert_eq!(specific_force(0.0, 0.0), [0.0, 0.0, 1.0]); // A3 up
/// assert_eq!(specific_force(90.0, 0.0), [0.0, 1.0, 0.0]); // A2 up
/// assert_eq!(specific_force(90.0, 90.0), [1.0, 0.0, 0.0]); // A1 up
/// ```
#[must_use]
pub fn specific_force(outer: f64, inner: f64) -> [f64; AXES] {
    let [_, _, z] = laboratory_axes(outer, inner);
    // Adding 0 turns -0 into 0, which matters where it is printed.
    z.map(|f| f + 0.0)
}

/// The laboratory's X, Y and Z along A1, A2, A3 at the angles \[deg\]: the columns of R'.
#[must_use]
pub fn laboratory_axes(outer: f64, inner: f64) -> [[f64; AXES]; 3] {
    let ((so, co), (si, ci)) = (sin_cos(outer), sin_cos(inner));
    [[ci, -si, 0.0], [si * co, ci * co, -so], [so * si, so * ci, co]]
}

/// The base's X, Y and Z in IMU coordinates at the angles \[deg\], as columns: R' of the module's convention.
#[must_use]
pub fn base_axes(outer: f64, inner: f64) -> Matrix3<f64> {
    let ((so, co), (si, ci)) = (sin_cos(outer), sin_cos(inner));
    Matrix3::new(ci, si * co, so * si, -si, ci * co, so * ci, 0.0, -so, co)
}

/// Direction of the outer axis at the inner angle \[deg\], along the turntable's table: (cos, -sin, 0).
#[must_use]
pub fn outer_axis(inner: f64) -> Vector3<f64> {
    let [x, _, _] = laboratory_axes(0.0, inner);
    // Adding 0 turns -0 into 0, which matters where it is printed.
    Vector3::from(x).map(|component| component + 0.0)
}

/// The rate about the vertical at the latitude \[deg\], in deg/h; positive in the north.
///
/// ```
/// use isotherm_campaign::{EARTH_RATE, horizontal_rate, vertical_rate};
///
/// assert!((EARTH_RATE - 15.041).abs() < 1e-3); // deg/h
/// assert!((vertical_rate(30.0) - 0.5 * EARTH_RATE).abs() < 1e-12);
/// assert!((horizontal_rate(60.0) - 0.5 * EARTH_RATE).abs() < 1e-12);
/// ```
#[must_use]
pub fn vertical_rate(latitude_deg: f64) -> f64 {
    EARTH_RATE * libm::sin(latitude_deg.to_radians())
}

/// The horizontal rate at the latitude \[deg\], in deg/h.
#[must_use]
pub fn horizontal_rate(latitude_deg: f64) -> f64 {
    EARTH_RATE * libm::cos(latitude_deg.to_radians())
}

/// Sine and cosine of an angle in degrees, exact at multiples of 90.
fn sin_cos(degrees: f64) -> (f64, f64) {
    let quarter = (degrees / 90.0).round();
    let (s, c) = libm::sincos((degrees - quarter * 90.0).to_radians());
    match quarter.rem_euclid(4.0) as u8 {
        0 => (s, c),
        1 => (c, -s),
        2 => (-s, -c),
        _ => (-c, s),
    }
}
