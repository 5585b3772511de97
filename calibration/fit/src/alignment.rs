//! Misalignments, and whether a table gets the matrix that undoes them.
//!
//! An alignment matrix turns the axes of the output: from the sensors' input axes to the axes of the turntable's table,
//! which the IMU was mounted on. How the IMU sat on the fixture is part of it. A vehicle that has been boresighted with
//! one choice must keep it.

use crate::one_stage::Solution;
use isotherm_shared::wire::AXES;
use nalgebra::Matrix3;

/// A smaller misalignment does not matter \[rad\].
const SMALL: f64 = 1e-6;
/// Confidence at which a misalignment must differ from 0.
pub(crate) const NEEDED_CONFIDENCE: f64 = 0.99;

/// Whether a table gets an alignment matrix.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum AlignmentChoice {
    /// If the IMU needs one, see [`is_needed`].
    #[default]
    IfNeeded,
    /// In any case.
    With,
    /// In no case: outputs stay along the sensors' input axes.
    Without,
}

impl AlignmentChoice {
    /// The choice of options that say yes or no.
    #[must_use]
    pub const fn of(with: bool, without: bool) -> Self {
        match (with, without) {
            (true, _) => Self::With,
            (false, true) => Self::Without,
            (false, false) => Self::IfNeeded,
        }
    }

    /// The alignment matrix, inverse of the misalignment matrix: indicated = M * specific force.
    pub fn matrix(self, solution: &Solution) -> Option<Matrix3<f64>> {
        let wanted = match self {
            Self::IfNeeded => is_needed(solution),
            Self::With => true,
            Self::Without => false,
        };
        wanted.then(|| misalignment(solution).try_inverse()).flatten()
    }
}

/// Whether a misalignment of an accelerometer exceeds its 99 % interval and 1e-6 rad. Without degrees of freedom none
/// is shown.
#[must_use]
pub fn is_needed(solution: &Solution) -> bool {
    solution.axes.iter().any(|axis| is_significant(axis.misalignment, axis.misalignment_interval(NEEDED_CONFIDENCE)))
}

/// The misalignment matrix M. Row i: sensitivity of accelerometer i to the specific force along each axis; 1 on the
/// diagonal.
#[must_use]
pub(crate) fn misalignment(solution: &Solution) -> Matrix3<f64> {
    matrix_of(solution.axes.each_ref().map(|axis| axis.misalignment))
}

/// Whether a misalignment of a sensor exceeds its interval at [`NEEDED_CONFIDENCE`] and [`SMALL`]; an unknown interval
/// has no end.
pub(crate) fn is_significant(misalignment: [f64; 2], interval: Option<[f64; 2]>) -> bool {
    let interval = interval.unwrap_or([f64::INFINITY; 2]);
    misalignment.iter().zip(interval).any(|(m, interval)| m.abs() > interval.max(SMALL))
}

/// The matrix with 1 on the diagonal, and with the misalignments onto the next axis and the one after it.
pub(crate) fn matrix_of(misalignments: [[f64; 2]; AXES]) -> Matrix3<f64> {
    let rows = beside_diagonal(1.0, misalignments);
    Matrix3::from_fn(|i, j| rows[i][j])
}

/// The matrix with these values next to the diagonal: row i has the value onto the next axis and the one onto the axis
/// after it.
pub(crate) fn beside_diagonal(diagonal: f64, pairs: [[f64; 2]; AXES]) -> [[f64; AXES]; AXES] {
    let mut rows = [[diagonal; AXES]; AXES];
    for (axis, pair) in pairs.into_iter().enumerate() {
        for (k, value) in pair.into_iter().enumerate() {
            rows[axis][(axis + 1 + k) % AXES] = value;
        }
    }
    rows
}
