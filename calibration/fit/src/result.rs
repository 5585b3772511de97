//! The results of a calibration.

use crate::alignment::{is_needed, misalignment};
use crate::checks::SetPoint;
use crate::gyroscopes::result::GyroscopeCalibration;
use crate::one_stage::Solution;
use crate::options::CalibrationOptions;
use crate::reduce::SensorReduction;
use crate::transients::Transients;
use isotherm_campaign::{Dwell, Observability};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{OrderTable, largest};
use isotherm_support::finding::Finding;
use nalgebra::Matrix3;

/// The results of a calibration.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The coefficient table.
    pub table: CoefficientTable,
    /// The options it was made with.
    pub options: CalibrationOptions,
    /// The dwells that were used.
    pub dwells: Vec<Dwell>,
    /// The set points.
    pub set_points: Vec<SetPoint>,
    /// Warnings of the checks and of the later steps.
    pub findings: Vec<Finding>,
    /// Names of the faults that were accepted, and are warnings now.
    pub accepted: Vec<&'static str>,
    /// What the positions determine, by axis.
    pub observability: [Observability; AXES],
    /// Each set point reduced by itself, by axis: the paper's values.
    pub reduced: Vec<[SensorReduction; AXES]>,
    /// The order tables, by axis and quantity.
    pub orders: [[OrderTable; 3]; AXES],
    /// The estimate that the table is made of.
    pub solution: Solution,
    /// Outlying dwells, which were kept in the fit: index and axis.
    pub outliers: Vec<(usize, usize)>,
    /// Number of the position without which the residuals would fall to a third, if there is one.
    pub suspect_position: Option<u32>,
    /// The gyroscopes, of a campaign with turns; see [`calibrate`](crate::calibrate()).
    pub gyroscopes: Option<GyroscopeCalibration>,
    /// What the ramps show, of a campaign with ramps; see [`calibrate`](crate::calibrate()).
    pub transients: Option<Transients>,
}

impl Calibration {
    /// What a table without an alignment matrix leaves, if the IMU needs one: the largest error at any attitude \[g0\].
    #[must_use]
    pub fn left_without_alignment(&self) -> Option<f64> {
        let aligned = self.table.content().alignment.is_some();
        let across = |axis: usize| {
            let [next, after] = self.solution.axes[axis].misalignment;
            libm::hypot(next, after)
        };
        (!aligned && is_needed(&self.solution)).then(|| largest((0..AXES).map(across)))
    }

    /// Why the errors of the accelerometers are not known, if the positions leave the base's tilt open.
    #[must_use]
    pub fn unknown_errors(&self) -> Option<&'static str> {
        self.solution.tilt_is_open.then_some(
            "these positions cannot separate the tilt of the base from bias, scale factors and misalignments, and it does not cancel: their errors are \
             not known, whatever the residuals are; measure every direction at two opposite headings, or, without them, state the angles",
        )
    }

    /// Residual standard deviation of accelerometer `axis` over all dwells \[g0\].
    #[must_use]
    pub fn residual_sd(&self, axis: usize) -> f64 {
        let sum: f64 = self.solution.residuals.iter().map(|residual| residual[axis].powi(2)).sum();
        (sum / self.dwells.len() as f64).sqrt()
    }

    /// The misalignment matrix M. Row i: sensitivity of accelerometer i to the specific force along each axis; 1 on the
    /// diagonal.
    #[must_use]
    pub fn misalignment(&self) -> Matrix3<f64> {
        misalignment(&self.solution)
    }
}
