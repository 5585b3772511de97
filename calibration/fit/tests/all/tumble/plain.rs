//! What others do: least squares of the lengths with nine unknowns, all static poses alike, as imu_tk and scripts with
//! numpy have it.

use isotherm_fit::Reading;
use nalgebra::{DMatrix, DVector, Vector3};

/// Its result.
pub(super) struct Plain {
    /// \[g0\]
    pub bias: Vector3<f64>,
    /// \[pulse/(s*g0)\]
    pub scale_factor: Vector3<f64>,
    /// Of the residuals, rms \[g0\].
    pub rms: f64,
}

/// b, 1/K relative to the middle of the rates, and m12, m13, m23: M s = N/K - b.
fn residuals(unknown: &DVector<f64>, readings: &[Reading], size: f64, gravity: f64) -> DVector<f64> {
    DVector::from_iterator(
        readings.len(),
        readings.iter().map(|reading| {
            let x = Vector3::from_fn(|axis, _| reading.net(axis) / size * unknown[3 + axis] - unknown[axis]);
            let s2 = x[1] - unknown[8] * x[2];
            let s1 = x[0] - unknown[6] * s2 - unknown[7] * x[2];
            Vector3::new(s1, s2, x[2]).norm() - gravity
        }),
    )
}

/// The fit by Levenberg-Marquardt with numerical derivatives; `None` with fewer static poses than unknowns.
pub(super) fn plain_fit(readings: &[Reading], gravity: f64) -> Option<Plain> {
    const COUNT: usize = 9;
    if readings.len() < COUNT {
        return None;
    }
    let middle = Vector3::from_fn(|axis, _| {
        let [low, high] = readings.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], reading| {
            [low.min(reading.net(axis)), high.max(reading.net(axis))]
        });
        (low + high) / 2.0
    });
    let of = |reading: &Reading| Vector3::from_fn(|axis, _| reading.net(axis) - middle[axis]).norm();
    let size = readings.iter().map(of).sum::<f64>() / readings.len() as f64 / gravity;
    let mut unknown = DVector::from_element(COUNT, 0.0);
    for axis in 0..3 {
        (unknown[axis], unknown[3 + axis]) = (middle[axis] / size, 1.0);
    }
    let mut now = residuals(&unknown, readings, size, gravity);
    let mut damping = 1e-3;
    for _ in 0..300 {
        let jacobian = DMatrix::from_fn(readings.len(), COUNT, |_, _| 0.0);
        let mut jacobian = jacobian;
        for k in 0..COUNT {
            let [mut up, mut down] = [unknown.clone(), unknown.clone()];
            up[k] += 1e-6;
            down[k] -= 1e-6;
            let by = (residuals(&up, readings, size, gravity) - residuals(&down, readings, size, gravity)) / 2e-6;
            jacobian.set_column(k, &by);
        }
        let mut normal = jacobian.tr_mul(&jacobian);
        for k in 0..COUNT {
            normal[(k, k)] *= 1.0 + damping;
        }
        let step = normal.cholesky()?.solve(&-jacobian.tr_mul(&now));
        let next = residuals(&(&unknown + &step), readings, size, gravity);
        if next.norm_squared() <= now.norm_squared() {
            (unknown, now, damping) = (unknown + &step, next, (damping / 10.0).max(1e-12));
            if step.amax() < 1e-10 {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e12 {
                break;
            }
        }
    }
    Some(Plain {
        bias: unknown.fixed_rows::<3>(0).into_owned(),
        scale_factor: Vector3::from_fn(|axis, _| size / unknown[3 + axis]),
        rms: (now.norm_squared() / readings.len() as f64).sqrt(),
    })
}
