//! A comparison in lines.

use super::words::{places, slope_interval, which, word};
use isotherm_analysis::{Comparison, ComparisonRequirement, NOT_IN_THE_ERRORS};
use std::fmt::Write as _;

/// The lines that `compare` prints: differences, changes, lines over the dates, what is required, and notes.
#[must_use]
pub fn text(comparison: &Comparison, required: Option<&ComparisonRequirement>) -> String {
    let content = comparison.new_table().table.content();
    let mut text = format!(
        "{}: {}\n\n  curve                              mean    largest         at  standard error   at least    at most\n",
        content.imu,
        which(comparison)
    );
    // Writing to a String cannot fail.
    for curve in &comparison.curves {
        let places = places(curve.unit);
        let (largest, at) = curve.largest();
        let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.places$}"));
        let _ = writeln!(
            text,
            "  {:<24} {:>5} {:>9.places$} {largest:>10.places$} {at:>10.4} {:>15} {:>10} {:>10}  {}",
            curve.name(),
            curve.unit,
            curve.mean(),
            number(curve.standard_error()),
            number(curve.lower()),
            number(curve.upper()),
            word(curve.is_changed()),
        );
    }
    for alignment in &comparison.alignments {
        let within = match (alignment.lower_urad(), alignment.upper_urad()) {
            (Some(lower), Some(upper)) => format!(", with its band {lower:.3} to {upper:.3}"),
            _ => String::new(),
        };
        let _ = writeln!(
            text,
            "  alignment of the {}: largest difference {:.3} [1e-6 rad]{within}: {}",
            alignment.name(),
            alignment.largest_urad(),
            word(alignment.is_changed())
        );
    }
    if !comparison.trends.is_empty() {
        text += "\n  over the dates, at mid range          slope   95 % interval          p\n";
    }
    for trend in &comparison.trends {
        let places = places(trend.unit);
        let p = trend.p.map_or_else(|| "-".to_owned(), |p| format!("{p:.2e}"));
        let unit = format!("{}/year", trend.unit);
        let interval = slope_interval(trend);
        let _ = writeln!(
            text,
            "  {:<24} {unit:>10} {:>8.places$} {interval:>15.places$} {p:>10}",
            trend.name(),
            trend.slope
        );
    }
    let _ = writeln!(text, "\n{}", comparison.conclusion());
    for finding in &comparison.findings {
        let _ = writeln!(text, "{finding}");
    }
    for note in &comparison.notes {
        let _ = writeln!(text, "{note}");
    }
    let _ = writeln!(text, "{NOT_IN_THE_ERRORS}");
    for judgement in required.iter().flat_map(|required| comparison.judge(required)) {
        let _ = writeln!(text, "{}", judgement.message);
    }
    text
}
