//! The inverse of the residuals' covariance, by the few columns that are shared.
//!
//! ```text
//! V = s2 I + U U',   V^-1 = (I - H H')/s2,   H H' = U (s2 I + U'U)^-1 U'
//! ```

use super::covariance::{KINDS, NOISE, Shapes};
use nalgebra::{DMatrix, DVector};

/// V^-1.
pub(super) struct Inverse {
    /// H.
    half: DMatrix<f64>,
    /// s2 \[g0^2\].
    noise: f64,
}

impl Inverse {
    /// That of the covariance with these variances; `None` if one is not finite.
    pub(super) fn of(shapes: &Shapes, variances: &[f64; KINDS]) -> Option<Self> {
        let noise = variances[NOISE];
        let mut shared = shapes.scaled(variances);
        if shared.ncols() > shared.nrows() {
            // U U' = R'R with fewer columns.
            shared = shared.transpose().qr().r().transpose();
        }
        let size = shared.ncols();
        let inner = shared.tr_mul(&shared) + DMatrix::identity(size, size) * noise;
        let triangle = inner.cholesky()?.unpack();
        let half = triangle.solve_lower_triangular(&shared.transpose())?.transpose();
        Some(Self { half, noise })
    }

    /// V^-1 B.
    pub(super) fn solve(&self, right: &DMatrix<f64>) -> DMatrix<f64> {
        (right - &self.half * self.half.tr_mul(right)) / self.noise
    }

    /// V^-1 b.
    pub(super) fn solve_vector(&self, right: &DVector<f64>) -> DVector<f64> {
        (right - &self.half * self.half.tr_mul(right)) / self.noise
    }

    /// The diagonal of V^-1.
    pub(super) fn diagonal(&self) -> DVector<f64> {
        let of = |row: usize| (1.0 - self.half.row(row).norm_squared()) / self.noise;
        DVector::from_fn(self.half.nrows(), |row, _| of(row))
    }
}
