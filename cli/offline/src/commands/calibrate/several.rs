//! A table for each of several IMUs. One whose rows give no table is dropped with its reason, and the others go on.

use super::outcome::tell_outcome;
use crate::commands::common::JsonOption;
use crate::messages::print_text;
use isotherm_campaign::Campaign;
use isotherm_pipeline::{JobFailure, JobOutcome};
use isotherm_shared::names::ImuId;
use isotherm_support::failure::{Exit, Failure, shown};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use tracing::info;

/// One of several IMUs, and its table or why it has none.
pub(super) struct TableMember {
    pub imu: ImuId,
    /// Where its table goes.
    pub table: PathBuf,
    pub result: Result<(Campaign, JobOutcome), JobFailure>,
}

impl TableMember {
    /// Prints what was found.
    pub(super) fn tell(&self, json: JsonOption) {
        if !json.is_given() {
            print_text(&format!("{}:\n", self.imu));
        }
        match &self.result {
            Ok((_, outcome)) => tell_outcome(outcome, json),
            Err(refusal) => info!("{} is dropped: {}", self.imu, refusal.failure.message),
        }
    }

    /// What was found, for the document.
    pub(super) fn json(&self) -> Value {
        let imu = self.imu.as_str();
        match &self.result {
            Ok((_, outcome)) => {
                json!({ "imu": imu, "table": self.table.display().to_string(), "calibration": outcome.json() })
            }
            Err(refusal) => json!({ "imu": imu, "dropped": refusal.document }),
        }
    }
}

/// Which IMUs of a file were dropped.
///
/// # Errors
/// With their names, if there are any.
pub(super) fn check_dropped(path: &Path, members: &[TableMember]) -> Result<(), Failure> {
    let dropped: Vec<_> =
        members.iter().filter(|member| member.result.is_err()).map(|member| member.imu.as_str()).collect();
    if dropped.is_empty() {
        return Ok(());
    }
    let (path, all, names) = (shown(path), members.len(), dropped.join(", "));
    let message = format!("{path}: {} of {all} IMUs dropped, the reasons are above: {names}", dropped.len());
    Err(Failure::new(Exit::Failed, message))
}
