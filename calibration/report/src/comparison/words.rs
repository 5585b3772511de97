//! Words and digits of a comparison.

use isotherm_analysis::{Comparison, Trend};
use isotherm_fit::TableFile;
use isotherm_statistics::f_limit;

/// Decimals of a figure in `unit`.
pub(super) fn places(unit: &str) -> usize {
    if unit == "deg/h" { 5 } else { 3 }
}

/// The dates' range of two, or the number of more.
pub(super) fn which(comparison: &Comparison) -> String {
    let [old, new] = [comparison.old_table(), comparison.new_table()].map(dated);
    match comparison.tables.len() {
        2 => format!("{new} less {old}"),
        count => format!("{count} tables; the newest, {new}, less the oldest, {old}"),
    }
}

/// `changed`, `not changed`, or that it is not known.
pub(super) const fn word(changed: Option<bool>) -> &'static str {
    match changed {
        Some(true) => "changed",
        Some(false) => "not changed",
        None => "not known",
    }
}

/// Half the width of the 95 % interval of a slope.
pub(super) fn slope_interval(trend: &Trend) -> f64 {
    f_limit(0.05, 1.0, trend.freedom as f64).sqrt() * trend.slope_error
}

/// The probability of such a slope where there is none.
pub(super) fn probability(trend: &Trend) -> String {
    trend.p.map_or_else(|| "-".to_owned(), |p| format!("{p:.2e}"))
}

/// A table's file with its date.
pub(super) fn dated(table: &TableFile) -> String {
    match &table.origin.time {
        Some(time) => format!("{} ({time})", table.name),
        None => table.name.clone(),
    }
}
