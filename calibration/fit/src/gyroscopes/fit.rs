//! The joint fit of the gyroscopes: all dwells and turns of a campaign at once, each with its own telemetry.
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
//! part is eliminated where it cancels (`Run::horizontal`).
//!
//! # Errors
//! As in [`one_stage`](crate::one_stage): from the scatter between set points. The parameters of a set point are here
//! D, K+, K-, two misalignments and three g-sensitivities of three gyroscopes, and the two components of Earth's rate.
//!
//! Over 400 lines: the fit, its covariance and the set points' values use the same equation and the same derivatives.

use super::runs::{AT_REST, TurnBlock};
use crate::one_stage::{OneStageError, SetPointValues};
use crate::sensor::ReducedSensor;
use isotherm_shared::units::ARCSEC;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{Curve, LeastSquares, MAX_SVD_STEPS, least_squares, pseudo_inverse, root, student_quantile};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use std::collections::BTreeMap;

/// Most Gauss-Newton steps; four are usual.
const MAX_STEPS: usize = 30;
/// The steps end when one moves no residual by more than this \[arcsec/sqrt(s)\].
const CONVERGED: f64 = 1e-8;
/// Rest before and after the motion in which phi follows the pulses \[s\].
const LONGEST_REST: f64 = 30.0;
/// Curves of a gyroscope: D, K+, K-.
const QUANTITIES: usize = 3;
/// Parameters of a gyroscope at one set point: D, K+, K-, two misalignments, three g-sensitivities.
pub(super) const PARAMETERS: usize = 8;

/// The curves D, K+, K- of each gyroscope.
pub(super) type GyroscopeCurves = [[Curve; QUANTITIES]; AXES];

/// One dwell or turn, as the fit needs it.
#[derive(Clone, Debug)]
pub(super) struct Run<'a> {
    /// Index of the set point.
    pub set_point: usize,
    /// T: sum of the intervals \[s\].
    pub seconds: f64,
    /// Pulses of the positive and of the negative channel, by gyroscope.
    pub pulses: [[f64; 2]; AXES],
    pub head: [f64; AXES],
    pub board: [f64; AXES],
    /// Specific force at the start \[g0\].
    pub force: Vector3<f64>,
    /// The part of Earth's rate at the start that is known \[deg/h\].
    pub earth: Vector3<f64>,
    /// Derivatives of Earth's rate at the start by its horizontal components in the base; 0 without angles.
    pub by_horizontal: [Vector3<f64>; 2],
    /// Without angles: components of Earth's rate that nobody knows, each with a number and its direction at the start.
    /// They are eliminated.
    pub horizontal: Vec<(usize, Vector3<f64>)>,
    /// The runs that have such components in common.
    pub group: Option<usize>,
    pub turn: Option<RunTurn<'a>>,
}

/// What a turn has beside what a dwell has.
#[derive(Clone, Copy, Debug)]
pub(super) struct RunTurn<'a> {
    /// k.
    pub axis: Vector3<f64>,
    /// theta \[arcsec\].
    pub angle: f64,
    /// -1 if the IMU coordinates are left-handed, which turns the sign of a cross product; else 1.
    pub hand: f64,
    pub blocks: &'a [TurnBlock],
}

/// The estimate for one gyroscope.
#[derive(Clone, Debug, PartialEq)]
pub struct GyroscopeSolution {
    /// D \[deg/h\] against head telemetry, K+ and K- \[pulse/arcsec\] against board telemetry.
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

/// The equations of the runs, and the current values of the unknowns.
pub(super) struct JointModel<'a> {
    runs: &'a [Run<'a>],
    set_points: usize,
    curves: &'a GyroscopeCurves,
    /// Index of the first coefficient of each curve, by gyroscope.
    offsets: [[usize; QUANTITIES]; AXES],
    misalignments: [usize; AXES],
    g_sensitivities: [usize; AXES],
    /// Index of Earth's horizontal components.
    earth: usize,
    with_earth: bool,
    unknown: DVector<f64>,
    /// The projectors that eliminate unknown components, with their runs.
    eliminations: Vec<(Vec<usize>, DMatrix<f64>)>,
}

