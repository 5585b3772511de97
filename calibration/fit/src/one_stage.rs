//! The joint fit: all dwells of a campaign at once, each with its own temperature.
//!
//! Reducing each set point first and fitting polynomials afterwards mixes the temperature's drift between positions
//! into the scale factors. Here every dwell d gives one equation for each accelerometer a, and all coefficients are
//! estimated together by Gauss-Newton with a QR factorisation:
//!
//! ```text
//! residual = rate+/K+(U_board) + rate-/K-(U_board) - sum over b of M_ab f_b - A(U_head)                [g0]
//! f = (g_local/g0) * (direction of the position + its change by the base's tilt),   M_aa = 1
//! ```
//! The residual is in g0. In pulses per second, the two readings of a horizontal pair with opposite signs would have
//! the weights of two different K. The level error would then not cancel, and the bias could be wrong by several ug0.
//!
//! The base's tilt about two axes is estimated too if the campaign file gives the turntable's angles and the positions
//! separate it from the other unknowns: six faces at one heading do not. With six faces at two headings the tilt
//! cancels anyway; with other lists of positions it does not.
//!
//! # Errors
//! Dwells of one set point share errors (repeatability, hysteresis), so the standard errors come from the
//! scatter *between* set points, not between dwells. From the residuals of each set point, the deviations of its 17
//! parameters (A, K+, K-, m, m of three accelerometers, and the tilt) from the fit are estimated. S is the covariance
//! of these deviations over the set points, with the degrees of freedom that the curves leave. It is propagated through
//! the estimator, with H = J'J:
//!
//! ```text
//! cov = H^-1 ( sum over set points of B S B' ) H^-1,     B = J' L,   L: derivatives by the set point's parameters
//! ```

use crate::checks::SetPoint;
use crate::joint::{JointModel, NewtonStep, Numbering, OneStageError};
use isotherm_campaign::{Campaign, Dwell, PARAMETERS};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{Curve, pseudo_inverse, student_quantile};
use nalgebra::{DMatrix, DVector};

/// The tilt is estimated only if it increases the condition number by less than this factor.
const MAX_TILT_CONDITION: f64 = 30.0;
/// Share of the largest singular value below which a set point does not determine a combination of its parameters.
const SINGULAR: f64 = 1e-9;
/// Curves of an accelerometer: A, K+, K-. The unknowns are, for each accelerometer, the coefficients of its curves and
/// its two misalignments; the tilt comes last.
const QUANTITIES: usize = 3;

/// The estimate for one accelerometer.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisSolution {
    /// A \[g0\] against head temperature, K+ and K- \[pulse/(s*g0)\] against board temperature.
    pub curves: [Curve; QUANTITIES],
    /// Misalignment onto the next axis and onto the one after it \[rad\].
    pub misalignment: [f64; 2],
    /// Standard errors of the misalignments \[rad\], with `freedom` degrees of freedom.
    pub misalignment_error: Option<[f64; 2]>,
    /// Degrees of freedom of the misalignments' standard errors.
    pub freedom: usize,
}

impl AxisSolution {
    /// Half width of the confidence interval of each misalignment \[rad\] at confidence `level`, 0 to 1.
    #[must_use]
    pub fn misalignment_interval(&self, level: f64) -> Option<[f64; 2]> {
        self.misalignment_error.map(|errors| errors.map(|error| error * student_quantile(level, self.freedom)))
    }
}

/// The values of one set point: for each accelerometer, A, K+ and K- as (effective temperature, value).
pub(crate) type SetPointValues = [[(f64, f64); QUANTITIES]; AXES];

/// The estimate for all accelerometers.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// A1, A2, A3.
    pub axes: [AxisSolution; AXES],
    /// Tilt of the base about the laboratory's X and Y \[rad\], if it could be estimated.
    pub tilt: Option<[f64; 2]>,
    /// Standard errors of the tilt \[rad\]. The degrees of freedom are the number of set points minus 1.
    pub tilt_error: Option<[f64; 2]>,
    /// Residual of each dwell and accelerometer \[g0\].
    pub residuals: Vec<[f64; AXES]>,
    /// Whether the positions leave the base's tilt open: it is not estimated, and does not cancel. The errors of curves
    /// and misalignments are not known then.
    pub tilt_is_open: bool,
}

