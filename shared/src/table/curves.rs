//! The curves of tables in units in which they can be compared.

use super::content::Axis;
use crate::polynomial::Polynomial;
use crate::units::SensorKind;

/// Points of the common range that curves are compared at.
pub const POINTS: usize = 41;
/// Standard gravity \[m/s2\]: 1e6 ug0. Tables may have other values of 1 g0; differences have this one.
pub const STANDARD_GRAVITY: f64 = 9.806_65;
/// The curves of a sensor, by their names in table files.
pub const QUANTITIES: [&str; 3] = ["bias", "positive_scale_factor", "negative_scale_factor"];

/// A curve in a unit that does not depend on a table's 1 g0: m/s2 and pulse/(m/s), deg/h and pulse/arcsec.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnitCurve {
    polynomial: Polynomial,
    /// From the unit of the table.
    factor: f64,
}

impl UnitCurve {
    /// Bias, K+ and K- of a sensor; `gravity` is the table's 1 g0 \[m/s2\].
    #[must_use]
    pub fn of_sensor(kind: SensorKind, axis: &Axis, gravity: f64) -> [Self; 3] {
        let (bias, scale_factor) = match kind {
            SensorKind::Accelerometer => (axis.bias_unit.factor() * gravity, 1.0 / gravity),
            SensorKind::Gyroscope => (axis.bias_unit.factor(), 1.0),
        };
        let curve = |polynomial: &Polynomial, factor| Self { polynomial: *polynomial, factor };
        [
            curve(&axis.bias, bias),
            curve(&axis.positive_scale_factor, scale_factor),
            curve(&axis.negative_scale_factor, scale_factor),
        ]
    }

    /// The curve times a number.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self { factor: self.factor * factor, ..self }
    }

    /// The polynomial, in the table's unit.
    #[must_use]
    pub const fn polynomial(&self) -> &Polynomial {
        &self.polynomial
    }

    /// What the polynomial's value is multiplied with.
    #[must_use]
    pub const fn factor(&self) -> f64 {
        self.factor
    }

    /// The value.
    #[must_use]
    pub fn at(&self, temperature: f64) -> f64 {
        self.polynomial.at(temperature) * self.factor
    }
}

/// The common range of curves; `None` if there is none.
pub fn common_range<'a>(curves: impl IntoIterator<Item = &'a UnitCurve>) -> Option<[f64; 2]> {
    let ends = |[low, high]: [f64; 2], curve: &UnitCurve| {
        let [from, to] = curve.polynomial.range();
        [low.max(from), high.min(to)]
    };
    let range = curves.into_iter().fold([f64::NEG_INFINITY, f64::INFINITY], ends);
    (range[0] < range[1]).then_some(range)
}

/// The points of a range, rising evenly.
#[must_use]
pub fn points([low, high]: [f64; 2]) -> Vec<f64> {
    let last = (POINTS - 1) as f64;
    (0..POINTS).map(|i| (low * (last - i as f64) + high * i as f64) / last).collect()
}

/// Unit of the difference of a quantity, by its index in [`QUANTITIES`].
#[must_use]
pub const fn unit(kind: SensorKind, quantity: usize) -> &'static str {
    match (kind, quantity) {
        (SensorKind::Accelerometer, 0) => "ug0",
        (SensorKind::Gyroscope, 0) => "deg/h",
        _ => "ppm",
    }
}

/// From a difference of a quantity to its unit; `old` is the old value.
#[must_use]
pub fn unit_factor(kind: SensorKind, quantity: usize, old: f64) -> f64 {
    match (kind, quantity) {
        (SensorKind::Accelerometer, 0) => 1e6 / STANDARD_GRAVITY,
        (SensorKind::Gyroscope, 0) => 1.0,
        _ => 1e6 / old,
    }
}
