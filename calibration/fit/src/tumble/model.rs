//! The equation of one static pose, its derivatives, and the fit.
//!
//! ```text
//! x = N+/K+(U_b) + N-/K-(U_b) - A(U_h),   x = M s,   M = [[1, m12, m13], [0, 1, m23], [0, 0, 1]]      [g0]
//! residual = |s| - g_local/g0
//! ```
//! The unknowns are on one scale: biases in g0, scale factors relative to those of the start, misalignments in rad.
//! Here static poses have equal weights; [`weighted`](super::weighted) has those of their covariance.

use super::reading::Reading;
use isotherm_campaign::joint_range;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{Curve, LeastSquares, least_squares};
use isotherm_support::checkpoint::checkpoint;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Most steps of the fit; ten are usual.
const MAX_STEPS: usize = 200;
/// Steps below this, in the unknowns' scale, are rounding.
const SMALL_STEP: f64 = 1e-13;
/// Least coefficient of a square, relative to the largest rate, of an ellipsoid that is closed.
const CLOSED: f64 = 1e-3;
/// Damping at which the fit gives up.
const MAX_DAMPING: f64 = 1e12;

/// Which unknowns there are.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Unknowns {
    /// Order of every polynomial.
    pub order: usize,
    /// Whether K- is a curve of its own; otherwise it is -K+.
    pub split: bool,
    /// Whether the misalignments are estimated.
    pub misalignment: bool,
}

impl Unknowns {
    /// Their number.
    #[must_use]
    pub const fn count(self) -> usize {
        self.misalignments() + if self.misalignment { AXES } else { 0 }
    }

    /// Index of the first misalignment.
    const fn misalignments(self) -> usize {
        AXES * self.curves() * (self.order + 1)
    }

    /// Curves of an axis.
    const fn curves(self) -> usize {
        if self.split { 3 } else { 2 }
    }

    /// Index of coefficient 0 of a curve: `quantity` is 0 for A, 1 for K+, 2 for K-.
    pub const fn offset(self, axis: usize, quantity: usize) -> usize {
        (axis * self.curves() + quantity) * (self.order + 1)
    }

    /// The name of an unknown: `A1 bias c0`, `A3 K+ c1`, `m12`.
    #[must_use]
    pub fn name(self, index: usize) -> String {
        match index.checked_sub(self.misalignments()) {
            Some(m) => ["m12", "m13", "m23"][m].to_owned(),
            None => {
                let (curve, k) = (index / (self.order + 1), index % (self.order + 1));
                let quantity = ["bias", "K+", "K-"][curve % self.curves()];
                format!("A{} {quantity} c{k}", curve / self.curves() + 1)
            }
        }
    }
}

/// The equations of all static poses, with the scale of the unknowns.
#[derive(Clone, Debug)]
pub struct GravityModel<'a> {
    readings: &'a [Reading],
    /// Which unknowns there are.
    pub unknowns: Unknowns,
    /// g_local/g0.
    gravity: f64,
    /// The scale factor that the unknowns of each axis are relative to \[pulse/(s*g0)\].
    scale_factor: [f64; AXES],
    /// Centre and scale of head and board temperature.
    basis: [[[f64; 2]; AXES]; 2],
    /// What the group of each static pose shares next to the unknowns.
    offsets: Vec<Offsets>,
}

/// What a group of static poses shares: x = N/(K (1 + gain)) - A - bias.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Offsets {
    /// Of the biases \[g0\].
    pub bias: Vector3<f64>,
    /// Of the scale factors, relative.
    pub gain: Vector3<f64>,
}

/// What an IMU indicates at one static pose, with derivatives.
struct Indication {
    /// s, along the body's axes \[g0\].
    force: Vector3<f64>,
    /// ds by the unknowns.
    by: DMatrix<f64>,
    /// x + A: what the pulses say \[g0\].
    load: Vector3<f64>,
}

/// Values of the unknowns with their Jacobian.
#[derive(Clone, Debug)]
pub struct GravityFit {
    /// The unknowns.
    pub unknown: DVector<f64>,
    /// |s| - g_local/g0 of each static pose \[g0\].
    pub residual: DVector<f64>,
    /// Derivatives of the residuals by the unknowns.
    pub jacobian: DMatrix<f64>,
    /// (J'J)^-1; `None` if the static poses do not determine all unknowns.
    pub inverse: Option<DMatrix<f64>>,
    /// d: derivatives of each residual by x, a row for each static pose.
    pub by_force: DMatrix<f64>,
    /// x + A of each static pose, a row each \[g0\].
    pub load: DMatrix<f64>,
}