impl Solution {
    /// Leaves the tilt of the base open: the scatter between the set points does not show what it does to the curves.
    pub(crate) fn leave_tilt_open(&mut self) {
        self.tilt_is_open = true;
        for curve in self.axes.iter_mut().flat_map(|axis| &mut axis.curves) {
            *curve = curve.clone().without_errors();
        }
    }

    /// Makes the curves those of temperature that is read in these steps: of heads, and of boards.
    pub(crate) fn read_in_steps(&mut self, [head, board]: &[[f64; AXES]; 2]) {
        for (axis, of_axis) in self.axes.iter_mut().enumerate() {
            let steps = [head[axis], board[axis], board[axis]];
            let curves = of_axis.curves.iter_mut().zip(steps);
            curves.for_each(|(curve, step)| *curve = curve.clone().read_in_steps(step));
        }
    }
}

/// The curves A, K+, K- of each accelerometer.
pub(crate) type Curves = [[Curve; QUANTITIES]; AXES];

/// Fits all unknowns together. `start` gives the orders, the centring and the first values. The dwells in `left_out`
/// have residuals, but no influence on the fit.
///
/// # Errors
/// If the dwells do not determine the unknowns or the steps do not converge.
pub fn solve(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_points: &[SetPoint],
    start: &Curves,
    left_out: &[usize],
) -> Result<Solution, OneStageError> {
    let mut model = AccelerometerModel::new(campaign, dwells, set_points, start);
    let counted: Vec<bool> = (0..dwells.len()).map(|dwell| !left_out.contains(&dwell)).collect();
    if model.with_tilt {
        let with = model.step(&counted).map_or(f64::INFINITY, |step| step.condition);
        model.with_tilt = false;
        let without = model.step(&counted).map_or(f64::INFINITY, |step| step.condition);
        // Do not estimate a tilt that these positions cannot separate from the other unknowns.
        model.with_tilt = with < MAX_TILT_CONDITION * without;
    }
    let step = match model.converge(&counted) {
        Err(OneStageError::Divergence) if model.with_tilt => {
            model = AccelerometerModel::new(campaign, dwells, set_points, start);
            model.with_tilt = false;
            model.converge(&counted)?
        }
        result => result?,
    };
    Ok(model.solution(&step, &counted))
}

/// A solution without a fit: only the residuals are computed. `misalignment(axis, k)` gives each misalignment with its
/// standard error.
pub(crate) fn fixed_solution(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_points: &[SetPoint],
    curves: Curves,
    tilt: Option<[f64; 2]>,
    misalignment: impl Fn(usize, usize) -> (f64, f64),
) -> Solution {
    let m = [0, 1, 2].map(|axis| [misalignment(axis, 0), misalignment(axis, 1)]);
    let mut model = AccelerometerModel::new(campaign, dwells, set_points, &curves);
    model.with_tilt = tilt.is_some();
    for (k, tilt) in tilt.unwrap_or_default().into_iter().enumerate() {
        model.unknown[model.tilt + k] = tilt;
    }
    for (axis, m) in m.iter().enumerate() {
        for (k, (value, _)) in m.iter().enumerate() {
            model.unknown[model.misalignments[axis] + k] = *value;
        }
    }
    let residuals = dwells.iter().map(|dwell| [0, 1, 2].map(|axis| model.row(dwell, axis, |_, _| {}).0)).collect();
    let freedom = set_points.len().saturating_sub(1);
    let axis = |(curves, m): ([Curve; QUANTITIES], [(f64, f64); 2])| AxisSolution {
        curves,
        misalignment: m.map(|(value, _)| value),
        misalignment_error: (freedom > 0).then(|| m.map(|(_, error)| error)),
        freedom,
    };
    let [a1, a2, a3] = curves;
    Solution {
        axes: [(a1, m[0]), (a2, m[1]), (a3, m[2])].map(axis),
        tilt,
        tilt_error: None,
        residuals,
        tilt_is_open: false,
    }
}

