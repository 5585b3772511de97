//! The provenance of ramps: what was decided about lag and transients, and why. Transients and prediction errors are in
//! the bias's unit.

use super::source::{CampaignSource, ReadRecord};
use crate::ramps::RampCalibration;
use crate::sensor::TriadUnits;
use crate::transients::{BiasTransient, Condition, Transients};
use isotherm_campaign::Campaign;
use isotherm_statistics::band;
use serde::Serialize;

#[derive(Serialize)]
struct RampsFile<'a> {
    provenance: RampsProvenance<'a>,
}

/// The section of a table of ramps alone.
#[derive(Serialize)]
struct RampsProvenance<'a> {
    tool: &'a str,
    time: &'a str,
    method: &'static str,
    accuracy: String,
    not_known: Vec<String>,
    campaign: &'a str,
    campaign_sha256: &'a str,
    /// Hashes of some of the rows, see [`Marks`](isotherm_recording::Marks).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    rows: Vec<String>,
    #[serde(flatten)]
    read: ReadRecord<'a>,
    /// The table that gave what is not known.
    curves: &'a str,
    curves_digest: String,
    gravity_local: f64,
    accepted: &'a [&'static str],
    warnings: Vec<String>,
    transients: TransientsRecord<'a>,
}

/// What the ramps show.
#[derive(Serialize)]
pub(super) struct TransientsRecord<'a> {
    verdict: &'static str,
    words: &'a [String],
    time_constant_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    interval_s: Option<[f64; 2]>,
    /// Whether the user gave the time constant, or that of the table in force was kept.
    given: bool,
    kept: bool,
    /// Names of the conditions of the time constant that are not met.
    not_met: Vec<&'static str>,
    ramp: Vec<RampRecord<'a>>,
    bias: Vec<BiasRecord>,
}

#[derive(Serialize)]
struct RampRecord<'a> {
    samples: &'a str,
    sha256: &'a str,
}

#[derive(Serialize)]
struct BiasRecord {
    axis: &'static str,
    unit: &'static str,
    /// What is written, then the estimate with its error, per unit of telemetry.
    transient: f64,
    estimate: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    standard_error: Option<f64>,
    /// Rms of the sweeps left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    left_out_static: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    left_out_hysteresis: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    left_out_lag_and_hysteresis: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    left_out_written: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    band_without: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    band_with: Option<f64>,
    /// Error of the curve: half of the largest difference of two sweeps, and the telemetry there.
    #[serde(skip_serializing_if = "Option::is_none")]
    curve_error: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    curve_error_at: Option<f64>,
    carried_g0: f64,
    not_met: Vec<&'static str>,
}

/// The text of the section of a table of ramps alone.
pub(super) fn of_ramps(
    campaign: &Campaign,
    calibration: &RampCalibration,
    source: &CampaignSource,
) -> Result<String, toml::ser::Error> {
    toml::to_string(&RampsFile {
        provenance: RampsProvenance {
            tool: &source.tool,
            time: &source.time,
            method: "ramps",
            accuracy: calibration.accuracy(),
            not_known: calibration.not_known(),
            campaign: &source.campaign,
            campaign_sha256: &source.campaign_sha256,
            rows: source.marks(),
            read: source.read(),
            curves: campaign.curves.as_deref().unwrap_or_default(),
            curves_digest: calibration.curves.digest().to_string(),
            gravity_local: campaign.gravity_local,
            accepted: &calibration.accepted,
            warnings: calibration.findings.iter().map(ToString::to_string).collect(),
            transients: TransientsRecord::of(campaign, &calibration.transients, source),
        },
    })
}

impl<'a> TransientsRecord<'a> {
    pub(super) fn of(campaign: &'a Campaign, found: &'a Transients, source: &'a CampaignSource) -> Self {
        let tau = &found.time_constant;
        let ramps = campaign.ramps.iter().zip(&source.recordings_sha256);
        Self {
            verdict: found.verdict.name(),
            words: &found.words,
            time_constant_s: tau.value_s,
            interval_s: Some(tau.interval_s).filter(|interval| interval.iter().all(|end| end.is_finite())),
            given: tau.given,
            kept: tau.kept,
            not_met: not_met(&found.conditions),
            ramp: ramps.map(|(ramp, sha256)| RampRecord { samples: &ramp.samples, sha256 }).collect(),
            bias: found.biases.iter().map(bias).collect(),
        }
    }
}

fn bias(bias: &BiasTransient) -> BiasRecord {
    let units = TriadUnits::of(bias.kind);
    let known = |value: Option<f64>| value.filter(|value| value.is_finite()).map(|value| value * units.bias_factor);
    let prediction = bias.prediction;
    BiasRecord {
        axis: bias.name(),
        unit: units.bias,
        transient: bias.transient * units.bias_factor,
        estimate: bias.estimate * units.bias_factor,
        standard_error: known(Some(bias.standard_error)),
        left_out_static: known(prediction.map(|it| it.static_curve)),
        left_out_hysteresis: known(prediction.map(|it| it.hysteresis)),
        left_out_lag_and_hysteresis: known(prediction.map(|it| it.lag_and_hysteresis)),
        left_out_written: known(prediction.map(|it| it.written)),
        band_without: known(band(&bias.before)),
        band_with: known(band(&bias.after)),
        curve_error: known(bias.curve_error.as_ref().map(|band| band.half_width)),
        curve_error_at: bias.curve_error.as_ref().map(|band| band.at),
        carried_g0: bias.carried_g0,
        not_met: not_met(&bias.conditions),
    }
}

/// Names of the conditions that are not met.
fn not_met(conditions: &[Condition]) -> Vec<&'static str> {
    conditions.iter().filter(|condition| !condition.met).map(|condition| condition.name).collect()
}
