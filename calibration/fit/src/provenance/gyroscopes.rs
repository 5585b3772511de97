//! What the provenance of a table with gyroscopes has more.

use super::document::{known, matrix_rows, millionths, misalignment_error, place, view};
use crate::accuracy::Accuracy;
use crate::gyroscopes::GyroscopeCalibration;
use crate::gyroscopes::earth::{EarthCheck, LeftOver};
use crate::result::Calibration;
use crate::triad::CalibratedTriad;
use isotherm_campaign::Campaign;
use isotherm_shared::table::GYROSCOPE_NAMES;
use isotherm_shared::wire::AXES;
use nalgebra::Matrix3;

impl GyroscopeProvenance {
    pub(super) fn new(
        campaign: &Campaign,
        calibration: &Calibration,
        found: &GyroscopeCalibration,
        triad: &CalibratedTriad<'_>,
    ) -> Self {
        Self::of(campaign, calibration, found, triad, &Accuracy::of_triad(calibration, triad))
    }
}

view! { pub(super) GyroscopeProvenance(
    campaign: &Campaign, calibration: &Calibration, found: &GyroscopeCalibration, triad: &CalibratedTriad<'_>, accuracy: &Accuracy
) {
    /// Turns in the fit.
    turns: usize = found.turns(),
    /// Outlying dwells and turns that were kept in the fit.
    gyroscope_outliers: Vec<String> = outliers(campaign, calibration, found),
    gyroscope_accuracy: String = accuracy.to_string(),
    gyroscope_bias_interval_deg_h: Option<[f64; AXES]> = known(accuracy.bias),
    gyroscope_scale_factor_interval_ppm: Option<[f64; AXES]> = millionths(accuracy.scale_factor),
    /// Of the residuals.
    random_walk_deg_sqrt_h: [f64; AXES] = [0, 1, 2].map(|axis| found.random_walk(axis)),
    /// Row i: of gyroscope i to the specific force along each axis.
    g_sensitivity_deg_h_g0: [[f64; AXES]; AXES] = found.solution.gyroscopes.each_ref().map(|axis| axis.g_sensitivity),
    g_sensitivity_standard_error: Option<[[f64; AXES]; AXES]> =
        known(found.solution.gyroscopes.each_ref().map(|axis| axis.g_sensitivity_error)),
    /// See [`GyroscopeCalibration::misalignment`].
    gyroscope_misalignment: [[f64; AXES]; AXES] = matrix_rows(&found.misalignment()),
    gyroscope_misalignment_standard_error: Option<[[f64; AXES]; AXES]> = misalignment_error(triad),
    #[serde(flatten)]
    earth: Option<EarthProvenance> = found.earth.as_ref()
        .and_then(|earth| Some(EarthProvenance::of(campaign, campaign.latitude_deg?, found, earth, found.solution.earth?))),
    earth_rate_left_over: Option<LeftOverRecord> = found.left_over.as_ref().map(LeftOverRecord::of),
}}

view! {
/// Earth's rate, of a campaign with angles.
EarthProvenance(
    campaign: &Campaign, latitude_deg: f64, found: &GyroscopeCalibration, earth: &EarthCheck, horizontal: [f64; 2]
) {
    latitude_deg: f64 = latitude_deg,
    /// Along X, Y and Z of the base: X along the outer axis, Z up at outer angle 0. Z is that of the latitude.
    earth_rate_deg_h: [f64; AXES] = [horizontal[0], horizontal[1], earth.along_z],
    /// Of the components along X and Y.
    earth_rate_standard_error: Option<[f64; 2]> = found.solution.earth_error,
    earth_horizontal_rate_deg_h: f64 = earth.found,
    earth_horizontal_rate_standard_error: Option<f64> = earth.error,
    earth_horizontal_rate_of_latitude_deg_h: f64 = earth.expected,
    /// The rotation from the direction that the angles give to `specific_force`, if it is not the identity.
    mounting: Option<[[f64; AXES]; AXES]> =
        campaign.mount.filter(|mount| *mount != Matrix3::identity()).map(|mount| matrix_rows(&mount)),
}}

view! {
/// What Earth's horizontal rate leaves in the estimate without angles, at most.
LeftOverRecord(left: &LeftOver) {
    bias_deg_h: f64 = left.bias,
    scale_factor_ppm: f64 = left.scale_factor * 1e6,
    g_sensitivity_deg_h_g0: f64 = left.g_sensitivity,
    misalignment_rad: f64 = left.misalignment,
}}

view! {
/// A set point of a gyroscope, reduced by itself. The values are D, K+, K-, two misalignments, three g-sensitivities.
pub(super) GyroscopeSetPointRecord(set_point_c: f64, axis: usize, temperature: [f64; 3], values: [f64; 8]) {
    set_point_c: f64 = set_point_c,
    axis: &'static str = GYROSCOPE_NAMES[axis],
    head: f64 = temperature[0],
    board: f64 = temperature[1],
    bias_deg_h: f64 = values[0],
    positive_scale_factor: f64 = values[1],
    negative_scale_factor: f64 = values[2],
    misalignment_rad: [f64; 2] = [values[3], values[4]],
    g_sensitivity_deg_h_g0: [f64; AXES] = [values[5], values[6], values[7]],
}}

impl GyroscopeSetPointRecord {
    pub(super) fn all(calibration: &Calibration, found: &GyroscopeCalibration) -> impl Iterator<Item = Self> {
        let set_points = calibration.set_points.iter().zip(&found.reduced);
        set_points.flat_map(|(set_point, reduced)| {
            (0..AXES).map(|axis| Self::of(set_point.set_point_c, axis, reduced.temperature[axis], reduced.values[axis]))
        })
    }
}

fn outliers(campaign: &Campaign, calibration: &Calibration, found: &GyroscopeCalibration) -> Vec<String> {
    let outlier = |&(run, axis): &(usize, usize)| {
        let run = &found.runs[run];
        let set_point_c = calibration.set_points[run.set_point].set_point_c;
        format!("{} {}", place(set_point_c, run.place.number(campaign).value()), GYROSCOPE_NAMES[axis])
    };
    found.outliers.iter().map(outlier).collect()
}
