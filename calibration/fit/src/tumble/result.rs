//! The result of a calibration by gravity's length.

use super::dilution::Dilution;
use super::evidence::Evidence;
use super::groups::Groups;
use super::model::Unknowns;
use super::options::TumbleOptions;
use super::reading::Reading;
use crate::accuracy::largest_band;
use isotherm_campaign::{GravitySource, joint_range};
use isotherm_recording::Losses;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{CONFIDENCE, Curve, rms, student_quantile_of};
use isotherm_support::finding::Finding;
use nalgebra::Matrix3;

/// The results of a calibration without a turntable.
#[derive(Clone, Debug)]
pub struct TumbleCalibration {
    /// The coefficient table.
    pub table: CoefficientTable,
    /// Where local gravity comes from; the table has its value.
    pub gravity_source: GravitySource,
    /// The options it was made with.
    pub options: TumbleOptions,
    /// The static poses of the fit.
    pub readings: Vec<Reading>,
    /// Static poses that were left out because they are too short.
    pub too_short: usize,
    /// Number of the rows of all recordings.
    pub rows: usize,
    /// Standard deviation of a row's counts at rest, for each recording.
    pub noise: Vec<[f64; AXES]>,
    /// Groups and temperatures of the static poses.
    pub groups: Groups,
    /// What the residuals say; `None` without degrees of freedom.
    pub evidence: Option<Evidence>,
    /// The unknowns.
    pub unknowns: Unknowns,
    /// Why this order, and one scale factor or two.
    pub reasons: [String; 2],
    /// |s| - g_local/g0 of each static pose \[g0\].
    pub residuals: Vec<f64>,
    /// Degrees of freedom: static poses less unknowns.
    pub freedom: usize,
    /// What the attitudes allow.
    pub dilution: Dilution,
    /// A \[g0\] against head temperature, K+ and K- \[pulse/(s*g0)\] against board temperature.
    pub curves: [[Curve; 3]; AXES],
    /// M: x = M s, with 1 on the diagonal and 0 below.
    pub misalignment: Matrix3<f64>,
    /// Standard errors of m12, m13 and m23 \[rad\]; `None` without degrees of freedom, or if they are not estimated.
    pub misalignment_error: Option<[f64; AXES]>,
    /// Degrees of freedom of these errors.
    pub misalignment_freedom: f64,
    /// Specific force of each static pose along the body's axes \[g0\].
    pub forces: Vec<[f64; AXES]>,
    /// Warnings.
    pub findings: Vec<Finding>,
    /// Names of the faults that were accepted, and are warnings now.
    pub accepted: Vec<&'static str>,
    /// Rows that are missing within the recordings by their sequences, and steps of time.
    pub losses: Losses,
}

impl TumbleCalibration {
    /// Root mean square of the residuals over the static poses \[g0\].
    #[must_use]
    pub fn residual_rms(&self) -> f64 {
        rms(&self.residuals)
    }

    /// The largest 95 % bands of the whole curves over the temperature of the static poses: of the biases \[g0\], and
    /// of the scale factors, relative. `None` if one is not known.
    #[must_use]
    pub fn largest_bands(&self) -> Option<[f64; 2]> {
        let largest = |quantity: usize, relative: bool| {
            let bands = self.curves.iter().map(|curves| largest_band(&curves[quantity], relative));
            bands.into_iter().try_fold(0.0, |most: f64, each| Some(most.max(each?)))
        };
        Some([largest(0, false)?, largest(1, true)?.max(largest(2, true)?)])
    }

    /// The bottom line, in words.
    #[must_use]
    pub fn accuracy(&self) -> String {
        let [low, high] = joint_range(self.curves.iter().flatten().map(Curve::measured));
        let of = format!(
            "over {low:.2}..{high:.2} {}, 95 % for each whole curve, from {} static poses, residuals {:.2}e-6 g0 rms",
            self.table.content().temperature_unit,
            self.readings.len(),
            self.residual_rms() * 1e6
        );
        match self.largest_bands() {
            Some([bias, scale_factor]) => {
                format!("bias +- {:.2}e-6 g0, scale factor +- {:.2} ppm {of}", bias * 1e6, scale_factor * 1e6)
            }
            None => format!("bias and scale factor not known (no degrees of freedom) {of}"),
        }
    }

    /// The temperature at which a curve's value is shown: the mean of one group, the middle of what was measured of
    /// more.
    #[must_use]
    pub fn mid(&self, axis: usize, quantity: usize) -> f64 {
        let [low, high] = self.curves[axis][quantity].measured();
        if self.groups.count > 1 {
            return (low + high) / 2.0;
        }
        let of = |reading: &Reading| if quantity == 0 { reading.head[axis] } else { reading.board[axis] };
        (self.readings.iter().map(of).sum::<f64>() / self.readings.len() as f64).clamp(low, high)
    }

    /// Half widths of the 95 % intervals of m12, m13 and m23 \[rad\].
    #[must_use]
    pub fn misalignment_interval(&self) -> Option<[f64; AXES]> {
        let errors = self.misalignment_error?;
        Some(errors.map(|error| error * student_quantile_of(CONFIDENCE, self.misalignment_freedom)))
    }

    /// Mean net rate of each gyroscope over all static poses \[pulse/s\]; Earth's rate is in it. `None` without
    /// gyroscopes.
    #[must_use]
    pub fn gyroscope_rates(&self) -> Option<[f64; AXES]> {
        let seconds: f64 = self.readings.iter().map(|reading| reading.seconds).sum();
        let mut sum = [0.0; AXES];
        for reading in &self.readings {
            let rates = reading.gyroscopes?;
            (0..AXES).for_each(|axis| sum[axis] += rates[axis] * reading.seconds);
        }
        Some(sum.map(|sum| sum / seconds))
    }
}