/// The equations of all dwells, and the current values of the unknowns.
struct AccelerometerModel<'a> {
    campaign: &'a Campaign,
    dwells: &'a [Dwell],
    set_points: &'a [SetPoint],
    curves: &'a Curves,
    /// Index of the first coefficient of each curve, by axis.
    offsets: [[usize; QUANTITIES]; AXES],
    /// Index of the first misalignment, by axis.
    misalignments: [usize; AXES],
    /// Index of the tilt.
    tilt: usize,
    with_tilt: bool,
    /// Scaling: a coefficient is its unknown times the unit of its quantity (A, K+, K-).
    unit: [f64; QUANTITIES],
    unknown: DVector<f64>,
}

impl<'a> AccelerometerModel<'a> {
    fn new(campaign: &'a Campaign, dwells: &'a [Dwell], set_points: &'a [SetPoint], curves: &'a Curves) -> Self {
        let mut numbering = Numbering::default();
        let mut offsets = [[0; QUANTITIES]; 3];
        let mut misalignments = [0; 3];
        for axis in 0..AXES {
            for (offset, curve) in offsets[axis].iter_mut().zip(&curves[axis]) {
                *offset = numbering.take(curve.order() + 1);
            }
            misalignments[axis] = numbering.take(2);
        }
        let tilt = numbering.take(2);
        // A bias is far below its unit, a scale factor is about as large as its unit.
        let unit = [1e-3, 1e5, 1e5];
        let mut unknown = DVector::zeros(numbering.count());
        for axis in 0..AXES {
            for (quantity, curve) in curves[axis].iter().enumerate() {
                for (k, c) in curve.coefficients().iter().enumerate() {
                    unknown[offsets[axis][quantity] + k] = c / unit[quantity];
                }
            }
        }
        let with_tilt = campaign.mount.is_some();
        Self { campaign, dwells, set_points, curves, offsets, misalignments, tilt, with_tilt, unit, unknown }
    }

    fn value(&self, axis: usize, quantity: usize, powers: &[f64]) -> f64 {
        let offset = self.offsets[axis][quantity];
        let terms = powers.iter().enumerate().map(|(k, power)| self.unknown[offset + k] * power);
        terms.sum::<f64>() * self.unit[quantity]
    }

    fn force(&self, dwell: &Dwell) -> ([f64; AXES], [[f64; 2]; AXES]) {
        let tilt = [self.unknown[self.tilt], self.unknown[self.tilt + 1]];
        self.campaign.force(&self.campaign.positions[dwell.position], self.with_tilt.then_some(tilt))
    }

    /// Residual of one dwell and axis \[g0\], and its derivatives by the five parameters of its set point (A, K+, K-,
    /// m, m). Calls `set(index, derivative)` for each unknown that the residual depends on.
    fn row(&self, dwell: &Dwell, axis: usize, mut set: impl FnMut(usize, f64)) -> (f64, [f64; PARAMETERS]) {
        let (force, by_tilt) = self.force(dwell);
        let others = [(axis + 1) % AXES, (axis + 2) % AXES];
        let misalignment = [0, 1].map(|k| self.unknown[self.misalignments[axis] + k]);
        let temperature = [dwell.head(axis), dwell.board(axis), dwell.board(axis)];
        let rates = dwell.sums.rates(axis);
        let powers = [0, 1, 2].map(|quantity| self.curves[axis][quantity].powers(temperature[quantity]));
        let [a, k_plus, k_minus] = [0, 1, 2].map(|quantity| self.value(axis, quantity, powers[quantity].as_slice()));
        let by = [-1.0, -rates[0] / (k_plus * k_plus), -rates[1] / (k_minus * k_minus)];
        for quantity in 0..QUANTITIES {
            for (k, power) in powers[quantity].iter().enumerate() {
                set(self.offsets[axis][quantity] + k, by[quantity] * self.unit[quantity] * power);
            }
        }
        let mut residual = rates[0] / k_plus + rates[1] / k_minus - force[axis] - a;
        let mut tilt = by_tilt[axis];
        for k in 0..2 {
            let other = others[k];
            residual -= misalignment[k] * force[other];
            set(self.misalignments[axis] + k, -force[other]);
            tilt = [0, 1].map(|t| tilt[t] + misalignment[k] * by_tilt[other][t]);
        }
        if self.with_tilt {
            set(self.tilt, -tilt[0]);
            set(self.tilt + 1, -tilt[1]);
        }
        (residual, [by[0], by[1], by[2], -force[others[0]], -force[others[1]]])
    }