impl GravityFit {
    /// Sum of the squared residuals \[g0^2\].
    #[must_use]
    pub fn squares(&self) -> f64 {
        self.residual.norm_squared()
    }

    /// The fit with (J'J)^-1.
    fn solved(self) -> Self {
        let inverse = least_squares(&self.jacobian, &self.residual).map(|solved| solved.inverse);
        Self { inverse, ..self }
    }
}

impl<'a> GravityModel<'a> {
    /// The equations of `readings`, with the linear ellipsoid along the axes as start, and the start's unknowns.
    #[must_use]
    pub fn new(readings: &'a [Reading], unknowns: Unknowns, gravity: f64) -> (Self, DVector<f64>) {
        let start = ellipsoid(readings, gravity).map(|found| (found.bias, found.scale_factor));
        let (bias, scale_factor) = start.unwrap_or_else(|| {
            // Any scale shows which unknowns the attitudes determine.
            let length = |reading: &Reading| Vector3::from([0, 1, 2].map(|axis| reading.net(axis))).norm();
            let mean = readings.iter().map(length).sum::<f64>() / readings.len().max(1) as f64;
            ([0.0; AXES], [mean.max(f64::MIN_POSITIVE) / gravity; AXES])
        });
        let of = |temperature: fn(&Reading) -> [f64; AXES]| {
            [0, 1, 2].map(|axis| {
                let [low, high] = joint_range(readings.iter().map(|reading| [temperature(reading)[axis]; 2]));
                [(low + high) / 2.0, if high > low { (high - low) / 2.0 } else { 1.0 }]
            })
        };
        let basis = [of(|reading| reading.head), of(|reading| reading.board)];
        let offsets = vec![Offsets::default(); readings.len()];
        let mut start = DVector::zeros(unknowns.count());
        for axis in 0..AXES {
            start[unknowns.offset(axis, 0)] = bias[axis];
            start[unknowns.offset(axis, 1)] = 1.0;
            if unknowns.split {
                start[unknowns.offset(axis, 2)] = -1.0;
            }
        }
        (Self { readings, unknowns, gravity, scale_factor, basis, offsets }, start)
    }

    /// The value of a curve: A \[g0\], K+ or K- \[relative\], and the powers of the temperature.
    fn value(&self, unknown: &DVector<f64>, axis: usize, quantity: usize, temperature: f64) -> (f64, Vec<f64>) {
        let [center, scale] = self.basis[usize::from(quantity > 0)][axis];
        let x = (temperature - center) / scale;
        let powers: Vec<f64> = (0..=self.unknowns.order).map(|k| x.powi(k as i32)).collect();
        let (offset, sign) = match quantity {
            2 if !self.unknowns.split => (self.unknowns.offset(axis, 1), -1.0),
            _ => (self.unknowns.offset(axis, quantity), 1.0),
        };
        let value = powers.iter().enumerate().map(|(k, power)| unknown[offset + k] * power).sum::<f64>();
        (sign * value, powers)
    }

    /// What rates and temperature show, with the derivatives by the unknowns.
    fn indicated(
        &self,
        unknown: &DVector<f64>,
        rates: &[[f64; 2]; AXES],
        [head, board]: [&[f64; AXES]; 2],
        offsets: &Offsets,
    ) -> Indication {
        let mut load = Vector3::zeros();
        let mut x = -offsets.bias;
        let mut by = DMatrix::zeros(AXES, self.unknowns.count());
        for axis in 0..AXES {
            let (a, powers) = self.value(unknown, axis, 0, head[axis]);
            for (k, power) in powers.iter().enumerate() {
                by[(axis, self.unknowns.offset(axis, 0) + k)] = -power;
            }
            for (channel, quantity) in [1, 2].into_iter().enumerate() {
                let (relative, powers) = self.value(unknown, axis, quantity, board[axis]);
                let term = rates[axis][channel] / (relative * self.scale_factor[axis] * (1.0 + offsets.gain[axis]));
                load[axis] += term;
                let (column, sign) = match (quantity, self.unknowns.split) {
                    (2, false) => (self.unknowns.offset(axis, 1), -1.0),
                    _ => (self.unknowns.offset(axis, quantity), 1.0),
                };
                for (k, power) in powers.iter().enumerate() {
                    by[(axis, column + k)] -= sign * term / relative * power;
                }
            }
            x[axis] += load[axis] - a;
        }
        if !self.unknowns.misalignment {
            return Indication { force: x, by, load };
        }
        // M s = x from below; the derivatives likewise.
        let m = self.unknowns.misalignments();
        let [m12, m13, m23] = [0, 1, 2].map(|k| unknown[m + k]);
        let s3 = x[2];
        let s2 = x[1] - m23 * s3;
        let s1 = x[0] - m12 * s2 - m13 * s3;
        by[(0, m)] = -s2;
        by[(0, m + 1)] = -s3;
        by[(1, m + 2)] = -s3;
        for column in 0..by.ncols() {
            by[(1, column)] -= m23 * by[(2, column)];
            by[(0, column)] -= m12 * by[(1, column)] + m13 * by[(2, column)];
        }
        Indication { force: Vector3::new(s1, s2, s3), by, load }
    }

