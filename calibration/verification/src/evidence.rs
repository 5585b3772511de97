//! What a recording that the table was made from is worth.

use isotherm_support::finding::{Finding, name};

/// Of a run or static poses that the table was made from.
pub const OWN_RECORDING: &str = "this recording made the table: no evidence";

/// The same as a finding.
#[must_use]
pub fn own_recording(made_the_table: bool) -> Option<Finding> {
    made_the_table
        .then(|| Finding::warning(name::OWN_RECORDING, format!("{OWN_RECORDING}; verify with a recording of its own")))
}
