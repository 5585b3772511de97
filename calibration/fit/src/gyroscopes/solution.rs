//! The estimate of a joint fit with its errors.

use super::model::{GyroscopeModel, PARAMETERS, QUANTITIES};
use crate::joint::NewtonStep;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{Curve, pseudo_inverse, root, student_quantile};
use nalgebra::{DMatrix, DVector};

/// The estimate for one gyroscope.
#[derive(Clone, Debug, PartialEq)]
pub struct GyroscopeSolution {
    /// D \[deg/h\] against head temperature, K+ and K- \[pulse/arcsec\] against board temperature.
    pub curves: [Curve; QUANTITIES],
    /// Misalignment onto the next axis and onto the one after it \[rad\].
    pub misalignment: [f64; 2],
    /// Standard errors of the misalignments \[rad\], with `freedom` degrees of freedom.
    pub misalignment_error: Option<[f64; 2]>,
    /// g-sensitivity to the specific force along each axis of the IMU \[deg/h/g0\].
    pub g_sensitivity: [f64; AXES],
    /// Standard errors of the g-sensitivities \[deg/h/g0\], with `freedom` degrees of freedom.
    pub g_sensitivity_error: Option<[f64; AXES]>,
    /// Degrees of freedom of the standard errors of misalignments and g-sensitivities.
    pub freedom: usize,
}

impl GyroscopeSolution {
    /// Half width of the confidence interval of each misalignment \[rad\].
    #[must_use]
    pub fn misalignment_interval(&self, confidence: f64) -> Option<[f64; 2]> {
        self.misalignment_error.map(|errors| errors.map(|error| error * student_quantile(confidence, self.freedom)))
    }

    /// Half width of the confidence interval of each g-sensitivity \[deg/h/g0\].
    #[must_use]
    pub fn g_sensitivity_interval(&self, confidence: f64) -> Option<[f64; AXES]> {
        self.g_sensitivity_error.map(|errors| errors.map(|error| error * student_quantile(confidence, self.freedom)))
    }
}

/// The estimate for the triad.
#[derive(Clone, Debug, PartialEq)]
pub struct TriadSolution {
    /// G1, G2, G3.
    pub gyroscopes: [GyroscopeSolution; AXES],
    /// The components of Earth's rate along the base's X and Y \[deg/h\]; `None` without angles.
    pub earth: Option<[f64; 2]>,
    /// Their standard errors \[deg/h\]. The degrees of freedom are the number of set points minus 1.
    pub earth_error: Option<[f64; 2]>,
    /// Residual of each run and gyroscope \[arcsec/sqrt(s)\]; times the root of the run's length it is an angle.
    pub residuals: Vec<[f64; AXES]>,
}

