//! The joint fit of the gyroscopes: all dwells and turns of a campaign at once, each with its own temperature.
//!
//! Every run r (a dwell or a turn of length T) gives one equation for each gyroscope i:
//!
//! ```text
//! residual = N+/K+(U_board) + N-/K-(U_board) - D(U_head) T - M_i.(theta k + J w0) - s_i.(J f0) [arcsec], weight T^-1/2
//! J v = T k (k.v) + Ic (v - k (k.v)) - Is (k x v),    Ic = integral of cos(phi) dt,   Is = integral of sin(phi) dt
//! ```
//! with Earth's rate w0 and the specific force f0 in IMU coordinates at the start. It is exact for any angle and any
//! speed profile. A dwell is theta = 0, J = T. phi, the angle so far, comes from the gyroscopes themselves: their
//! pulses along k, cumulated, scaled to theta, linear within a row. What bias, Earth and gravity add to the pulses is
//! taken for motion there; a bias of 1 deg/h moves M by 5e-9 rad through it. In a rest it counts for 30 s at most.
//!
//! The weight is that of a random walk of the angle. In coordinates of the base, the two horizontal components of
//! Earth's rate are unknowns that the gyroscopes share, if the campaign file has angles. Without them, the horizontal
//! part is eliminated where it cancels (`GyroscopeRun::horizontal`).
//!
//! # Errors
//! As in [`one_stage`](crate::one_stage): from the scatter between set points. The parameters of a set point are here
//! D, K+, K-, two misalignments and three g-sensitivities of three gyroscopes, and the two components of Earth's rate.

use super::input::GyroscopeRun;
use super::model::{GyroscopeCurves, GyroscopeModel, PARAMETERS};
use super::solution::TriadSolution;
use crate::joint::JointModel as _;
use crate::joint::OneStageError;
use isotherm_shared::wire::AXES;
use isotherm_statistics::Curve;
use nalgebra::{DMatrix, DVector, Vector3};

/// Fits all unknowns together. `start` gives the orders, the centring and the first values. The runs in `left_out` have
/// residuals, but no influence on the fit.
pub(super) fn solve(
    runs: &[GyroscopeRun<'_>],
    set_points: usize,
    start: &GyroscopeCurves,
    left_out: &[usize],
) -> Result<TriadSolution, OneStageError> {
    let mut model = GyroscopeModel::new(runs, set_points, start);
    let counted: Vec<bool> = (0..runs.len()).map(|run| !left_out.contains(&run)).collect();
    let step = model.converge(&counted)?;
    Ok(model.solution(&step, &counted))
}

impl GyroscopeModel<'_> {
    /// Takes misalignments, g-sensitivities and Earth's rate from a solution.
    fn set_constants(&mut self, solution: &TriadSolution) {
        for (axis, part) in solution.gyroscopes.iter().enumerate() {
            (0..2).for_each(|k| self.unknown[self.misalignments[axis] + k] = part.misalignment[k]);
            (0..AXES).for_each(|k| self.unknown[self.g_sensitivities[axis] + k] = part.g_sensitivity[k]);
        }
        let earth = solution.earth.unwrap_or_default();
        (0..2).for_each(|k| self.unknown[self.earth + k] = earth[k]);
    }

    /// A solution without a fit of the curves: only the residuals are computed. `constants` has, for each gyroscope,
    /// misalignments and g-sensitivities with their errors; `earth` Earth's rate with its errors.
    pub(super) fn fixed(
        &mut self,
        constants: [[(f64, f64); 2 + AXES]; AXES],
        earth: [(f64, f64); 2],
    ) -> Option<TriadSolution> {
        for (axis, constants) in constants.iter().enumerate() {
            (0..2).for_each(|k| self.unknown[self.misalignments[axis] + k] = constants[k].0);
            (0..AXES).for_each(|k| self.unknown[self.g_sensitivities[axis] + k] = constants[2 + k].0);
        }
        (0..2).for_each(|k| self.unknown[self.earth + k] = earth[k].0);
        let counted = vec![true; self.runs.len()];
        let step = self.step(&counted)?;
        let mut solution = self.solution(&step, &counted);
        let known = self.set_points > 1;
        for (axis, gyroscope) in solution.gyroscopes.iter_mut().enumerate() {
            let errors = constants[axis].map(|(_, error)| error);
            gyroscope.curves = self.curves[axis].clone();
            gyroscope.misalignment_error = known.then_some([errors[0], errors[1]]);
            gyroscope.g_sensitivity_error = known.then_some([errors[2], errors[3], errors[4]]);
        }
        solution.earth_error = (known && self.with_earth).then_some(earth.map(|(_, error)| error));
        Some(solution)
    }
}

