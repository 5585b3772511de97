//! One Gauss-Newton step of a joint fit: linear least squares by QR, with columns scaled to length 1.

use nalgebra::{DMatrix, DVector};

/// Condition number above which the rows do not determine the unknowns. Powers are not orthogonal, so high orders reach
/// some thousands; a real deficiency is far above.
const MAX_CONDITION: f64 = 1e7;
/// Most steps of the search for singular values; it needs a few for each.
pub const MAX_SVD_STEPS: usize = 10_000;

/// The solution of J change = -residual.
pub struct LeastSquares {
    /// The change of the unknowns that makes the residuals smallest.
    pub change: DVector<f64>,
    /// H^-1, with H = J'J.
    pub inverse: DMatrix<f64>,
    /// Condition number of J with columns of length 1.
    pub condition: f64,
}

/// Solves for the change of the unknowns; `None` if the rows do not determine them, or if a value is not finite.
///
/// The line through three points, from the unknowns 0, 0:
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_statistics::least_squares;
/// use nalgebra::{DMatrix, DVector};
///
/// let jacobian = DMatrix::from_row_slice(3, 2, &[1.0, 0.0, 1.0, 1.0, 1.0, 2.0]);
/// let residual = -DVector::from_vec(vec![1.0, 3.0, 5.0]); // the model, 0, less the data
/// let solution = least_squares(&jacobian, &residual).ok_or("the rows do not determine the unknowns")?;
/// assert!((solution.change[0] - 1.0).abs() < 1e-12 && (solution.change[1] - 2.0).abs() < 1e-12);
/// // Two equal columns cannot be distinguished.
/// assert!(least_squares(&DMatrix::repeat(3, 2, 1.0), &residual).is_none());
/// # Ok(())
/// # }
/// ```
pub fn least_squares(jacobian: &DMatrix<f64>, residual: &DVector<f64>) -> Option<LeastSquares> {
    let (rows, columns) = jacobian.shape();
    if rows < columns {
        return None;
    }
    let scale = DVector::from_fn(columns, |j, _| jacobian.column(j).norm());
    // A value that is not finite, or overflows, would keep the search for singular values from ending.
    if !scale.iter().all(|norm| *norm > 0.0 && norm.is_finite()) || !residual.iter().all(|r| r.is_finite()) {
        return None;
    }
    let mut scaled = jacobian.clone();
    for (mut column, norm) in scaled.column_iter_mut().zip(&scale) {
        column /= *norm;
    }
    let qr = scaled.qr();
    let r = qr.r();
    let mut right = residual.clone();
    qr.q_tr_mul(&mut right);
    let sizes = r.clone().try_svd_unordered(false, false, f64::EPSILON, MAX_SVD_STEPS)?.singular_values;
    let condition = sizes.max() / sizes.min();
    if condition.is_nan() || condition > MAX_CONDITION {
        return None;
    }
    let inverse = r.try_inverse()?;
    let mut change = -(&inverse * right.rows(0, columns));
    change.component_div_assign(&scale);
    let mut inverse = &inverse * inverse.transpose();
    for i in 0..columns {
        for j in 0..columns {
            inverse[(i, j)] /= scale[i] * scale[j];
        }
    }
    Some(LeastSquares { change, inverse, condition })
}

/// The pseudo-inverse of a matrix, of the singular values over `share` of the largest one: nalgebra's limit is absolute
/// and depends on the units. `None` if a value is not finite.
///
/// ```
/// use isotherm_statistics::pseudo_inverse;
/// use nalgebra::DMatrix;
///
/// // A tiny matrix is inverted as well as a large one.
/// let inverse = pseudo_inverse(DMatrix::identity(2, 2) * 1e-20, 1e-9);
/// assert!(inverse.is_some_and(|it| (it[(0, 0)] / 1e20 - 1.0).abs() < 1e-12));
/// ```
#[must_use]
pub fn pseudo_inverse(matrix: DMatrix<f64>, share: f64) -> Option<DMatrix<f64>> {
    if !matrix.iter().all(|value| value.is_finite()) {
        return None;
    }
    let svd = matrix.try_svd_unordered(true, true, 5.0 * f64::EPSILON, MAX_SVD_STEPS)?;
    let limit = share * svd.singular_values.max();
    svd.pseudo_inverse(limit).ok()
}
