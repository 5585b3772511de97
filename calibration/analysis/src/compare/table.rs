//! Tables as they are compared: curves in units that no table's 1 g0 changes, and both triads' alignment by one
//! convention.

use isotherm_fit::{CurveErrors, TableFile};
use isotherm_shared::table::difference::UnitCurve;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{CONFIDENCE, student_quantile_of};
use nalgebra::{DVector, Matrix3};

/// Entries of a matrix that differ by less than this are the same.
const ROUNDING: f64 = 1e-12;

/// The alignment matrices of accelerometers and gyroscopes.
fn alignments(file: &TableFile) -> [Option<Matrix3<f64>>; 2] {
    let content = file.table.content();
    [content.alignment, content.gyroscopes.as_ref().and_then(|gyroscopes| gyroscopes.alignment)]
}

/// How the accelerometers' misalignments are written.
fn written(file: &TableFile) -> Written {
    match alignments(file)[0] {
        None => Written::Either,
        Some(matrix) if (matrix - Matrix3::identity()).amax() < ROUNDING => Written::Either,
        Some(matrix) => {
            let below = matrix.lower_triangle() - Matrix3::identity();
            if below.amax() < ROUNDING { Written::Triangular } else { Written::Full }
        }
    }
}

/// How a table's misalignments are written.
#[derive(Clone, Copy, Eq, PartialEq)]
enum Written {
    /// With six: relative to the turntable's axes.
    Full,
    /// With three, so that A3 is along the body's z, and A2 in its y-z plane.
    Triangular,
    /// There are none.
    Either,
}

/// The convention that misalignments are compared by.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Convention {
    /// As they are in the tables.
    AsWritten,
    /// Three misalignments: A3 along the body's z, A2 in its y-z plane. Tables with six were converted to it.
    Triangular,
}

impl Convention {
    /// The one that all tables can be compared by.
    #[must_use]
    pub fn of(tables: &[TableFile]) -> Self {
        let has = |found: Written| tables.iter().any(|table| written(table) == found);
        if has(Written::Full) && has(Written::Triangular) { Self::Triangular } else { Self::AsWritten }
    }

    /// What a reader must know of the conversion, if there is one.
    #[must_use]
    pub const fn note(self) -> Option<&'static str> {
        match self {
            Self::AsWritten => None,
            Self::Triangular => Some(
                "Some tables have three misalignments, others six. They are compared with three: A3 along the body's z, A2 in its y-z plane; \
                 the scale factors and biases of the others are converted with them.",
            ),
        }
    }

    /// Its name in documents.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::AsWritten => "as written",
            Self::Triangular => "triangular",
        }
    }
}

/// A curve of a table, with its errors.
#[derive(Clone, Debug)]
pub(crate) struct FormCurve {
    /// Which curve.
    pub curve: UnitCurve,
    errors: Option<CurveErrors>,
}

impl FormCurve {
    /// The temperature that it holds for: where it was measured, if that is known and more than one value.
    pub(crate) fn range(&self) -> [f64; 2] {
        let measured = self.errors.as_ref().and_then(|errors| errors.measured);
        measured.filter(|[low, high]| low < high).unwrap_or(self.curve.polynomial().range())
    }

    /// How many coefficients it has.
    pub(crate) fn coefficients(&self) -> usize {
        self.curve.polynomial().coefficients().len()
    }

    /// Its value \[its unit\].
    pub(crate) fn at(&self, temperature: f64) -> f64 {
        self.curve.at(temperature)
    }

    /// Variance of the value; `None` if it is not known, or if it is not over 0, which no variance is.
    pub(crate) fn variance(&self, temperature: f64) -> Option<f64> {
        let known = |errors: &&CurveErrors| {
            errors.measured.is_none_or(|[low, high]| {
                let rounding = 1e-9 * (high - low);
                (low - rounding..=high + rounding).contains(&temperature)
            })
        };
        let errors = self.errors.as_ref().filter(known)?;
        let slope = errors.slope.map_or(0.0, |slope| {
            slope.per_unit * (temperature - slope.about) / student_quantile_of(CONFIDENCE, errors.freedom)
        });
        let polynomial = self.curve.polynomial();
        let x = (temperature - polynomial.center()) / polynomial.scale();
        let powers = DVector::from_fn(self.coefficients(), |k, _| x.powi(k as i32));
        let variance = (powers.dot(&(&errors.covariance * &powers)) + slope * slope) * self.curve.factor().powi(2);
        (variance > 0.0 && variance.is_finite()).then_some(variance)
    }

    /// Degrees of freedom of the variance.
    pub(crate) fn freedom(&self) -> Option<f64> {
        self.errors.as_ref().map(|errors| errors.freedom)
    }
}

/// A table in the form that is compared.
#[derive(Clone, Debug)]
pub(crate) struct Form {
    /// Bias, K+ and K- of each sensor; three sensors or six.
    pub curves: Vec<[FormCurve; 3]>,
    /// Of the accelerometers and of the gyroscopes; the identity without one.
    pub alignment: [Matrix3<f64>; 2],
    /// Standard errors of the entries \[rad\]. They are 0 for a table without a matrix, because it is the identity by
    /// choice.
    pub alignment_error: [Option<Matrix3<f64>>; 2],
    /// Misalignments \[rad\] of the provenance, otherwise of the matrix, by the same convention.
    pub misalignment: [Option<Matrix3<f64>>; 2],
}

