//! The equations of dwells and turns, as [`fit`](super::fit) has them.

use super::input::GyroscopeRun;
use super::rotation::{TurnIntegrals, hold_at_rest};
use super::runs::TurnBlock;
use crate::joint::{JointModel, NewtonStep, Numbering};
use isotherm_shared::wire::AXES;
use isotherm_statistics::Curve;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Curves of a gyroscope: D, K+, K-.
pub(super) const QUANTITIES: usize = 3;
/// Parameters of a gyroscope at one set point: D, K+, K-, two misalignments, three g-sensitivities.
pub(super) const PARAMETERS: usize = 8;

/// The curves D, K+, K- of each gyroscope.
pub(super) type GyroscopeCurves = [[Curve; QUANTITIES]; AXES];

/// The equations of the runs, and the current values of the unknowns.
pub(super) struct GyroscopeModel<'a> {
    pub runs: &'a [GyroscopeRun<'a>],
    pub set_points: usize,
    pub curves: &'a GyroscopeCurves,
    /// Index of the first coefficient of each curve, by gyroscope.
    pub offsets: [[usize; QUANTITIES]; AXES],
    pub misalignments: [usize; AXES],
    pub g_sensitivities: [usize; AXES],
    /// Index of Earth's horizontal components.
    pub earth: usize,
    pub with_earth: bool,
    pub unknown: DVector<f64>,
    /// The projectors that eliminate unknown components, with their runs.
    pub eliminations: Vec<(Vec<usize>, DMatrix<f64>)>,
    /// J of each run at the last linearisation.
    pub operators: Vec<Matrix3<f64>>,
}

impl<'a> GyroscopeModel<'a> {
    pub(super) fn new(runs: &'a [GyroscopeRun<'a>], set_points: usize, curves: &'a GyroscopeCurves) -> Self {
        let mut numbering = Numbering::default();
        let (mut offsets, mut misalignments, mut g_sensitivities) = ([[0; QUANTITIES]; AXES], [0; AXES], [0; AXES]);
        for axis in 0..AXES {
            for (offset, curve) in offsets[axis].iter_mut().zip(&curves[axis]) {
                *offset = numbering.take(curve.order() + 1);
            }
            misalignments[axis] = numbering.take(2);
            g_sensitivities[axis] = numbering.take(AXES);
        }
        let earth = numbering.take(2);
        let mut unknown = DVector::zeros(numbering.count());
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
            operators: Vec::new(),
        }
    }

    fn value(&self, axis: usize, quantity: usize, powers: &DVector<f64>) -> f64 {
        self.unknown.rows(self.offsets[axis][quantity], powers.len()).dot(powers)
    }

    /// D, K+ and K- of gyroscope `axis` in a run, and the powers that they are made of.
    fn parameters(&self, run: &GyroscopeRun<'_>, axis: usize) -> ([f64; QUANTITIES], [DVector<f64>; QUANTITIES]) {
        let temperature = [run.head[axis], run.board[axis], run.board[axis]];
        let powers = [0, 1, 2].map(|quantity| self.curves[axis][quantity].powers(temperature[quantity]));
        ([0, 1, 2].map(|quantity| self.value(axis, quantity, &powers[quantity])), powers)
    }

    fn earth_at(&self, run: &GyroscopeRun<'_>) -> Vector3<f64> {
        if !self.with_earth {
            return run.earth;
        }
        run.earth
            + run.by_horizontal[0] * self.unknown[self.earth]
            + run.by_horizontal[1] * self.unknown[self.earth + 1]
    }

    /// Row i of M.
    pub(super) fn sensitivity(&self, axis: usize) -> Vector3<f64> {
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
    fn operator(&self, run: &GyroscopeRun<'_>) -> Matrix3<f64> {
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
        let TurnIntegrals { cosine, sine } = TurnIntegrals::of(turn.blocks, &rotations, turn.angle);
        let along = turn.axis * turn.axis.transpose();
        along * run.seconds + (Matrix3::identity() - along) * cosine - turn.axis.cross_matrix() * (sine * turn.hand)
    }

    /// Residual of one run and gyroscope \[arcsec/sqrt(s)\], and its derivatives by the parameters of the set point:
    /// the eight of the gyroscope, and the two of Earth's rate. Calls `set(index, derivative)` for each unknown that
    /// the residual depends on.
    pub(super) fn row(
        &self,
        run: &GyroscopeRun<'_>,
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

    /// Jacobian and residuals at the current values, without the unknown components of Earth's rate.
    pub(super) fn linearised(&mut self, counted: &[bool]) -> Option<(DMatrix<f64>, DVector<f64>)> {
        self.operators = self.runs.iter().map(|run| self.operator(run)).collect();
        self.eliminations = self.eliminations(counted)?;
        let (rows, columns) = (AXES * self.runs.len(), self.unknowns());
        // The last column is the residual.
        let mut all = DMatrix::zeros(rows, columns + 1);
        for (r, (run, operator)) in self.runs.iter().zip(&self.operators).enumerate() {
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
        Some((jacobian, residual))
    }
}

impl JointModel for GyroscopeModel<'_> {
    /// \[arcsec/sqrt(s)\].
    const CONVERGED: f64 = 1e-8;
    const AT_ROUNDING: f64 = 0.0;

    fn unknowns(&self) -> usize {
        if self.with_earth { self.earth + 2 } else { self.earth }
    }

    fn values(&mut self) -> &mut DVector<f64> {
        &mut self.unknown
    }

    fn step(&mut self, counted: &[bool]) -> Option<NewtonStep> {
        let (jacobian, residual) = self.linearised(counted)?;
        NewtonStep::of(jacobian, residual)
    }

    /// Largest change of a residual.
    fn size(step: &NewtonStep) -> f64 {
        (&step.jacobian * &step.change).amax()
    }
}
