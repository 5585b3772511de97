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
const NEEDED_CONFIDENCE: f64 = 0.99;

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
    solution.axes.iter().any(|axis| {
        let intervals = axis.misalignment_interval(NEEDED_CONFIDENCE).unwrap_or([f64::INFINITY; 2]);
        axis.misalignment.iter().zip(intervals).any(|(m, interval)| m.abs() > interval.max(SMALL))
    })
}

/// The misalignment matrix M. Row i: sensitivity of accelerometer i to the specific force along each axis; 1 on the
/// diagonal.
#[must_use]
pub(crate) fn misalignment(solution: &Solution) -> Matrix3<f64> {
    let mut matrix = Matrix3::identity();
    for (axis, part) in solution.axes.iter().enumerate() {
        for (k, m) in part.misalignment.into_iter().enumerate() {
            matrix[(axis, (axis + 1 + k) % AXES)] = m;
        }
    }
    matrix
}
