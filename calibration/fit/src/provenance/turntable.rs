//! The provenance of a campaign on a turntable.

use super::document::{CurveErrorsRecord, matrix_rows, millionths, misalignment_error, place, view};
use super::gyroscopes::{GyroscopeProvenance, GyroscopeSetPointRecord};
use super::source::{CampaignSource, ReadRecord};
use super::transients::TransientsRecord;
use crate::accuracy::Accuracy;
use crate::reduce::SensorReduction;
use crate::result::Calibration;
use crate::triad::CalibratedTriad;
use isotherm_campaign::Campaign;
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use isotherm_statistics::QUANTITIES;

/// The accelerometers and the gyroscopes, if there are any.
type Triads<'a> = (CalibratedTriad<'a>, Option<CalibratedTriad<'a>>);

/// The section of a campaign.
pub(super) fn provenance<'a>(
    campaign: &'a Campaign,
    calibration: &'a Calibration,
    source: &'a CampaignSource,
) -> Provenance<'a> {
    let gyroscopes = calibration.gyroscopes.as_ref().map(|found| CalibratedTriad::gyroscopes(calibration, found));
    let triads = (CalibratedTriad::accelerometers(calibration), gyroscopes);
    Provenance::of(campaign, calibration, source, &triads, &Accuracy::of(calibration))
}

view! { pub(super) Provenance<'a>(
    campaign: &'a Campaign, calibration: &'a Calibration, source: &'a CampaignSource, triads: &Triads<'a>, accuracy: &Accuracy
) {
    tool: &'a str = &source.tool,
    time: &'a str = &source.time,
    method: &'static str = calibration.options.method.name(),
    campaign: &'a str = &source.campaign,
    campaign_sha256: &'a str = &source.campaign_sha256,
    samples_sha256: &'a str = &source.samples_sha256,
    #[serde(flatten)]
    read: ReadRecord<'a> = ReadRecord::of(source),
    gravity_local: f64 = campaign.gravity_local,
    set_points: usize = calibration.set_points.len(),
    dwells: usize = calibration.dwells.len(),
    excluded: Vec<String> = calibration.options.exclude.iter().map(|&(s, n)| place(s, n)).collect(),
    /// Outlying dwells that were kept in the fit.
    outliers: Vec<String> = outliers(campaign, calibration),
    /// The bottom line in words, then its parts by axis.
    accuracy: String = accuracy.to_string(),
    bias_interval_ug0: Option<[f64; AXES]> = millionths(accuracy.bias),
    scale_factor_interval_ppm: Option<[f64; AXES]> = millionths(accuracy.scale_factor),
    residual_sd_g0: [f64; AXES] = [0, 1, 2].map(|axis| calibration.residual_sd(axis)),
    tilt_rad: Option<[f64; 2]> = calibration.solution.tilt,
    tilt_standard_error: Option<[f64; 2]> = calibration.solution.tilt_error,
    /// See [`Calibration::misalignment`].
    misalignment: [[f64; AXES]; AXES] = matrix_rows(&calibration.misalignment()),
    misalignment_standard_error: Option<[[f64; AXES]; AXES]> = misalignment_error(&triads.0),
    /// Names of the faults that were accepted; they are among the warnings.
    accepted: &'a [&'static str] = &calibration.accepted,
    warnings: Vec<String> = calibration.findings.iter().map(ToString::to_string).collect(),
    #[serde(flatten)]
    gyroscopes: Option<GyroscopeProvenance> = triads.1.as_ref()
        .and_then(|triad| Some(GyroscopeProvenance::new(campaign, calibration, triad.gyroscopes?, triad))),
    transients: Option<TransientsRecord<'a>> =
        calibration.transients.as_ref().map(|found| TransientsRecord::of(campaign, found, source)),
    curve: Vec<CurveRecord<'a>> = [Some(&triads.0), triads.1.as_ref()].into_iter().flatten()
        .flat_map(|triad| (0..9).map(move |index| CurveRecord::of(triad, index / 3, index % 3))).collect(),
    two_stage: Vec<SetPointRecord> = two_stage(calibration).collect(),
    #[serde(skip_serializing_if = "Vec::is_empty")]
    gyroscope_two_stage: Vec<GyroscopeSetPointRecord> =
        calibration.gyroscopes.iter().flat_map(|found| GyroscopeSetPointRecord::all(calibration, found)).collect(),
}}

view! { CurveRecord<'a>(triad: &CalibratedTriad<'a>, axis: usize, quantity: usize) {
    axis: &'static str = triad.names[axis],
    quantity: &'static str = QUANTITIES[quantity],
    unit: &'static str = triad.units.in_table(quantity),
    order: usize = triad.curves[axis][quantity].order(),
    reason: &'a str = &triad.orders[axis][quantity].choice.reason,
    r_squared: Option<f64> = triad.orders[axis][quantity].chosen().r_squared,
    leave_one_set_point_out_rms: Option<f64> =
        triad.orders[axis][quantity].chosen().leave_one_out_rms.map(|rms| rms * triad.units.factor(quantity)),
    leave_one_set_point_out_max: Option<f64> =
        triad.orders[axis][quantity].chosen().leave_one_out_max.map(|max| max * triad.units.factor(quantity)),
    degrees_of_freedom: usize = triad.curves[axis][quantity].freedom() as usize,
    #[serde(flatten)]
    errors: CurveErrorsRecord =
        CurveErrorsRecord::in_table(&triad.curves[axis][quantity], triad.units.factor(quantity)),
}}

view! {
/// A set point reduced by itself.
SetPointRecord(set_point_c: f64, axis: &'static str, reduced: &SensorReduction) {
    set_point_c: f64 = set_point_c,
    axis: &'static str = axis,
    head: f64 = reduced.temperature[0],
    board: f64 = reduced.temperature[1],
    bias_ug0: f64 = reduced.values[0] * 1e6,
    positive_scale_factor: f64 = reduced.values[1],
    negative_scale_factor: f64 = reduced.values[2],
    misalignment_rad: [f64; 2] = [reduced.values[3], reduced.values[4]],
}}

/// The accelerometers at each set point.
fn two_stage(calibration: &Calibration) -> impl Iterator<Item = SetPointRecord> {
    let set_points = calibration.set_points.iter().zip(&calibration.reduced);
    set_points.flat_map(|(set_point, reduced)| {
        AXIS_NAMES.iter().zip(reduced).map(|(axis, reduced)| SetPointRecord::of(set_point.set_point_c, axis, reduced))
    })
}

/// `-25/3 A1` for each outlying dwell.
fn outliers(campaign: &Campaign, calibration: &Calibration) -> Vec<String> {
    let outlier = |&(dwell, axis): &(usize, usize)| {
        let dwell = &calibration.dwells[dwell];
        format!("{} {}", place(dwell.set_point_c, campaign.positions[dwell.position].number), AXIS_NAMES[axis])
    };
    calibration.outliers.iter().map(outlier).collect()
}
