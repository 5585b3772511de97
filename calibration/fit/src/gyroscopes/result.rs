//! What the calibration of the gyroscopes found.

use super::earth::{EarthCheck, LeftOver};
use super::observability::TriadObservability;
use super::runs::{FittedRun, RunPlace};
use super::set_points::SetPointReduction;
use super::solution::{GyroscopeSolution, TriadSolution};
use crate::alignment::{NEEDED_CONFIDENCE, is_significant, matrix_of};
use isotherm_shared::table::{CoefficientTable, Turntable};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{OrderTable, largest, student_quantile};
use nalgebra::Matrix3;

/// What the calibration of the gyroscopes found.
#[derive(Clone, Debug)]
pub struct GyroscopeCalibration {
    /// The dwells, then the turns.
    pub runs: Vec<FittedRun>,
    /// What positions and turns determine.
    pub observability: TriadObservability,
    /// Each set point reduced by itself.
    pub reduced: Vec<SetPointReduction>,
    /// The order tables, by gyroscope and quantity, with leave-one-set-point-out errors.
    pub orders: [[OrderTable; 3]; AXES],
    /// The estimate that the table is made of.
    pub solution: TriadSolution,
    /// Earth's horizontal rate compared with that of the latitude; `None` without angles.
    pub earth: Option<EarthCheck>,
    /// Without angles: what Earth's rate leaves in the estimate, if it does not cancel.
    pub left_over: Option<LeftOver>,
    /// Outlying runs, which were kept in the fit: index into `runs` and gyroscope.
    pub outliers: Vec<(usize, usize)>,
    /// Index of the gyroscopes' first finding in [`Calibration::findings`](crate::result::Calibration::findings); those
    /// before it are not only of the gyroscopes.
    pub first_finding: usize,
    /// White noise of each gyroscope in a mean over 1 s \[deg/h\], from the rows of the dwells; a wrong position or
    /// curve does not change it.
    pub noise: [f64; AXES],
}

impl GyroscopeCalibration {
    /// The misalignment matrix M. Row i: sensitivity of gyroscope i to the rate about each axis; 1 on the diagonal.
    #[must_use]
    pub fn misalignment(&self) -> Matrix3<f64> {
        misalignment(&self.solution)
    }

    /// Number of turns in the fit.
    #[must_use]
    pub fn turns(&self) -> usize {
        self.runs.iter().filter(|run| matches!(run.place, RunPlace::Turn(_))).count()
    }

    /// What `table` without alignment matrices leaves, if the gyroscopes need one: the largest error for a rate about
    /// any axis, in parts of the rate \[rad\].
    #[must_use]
    pub fn left_without_alignment(&self, table: &CoefficientTable) -> Option<f64> {
        let aligned = table.content().gyroscopes.as_ref().is_some_and(|gyroscopes| gyroscopes.alignment.is_some());
        let across =
            self.solution.gyroscopes.iter().map(|axis| libm::hypot(axis.misalignment[0], axis.misalignment[1]));
        (!aligned && is_alignment_needed(&self.solution)).then(|| largest(across))
    }

    /// Half width of the confidence interval of Earth's horizontal rate \[deg/h\].
    #[must_use]
    pub fn horizontal_rate_interval(&self, confidence: f64) -> Option<f64> {
        let freedom = self.reduced.len().checked_sub(1).filter(|freedom| *freedom > 0)?;
        Some(self.earth?.error? * student_quantile(confidence, freedom))
    }

    /// The turntable as the fit found it, with the tilt of the accelerometers' fit and the mounting; `None` without
    /// angles.
    #[must_use]
    pub fn turntable(&self, tilt: Option<[f64; 2]>, mount: Option<Matrix3<f64>>) -> Option<Turntable> {
        let [x, y] = self.solution.earth?;
        Some(Turntable {
            earth_rate_deg_h: [x, y, self.earth?.along_z],
            earth_rate_standard_error: self.solution.earth_error,
            freedom: (self.reduced.len() - 1).max(1),
            tilt_rad: tilt.unwrap_or_default(),
            mounting: mount?,
        })
    }

    /// Residual standard deviation of gyroscope `axis` over all runs, as a random walk of the angle \[deg/sqrt(h)\].
    #[must_use]
    pub fn random_walk(&self, axis: usize) -> f64 {
        let sum: f64 = self.solution.residuals.iter().map(|residual| residual[axis].powi(2)).sum();
        // 1 arcsec/sqrt(s) is 60/3600 deg/sqrt(h).
        (sum / self.solution.residuals.len() as f64).sqrt() / 60.0
    }
}

/// See [`GyroscopeCalibration::misalignment`].
pub(super) fn misalignment(solution: &TriadSolution) -> Matrix3<f64> {
    matrix_of(solution.gyroscopes.each_ref().map(|gyroscope| gyroscope.misalignment))
}

/// Whether a misalignment of a gyroscope exceeds its 99 % interval and 1e-6 rad.
#[must_use]
pub fn is_alignment_needed(solution: &TriadSolution) -> bool {
    let interval = |gyroscope: &GyroscopeSolution| gyroscope.misalignment_interval(NEEDED_CONFIDENCE);
    solution.gyroscopes.iter().any(|gyroscope| is_significant(gyroscope.misalignment, interval(gyroscope)))
}
