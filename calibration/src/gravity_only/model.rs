//! The equation of one standstill, its derivatives, and the fit.
//!
//! ```text
//! x = N+/K+(U_b) + N-/K-(U_b) - A(U_h),   x = M s,   M = [[1, m12, m13], [0, 1, m23], [0, 0, 1]]      [g0]
//! residual = |s| - g_local/g0
//! ```
//! Standstills have equal weights: what the model leaves is larger than the noise of a mean. The unknowns are on one
//! scale: biases in g0, scale factors relative to those of the start, misalignments in rad.

use super::reading::Reading;
use isotherm_campaign::joint_range;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{Curve, LeastSquares, least_squares};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Most steps of the fit; ten are usual.
const MAX_STEPS: usize = 200;
/// Steps below this, in the unknowns' scale, are rounding.
const SMALL_STEP: f64 = 1e-13;
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
    const fn offset(self, axis: usize, quantity: usize) -> usize {
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

/// The equations of all standstills, with the scale of the unknowns.
#[derive(Clone, Debug)]
pub struct GravityModel<'a> {
    readings: &'a [Reading],
    /// Which unknowns there are.
    pub unknowns: Unknowns,
    /// g_local/g0.
    gravity: f64,
    /// The scale factor that the unknowns of each axis are relative to \[pulse/(s*g0)\].
    scale_factor: [f64; AXES],
    /// Centre and scale of head and board telemetry.
    basis: [[[f64; 2]; AXES]; 2],
}

/// Values of the unknowns with their Jacobian.
#[derive(Clone, Debug)]
pub struct GravityFit {
    /// The unknowns.
    pub unknown: DVector<f64>,
    /// |s| - g_local/g0 of each standstill \[g0\].
    pub residual: DVector<f64>,
    /// Derivatives of the residuals by the unknowns.
    pub jacobian: DMatrix<f64>,
    /// (J'J)^-1; `None` if the standstills do not determine all unknowns.
    pub inverse: Option<DMatrix<f64>>,
}

impl GravityFit {
    /// Sum of the squared residuals \[g0^2\].
    #[must_use]
    pub fn squares(&self) -> f64 {
        self.residual.norm_squared()
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
        let of = |telemetry: fn(&Reading) -> [f64; AXES]| {
            [0, 1, 2].map(|axis| {
                let [low, high] = joint_range(readings.iter().map(|reading| [telemetry(reading)[axis]; 2]));
                [(low + high) / 2.0, if high > low { (high - low) / 2.0 } else { 1.0 }]
            })
        };
        let basis = [of(|reading| reading.head), of(|reading| reading.board)];
        let mut start = DVector::zeros(unknowns.count());
        for axis in 0..AXES {
            start[unknowns.offset(axis, 0)] = bias[axis];
            start[unknowns.offset(axis, 1)] = 1.0;
            if unknowns.split {
                start[unknowns.offset(axis, 2)] = -1.0;
            }
        }
        (Self { readings, unknowns, gravity, scale_factor, basis }, start)
    }

    /// The value of a curve: A \[g0\], K+ or K- \[relative\], and the powers of the telemetry.
    fn value(&self, unknown: &DVector<f64>, axis: usize, quantity: usize, telemetry: f64) -> (f64, Vec<f64>) {
        let [center, scale] = self.basis[usize::from(quantity > 0)][axis];
        let x = (telemetry - center) / scale;
        let powers: Vec<f64> = (0..=self.unknowns.order).map(|k| x.powi(k as i32)).collect();
        let (offset, sign) = match quantity {
            2 if !self.unknowns.split => (self.unknowns.offset(axis, 1), -1.0),
            _ => (self.unknowns.offset(axis, quantity), 1.0),
        };
        let value = powers.iter().enumerate().map(|(k, power)| unknown[offset + k] * power).sum::<f64>();
        (sign * value, powers)
    }

    /// The specific force that rates and telemetry show \[g0\], and its derivatives by the unknowns.
    fn force(
        &self,
        unknown: &DVector<f64>,
        rates: &[[f64; 2]; AXES],
        [head, board]: [&[f64; AXES]; 2],
    ) -> (Vector3<f64>, DMatrix<f64>) {
        let mut x = Vector3::zeros();
        let mut by = DMatrix::zeros(AXES, self.unknowns.count());
        for axis in 0..AXES {
            let (a, powers) = self.value(unknown, axis, 0, head[axis]);
            x[axis] = -a;
            for (k, power) in powers.iter().enumerate() {
                by[(axis, self.unknowns.offset(axis, 0) + k)] = -power;
            }
            for (channel, quantity) in [1, 2].into_iter().enumerate() {
                let (relative, powers) = self.value(unknown, axis, quantity, board[axis]);
                let term = rates[axis][channel] / (relative * self.scale_factor[axis]);
                x[axis] += term;
                let (column, sign) = match (quantity, self.unknowns.split) {
                    (2, false) => (self.unknowns.offset(axis, 1), -1.0),
                    _ => (self.unknowns.offset(axis, quantity), 1.0),
                };
                for (k, power) in powers.iter().enumerate() {
                    by[(axis, column + k)] -= sign * term / relative * power;
                }
            }
        }
        if !self.unknowns.misalignment {
            return (x, by);
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
        (Vector3::new(s1, s2, s3), by)
    }

    /// The specific force of a reading along the body's axes \[g0\].
    #[must_use]
    pub fn force_of(&self, unknown: &DVector<f64>, reading: &Reading) -> Vector3<f64> {
        self.force(unknown, &reading.rates, [&reading.head, &reading.board]).0
    }

    /// Derivatives by the unknowns of the specific force that is indicated where it is `force`, `part` of the way
    /// through the telemetry's range, 0 to 1.
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
        self.force(unknown, &rates, [&head, &board]).1
    }

