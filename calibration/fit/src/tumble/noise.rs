//! The noise of static poses.

use super::reading::Reading;
use isotherm_shared::wire::AXES;
use isotherm_statistics::median;
use nalgebra::Vector3;

/// Noise of a static pose that is taken at least for that \[g0\].
pub(super) const LEAST_NOISE: f64 = 1e-6;
/// Median of chi-square with one degree of freedom.
const CHI_SQUARE_MEDIAN: f64 = 0.454_936;

/// The standard error of a specific force's length \[g0\], from those of its net rates \[pulse/s\].
pub fn error_of_magnitude(force: &Vector3<f64>, errors: [f64; AXES], scale_factor: impl Fn(usize) -> f64) -> f64 {
    let part = |axis: usize| force[axis] / force.norm() * errors[axis] / scale_factor(axis);
    (0..AXES).map(|axis| part(axis).powi(2)).sum::<f64>().sqrt()
}

/// The standard errors of the net rates of each static pose \[pulse/s\]. The rows of a counter that keeps what is left
/// over vary, but their sum does not: over n rows, noise w of each row and what is left over q give the mean a variance
/// of (w + q/n)/n. Half the difference between the halves has (w + 3 q/n)/n, and a row w + q. The median over the
/// static poses, because the IMU may have turned in some. Where most static poses have one count, its rounding is
/// added.
pub fn errors_of_means(readings: &[Reading]) -> Vec<[f64; AXES]> {
    let parts = [0, 1, 2].map(|axis| {
        let of_halves = |reading: &Reading| {
            let [first, last] = reading.halves;
            let n = reading.rows.len() as f64;
            let row = reading.noise[axis].powi(2) * n;
            let square = ((last[axis] - first[axis]) / 2.0).powi(2) / CHI_SQUARE_MEDIAN * n;
            [square, row, n]
        };
        let [square, row, n] = [0, 1, 2].map(|k| median(readings.iter().map(|reading| of_halves(reading)[k])));
        let w = ((square - 3.0 * row / n) / (1.0 - 3.0 / n)).clamp(0.0, row);
        [w, row - w]
    });
    let rounding = [0, 1, 2].map(|axis| median(readings.iter().map(|reading| reading.rounding[axis])));
    let errors = |reading: &Reading| {
        let n = reading.rows.len() as f64;
        [0, 1, 2].map(|axis| {
            let [w, q] = parts[axis];
            libm::hypot(((w + q / n) / n).sqrt(), rounding[axis])
        })
    };
    readings.iter().map(errors).collect()
}
