//! The provenance of a tumble.

use super::document::{CurveErrorsRecord, matrix_rows, view};
use super::source::{CampaignSource, ReadRecord};
use crate::tumble::TumbleCalibration;
use isotherm_campaign::Campaign;
use isotherm_shared::table::{AXIS_NAMES, GRAVITY_ONLY};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{Curve, QUANTITIES};

view! { pub(super) TumbleProvenance<'a>(
    campaign: &Campaign, calibration: &'a TumbleCalibration, source: &'a CampaignSource
) {
    tool: &'a str = &source.tool,
    time: &'a str = &source.time,
    method: &'static str = GRAVITY_ONLY,
    /// Empty where the facts were given as options.
    campaign: &'a str = &source.campaign,
    campaign_sha256: &'a str = &source.campaign_sha256,
    recordings_sha256: &'a [String] = &source.recordings_sha256,
    #[serde(flatten)]
    read: ReadRecord<'a> = ReadRecord::of(source),
    gravity_local: f64 = campaign.gravity_local,
    /// `stated` or `normal`.
    gravity_source: &'static str = campaign.gravity_source.name(),
    /// Half width of its 95 % interval [m/s2]; only of normal gravity.
    gravity_half_width: Option<f64> =
        Some(campaign.gravity_source.half_width() * campaign.gravity_local).filter(|half| *half > 0.0),
    latitude_deg: Option<f64> = campaign.latitude_deg,
    height_m: Option<f64> = campaign.height_m,
    standstills: usize = calibration.readings.len(),
    /// Numbers of the static poses that were left out.
    excluded: &'a [usize] = &calibration.options.exclude,
    temperatures: usize = calibration.groups.levels,
    order_reason: &'a str = &calibration.reasons[0],
    scale_factor_reason: &'a str = &calibration.reasons[1],
    residual_rms_g0: f64 = calibration.residual_rms(),
    /// D sqrt(n), see `Dilution`.
    dilution_sqrt_n: f64 = calibration.dilution.times_root_n,
    degrees_of_freedom: usize = calibration.freedom,
    /// M, with 1 on the diagonal and 0 below it: the rotation of the output is not observable.
    misalignment: [[f64; AXES]; AXES] = matrix_rows(&calibration.misalignment),
    misalignment_standard_error: Option<[[f64; AXES]; AXES]> = calibration.misalignment_error
        .map(|[m12, m13, m23]| [[0.0, m12, m13], [0.0, 0.0, m23], [0.0; AXES]]),
    /// Names of the faults that were accepted; they are among the warnings.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    accepted: &'a [&'static str] = &calibration.accepted,
    warnings: Vec<String> = calibration.findings.iter().map(ToString::to_string).collect(),
    curve: Vec<CurveRecord> = (0..9).map(|index| CurveRecord::new(calibration, index / 3, index % 3)).collect(),
}}

impl CurveRecord {
    fn new(calibration: &TumbleCalibration, axis: usize, quantity: usize) -> Self {
        let unit = if quantity == 0 { (1e6, "ug0") } else { (1.0, "pulse/(s*g0)") };
        Self::of(&calibration.curves[axis][quantity], [AXIS_NAMES[axis], QUANTITIES[quantity]], unit)
    }
}

view! { CurveRecord(curve: &Curve, names: [&'static str; 2], unit: (f64, &'static str)) {
    axis: &'static str = names[0],
    quantity: &'static str = names[1],
    unit: &'static str = unit.1,
    order: usize = curve.order(),
    /// The least over the measured temperature.
    degrees_of_freedom: Option<f64> = curve.table_covariance().map(|_| (curve.freedom() * 100.0).round() / 100.0),
    /// Temperature that was measured: the errors are known in it.
    measured: Option<[f64; 2]> = curve.table_covariance().map(|_| curve.measured()),
    #[serde(flatten)]
    errors: CurveErrorsRecord = CurveErrorsRecord::in_table(curve, unit.0),
    /// What the slope that a constant lacks adds to its 95 % interval, per unit of temperature off `slope_about`.
    slope_error: Option<f64> = curve.slope_error().map(|slope| slope.per_unit * unit.0),
    slope_about: Option<f64> = curve.slope_error().map(|slope| slope.about),
}}