/// A linearisation and its solution.
pub(super) struct NewtonStep {
    jacobian: DMatrix<f64>,
    residual: DVector<f64>,
    /// H^-1, with H = J'J.
    inverse: DMatrix<f64>,
    change: DVector<f64>,
    /// Largest change of a residual by the step.
    moves: f64,
    /// Condition number of the Jacobian with columns of length 1.
    condition: f64,
    operators: Vec<Matrix3<f64>>,
}

/// Jacobian, residuals, and J of each run.
type Linearised = (DMatrix<f64>, DVector<f64>, Vec<Matrix3<f64>>);

/// Fits all unknowns together. `start` gives the orders, the centring and the first values. The runs in `left_out` have
/// residuals, but no influence on the fit.
pub(super) fn solve(
    runs: &[Run<'_>],
    set_points: usize,
    start: &GyroscopeCurves,
    left_out: &[usize],
) -> Result<TriadSolution, OneStageError> {
    let mut model = JointModel::new(runs, set_points, start);
    let counted: Vec<bool> = (0..runs.len()).map(|run| !left_out.contains(&run)).collect();
    let step = model.converge(&counted)?;
    Ok(model.solution(&step, &counted))
}

impl<'a> JointModel<'a> {
    pub(super) fn new(runs: &'a [Run<'a>], set_points: usize, curves: &'a GyroscopeCurves) -> Self {
        let mut next = 0;
        let mut take = |count| {
            next += count;
            next - count
        };
        let (mut offsets, mut misalignments, mut g_sensitivities) = ([[0; QUANTITIES]; AXES], [0; AXES], [0; AXES]);
        for axis in 0..AXES {
            for (offset, curve) in offsets[axis].iter_mut().zip(&curves[axis]) {
                *offset = take(curve.order() + 1);
            }
            misalignments[axis] = take(2);
            g_sensitivities[axis] = take(AXES);
        }
        let earth = take(2);
        let mut unknown = DVector::zeros(next);
        for axis in 0..AXES {
            for (offset, curve) in offsets[axis].into_iter().zip(&curves[axis]) {
                unknown.rows_mut(offset, curve.order() + 1).copy_from(curve.coefficients());
            }
        }
        let with_earth = runs.iter().any(|run| run.by_horizontal != [Vector3::zeros(); 2]);
        Self {
            runs,
            set_points,
            curves,
            offsets,
            misalignments,
            g_sensitivities,
            earth,
            with_earth,
            unknown,
            eliminations: Vec::new(),
        }
    }

    /// Repeats Gauss-Newton steps until they are at rounding level.
    pub(super) fn converge(&mut self, counted: &[bool]) -> Result<NewtonStep, OneStageError> {
        let undetermined = OneStageError::Undetermined { unknowns: self.unknowns() };
        let mut step = self.step(counted).ok_or(undetermined)?;
        for _ in 0..MAX_STEPS {
            if !step.moves.is_finite() {
                return Err(OneStageError::Divergence);
            }
            let done = step.moves < CONVERGED;
            let mut unknown = self.unknown.rows_mut(0, step.change.len());
            unknown += &step.change;
            step = self.step(counted).ok_or(undetermined)?;
            if done {
                return Ok(step);
            }
        }
        Err(OneStageError::Divergence)
    }

    fn unknowns(&self) -> usize {
        if self.with_earth { self.earth + 2 } else { self.earth }
    }

    fn value(&self, axis: usize, quantity: usize, powers: &DVector<f64>) -> f64 {
        self.unknown.rows(self.offsets[axis][quantity], powers.len()).dot(powers)
    }

    /// D, K+ and K- of gyroscope `axis` in a run, and the powers that they are made of.
    fn parameters(&self, run: &Run<'_>, axis: usize) -> ([f64; QUANTITIES], [DVector<f64>; QUANTITIES]) {
        let telemetry = [run.head[axis], run.board[axis], run.board[axis]];
        let powers = [0, 1, 2].map(|quantity| self.curves[axis][quantity].powers(telemetry[quantity]));
        ([0, 1, 2].map(|quantity| self.value(axis, quantity, &powers[quantity])), powers)
    }

    fn earth_at(&self, run: &Run<'_>) -> Vector3<f64> {
        if !self.with_earth {
            return run.earth;
        }
        run.earth
            + run.by_horizontal[0] * self.unknown[self.earth]
            + run.by_horizontal[1] * self.unknown[self.earth + 1]
    }

    /// Row i of M.
    fn sensitivity(&self, axis: usize) -> Vector3<f64> {
        let mut row = Vector3::zeros();
        row[axis] = 1.0;
        for k in 0..2 {
            row[(axis + 1 + k) % AXES] = self.unknown[self.misalignments[axis] + k];
        }
        row
    }

    /// s of a gyroscope.
    fn sensitivity_to_force(&self, axis: usize) -> Vector3<f64> {
        self.unknown.fixed_rows::<AXES>(self.g_sensitivities[axis]).into()
    }

    /// J of a run at the current values.
    fn operator(&self, run: &Run<'_>) -> Matrix3<f64> {
        let Some(turn) = run.turn else { return Matrix3::identity() * run.seconds };
        let parameters = [0, 1, 2].map(|axis| self.parameters(run, axis).0);
        let rotation = |block: &TurnBlock| -> f64 {
            let parts = (0..AXES).map(|axis| {
                let ([_, k_plus, k_minus], [positive, negative]) = (parameters[axis], block.pulses[axis]);
                turn.axis[axis] * (positive / k_plus + negative / k_minus)
            });
            parts.sum()
        };
        let mut rotations: Vec<f64> = turn.blocks.iter().map(rotation).collect();
        hold_at_rest(turn.blocks, &mut rotations);
        let Turned { cosine, sine } = Turned::of(turn.blocks, &rotations, turn.angle);
        let along = turn.axis * turn.axis.transpose();
        along * run.seconds + (Matrix3::identity() - along) * cosine - turn.axis.cross_matrix() * (sine * turn.hand)
    }

    /// Residual of one run and gyroscope \[arcsec/sqrt(s)\], and its derivatives by the parameters of the set point:
    /// the eight of the gyroscope, and the two of Earth's rate. Calls `set(index, derivative)` for each unknown that
    /// the residual depends on.
    fn row(
        &self,
        run: &Run<'_>,
        operator: &Matrix3<f64>,
        axis: usize,
        mut set: impl FnMut(usize, f64),
    ) -> (f64, [f64; PARAMETERS + 2]) {
        let weight = run.seconds.sqrt().recip();
        let sensitivity = self.sensitivity(axis);
        let angle = operator * self.earth_at(run) + run.turn.map_or(Vector3::zeros(), |turn| turn.axis * turn.angle);
        let force = operator * run.force;
        let ([d, k_plus, k_minus], powers) = self.parameters(run, axis);
        let [positive, negative] = run.pulses[axis];
        let g = self.sensitivity_to_force(axis);
        let residual =
            positive / k_plus + negative / k_minus - d * run.seconds - sensitivity.dot(&angle) - g.dot(&force);
        let earth = run.by_horizontal.map(|direction| -sensitivity.dot(&(operator * direction)));
        let by = [
            -run.seconds,
            -positive / (k_plus * k_plus),
            -negative / (k_minus * k_minus),
            -angle[(axis + 1) % AXES],
            -angle[(axis + 2) % AXES],
            -force[0],
            -force[1],
            -force[2],
            earth[0],
            earth[1],
        ]
        .map(|derivative| derivative * weight);
        for (quantity, powers) in powers.iter().enumerate() {
            for (k, power) in powers.iter().enumerate() {
                set(self.offsets[axis][quantity] + k, by[quantity] * power);
            }
        }
        (0..2).for_each(|k| set(self.misalignments[axis] + k, by[3 + k]));
        (0..AXES).for_each(|k| set(self.g_sensitivities[axis] + k, by[5 + k]));
        if self.with_earth {
            (0..2).for_each(|k| set(self.earth + k, by[PARAMETERS + k]));
        }
        (residual * weight, by)
    }

    /// The projectors off the components that nobody knows, each with its runs.
    fn eliminations(&self, operators: &[Matrix3<f64>], counted: &[bool]) -> Option<Vec<(Vec<usize>, DMatrix<f64>)>> {
        let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (index, run) in self.runs.iter().enumerate().filter(|(index, _)| counted[*index]) {
            if let Some(group) = run.group {
                groups.entry(group).or_default().push(index);
            }
        }
        groups
            .into_values()
            .map(|runs| {
                let projector = self.projector(&runs, operators)?;
                Some((runs, projector))
            })
            .collect()
    }

    /// The projector of the rows of `runs` off the components of Earth's rate that they share.
    fn projector(&self, runs: &[usize], operators: &[Matrix3<f64>]) -> Option<DMatrix<f64>> {
        let mut numbers: Vec<usize> =
            runs.iter().flat_map(|run| self.runs[*run].horizontal.iter().map(|(number, _)| *number)).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let mut matrix: DMatrix<f64> = DMatrix::zeros(AXES * runs.len(), numbers.len());
        for (i, index) in runs.iter().enumerate() {
            let run = &self.runs[*index];
            for (number, direction) in &run.horizontal {
                let column = numbers.binary_search(number).ok()?;
                let angle = operators[*index] * direction / run.seconds.sqrt();
                for axis in 0..AXES {
                    matrix[(AXES * i + axis, column)] += self.sensitivity(axis).dot(&angle);
                }
            }
        }
        let basis = matrix.try_svd(true, false, f64::EPSILON, MAX_SVD_STEPS)?;
        let limit = 1e-9 * basis.singular_values.max();
        let columns: Vec<_> = (0..basis.singular_values.len()).filter(|k| basis.singular_values[*k] > limit).collect();
        let u = basis.u?.select_columns(&columns);
        Some(DMatrix::identity(u.nrows(), u.nrows()) - &u * u.transpose())
    }

    /// Applies the projectors to the rows of `matrix`.
    fn eliminate(&self, matrix: &mut DMatrix<f64>) {
        for (runs, projector) in &self.eliminations {
            let rows: Vec<usize> = runs.iter().flat_map(|run| (0..AXES).map(move |axis| AXES * run + axis)).collect();
            let projected = projector * matrix.select_rows(&rows);
            for (i, row) in rows.into_iter().enumerate() {
                matrix.row_mut(row).copy_from(&projected.row(i));
            }
        }
    }

    /// Takes misalignments, g-sensitivities and Earth's rate from a solution.
    fn set_constants(&mut self, solution: &TriadSolution) {
        for (axis, part) in solution.gyroscopes.iter().enumerate() {
            (0..2).for_each(|k| self.unknown[self.misalignments[axis] + k] = part.misalignment[k]);
            (0..AXES).for_each(|k| self.unknown[self.g_sensitivities[axis] + k] = part.g_sensitivity[k]);
        }
        let earth = solution.earth.unwrap_or_default();
        (0..2).for_each(|k| self.unknown[self.earth + k] = earth[k]);
    }

    /// Jacobian, residuals and J of each run at the current values, without the unknown components of Earth's rate.
    fn linearised(&mut self, counted: &[bool]) -> Option<Linearised> {
        let operators: Vec<_> = self.runs.iter().map(|run| self.operator(run)).collect();
        self.eliminations = self.eliminations(&operators, counted)?;
        let (rows, columns) = (AXES * self.runs.len(), self.unknowns());
        // The last column is the residual.
        let mut all = DMatrix::zeros(rows, columns + 1);
        for (r, (run, operator)) in self.runs.iter().zip(&operators).enumerate() {
            for axis in 0..AXES {
                let i = AXES * r + axis;
                let (residual, _) = self.row(run, operator, axis, |j, value| all[(i, j)] = value);
                all[(i, columns)] = residual;
            }
        }
        self.eliminate(&mut all);
        let residual = all.column(columns).into_owned();
        let mut jacobian = all.remove_column(columns);
        for (run, _) in counted.iter().enumerate().filter(|(_, counted)| !**counted) {
            jacobian.rows_mut(AXES * run, AXES).fill(0.0);
        }
        Some((jacobian, residual, operators))
    }

    /// Linearises at the current values and solves; `None` if the runs do not determine the unknowns.
    fn step(&mut self, counted: &[bool]) -> Option<NewtonStep> {
        let (jacobian, residual, operators) = self.linearised(counted)?;
        let LeastSquares { change, inverse, condition } = least_squares(&jacobian, &residual)?;
        let moves = (&jacobian * &change).amax();
        Some(NewtonStep { jacobian, residual, inverse, change, moves, condition, operators })
    }

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
    fn local(&self, set_point: usize, step: &NewtonStep, counted: &[bool]) -> (Vec<usize>, DMatrix<f64>) {
        let all = self.local_parameters();
        let runs: Vec<_> =
            (0..self.runs.len()).filter(|r| self.runs[*r].set_point == set_point && counted[*r]).collect();
        // A whole matrix, because the projectors take the rows by their numbers.
        let mut matrix = DMatrix::zeros(AXES * self.runs.len(), all);
        for &r in &runs {
            for axis in 0..AXES {
                let (_, by) = self.row(&self.runs[r], &step.operators[r], axis, |_, _| {});
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
    fn deviations(
        &self,
        set_point: usize,
        step: &NewtonStep,
        counted: &[bool],
    ) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let (rows, local) = self.local(set_point, step, counted);
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

    /// Covariance of the unknowns as in the module's header; `None` if a set point has fewer equations than parameters.
    fn covariance(&self, step: &NewtonStep, counted: &[bool]) -> Option<DMatrix<f64>> {
        let parts: Option<Vec<_>> = (0..self.set_points).map(|s| self.deviations(s, step, counted)).collect();
        let parts = parts?;
        // Degrees of freedom that the fit takes: the coefficients of a curve, or 1 for a constant.
        let spent = |parameter: usize| match (parameter / PARAMETERS, parameter % PARAMETERS) {
            (axis @ 0..AXES, quantity @ 0..QUANTITIES) => self.curves[axis][quantity].order() + 1,
            _ => 1,
        };
        let freedom = |parameter: usize| self.set_points.saturating_sub(spent(parameter)).max(1) as f64;
        let all = self.local_parameters();
        let s = DMatrix::from_fn(all, all, |i, j| {
            parts.iter().map(|(delta, _)| delta[i] * delta[j]).sum::<f64>() / (freedom(i) * freedom(j)).sqrt()
        });
        let middle = parts.iter().map(|(_, score)| score * &s * score.transpose()).sum::<DMatrix<f64>>();
        Some(&step.inverse * middle * &step.inverse)
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
pub(super) fn design(runs: &[Run<'_>]) -> DMatrix<f64> {
    let constant = |value: f64| Curve::new([0.0, 1.0], DVector::from_element(1, value), None, 0.0, [0.0, 1.0]);
    let curves = [0, 1, 2].map(|_| [constant(0.0), constant(1.0), constant(-1.0)]);
    let mut model = JointModel::new(runs, 1, &curves);
    let mut matrix = model
        .linearised(&vec![true; runs.len()])
        .map_or_else(|| DMatrix::zeros(0, model.unknowns()), |(matrix, ..)| matrix);
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
    runs: &[Run<'_>],
    set_points: usize,
    solution: &TriadSolution,
    sources: &[RateInput],
) -> Option<Vec<[[f64; PARAMETERS]; AXES]>> {
    let curves: GyroscopeCurves = [0, 1, 2].map(|axis| solution.gyroscopes[axis].curves.clone());
    let mut model = JointModel::new(runs, set_points, &curves);
    model.set_constants(solution);
    let step = model.step(&vec![true; runs.len()])?;
    let effect = |source: &RateInput| {
        let mut input = DMatrix::zeros(AXES * runs.len(), 1);
        for (run, direction) in source {
            let angle = step.operators[*run] * direction / runs[*run].seconds.sqrt();
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

/// Sets the rotations of blocks to 0 that lie further than [`LONGEST_REST`] from the motion. Bias and Earth's rate
/// count as rotation, and in a long rest they would add up.
fn hold_at_rest(blocks: &[TurnBlock], rotations: &mut [f64]) {
    let rate = |(block, rotation): (&TurnBlock, &f64)| rotation.abs() / block.seconds;
    let rates: Vec<f64> = blocks.iter().zip(rotations.iter()).map(rate).collect();
    let fastest = rates.iter().copied().fold(0.0, f64::max);
    let moves = |rate: &f64| *rate > AT_REST * fastest;
    let (Some(first), Some(last)) = (rates.iter().position(moves), rates.iter().rposition(moves)) else { return };
    let (before, after): (Vec<usize>, Vec<usize>) = ((0..first).rev().collect(), (last + 1..blocks.len()).collect());
    for side in [before, after] {
        let mut seconds = 0.0;
        for index in side {
            seconds += blocks[index].seconds;
            if seconds > LONGEST_REST {
                rotations[index] = 0.0;
            }
        }
    }
}

/// phi over a turn: the cumulated rotations of its blocks, scaled to the angle in total, linear within a block.
struct Turned {
    /// Integral of cos(phi) \[s\].
    cosine: f64,
    /// Integral of sin(phi) \[s\].
    sine: f64,
}

impl Turned {
    /// `rotations` of the blocks, in any unit; `angle` in arcsec.
    fn of(blocks: &[TurnBlock], rotations: &[f64], angle: f64) -> Self {
        let factor = angle / rotations.iter().sum::<f64>() * ARCSEC;
        let (mut phi, mut cosine, mut sine) = (0.0, 0.0, 0.0);
        for (block, rotation) in blocks.iter().zip(rotations) {
            let half = 0.5 * rotation * factor;
            // The mean over an angle from a to b is that at the middle times sin(h)/h, with h = (b - a)/2.
            let mean = if half.abs() < 1e-4 { 1.0 - half * half / 6.0 } else { half.sin() / half };
            cosine += block.seconds * mean * (phi + half).cos();
            sine += block.seconds * mean * (phi + half).sin();
            phi += 2.0 * half;
        }
        Self { cosine, sine }
    }
}

/// One set point reduced by itself: D, K+, K-, two misalignments and three g-sensitivities of each gyroscope.
#[derive(Clone, Debug, PartialEq)]
pub struct ReducedSetPoint {
    /// D \[deg/h\], K+, K- \[pulse/arcsec\], m, m \[rad\], s, s, s \[deg/h/g0\], by gyroscope.
    pub values: [[f64; PARAMETERS]; AXES],
    /// Their standard errors, from the scatter within the set point.
    pub standard_errors: [[f64; PARAMETERS]; AXES],
    /// Effective telemetry of D, K+ and K-: the mean over the runs with the weights that they have in the value.
    pub telemetry: [[f64; QUANTITIES]; AXES],
    /// Earth's rate along the base's X and Y \[deg/h\], if there are angles.
    pub earth: Option<[f64; 2]>,
    /// Residual standard deviation \[arcsec/sqrt(s)\].
    pub residual_sd: f64,
    /// Its degrees of freedom.
    pub freedom: usize,
    /// Condition number of the equations.
    pub condition: f64,
}

impl ReducedSetPoint {
    /// What both triads have.
    pub(crate) fn sensors(&self) -> [ReducedSensor<'_>; AXES] {
        [0, 1, 2].map(|axis| ReducedSensor {
            telemetry: self.telemetry[axis],
            values: &self.values[axis],
            standard_errors: &self.standard_errors[axis],
            freedom: self.freedom,
        })
    }
}

/// Reduces the runs of one set point. `start` has constant curves.
pub(super) fn reduce(runs: &[Run<'_>], start: &GyroscopeCurves) -> Result<ReducedSetPoint, OneStageError> {
    let mut model = JointModel::new(runs, 1, start);
    let step = model.converge(&vec![true; runs.len()])?;
    let unknown = |axis: usize| -> [usize; PARAMETERS] {
        let ([d, k_plus, k_minus], m, s) =
            (model.offsets[axis], model.misalignments[axis], model.g_sensitivities[axis]);
        [d, k_plus, k_minus, m, m + 1, s, s + 1, s + 2]
    };
    let freedom = step.residual.len().saturating_sub(model.unknowns());
    let residual_sd = (step.residual.norm_squared() / freedom as f64).sqrt();
    let weights = &step.inverse * step.jacobian.transpose();
    let effective = |axis: usize, quantity: usize| -> f64 {
        let j = unknown(axis)[quantity];
        let telemetry = |run: &Run<'_>| if quantity == 0 { run.head[axis] } else { run.board[axis] };
        let terms = runs.iter().enumerate().map(|(r, run)| {
            let weight: f64 = (0..AXES).map(|i| weights[(j, AXES * r + i)] * step.jacobian[(AXES * r + i, j)]).sum();
            weight * telemetry(run)
        });
        terms.sum()
    };
    Ok(ReducedSetPoint {
        values: [0, 1, 2].map(|axis| unknown(axis).map(|j| model.unknown[j])),
        standard_errors: [0, 1, 2].map(|axis| unknown(axis).map(|j| residual_sd * step.inverse[(j, j)].sqrt())),
        telemetry: [0, 1, 2].map(|axis| [0, 1, 2].map(|quantity| effective(axis, quantity))),
        earth: model.with_earth.then(|| [model.unknown[model.earth], model.unknown[model.earth + 1]]),
        residual_sd,
        freedom,
        condition: step.condition,
    })
}

/// Fits all unknowns, and gives D, K+ and K- of each set point without the drift within it: the curve at the effective
/// telemetry plus the correction from the set point's residuals. A set point that does not determine its parameters
/// keeps its reduced values.
pub(super) fn corrected_values(
    runs: &[Run<'_>],
    reduced: &[ReducedSetPoint],
    start: &GyroscopeCurves,
) -> Result<Vec<SetPointValues>, OneStageError> {
    let mut model = JointModel::new(runs, reduced.len(), start);
    let counted = vec![true; runs.len()];
    let step = model.converge(&counted)?;
    let solution = model.solution(&step, &counted);
    let values = |(set_point, reduced): (usize, &ReducedSetPoint)| {
        let deviations = model.deviations(set_point, &step, &counted);
        [0, 1, 2].map(|axis| {
            [0, 1, 2].map(|quantity| {
                let telemetry = reduced.telemetry[axis][quantity];
                let curve = &solution.gyroscopes[axis].curves[quantity];
                // A residual falls where its parameter rises by the deviation.
                let value = match &deviations {
                    Some((deviation, _)) => curve.at(telemetry) - deviation[axis * PARAMETERS + quantity],
                    None => reduced.values[axis][quantity],
                };
                (telemetry, value)
            })
        })
    };
    Ok(reduced.iter().enumerate().map(values).collect())
}
