//! What `calibrate` prints about a fit.

use crate::commands::common::JsonOption;
use crate::messages::{print_text, tell_findings};
use crate::progress::spinner;
use isotherm_campaign::Campaign;
use isotherm_pipeline::{CampaignFile, Inputs, JobFailure, JobOutcome};
use serde_json::Value;
use std::fmt::Write as _;
use tracing::info;

/// Makes the table of what was read. A refusal has the names of all faults that must be accepted, if the user accepts
/// some already.
pub(super) fn fit(
    inputs: Inputs,
    (campaign, file): (&Campaign, Option<&CampaignFile>),
    accepted: &[&'static str],
) -> Result<JobOutcome, JobFailure> {
    let spinner = spinner("fitting");
    let outcome = inputs.fit(campaign, file);
    spinner.finish_and_clear();
    outcome.map_err(|refusal| with_names(refusal, accepted))
}

/// Adds which faults must be accepted too, if the user accepts some and others are left.
fn with_names(mut refusal: JobFailure, accepted: &[&'static str]) -> JobFailure {
    let left = refusal.fit.as_ref().map(|fit| fit.0.acceptable()).unwrap_or_default();
    if !accepted.is_empty() && !left.is_empty() {
        let all: Vec<_> = accepted.iter().copied().chain(left).collect();
        let message = &mut refusal.failure.message;
        let _ = write!(
            message,
            "\nthese faults must be accepted too, for a table in spite of all: --accept {}",
            all.join(",")
        );
        refusal.document["error"] = Value::from(message.as_str());
    }
    refusal
}

/// Prints findings, notes and text.
pub(super) fn tell_outcome(outcome: &JobOutcome, json: JsonOption) {
    tell_findings(outcome.findings());
    outcome.notes.iter().for_each(|note| info!("{note}"));
    if !json.is_given() {
        print_text(&outcome.text());
    }
}
