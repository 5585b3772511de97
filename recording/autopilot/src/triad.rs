//! The sensors of one kind in a table, in the units of the autopilots: m/s2 and rad/s.

use crate::curve;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{Axis, Content};
use isotherm_shared::units::{ARCSEC, SensorKind};
use isotherm_shared::wire::AXES;

/// The accelerometers or the gyroscopes of a table.
pub(crate) struct Triad<'a> {
    pub kind: SensorKind,
    pub axes: &'a [Axis; AXES],
    /// How far the alignment matrix is from one: of each axis the length of its row less that of the unit matrix.
    pub misalignment: [f64; AXES],
    /// Length of each axis's g-sensitivity \[deg/h/g0\].
    pub g_sensitivity: [f64; AXES],
    /// The base unit of the biases, 1 g0 or 1 deg/h \[m/s2 or rad/s\].
    pub unit: f64,
    /// The input for which sizes of scale and alignment are given: 1 g0 \[m/s2\], 1 rad/s.
    pub input: f64,
}

impl Triad<'_> {
    /// A bias in m/s2 or rad/s over 1 unit of its polynomial.
    pub(crate) fn factor(&self, axis: &Axis) -> f64 {
        axis.bias_unit.factor() * self.unit
    }

    /// The curves of the biases, as they can be written.
    pub(crate) fn curves(&self) -> Option<[TriadCurve; AXES]> {
        let curve = |axis: &Axis| {
            let polynomial = if curve::is_higher(&axis.bias) { curve::third_order(&axis.bias)? } else { axis.bias };
            Some(TriadCurve { polynomial, factor: self.factor(axis) })
        };
        let [x, y, z] = self.axes;
        Some([curve(x)?, curve(y)?, curve(z)?])
    }
}

/// A bias \[m/s2 or rad/s\] of order 3 at most.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TriadCurve {
    polynomial: Polynomial,
    factor: f64,
}

impl TriadCurve {
    /// The bias at a temperature \[degC\], clamped by the caller.
    pub(crate) fn at(&self, temperature: f64) -> f64 {
        self.polynomial.at(temperature) * self.factor
    }

    /// Coefficients of powers of (T - about), over degC^k.
    pub(crate) fn powers(&self, about: f64) -> [f64; curve::TERMS] {
        curve::powers(&self.polynomial, about).map(|power| power * self.factor)
    }

    pub(crate) fn center(&self) -> f64 {
        self.polynomial.center()
    }

    pub(crate) fn is_constant(&self) -> bool {
        self.polynomial.coefficients().iter().skip(1).all(|coefficient| *coefficient == 0.0)
    }
}

/// The triads of a table: the accelerometers, and the gyroscopes if it has any.
pub(crate) fn triads(content: &Content) -> Vec<Triad<'_>> {
    let accelerometers = Triad {
        kind: SensorKind::Accelerometer,
        axes: &content.axes,
        misalignment: misalignment(content.alignment.as_ref()),
        g_sensitivity: [0.0; AXES],
        unit: content.gravity,
        input: content.gravity,
    };
    let gyroscopes = content.gyroscopes.iter().map(|gyroscopes| Triad {
        kind: SensorKind::Gyroscope,
        axes: &gyroscopes.axes,
        misalignment: misalignment(gyroscopes.alignment.as_ref()),
        g_sensitivity: gyroscopes.g_sensitivity.map(|coefficients| coefficients.map_or(0.0, length)),
        unit: ARCSEC,
        input: 1.0,
    });
    [accelerometers].into_iter().chain(gyroscopes).collect()
}

fn misalignment(matrix: Option<&impl std::ops::Index<(usize, usize), Output = f64>>) -> [f64; AXES] {
    let row =
        |i: usize| matrix.map_or(0.0, |matrix| length([0, 1, 2].map(|j| matrix[(i, j)] - f64::from(u8::from(i == j)))));
    [row(0), row(1), row(2)]
}

fn length(vector: [f64; AXES]) -> f64 {
    vector.iter().map(|part| part * part).sum::<f64>().sqrt()
}
