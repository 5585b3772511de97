//! Rows of another device than a table's.

use isotherm_shared::table::CoefficientTable;
use isotherm_support::finding::{Finding, name};

/// The finding that `rows` of a recording are of another device than `table`.
#[must_use]
pub fn other_device(table: &CoefficientTable, rows: u64) -> Finding {
    let serial = table.content().serial.as_deref().unwrap_or_default().trim();
    let message =
        format!("{rows} samples are of another device than the table's, which has the serial number {serial:?}");
    Finding::warning(name::OTHER_DEVICE, message)
}