    /// K+ of an axis at the middle of the telemetry's range \[pulse/(s*g0)\].
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

    /// Standard errors of m12, m13 and m23 from the covariance of the unknowns; `None` if they are not estimated.
    #[must_use]
    pub fn misalignment_errors(&self, covariance: &DMatrix<f64>) -> Option<[f64; AXES]> {
        let m = self.unknowns.misalignments();
        self.unknowns.misalignment.then(|| [0, 1, 2].map(|k| covariance[(m + k, m + k)].max(0.0).sqrt()))
    }

    /// The curve A \[g0\], K+ or K- \[pulse/(s*g0)\] of an axis over `range`.
    #[must_use]
    pub fn curve(
        &self,
        unknown: &DVector<f64>,
        covariance: Option<&DMatrix<f64>>,
        [axis, quantity]: [usize; 2],
        freedom: usize,
        range: [f64; 2],
    ) -> Curve {
        let (from, sign) = if quantity == 2 && !self.unknowns.split { (1, -1.0) } else { (quantity, 1.0) };
        let (offset, count) = (self.unknowns.offset(axis, from), self.unknowns.order + 1);
        let unit = if quantity == 0 { 1.0 } else { sign * self.scale_factor[axis] };
        let coefficients = unknown.rows(offset, count) * unit;
        let covariance = covariance.map(|all| all.view((offset, offset), (count, count)) * (unit * unit));
        Curve::new(self.basis[usize::from(quantity > 0)][axis], coefficients, covariance, freedom, range)
    }

    /// Residuals, Jacobian and (J'J)^-1 at `unknown`.
    #[must_use]
    pub fn at(&self, unknown: DVector<f64>) -> GravityFit {
        let (rows, columns) = (self.readings.len(), self.unknowns.count());
        let mut jacobian = DMatrix::zeros(rows, columns);
        let mut residual = DVector::zeros(rows);
        for (i, reading) in self.readings.iter().enumerate() {
            let (force, by) = self.force(&unknown, &reading.rates, [&reading.head, &reading.board]);
            let length = force.norm();
            residual[i] = length - self.gravity;
            jacobian.row_mut(i).copy_from(&((force / length).transpose() * by));
        }
        let inverse = least_squares(&jacobian, &residual).map(|solved| solved.inverse);
        GravityFit { unknown, residual, jacobian, inverse }
    }

    /// Fits all unknowns by Levenberg-Marquardt from `start`; `None` if no step makes the residuals smaller before they
    /// are at their least.
    #[must_use]
    pub fn fit(&self, start: DVector<f64>) -> Option<GravityFit> {
        let mut now = self.at(start);
        let mut damping = 1e-3;
        for _ in 0..MAX_STEPS {
            let LeastSquares { change, .. } = damped(&now, damping)?;
            let next = self.at(&now.unknown + &change);
            let size = change.amax();
            if next.squares() <= now.squares() {
                damping /= 10.0;
                now = next;
                if size < SMALL_STEP {
                    return Some(now);
                }
            } else {
                if size < SMALL_STEP.sqrt() * 1e-3 {
                    return Some(now);
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

/// The ellipsoid along the axes through all net rates, at whatever telemetry.
pub(super) struct Ellipsoid {
    /// Its centre \[g0\].
    pub bias: [f64; AXES],
    /// Its half axes \[pulse/(s*g0)\].
    pub scale_factor: [f64; AXES],
    /// Condition number of its equations.
    pub condition: f64,
}

/// Finds the ellipsoid; `None` if the net rates lie on none.
#[must_use]
pub(super) fn ellipsoid(readings: &[Reading], gravity: f64) -> Option<Ellipsoid> {
    let count = readings.len() as f64;
    let middle = [0, 1, 2].map(|axis| readings.iter().map(|reading| reading.net(axis)).sum::<f64>() / count);
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
    let found = Ellipsoid { bias, scale_factor, condition };
    found.scale_factor.iter().chain(&found.bias).all(|value| value.is_finite()).then_some(found)
}