impl Form {
    /// A table by the definition `convention` of bias and scale factors.
    pub(crate) fn of(table: &TableFile, convention: Convention) -> Self {
        let gravity = table.table.content().gravity;
        let matrices = alignments(table);
        let mut alignment = matrices.map(|matrix| matrix.unwrap_or_else(Matrix3::identity));
        let mut alignment_error = [0, 1].map(|triad| match matrices[triad] {
            Some(_) => table.origin.misalignment_error[triad],
            None => Some(Matrix3::zeros()),
        });
        let inverse = |triad: usize| matrices[triad].and_then(|matrix: Matrix3<f64>| matrix.try_inverse());
        let mut misalignment = [0, 1].map(|triad| table.origin.misalignment[triad].or_else(|| inverse(triad)));
        if convention == Convention::Triangular
            && let Some(triangular) = misalignment[0].and_then(Triangular::of)
        {
            let turned = misalignment[1].map(|matrix| matrix * triangular.rotation.transpose());
            misalignment = [Some(triangular.misalignment), turned];
        }
        let mut scales = [1.0; 2 * AXES];
        if convention == Convention::Triangular
            && written(table) == Written::Full
            && let Some(triangular) = inverse(0).and_then(Triangular::of)
            && let Some(matrix) = triangular.misalignment.try_inverse()
        {
            scales[..AXES].copy_from_slice(&triangular.scale);
            alignment[0] = matrix;
            // The body's axes turn, so those that the gyroscopes' output is along turn too. Without a matrix it is
            // along the gyroscopes' input axes.
            if matrices[1].is_some() {
                alignment[1] = triangular.rotation * alignment[1];
                // To first order the angles of the rotation are the misalignments below the diagonal.
                alignment_error[1] = alignment_error[1].zip(alignment_error[0]).map(|(own, angles)| {
                    let turned = |i: usize, j: usize| libm::hypot(own[(i, j)], angles[(i.max(j), i.min(j))]);
                    Matrix3::from_fn(|i, j| if i == j { own[(i, j)] } else { turned(i, j) })
                });
            }
            // To first order a misalignment of the triangle is the sum of the two that are opposite in the full matrix.
            alignment_error[0] = alignment_error[0].map(|error| {
                Matrix3::from_fn(|i, j| if i < j { libm::hypot(error[(i, j)], error[(j, i)]) } else { 0.0 })
            });
        }
        let curves = table.sensors().enumerate().map(|(index, (kind, _, axis))| {
            let scale = scales[index];
            let [bias, positive, negative] = UnitCurve::of_sensor(kind, axis, gravity);
            let scaled = [bias.times(1.0 / scale), positive.times(scale), negative.times(scale)];
            let errors = &table.origin.curves[index];
            [0, 1, 2].map(|quantity| FormCurve { curve: scaled[quantity], errors: errors[quantity].clone() })
        });
        Self { curves: curves.collect(), alignment, alignment_error, misalignment }
    }

    /// The same with K+ and K- of each sensor times a number.
    pub(crate) fn with_scale_factors_times(mut self, number: f64) -> Self {
        for curve in self.curves.iter_mut().flat_map(|curves| &mut curves[1..]) {
            curve.curve = curve.curve.times(number);
        }
        self
    }
}

/// Full misalignments in the triangular convention.
struct Triangular {
    misalignment: Matrix3<f64>,
    /// From the axes of the full convention to those of the triangular one.
    rotation: Matrix3<f64>,
    /// K of the triangular convention over K of the full one, and A of the full one over A of the triangular one.
    scale: [f64; AXES],
}

impl Triangular {
    /// The matrix M of the misalignments, the inverse of the alignment, is R Q with an upper triangle R and a rotation
    /// Q. What accelerometer i indicates is row i of M times the specific force f, so row i of R times Q f: in the
    /// turned axes, with d = R(i,i), it has K d, A/d and the row R(i,...)/d.
    fn of(misalignment: Matrix3<f64>) -> Option<Self> {
        // R Q of M is the transpose of the Q R of M with its rows in reverse order, reversed again.
        let reverse = Matrix3::from_fn(|i, j| if i + j == 2 { 1.0 } else { 0.0 });
        let (q, r) = (reverse * misalignment).transpose().qr().unpack();
        let (mut r, mut q) = (reverse * r.transpose() * reverse, reverse * q.transpose());
        for i in 0..AXES {
            if r[(i, i)] < 0.0 {
                r.column_mut(i).neg_mut();
                q.row_mut(i).neg_mut();
            }
        }
        let scale = [0, 1, 2].map(|i| r[(i, i)]);
        let unit = Matrix3::from_fn(|i, j| match i.cmp(&j) {
            std::cmp::Ordering::Less => r[(i, j)] / r[(i, i)],
            std::cmp::Ordering::Equal => 1.0,
            std::cmp::Ordering::Greater => 0.0,
        });
        scale.iter().all(|d| *d > 0.0).then_some(Self { misalignment: unit, rotation: q, scale })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_alignment_is_a_triangle_times_a_rotation() {
        let misalignment = Matrix3::new(1.0, 0.02, -0.01, -0.015, 1.0, 0.025, 0.01, -0.03, 1.0);
        let found = Triangular::of(misalignment).unwrap();
        let triangle = Matrix3::from_diagonal(&found.scale.into()) * found.misalignment;
        assert!((triangle * found.rotation - misalignment).amax() < 1e-15);
        assert!((found.rotation * found.rotation.transpose() - Matrix3::identity()).amax() < 1e-15);
        assert!(found.rotation.determinant() > 0.0);
        assert!((found.misalignment.lower_triangle() - Matrix3::identity()).amax() < 1e-15);
    }
}