    fn solution(&self, step: &NewtonStep, counted: &[bool]) -> Solution {
        let covariance = self.covariance(step, counted);
        let set_point_count = self.set_points.len();
        let block = |offset: usize, count: usize, unit: f64| {
            covariance.as_ref().map(|c| c.view((offset, offset), (count, count)) * (unit * unit))
        };
        let axis_solution = |axis: usize| {
            let curve = |quantity: usize| {
                let given = &self.curves[axis][quantity];
                let (offset, count) = (self.offsets[axis][quantity], given.order() + 1);
                let coefficients = self.unknown.rows(offset, count) * self.unit[quantity];
                let covariance = block(offset, count, self.unit[quantity]);
                Curve::new(
                    given.basis(),
                    coefficients,
                    covariance,
                    set_point_count.saturating_sub(count) as f64,
                    given.range(),
                )
            };
            let m = self.misalignments[axis];
            AxisSolution {
                curves: [curve(0), curve(1), curve(2)],
                misalignment: [self.unknown[m], self.unknown[m + 1]],
                misalignment_error: block(m, 2, 1.0)
                    .filter(|_| set_point_count > 1)
                    .map(|c| [c[(0, 0)].sqrt(), c[(1, 1)].sqrt()]),
                freedom: set_point_count.saturating_sub(1),
            }
        };
        let residual = |d: usize| [0, 1, 2].map(|axis| step.residual[AXES * d + axis]);
        Solution {
            axes: [axis_solution(0), axis_solution(1), axis_solution(2)],
            tilt: self.with_tilt.then(|| [self.unknown[self.tilt], self.unknown[self.tilt + 1]]),
            tilt_error: covariance
                .as_ref()
                .filter(|_| self.with_tilt && set_point_count > 1)
                .map(|c| [c[(self.tilt, self.tilt)].sqrt(), c[(self.tilt + 1, self.tilt + 1)].sqrt()]),
            residuals: (0..self.dwells.len()).map(residual).collect(),
            tilt_is_open: false,
        }
    }

    /// The rows of one set point in the Jacobian, and L: the derivatives of their residuals by the five parameters of
    /// each axis and by the tilt. `None` if the set point has fewer dwells than parameters.
    fn local(&self, set_point: &SetPoint, step: &NewtonStep, counted: &[bool]) -> Option<(Vec<usize>, DMatrix<f64>)> {
        // K in units of 1e5 pulse/(s*g0), so that all columns are of order 1.
        let size = [1.0, 1e5, 1e5, 1.0, 1.0];
        let used: Vec<_> = set_point.dwells.iter().copied().filter(|&d| counted[d]).collect();
        if used.len() < PARAMETERS {
            return None;
        }
        let rows: Vec<_> = used.iter().flat_map(|&d| (0..AXES).map(move |axis| AXES * d + axis)).collect();
        let mut matrix = DMatrix::zeros(rows.len(), self.local_parameters());
        for (i, &row) in rows.iter().enumerate() {
            let axis = row % AXES;
            let (_, by) = self.row(&self.dwells[row / AXES], axis, |_, _| {});
            for (j, derivative) in by.iter().enumerate() {
                matrix[(i, axis * PARAMETERS + j)] = derivative * size[j];
            }
            for j in AXES * PARAMETERS..matrix.ncols() {
                matrix[(i, j)] = step.jacobian[(row, self.tilt + j - AXES * PARAMETERS)];
            }
        }
        Some((rows, matrix))
    }

    fn local_parameters(&self) -> usize {
        AXES * PARAMETERS + if self.with_tilt { 2 } else { 0 }
    }

    /// Covariance of the unknowns as in the module's header; `None` if a set point has fewer dwells than parameters.
    fn covariance(&self, step: &NewtonStep, counted: &[bool]) -> Option<DMatrix<f64>> {
        let columns = self.unknowns();
        let deviations = |set_point: &SetPoint| {
            let (rows, local) = self.local(set_point, step, counted)?;
            let residual = DVector::from_iterator(rows.len(), rows.iter().map(|&row| step.residual[row]));
            let jacobian = DMatrix::from_fn(rows.len(), columns, |i, j| step.jacobian[(rows[i], j)]);
            let score = jacobian.transpose() * &local;
            Some((pseudo_inverse(local, SINGULAR)? * residual, score))
        };
        let parts: Option<Vec<_>> = self.set_points.iter().map(deviations).collect();
        // Degrees of freedom that the fit takes: the coefficients of a curve, or 1 for a constant.
        let spent = |parameter: usize| match (parameter / PARAMETERS, parameter % PARAMETERS) {
            (axis @ 0..AXES, quantity @ 0..QUANTITIES) => self.curves[axis][quantity].order() + 1,
            _ => 1,
        };
        let freedom = |parameter: usize| self.set_points.len().saturating_sub(spent(parameter)).max(1) as f64;
        Some(step.covariance(&parts?, self.local_parameters(), freedom))
    }
}