    /// The specific force of a reading along the body's axes \[g0\].
    #[must_use]
    pub fn force_of(&self, unknown: &DVector<f64>, reading: &Reading) -> Vector3<f64> {
        self.indicated(unknown, &reading.rates, [&reading.head, &reading.board], &Offsets::default()).force
    }

    /// The derivative of each residual by the temperature, that of head and board moving alike \[g0 per unit\].
    #[must_use]
    pub fn by_temperature(&self, fit: &GravityFit) -> DVector<f64> {
        let curves = [0, 1, 2]
            .map(|axis| [0, 1, 2].map(|quantity| self.curve(&fit.unknown, None, [axis, quantity], 0.0, [0.0, 1.0])));
        let of = |i: usize, reading: &Reading, axis: usize| {
            let [bias, plus, minus] = &curves[axis];
            let scale_factor = if reading.net(axis) < 0.0 { minus } else { plus };
            let board = reading.board[axis];
            let by_board = fit.load[(i, axis)] * scale_factor.slope(board) / scale_factor.at(board);
            -fit.by_force[(i, axis)] * (by_board + bias.slope(reading.head[axis]))
        };
        let sums =
            self.readings.iter().enumerate().map(|(i, reading)| (0..AXES).map(|axis| of(i, reading, axis)).sum());
        DVector::from_iterator(self.readings.len(), sums)
    }

    /// The scale factor of each reading's channel, relative to the start's, and its bias \[g0\], of each axis.
    pub fn relative(&self, unknown: &DVector<f64>) -> impl Iterator<Item = [[f64; 2]; AXES]> {
        self.readings.iter().map(move |reading| {
            [0, 1, 2].map(|axis| {
                let (quantity, sign) = if reading.net(axis) < 0.0 { (2, -1.0) } else { (1, 1.0) };
                let scale_factor = sign * self.value(unknown, axis, quantity, reading.board[axis]).0;
                [scale_factor, self.value(unknown, axis, 0, reading.head[axis]).0]
            })
        })
    }

    /// The derivatives of a curve's value at `temperature` by the unknowns: of a bias \[g0\], or of a scale factor
    /// relative to the start's.
    #[must_use]
    pub fn gradient(&self, axis: usize, quantity: usize, temperature: f64) -> DVector<f64> {
        let (_, powers) = self.value(&DVector::zeros(self.unknowns.count()), axis, quantity, temperature);
        let from = if quantity == 2 && !self.unknowns.split { 1 } else { quantity };
        let mut gradient = DVector::zeros(self.unknowns.count());
        for (k, power) in powers.into_iter().enumerate() {
            gradient[self.unknowns.offset(axis, from) + k] = power;
        }
        gradient
    }

    /// How much of a reading's residual its group's offsets are, linear \[g0\].
    #[must_use]
    pub fn shared(&self, fit: &GravityFit, reading: usize) -> f64 {
        let Offsets { bias, gain } = &self.offsets[reading];
        let of = |axis: usize| fit.by_force[(reading, axis)] * (bias[axis] + fit.load[(reading, axis)] * gain[axis]);
        (0..AXES).map(of).sum()
    }