/// The equations of the runs of one set point for scale factors of 1 and zeros elsewhere, eight columns a gyroscope and
/// two for Earth's rate if it is unknown; columns of length 1 where they are not 0.
pub(super) fn design(runs: &[GyroscopeRun<'_>]) -> DMatrix<f64> {
    let constant = |value: f64| Curve::new([0.0, 1.0], DVector::from_element(1, value), None, 0.0, [0.0, 1.0]);
    let curves = [0, 1, 2].map(|_| [constant(0.0), constant(1.0), constant(-1.0)]);
    let mut model = GyroscopeModel::new(runs, 1, &curves);
    let mut matrix = model
        .linearised(&vec![true; runs.len()])
        .map_or_else(|| DMatrix::zeros(0, model.unknowns()), |(matrix, _)| matrix);
    for mut column in matrix.column_iter_mut() {
        let norm = column.norm();
        if norm > 0.0 {
            column /= norm;
        }
    }
    matrix
}

/// Runs, each with the direction of a rate of 1 deg/h that the equations do not have.
pub(super) type RateInput = Vec<(usize, Vector3<f64>)>;

/// What an input that the equations do not have does to the estimate. `sources` are alternatives, each with the runs
/// and the direction of a rate of 1 deg/h; for each one the changes, D \[deg/h\], K+ and K- (relative), misalignments
/// \[rad\], g-sensitivities, are given by gyroscope.
pub(super) fn effects(
    runs: &[GyroscopeRun<'_>],
    set_points: usize,
    solution: &TriadSolution,
    sources: &[RateInput],
) -> Option<Vec<[[f64; PARAMETERS]; AXES]>> {
    let curves: GyroscopeCurves = [0, 1, 2].map(|axis| solution.gyroscopes[axis].curves.clone());
    let mut model = GyroscopeModel::new(runs, set_points, &curves);
    model.set_constants(solution);
    let step = model.step(&vec![true; runs.len()])?;
    let effect = |source: &RateInput| {
        let mut input = DMatrix::zeros(AXES * runs.len(), 1);
        for (run, direction) in source {
            let angle = model.operators[*run] * direction / runs[*run].seconds.sqrt();
            for axis in 0..AXES {
                input[(AXES * run + axis, 0)] += model.sensitivity(axis).dot(&angle);
            }
        }
        model.eliminate(&mut input);
        let change = -(&step.inverse * (step.jacobian.transpose() * input)).column(0);
        [0, 1, 2].map(|axis| {
            let curve = |quantity: usize| {
                let [low, high] = curves[axis][quantity].range();
                let points = [low, 0.5 * (low + high), high].map(|u| {
                    let powers = curves[axis][quantity].powers(u);
                    let value = change.rows(model.offsets[axis][quantity], powers.len()).dot(&powers);
                    if quantity == 0 { value } else { value / curves[axis][quantity].at(u) }
                });
                points.into_iter().fold(0.0, |most: f64, value| if value.abs() > most.abs() { value } else { most })
            };
            let (m, s) = (model.misalignments[axis], model.g_sensitivities[axis]);
            [curve(0), curve(1), curve(2), change[m], change[m + 1], change[s], change[s + 1], change[s + 2]]
        })
    };
    Some(sources.iter().map(effect).collect())
}
