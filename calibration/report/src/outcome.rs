//! A calibration of any kind as text, as JSON and as HTML.

use crate::{calibration, json, ramps, text, tumble, warm_up};
use isotherm_campaign::Campaign;
use isotherm_fit::{CalibrationOutcome, CampaignSource};
use serde_json::Value;

/// What was found, in lines.
#[must_use]
pub fn text(fitted: &CalibrationOutcome) -> String {
    match fitted {
        CalibrationOutcome::Campaign(found) => text::calibration(found),
        CalibrationOutcome::Ramps(found) => text::ramps(found),
        CalibrationOutcome::WarmUp(found) => warm_up::text(found),
        CalibrationOutcome::Tumble(found) => tumble::text(found),
    }
}

/// What was found, as JSON. `locate` gives file and line of a row.
#[must_use]
pub fn json(fitted: &CalibrationOutcome, locate: impl Fn(u64) -> String) -> Value {
    match fitted {
        CalibrationOutcome::Campaign(found) => json::calibration(found, locate),
        CalibrationOutcome::Ramps(found) => json::ramps(found, locate),
        CalibrationOutcome::WarmUp(found) => warm_up::json(found, locate),
        CalibrationOutcome::Tumble(found) => tumble::json(found, locate),
    }
}

/// The report as HTML.
#[must_use]
pub fn html(
    campaign: &Campaign,
    fitted: &CalibrationOutcome,
    source: &CampaignSource,
    locate: &dyn Fn(u64) -> String,
) -> String {
    match fitted {
        CalibrationOutcome::Campaign(found) => calibration::html(campaign, found, source, locate),
        CalibrationOutcome::Ramps(found) => ramps::html(campaign, found, source),
        CalibrationOutcome::WarmUp(found) => warm_up::html(campaign, found, source),
        CalibrationOutcome::Tumble(found) => tumble::html(campaign, found, source),
    }
}
