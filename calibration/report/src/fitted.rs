//! A calibration of any kind as text, as JSON and as HTML.

use crate::{calibration, gravity_only, json, one_attitude, ramps, text};
use isotherm_campaign::Campaign;
use isotherm_fit::{CampaignSource, Fitted};
use serde_json::Value;

/// What was found, in lines.
#[must_use]
pub fn text(fitted: &Fitted) -> String {
    match fitted {
        Fitted::Campaign(found) => text::calibration(found),
        Fitted::Ramps(found) => text::ramps(found),
        Fitted::OneAttitude(found) => one_attitude::text(found),
        Fitted::GravityOnly(found) => gravity_only::text(found),
    }
}

/// What was found, as JSON. `locate` gives file and line of a row.
#[must_use]
pub fn json(fitted: &Fitted, locate: impl Fn(u64) -> String) -> Value {
    match fitted {
        Fitted::Campaign(found) => json::calibration(found, locate),
        Fitted::Ramps(found) => json::ramps(found, locate),
        Fitted::OneAttitude(found) => one_attitude::json(found, locate),
        Fitted::GravityOnly(found) => gravity_only::json(found, locate),
    }
}

/// The report as HTML.
#[must_use]
pub fn html(campaign: &Campaign, fitted: &Fitted, source: &CampaignSource, locate: &dyn Fn(u64) -> String) -> String {
    match fitted {
        Fitted::Campaign(found) => calibration::html(campaign, found, source, locate),
        Fitted::Ramps(found) => ramps::html(campaign, found, source),
        Fitted::OneAttitude(found) => one_attitude::html(campaign, found, source),
        Fitted::GravityOnly(found) => gravity_only::html(campaign, found, source),
    }
}