impl JointModel for AccelerometerModel<'_> {
    /// The unknowns are scaled so that the curves are of order 1.
    const CONVERGED: f64 = 1e-13;
    const AT_ROUNDING: f64 = 1e-11;

    fn unknowns(&self) -> usize {
        if self.with_tilt { self.tilt + 2 } else { self.tilt }
    }

    fn values(&mut self) -> &mut DVector<f64> {
        &mut self.unknown
    }

    fn step(&mut self, counted: &[bool]) -> Option<NewtonStep> {
        let (rows, columns) = (AXES * self.dwells.len(), self.unknowns());
        let mut jacobian = DMatrix::zeros(rows, columns);
        let mut residual = DVector::zeros(rows);
        for (d, dwell) in self.dwells.iter().enumerate() {
            for axis in 0..AXES {
                let i = AXES * d + axis;
                (residual[i], _) = self.row(dwell, axis, |j, value| jacobian[(i, j)] = value);
                if !counted[d] {
                    jacobian.row_mut(i).fill(0.0);
                }
            }
        }
        NewtonStep::of(jacobian, residual)
    }

    fn size(step: &NewtonStep) -> f64 {
        step.change.amax()
    }
}

/// A, K+ and K- of each set point without the drift within it: the curve at the effective temperature plus the
/// correction from the set point's residuals. `None` for a set point that does not determine its parameters.
#[must_use]
pub(crate) fn set_point_values(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_points: &[SetPoint],
    solution: &Solution,
) -> Vec<Option<SetPointValues>> {
    let of = |set_point: &SetPoint| -> Option<SetPointValues> {
        let mut values = [[(0.0, 0.0); QUANTITIES]; 3];
        let parts: Vec<_> = set_point.dwells.iter().map(|&d| &dwells[d]).collect();
        for (axis, values) in values.iter_mut().enumerate() {
            let reduced = crate::reduce::reduce(campaign, &parts, axis, solution.tilt)?;
            let delta = local_correction(campaign, dwells, set_point, solution, axis)?;
            for (quantity, value) in values.iter_mut().enumerate() {
                let temperature = reduced.temperature[quantity];
                let curve = &solution.axes[axis].curves[quantity];
                *value = (temperature, curve.at(temperature) + delta[quantity]);
            }
        }
        Some(values)
    };
    set_points.iter().map(of).collect()
}

/// Differences of a set point's own A, K+ and K- from the curves, estimated from its residuals.
fn local_correction(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_point: &SetPoint,
    solution: &Solution,
    axis: usize,
) -> Option<[f64; QUANTITIES]> {
    let curves = &solution.axes[axis].curves;
    // K in units of this, so that all columns are of order 1.
    let size = 1e5;
    let rows: Vec<_> = set_point
        .dwells
        .iter()
        .map(|&d| {
            let (board, rates) = (dwells[d].board(axis), dwells[d].sums.rates(axis));
            let (force, _) = campaign.force(&campaign.positions[dwells[d].position], solution.tilt);
            let by = |channel: usize| -rates[channel] * size / curves[channel + 1].at(board).powi(2);
            [-1.0, by(0), by(1), -force[(axis + 1) % AXES], -force[(axis + 2) % AXES]]
        })
        .collect();
    let local = DMatrix::from_fn(rows.len(), PARAMETERS, |i, j| rows[i][j]);
    let residual = DVector::from_iterator(rows.len(), set_point.dwells.iter().map(|&d| solution.residuals[d][axis]));
    // The change of the parameters that minimises the residuals.
    let delta = -(pseudo_inverse(local, SINGULAR)? * residual);
    Some([delta[0], delta[1] * size, delta[2] * size])
}