    /// The readings.
    #[must_use]
    pub const fn readings(&self) -> &'a [Reading] {
        self.readings
    }

    /// The equations with what the group of each reading shares.
    #[must_use]
    pub fn with_offsets(self, offsets: Vec<Offsets>) -> Self {
        Self { offsets, ..self }
    }

    /// The equations without what groups share.
    #[must_use]
    pub fn without_offsets(self) -> Self {
        let offsets = vec![Offsets::default(); self.readings.len()];
        Self { offsets, ..self }
    }

    /// Derivatives by the unknowns of the specific force that is indicated where it is `force`, `part` of the way
    /// through the temperature's range, 0 to 1.
    #[must_use]
    pub fn derivatives_at(&self, unknown: &DVector<f64>, force: &Vector3<f64>, part: f64) -> DMatrix<f64> {
        let [head, board] =
            [0, 1].map(|sensor| self.basis[sensor].map(|[center, scale]| center + scale * (2.0 * part - 1.0)));
        let x = self.misalignment(unknown) * force;
        let rates = [0, 1, 2].map(|axis| {
            let counted = x[axis] + self.value(unknown, axis, 0, head[axis]).0;
            let quantity = if counted >= 0.0 { 1 } else { 2 };
            let rate = counted * self.value(unknown, axis, quantity, board[axis]).0 * self.scale_factor[axis];
            if counted >= 0.0 { [rate, 0.0] } else { [0.0, rate] }
        });
        self.indicated(unknown, &rates, [&head, &board], &Offsets::default()).by
    }

    /// K+ of an axis at the middle of the temperature's range \[pulse/(s*g0)\].
    #[must_use]
    pub fn scale_factor(&self, unknown: &DVector<f64>, axis: usize) -> f64 {
        unknown[self.unknowns.offset(axis, 1)] * self.scale_factor[axis]
    }

    /// M.
    #[must_use]
    pub fn misalignment(&self, unknown: &DVector<f64>) -> Matrix3<f64> {
        let m = self.unknowns.misalignments();
        let [m12, m13, m23] = [0, 1, 2].map(|k| if self.unknowns.misalignment { unknown[m + k] } else { 0.0 });
        Matrix3::new(1.0, m12, m13, 0.0, 1.0, m23, 0.0, 0.0, 1.0)
    }

    /// The curve A \[g0\], K+ or K- \[pulse/(s*g0)\] of an axis over `range`.
    #[must_use]
    pub fn curve(
        &self,
        unknown: &DVector<f64>,
        covariance: Option<&DMatrix<f64>>,
        [axis, quantity]: [usize; 2],
        freedom: f64,
        range: [f64; 2],
    ) -> Curve {
        let (from, sign) = if quantity == 2 && !self.unknowns.split { (1, -1.0) } else { (quantity, 1.0) };
        let (offset, count) = (self.unknowns.offset(axis, from), self.unknowns.order + 1);
        let unit = if quantity == 0 { 1.0 } else { sign * self.scale_factor[axis] };
        let coefficients = unknown.rows(offset, count) * unit;
        let covariance = covariance.map(|all| all.view((offset, offset), (count, count)) * (unit * unit));
        Curve::new(self.basis[usize::from(quantity > 0)][axis], coefficients, covariance, freedom, range)
    }

    /// Residuals and derivatives at `unknown`.
    #[must_use]
    pub fn at(&self, unknown: DVector<f64>) -> GravityFit {
        let (rows, columns) = (self.readings.len(), self.unknowns.count());
        let mut jacobian = DMatrix::zeros(rows, columns);
        let mut residual = DVector::zeros(rows);
        let [mut by_force, mut load] = [DMatrix::zeros(rows, AXES), DMatrix::zeros(rows, AXES)];
        let m = self.misalignment(&unknown);
        for (i, (reading, offsets)) in self.readings.iter().zip(&self.offsets).enumerate() {
            let found = self.indicated(&unknown, &reading.rates, [&reading.head, &reading.board], offsets);
            let length = found.force.norm();
            residual[i] = length - self.gravity;
            let direction = found.force / length;
            jacobian.row_mut(i).copy_from(&(direction.transpose() * found.by));
            // M' d = s/|s|, from above.
            let d1 = direction[0];
            let d2 = direction[1] - m[(0, 1)] * d1;
            let d3 = direction[2] - m[(0, 2)] * d1 - m[(1, 2)] * d2;
            by_force.row_mut(i).copy_from(&Vector3::new(d1, d2, d3).transpose());
            load.row_mut(i).copy_from(&found.load.transpose());
        }
        GravityFit { unknown, residual, jacobian, inverse: None, by_force, load }
    }

    /// Fits all unknowns by Levenberg-Marquardt from `start`; `None` if no step makes the residuals smaller before they
    /// are at their least.
    #[must_use]
    pub fn fit(&self, start: DVector<f64>) -> Option<GravityFit> {
        let mut now = self.at(start);
        let mut damping = 1e-3;
        for _ in 0..MAX_STEPS {
            checkpoint();
            let LeastSquares { change, .. } = damped(&now, damping)?;
            let next = self.at(&now.unknown + &change);
            let size = change.amax();
            if next.squares() <= now.squares() {
                damping /= 10.0;
                now = next;
                if size < SMALL_STEP {
                    return Some(now.solved());
                }
            } else {
                if size < SMALL_STEP.sqrt() * 1e-3 {
                    return Some(now.solved());
                }
                damping *= 10.0;
                if damping > MAX_DAMPING {
                    return None;
                }
            }
        }
        None
    }
}

