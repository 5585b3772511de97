//! The `[provenance]` section of a table without a turntable.

use super::result::TumbleCalibration;
use crate::accuracy::largest_interval;
use crate::provenance::{CampaignSource, ReadRecord, matrix_rows, sealed};
use isotherm_campaign::Campaign;
use isotherm_shared::table::{AXIS_NAMES, GRAVITY_ONLY};
use isotherm_statistics::{QUANTITIES, root};
use serde::Serialize;

#[derive(Serialize)]
struct ProvenanceFile<'a> {
    provenance: TumbleProvenance<'a>,
}

#[derive(Serialize)]
struct TumbleProvenance<'a> {
    tool: &'a str,
    time: &'a str,
    method: &'static str,
    /// Empty where the facts were given as options.
    campaign: &'a str,
    campaign_sha256: &'a str,
    recordings_sha256: &'a [String],
    /// Hashes of some of the rows, see [`Marks`](isotherm_recording::Marks).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    rows: Vec<String>,
    #[serde(flatten)]
    read: ReadRecord<'a>,
    gravity_local: f64,
    /// `stated` or `normal`.
    gravity_source: &'static str,
    /// Half width of its 95 % interval [m/s2]; only of normal gravity.
    #[serde(skip_serializing_if = "Option::is_none")]
    gravity_half_width: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    latitude_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    height_m: Option<f64>,
    standstills: usize,
    /// Numbers of the standstills that were left out.
    excluded: &'a [usize],
    temperatures: usize,
    order_reason: &'a str,
    scale_factor_reason: &'a str,
    residual_rms_g0: f64,
    /// D sqrt(n), see [`Dilution`](super::dilution::Dilution).
    dilution_sqrt_n: f64,
    degrees_of_freedom: usize,
    /// M, with 1 on the diagonal and 0 below it: the rotation of the output is not observable.
    misalignment: [[f64; 3]; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    misalignment_standard_error: Option<[[f64; 3]; 3]>,
    /// Names of the faults that were accepted; they are among the warnings.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    accepted: &'a [&'static str],
    warnings: Vec<String>,
    curve: Vec<CurveRecord>,
}

#[derive(Serialize)]
struct CurveRecord {
    axis: &'static str,
    quantity: &'static str,
    unit: &'static str,
    order: usize,
    /// The least over the measured telemetry.
    #[serde(skip_serializing_if = "Option::is_none")]
    degrees_of_freedom: Option<f64>,
    /// Telemetry that was measured: the errors are known in it.
    #[serde(skip_serializing_if = "Option::is_none")]
    measured: Option<[f64; 2]>,
    /// Largest half width of the curve's 95 % interval over its range, in its unit.
    #[serde(skip_serializing_if = "Option::is_none")]
    largest_interval: Option<f64>,
    /// Standard errors of the coefficients in the table, in their unit.
    #[serde(skip_serializing_if = "Option::is_none")]
    standard_errors: Option<Vec<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    covariance: Option<Vec<Vec<f64>>>,
    /// What the slope that a constant lacks adds to its 95 % interval, per unit of telemetry off `slope_about`.
    #[serde(skip_serializing_if = "Option::is_none")]
    slope_error: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    slope_about: Option<f64>,
}

/// The text of the table file of an IMU that was put down by hand.
pub(crate) fn sealed_tumble_table(
    campaign: &Campaign,
    calibration: &TumbleCalibration,
    source: &CampaignSource,
) -> Result<String, String> {
    let document = ProvenanceFile {
        provenance: TumbleProvenance {
            tool: &source.tool,
            time: &source.time,
            method: GRAVITY_ONLY,
            campaign: &source.campaign,
            campaign_sha256: &source.campaign_sha256,
            recordings_sha256: &source.recordings_sha256,
            rows: source.marks(),
            read: source.read(),
            gravity_local: campaign.gravity_local,
            gravity_source: campaign.gravity_source.name(),
            gravity_half_width: half_width(campaign),
            latitude_deg: campaign.latitude_deg,
            height_m: campaign.height_m,
            standstills: calibration.readings.len(),
            excluded: &calibration.options.exclude,
            temperatures: calibration.groups.levels,
            order_reason: &calibration.reasons[0],
            scale_factor_reason: &calibration.reasons[1],
            residual_rms_g0: calibration.residual_rms(),
            dilution_sqrt_n: calibration.dilution.times_root_n,
            degrees_of_freedom: calibration.freedom,
            misalignment: matrix_rows(&calibration.misalignment),
            misalignment_standard_error: calibration
                .misalignment_error
                .map(|[m12, m13, m23]| [[0.0, m12, m13], [0.0, 0.0, m23], [0.0, 0.0, 0.0]]),
            accepted: &calibration.accepted,
            warnings: calibration.findings.iter().map(ToString::to_string).collect(),
            curve: (0..9).map(|index| curve(calibration, index / 3, index % 3)).collect(),
        },
    };
    sealed(campaign, &calibration.table, toml::to_string(&document))
}

fn half_width(campaign: &Campaign) -> Option<f64> {
    let half = campaign.gravity_source.half_width() * campaign.gravity_local;
    (half > 0.0).then_some(half)
}

fn curve(calibration: &TumbleCalibration, axis: usize, quantity: usize) -> CurveRecord {
    let curve = &calibration.curves[axis][quantity];
    let (factor, unit) = if quantity == 0 { (1e6, "ug0") } else { (1.0, "pulse/(s*g0)") };
    let covariance = curve.table_covariance().map(|covariance| covariance * (factor * factor));
    CurveRecord {
        axis: AXIS_NAMES[axis],
        quantity: QUANTITIES[quantity],
        unit,
        order: curve.order(),
        degrees_of_freedom: covariance.as_ref().map(|_| (curve.freedom() * 100.0).round() / 100.0),
        measured: covariance.as_ref().map(|_| curve.measured()),
        largest_interval: largest_interval(curve, false).map(|half| half * factor),
        slope_error: curve.slope_error().map(|slope| slope.per_unit * factor),
        slope_about: curve.slope_error().map(|slope| slope.about),
        standard_errors: covariance.as_ref().map(|c| c.diagonal().iter().map(|v| root(*v)).collect()),
        covariance: covariance.map(|c| c.row_iter().map(|row| row.iter().copied().collect()).collect()),
    }
}