impl GyroscopeModel<'_> {
    pub(super) fn solution(&self, step: &NewtonStep, counted: &[bool]) -> TriadSolution {
        let covariance = self.covariance(step, counted).filter(|_| self.set_points > 1);
        let n = self.set_points;
        let errors = |offset: usize, count: usize| -> Option<Vec<f64>> {
            covariance.as_ref().map(|c| (offset..offset + count).map(|j| root(c[(j, j)])).collect())
        };
        let gyroscope = |axis: usize| {
            let curve = |quantity: usize| {
                let given = &self.curves[axis][quantity];
                let (offset, count) = (self.offsets[axis][quantity], given.order() + 1);
                let covariance = covariance.as_ref().map(|c| c.view((offset, offset), (count, count)).into_owned());
                let coefficients = self.unknown.rows(offset, count).into_owned();
                Curve::new(given.basis(), coefficients, covariance, n.saturating_sub(count) as f64, given.range())
            };
            let (m, s) = (self.misalignments[axis], self.g_sensitivities[axis]);
            GyroscopeSolution {
                curves: [curve(0), curve(1), curve(2)],
                misalignment: [0, 1].map(|k| self.unknown[m + k]),
                misalignment_error: errors(m, 2).and_then(|errors| errors.try_into().ok()),
                g_sensitivity: [0, 1, 2].map(|k| self.unknown[s + k]),
                g_sensitivity_error: errors(s, AXES).and_then(|errors| errors.try_into().ok()),
                freedom: n.saturating_sub(1),
            }
        };
        TriadSolution {
            gyroscopes: [gyroscope(0), gyroscope(1), gyroscope(2)],
            earth: self.with_earth.then(|| [self.unknown[self.earth], self.unknown[self.earth + 1]]),
            earth_error: errors(self.earth, if self.with_earth { 2 } else { 0 })
                .and_then(|errors| errors.try_into().ok()),
            residuals: (0..self.runs.len()).map(|r| [0, 1, 2].map(|axis| step.residual[AXES * r + axis])).collect(),
        }
    }

    fn local_parameters(&self) -> usize {
        AXES * PARAMETERS + if self.with_earth { 2 } else { 0 }
    }

    /// The rows of one set point, and L: the derivatives of their residuals by the parameters of the set point.
    fn local(&self, set_point: usize, counted: &[bool]) -> (Vec<usize>, DMatrix<f64>) {
        let all = self.local_parameters();
        let runs: Vec<_> =
            (0..self.runs.len()).filter(|r| self.runs[*r].set_point == set_point && counted[*r]).collect();
        // A whole matrix, because the projectors take the rows by their numbers.
        let mut matrix = DMatrix::zeros(AXES * self.runs.len(), all);
        for &r in &runs {
            for axis in 0..AXES {
                let (_, by) = self.row(&self.runs[r], &self.operators[r], axis, |_, _| {});
                for (j, derivative) in by.into_iter().enumerate() {
                    let column =
                        if j < PARAMETERS { axis * PARAMETERS + j } else { AXES * PARAMETERS + j - PARAMETERS };
                    if column < all {
                        matrix[(AXES * r + axis, column)] = derivative;
                    }
                }
            }
        }
        self.eliminate(&mut matrix);
        let rows: Vec<_> = runs.iter().flat_map(|r| (0..AXES).map(move |axis| AXES * r + axis)).collect();
        let matrix = matrix.select_rows(&rows);
        (rows, matrix)
    }

    /// The deviations of a set point's parameters from the fit, estimated from its residuals; with the sign of a
    /// residual. `None` if the set point has fewer equations than parameters.
    pub(super) fn deviations(
        &self,
        set_point: usize,
        step: &NewtonStep,
        counted: &[bool],
    ) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let (rows, local) = self.local(set_point, counted);
        let residual = DVector::from_iterator(rows.len(), rows.iter().map(|&row| step.residual[row]));
        let jacobian = step.jacobian.select_rows(&rows);
        let scale = DVector::from_fn(local.ncols(), |j, _| local.column(j).norm());
        if rows.len() < local.ncols() || !scale.iter().all(|norm| *norm > 0.0) {
            return None;
        }
        let mut scaled = local.clone();
        for (mut column, norm) in scaled.column_iter_mut().zip(&scale) {
            column /= *norm;
        }
        let deviation = (pseudo_inverse(scaled, 1e-9)? * residual).component_div(&scale);
        Some((deviation, jacobian.transpose() * local))
    }

    /// Covariance of the unknowns as in the header of [`fit`](super::fit); `None` if a set point has fewer equations
    /// than parameters.
    fn covariance(&self, step: &NewtonStep, counted: &[bool]) -> Option<DMatrix<f64>> {
        let parts: Option<Vec<_>> = (0..self.set_points).map(|s| self.deviations(s, step, counted)).collect();
        // Degrees of freedom that the fit takes: the coefficients of a curve, or 1 for a constant.
        let spent = |parameter: usize| match (parameter / PARAMETERS, parameter % PARAMETERS) {
            (axis @ 0..AXES, quantity @ 0..QUANTITIES) => self.curves[axis][quantity].order() + 1,
            _ => 1,
        };
        let freedom = |parameter: usize| self.set_points.saturating_sub(spent(parameter)).max(1) as f64;
        Some(step.covariance(&parts?, self.local_parameters(), freedom))
    }
}
