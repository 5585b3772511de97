//! Findings as JSON.

use isotherm_support::finding::Finding;
use serde_json::{Value, json};

/// The findings as JSON documents have them. `locate` gives file and line of a row.
pub fn findings<'a>(all: impl IntoIterator<Item = &'a Finding>, locate: impl Fn(u64) -> String) -> Value {
    all.into_iter().map(|finding| json!(finding.record(&locate))).collect()
}

/// The findings of tables or of a whole recording, as views have them.
pub(crate) fn records(all: &[Finding]) -> Value {
    findings(all, |line| line.to_string())
}
