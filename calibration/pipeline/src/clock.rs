//! The clock of the machine, which only this crate reads for tables and reports.

use std::time::SystemTime;

/// The current time to the second, RFC 3339 in UTC, for the provenance of a table or a report.
#[must_use]
pub fn now() -> String {
    humantime::format_rfc3339_seconds(SystemTime::now()).to_string()
}
