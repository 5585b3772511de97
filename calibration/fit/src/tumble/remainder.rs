//! Residuals and shapes in the space that some columns leave.

use super::covariance::{Shapes, beside};
use nalgebra::{DMatrix, DVector};

/// Columns of the pivoted triangle below this share of the largest depend on the others.
const DEPENDENT: f64 = 1e-9;

/// Coordinates in which the shapes are not 0, and what the residuals have in addition to them.
pub(super) struct Remainder {
    /// The residuals.
    pub right: DVector<f64>,
    /// The columns of the shapes.
    pub shapes: Shapes,
    /// Dimensions that no shape reaches.
    pub others: usize,
    /// Squares of the residuals in them \[g0^2\].
    pub other_squares: f64,
}

impl Remainder {
    /// What `columns` leave of the residuals and of the shapes. Columns that depend on others leave as much. The
    /// effort is linear in the number of residuals.
    pub(super) fn of(columns: &DMatrix<f64>, shapes: &Shapes, residual: &DVector<f64>) -> Self {
        let n = residual.len();
        let range = range(columns);
        let rank = range.ncols();
        let all: Vec<DMatrix<f64>> =
            [range].into_iter().chain(shapes.columns.iter().cloned()).chain([shapes.known.clone()]).collect();
        let qr = beside(n, &all).qr();
        let triangle = qr.r();
        let mut rotated = residual.clone();
        qr.q_tr_mul(&mut rotated);
        let size = triangle.nrows();
        let mut at = 0;
        let mut blocks = all.iter().map(|part| {
            at += part.ncols();
            triangle.view((rank, at - part.ncols()), (size - rank, part.ncols())).into_owned()
        });
        blocks.next();
        let columns = core::array::from_fn(|_| blocks.next().unwrap_or_else(|| DMatrix::zeros(size - rank, 0)));
        let known = blocks.next().unwrap_or_else(|| DMatrix::zeros(size - rank, 0));
        let reduced = shapes.seen(Shapes { columns, known });
        let others = rotated.rows(size, n - size).norm_squared();
        Self {
            right: rotated.rows(rank, size - rank).into_owned(),
            shapes: reduced,
            others: n - size,
            other_squares: others,
        }
    }

    /// Dimension of the space that is left.
    pub(super) fn dimension(&self) -> usize {
        self.right.len() + self.others
    }

    /// Squares of the residuals in it \[g0^2\].
    pub(super) fn squares(&self) -> f64 {
        self.right.norm_squared() + self.other_squares
    }
}

/// An orthonormal basis of what the columns span.
fn range(columns: &DMatrix<f64>) -> DMatrix<f64> {
    if columns.ncols() == 0 {
        return columns.clone();
    }
    let mut scaled = columns.clone();
    for mut column in scaled.column_iter_mut() {
        let norm = column.norm();
        if norm > 0.0 {
            column /= norm;
        }
    }
    let qr = scaled.col_piv_qr();
    let triangle = qr.r();
    let sizes: Vec<f64> = (0..triangle.nrows()).map(|k| triangle[(k, k)].abs()).collect();
    let largest = sizes.iter().copied().fold(0.0, f64::max);
    let rank = sizes.iter().filter(|size| **size > DEPENDENT * largest).count();
    qr.q().columns(0, rank).into_owned()
}
