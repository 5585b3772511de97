//! The provenance of recordings at one attitude: how the order was chosen, and what the curves leave, in m/s2 and
//! rad/s.

use super::document::view;
use super::source::{CampaignSource, ReadRecord};
use super::transients::TransientsRecord;
use crate::rest::{LeftOutPart, RowAccount};
use crate::screen::BadKind;
use crate::sensor::TriadUnits;
use crate::warm_up::{BiasCurve, TriedOrder, WarmUpCalibration};
use isotherm_campaign::Campaign;

view! { pub(super) WarmUpProvenance<'a>(
    campaign: &'a Campaign, calibration: &'a WarmUpCalibration, source: &'a CampaignSource
) {
    tool: &'a str = &source.tool,
    time: &'a str = &source.time,
    method: &'static str = "one-attitude",
    accuracy: String = calibration.accuracy(),
    not_known: Vec<String> = calibration.not_known(),
    #[serde(flatten)]
    read: ReadRecord<'a> = ReadRecord::of(source),
    /// The table that gave everything but the bias curves.
    nominal_digest: String = calibration.ramps.curves.digest().to_string(),
    gravity_local: Option<f64> = calibration.ramps.curves.gravity_local(),
    order: usize = calibration.order.order,
    order_given: bool = calibration.order.given,
    /// What was left out to try it, one at a time, and how many.
    left_out: &'static str = if calibration.order.sweeps_left_out > 0 { "sweeps" } else { "none" },
    left_out_count: usize = calibration.order.sweeps_left_out,
    reference_temperature: f64 = calibration.at,
    accepted: &'a [&'static str] = &calibration.ramps.accepted,
    warnings: Vec<String> = calibration.ramps.findings.iter().map(ToString::to_string).collect(),
    recording: Vec<RowsRecord<'a>> = calibration.rows.iter().map(RowsRecord::of).collect(),
    tried: Vec<TriedRecord> = calibration.order.tried.iter().map(|tried| TriedRecord::of(tried, calibration)).collect(),
    curve: Vec<CurveRecord> = calibration.biases.iter().map(|bias| CurveRecord::new(bias, calibration.gravity())).collect(),
    transients: TransientsRecord<'a> = TransientsRecord::of(campaign, &calibration.ramps.transients, source),
}}

view! {
/// What was used of the rows of a recording.
RowsRecord<'a>(account: &'a RowAccount) {
    name: &'a str = &account.recording,
    rows: usize = account.rows,
    /// Begin and end of what is used, since it began.
    used_s: &'a [[f64; 2]] = &account.used_s,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    left_out: Vec<LeftOutRecord> = account.left_out.iter().map(LeftOutRecord::of).collect(),
    #[serde(skip_serializing_if = "Vec::is_empty")]
    bad_rows: Vec<BadRecord> = account.bad.counts().into_iter().map(|(kind, count)| BadRecord::of(kind, count)).collect(),
}}

view! { LeftOutRecord(part: &LeftOutPart) {
    cause: &'static str = part.cause.words(),
    age_s: [f64; 2] = part.age_s,
}}

view! { BadRecord(kind: BadKind, count: usize) {
    kind: &'static str = kind.name(),
    count: usize = count,
}}

view! { TriedRecord(tried: &TriedOrder, calibration: &WarmUpCalibration) {
    order: usize = tried.order,
    /// The highest term by bias, in standard errors.
    terms: Vec<f64> = tried.terms.clone(),
    /// What is left of sweeps left out by bias, in the unit of its curve.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    errors: Vec<f64> = calibration.errors_of(tried),
}}

impl CurveRecord {
    fn new(bias: &BiasCurve, gravity: f64) -> Self {
        let units = TriadUnits::of(bias.kind);
        Self::of(bias, units.si(0.0, gravity).1, &|value| units.si(value, gravity).0)
    }
}

view! { CurveRecord(bias: &BiasCurve, unit: &'static str, si: &dyn Fn(f64) -> f64) {
    axis: &'static str = bias.name(),
    unit: &'static str = unit,
    /// Of the means of bins, about their mean.
    before_sd: f64 = si(bias.before.sd),
    before_largest: f64 = si(bias.before.largest),
    after_sd: f64 = si(bias.after.sd),
    after_largest: f64 = si(bias.after.largest),
    /// Largest half width of the 95 % interval that the noise gives.
    interval_95: f64 = si(bias.interval),
    /// How far the curve is off at most if the element is 60 s behind its temperature.
    behind_60_s: f64 = si(bias.behind),
    /// Half of the largest difference of two sweeps, and the temperature there.
    band: Option<f64> = bias.band.as_ref().map(|band| si(band.half_width)),
    band_at: Option<f64> = bias.band.as_ref().map(|band| band.at),
}}
