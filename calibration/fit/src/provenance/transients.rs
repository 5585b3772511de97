//! The provenance of ramps: what was decided about lag and transients, and why. Transients and prediction errors are in
//! the bias's unit.

use super::document::view;
use super::source::{CampaignSource, ReadRecord};
use crate::ramps::RampCalibration;
use crate::sensor::TriadUnits;
use crate::transients::{BiasTransient, Condition, Prediction, Transients};
use isotherm_campaign::{Campaign, Ramp};
use isotherm_statistics::band;

view! {
/// The section of a table of only ramps.
pub(super) RampsProvenance<'a>(campaign: &'a Campaign, calibration: &'a RampCalibration, source: &'a CampaignSource) {
    tool: &'a str = &source.tool,
    time: &'a str = &source.time,
    method: &'static str = "ramps",
    accuracy: String = calibration.accuracy(),
    not_known: Vec<String> = calibration.not_known(),
    campaign: &'a str = &source.campaign,
    campaign_sha256: &'a str = &source.campaign_sha256,
    #[serde(flatten)]
    read: ReadRecord<'a> = ReadRecord::of(source),
    /// The table that gave what is not known.
    curves: &'a str = campaign.curves.as_deref().unwrap_or_default(),
    curves_digest: String = calibration.curves.digest().to_string(),
    gravity_local: f64 = campaign.gravity_local,
    accepted: &'a [&'static str] = &calibration.accepted,
    warnings: Vec<String> = calibration.findings.iter().map(ToString::to_string).collect(),
    transients: TransientsRecord<'a> = TransientsRecord::of(campaign, &calibration.transients, source),
}}

view! {
/// What the ramps show.
pub(super) TransientsRecord<'a>(campaign: &'a Campaign, found: &'a Transients, source: &'a CampaignSource) {
    verdict: &'static str = found.verdict.name(),
    words: &'a [String] = &found.words,
    time_constant_s: f64 = found.time_constant.value_s,
    interval_s: Option<[f64; 2]> =
        Some(found.time_constant.interval_s).filter(|interval| interval.iter().all(|end| end.is_finite())),
    /// Whether the user gave the time constant, or that of the table in force was kept.
    given: bool = found.time_constant.given,
    kept: bool = found.time_constant.kept,
    /// Names of the conditions of the time constant that are not met.
    not_met: Vec<&'static str> = not_met(&found.conditions),
    ramp: Vec<RampRecord<'a>> =
        campaign.ramps.iter().zip(&source.recordings_sha256).map(|(ramp, sha256)| RampRecord::of(ramp, sha256)).collect(),
    bias: Vec<BiasRecord> =
        found.biases.iter().map(|bias| BiasRecord::of(bias, TriadUnits::of(bias.kind), bias.prediction)).collect(),
}}

view! { RampRecord<'a>(ramp: &'a Ramp, sha256: &'a str) {
    samples: &'a str = &ramp.samples,
    sha256: &'a str = sha256,
}}

view! { BiasRecord(bias: &BiasTransient, units: &TriadUnits, prediction: Option<Prediction>) {
    axis: &'static str = bias.name(),
    unit: &'static str = units.bias,
    /// What is written, then the estimate with its error, per unit of temperature.
    transient: f64 = bias.transient * units.bias_factor,
    estimate: f64 = bias.estimate * units.bias_factor,
    standard_error: Option<f64> = in_unit(units, Some(bias.standard_error)),
    /// Rms of the sweeps left out.
    left_out_static: Option<f64> = in_unit(units, prediction.map(|it| it.static_curve)),
    left_out_hysteresis: Option<f64> = in_unit(units, prediction.map(|it| it.hysteresis)),
    left_out_lag_and_hysteresis: Option<f64> = in_unit(units, prediction.map(|it| it.lag_and_hysteresis)),
    left_out_written: Option<f64> = in_unit(units, prediction.map(|it| it.written)),
    band_without: Option<f64> = in_unit(units, band(&bias.before)),
    band_with: Option<f64> = in_unit(units, band(&bias.after)),
    /// Error of the curve: half of the largest difference of two sweeps, and the temperature there.
    curve_error: Option<f64> = in_unit(units, bias.curve_error.as_ref().map(|band| band.half_width)),
    curve_error_at: Option<f64> = bias.curve_error.as_ref().map(|band| band.at),
    carried_g0: f64 = bias.carried_g0,
    not_met: Vec<&'static str> = not_met(&bias.conditions),
}}

/// A figure of a bias in the unit of a table, where it is a number.
fn in_unit(units: &TriadUnits, value: Option<f64>) -> Option<f64> {
    value.filter(|value| value.is_finite()).map(|value| value * units.bias_factor)
}

/// Names of the conditions that are not met.
fn not_met(conditions: &[Condition]) -> Vec<&'static str> {
    conditions.iter().filter(|condition| !condition.met).map(|condition| condition.name).collect()
}
