//! The provenance of recordings at one attitude: how the order was chosen, and what the curves leave, in m/s2 and
//! rad/s.

use super::source::{CampaignSource, ReadRecord};
use super::transients::TransientsRecord;
use crate::rest::{LeftOutPart, RowAccount};
use crate::screen::BadKind;
use crate::sensor::TriadUnits;
use crate::warm_up::{BiasCurve, Spread, TriedOrder, WarmUpCalibration};
use isotherm_campaign::Campaign;
use serde::Serialize;

#[derive(Serialize)]
struct File<'a> {
    provenance: Section<'a>,
}

#[derive(Serialize)]
struct Section<'a> {
    tool: &'a str,
    time: &'a str,
    method: &'static str,
    accuracy: String,
    not_known: Vec<String>,
    /// Hashes of some of the rows, see [`Marks`](isotherm_recording::Marks).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    rows: Vec<String>,
    #[serde(flatten)]
    read: ReadRecord<'a>,
    /// The table that gave everything but the bias curves.
    nominal_digest: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    gravity_local: Option<f64>,
    order: usize,
    order_given: bool,
    /// What was left out to try it, one at a time, and how many.
    left_out: &'static str,
    left_out_count: usize,
    reference_temperature: f64,
    accepted: &'a [&'static str],
    warnings: Vec<String>,
    recording: Vec<RowsRecord<'a>>,
    tried: Vec<TriedRecord>,
    curve: Vec<CurveRecord>,
    transients: TransientsRecord<'a>,
}

/// What was used of the rows of a recording.
#[derive(Serialize)]
struct RowsRecord<'a> {
    name: &'a str,
    rows: usize,
    /// Begin and end of what is used, since it began.
    used_s: &'a [[f64; 2]],
    #[serde(skip_serializing_if = "Vec::is_empty")]
    left_out: Vec<LeftOutRecord>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    bad_rows: Vec<BadRecord>,
}

#[derive(Serialize)]
struct LeftOutRecord {
    cause: &'static str,
    age_s: [f64; 2],
}

#[derive(Serialize)]
struct BadRecord {
    kind: &'static str,
    count: usize,
}

#[derive(Serialize)]
struct TriedRecord {
    order: usize,
    /// The highest term by bias, in standard errors.
    terms: Vec<f64>,
    /// What is left of sweeps left out by bias, in the unit of its curve.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    errors: Vec<f64>,
}

#[derive(Serialize)]
struct CurveRecord {
    axis: &'static str,
    unit: &'static str,
    /// Of the means of bins, about their mean.
    before_sd: f64,
    before_largest: f64,
    after_sd: f64,
    after_largest: f64,
    /// Largest half width of the 95 % interval that the noise gives.
    interval_95: f64,
    /// How far the curve is off at most if the element is 60 s behind its telemetry.
    behind_60_s: f64,
    /// Half of the largest difference of two sweeps, and the telemetry there.
    #[serde(skip_serializing_if = "Option::is_none")]
    band: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    band_at: Option<f64>,
}

/// The text of the section.
pub(super) fn section(
    campaign: &Campaign,
    calibration: &WarmUpCalibration,
    source: &CampaignSource,
) -> Result<String, toml::ser::Error> {
    let gravity = calibration.table().content().gravity;
    toml::to_string(&File {
        provenance: Section {
            tool: &source.tool,
            time: &source.time,
            method: "one-attitude",
            accuracy: calibration.accuracy(),
            not_known: calibration.not_known(),
            rows: source.marks(),
            read: source.read(),
            nominal_digest: calibration.ramps.curves.digest().to_string(),
            gravity_local: calibration.ramps.curves.gravity_local(),
            order: calibration.order.order,
            order_given: calibration.order.given,
            left_out: if calibration.order.sweeps_left_out > 0 { "sweeps" } else { "none" },
            left_out_count: calibration.order.sweeps_left_out,
            reference_temperature: calibration.at,
            accepted: &calibration.ramps.accepted,
            warnings: calibration.ramps.findings.iter().map(ToString::to_string).collect(),
            recording: calibration.rows.iter().map(rows).collect(),
            tried: calibration.order.tried.iter().map(|it| tried(it, &calibration.biases, gravity)).collect(),
            curve: calibration.biases.iter().map(|bias| curve(bias, gravity)).collect(),
            transients: TransientsRecord::of(campaign, &calibration.ramps.transients, source),
        },
    })
}

fn rows(account: &RowAccount) -> RowsRecord<'_> {
    let left_out = |part: &LeftOutPart| LeftOutRecord { cause: part.cause.words(), age_s: part.age_s };
    let bad = |(kind, count): (BadKind, usize)| BadRecord { kind: kind.name(), count };
    RowsRecord {
        name: &account.recording,
        rows: account.rows,
        used_s: &account.used_s,
        left_out: account.left_out.iter().map(left_out).collect(),
        bad_rows: account.bad.counts().into_iter().map(bad).collect(),
    }
}

fn tried(tried: &TriedOrder, biases: &[BiasCurve], gravity: f64) -> TriedRecord {
    let si = |(error, bias): (&f64, &BiasCurve)| TriadUnits::of(bias.kind).si(*error, gravity).0;
    let errors = tried.errors.iter().zip(biases).map(si).collect();
    TriedRecord { order: tried.order, terms: tried.terms.clone(), errors }
}

fn curve(bias: &BiasCurve, gravity: f64) -> CurveRecord {
    let units = TriadUnits::of(bias.kind);
    let si = |value: f64| units.si(value, gravity).0;
    let [before, after] = [bias.before, bias.after].map(|Spread { sd, largest }| [si(sd), si(largest)]);
    CurveRecord {
        axis: bias.name(),
        unit: units.si(0.0, gravity).1,
        before_sd: before[0],
        before_largest: before[1],
        after_sd: after[0],
        after_largest: after[1],
        interval_95: si(bias.interval),
        behind_60_s: si(bias.behind),
        band: bias.band.as_ref().map(|band| si(band.half_width)),
        band_at: bias.band.as_ref().map(|band| band.at),
    }
}