/// A step of least squares with the rows damping^(1/2) I below those of the Jacobian.
fn damped(now: &GravityFit, damping: f64) -> Option<LeastSquares> {
    let (rows, columns) = now.jacobian.shape();
    let mut jacobian = DMatrix::zeros(rows + columns, columns);
    jacobian.rows_mut(0, rows).copy_from(&now.jacobian);
    for k in 0..columns {
        jacobian[(rows + k, k)] = damping.sqrt();
    }
    let mut residual = DVector::zeros(rows + columns);
    residual.rows_mut(0, rows).copy_from(&now.residual);
    least_squares(&jacobian, &residual)
}

/// The ellipsoid along the axes through all net rates, at whatever temperature.
pub(super) struct Ellipsoid {
    /// Its centre \[g0\].
    pub bias: [f64; AXES],
    /// Its half axes \[pulse/(s*g0)\].
    pub scale_factor: [f64; AXES],
    /// Condition number of its equations.
    pub condition: f64,
    /// Whether each axis has an end.
    pub is_closed: bool,
}

/// Finds the ellipsoid; `None` if the net rates lie on none. Unsigned counts may have any offset.
#[must_use]
pub(super) fn ellipsoid(readings: &[Reading], gravity: f64) -> Option<Ellipsoid> {
    let count = readings.len() as f64;
    ellipsoid_about(readings, gravity, |axis| readings.iter().map(|reading| reading.net(axis)).sum::<f64>() / count)
}

/// The same in numbers about a middle of each axis \[pulse/s\]. The condition is that of attitudes seen from there:
/// about 0, one attitude many times shows nothing.
#[must_use]
pub(super) fn ellipsoid_about(readings: &[Reading], gravity: f64, middle: impl Fn(usize) -> f64) -> Option<Ellipsoid> {
    let middle = [0, 1, 2].map(middle);
    let off = |reading: &Reading, axis: usize| reading.net(axis) - middle[axis];
    let size = readings.iter().flat_map(|reading| [0, 1, 2].map(|axis| off(reading, axis).abs())).fold(0.0, f64::max);
    // sum of p n^2 + q n = 1, with rates off the middle relative to the largest.
    let design = DMatrix::from_fn(readings.len(), 2 * AXES, |i, column| {
        let net = off(&readings[i], column % AXES) / size;
        if column < AXES { net * net } else { net }
    });
    let right = DVector::from_element(readings.len(), -1.0);
    let LeastSquares { change, condition, .. } = least_squares(&design, &right)?;
    let [p, q] = [0, AXES].map(|first| [0, 1, 2].map(|axis| change[first + axis]));
    let radius = 1.0 + (0..AXES).map(|axis| q[axis] * q[axis] / (4.0 * p[axis])).sum::<f64>();
    let scale_factor = p.map(|p| size * (radius / p).sqrt() / gravity);
    let bias = [0, 1, 2].map(|axis| (middle[axis] - q[axis] / (2.0 * p[axis]) * size) / scale_factor[axis]);
    let is_closed = p.iter().all(|p| *p > CLOSED);
    let found = Ellipsoid { bias, scale_factor, condition, is_closed };
    found.scale_factor.iter().chain(&found.bias).all(|value| value.is_finite()).then_some(found)
}
