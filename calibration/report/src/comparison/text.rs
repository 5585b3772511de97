//! A comparison in lines.

use super::words::{places, probability, slope_interval, which, word};
use isotherm_analysis::{
    AlignmentComparison, Comparison, ComparisonRequirement, CurveComparison, NOT_IN_THE_ERRORS, Trend,
};
use isotherm_support::finding::{Finding, name};
use std::fmt::Write as _;

/// The lines that `compare` prints: differences, changes, lines over the dates, what is required, and notes.
#[must_use]
pub fn text(comparison: &Comparison, required: Option<&ComparisonRequirement>) -> String {
    let imu = &comparison.new_table().table.content().imu;
    let is_same = |finding: &&Finding| finding.name == name::SAME_TABLE;
    let mut text: String = comparison.findings.iter().filter(is_same).map(|finding| format!("{finding}\n")).collect();
    text += &format!("{imu}: {}\n\n{}", which(comparison), curves(&comparison.curves));
    text.extend(comparison.alignments.iter().map(alignment));
    text += &trends(&comparison.trends);
    text += &format!("\n{}\n", comparison.conclusion());
    let judgements = required.iter().flat_map(|required| comparison.judge(required)).map(|judgement| judgement.message);
    let findings = comparison.findings.iter().filter(|finding| !is_same(finding)).map(ToString::to_string);
    let lines =
        findings.chain(comparison.notes.iter().cloned()).chain([NOT_IN_THE_ERRORS.to_owned()]).chain(judgements);
    text.extend(lines.map(|line| line + "\n"));
    text
}

/// The differences, a line each, with their header.
fn curves(curves: &[CurveComparison]) -> String {
    let mut text =
        "  curve                              mean    largest         at  standard error   at least    at most\n"
            .to_owned();
    for curve in curves {
        let places = places(curve.unit);
        let (largest, at) = curve.largest();
        let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.places$}"));
        // Writing to a String cannot fail.
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
    text
}

fn alignment(alignment: &AlignmentComparison) -> String {
    let within = match (alignment.lower_urad(), alignment.upper_urad()) {
        (Some(lower), Some(upper)) => format!(", with its band {lower:.3} to {upper:.3}"),
        _ => String::new(),
    };
    let (name, largest, changed) = (alignment.name(), alignment.largest_urad(), word(alignment.is_changed()));
    format!("  alignment of the {name}: largest difference {largest:.3} [1e-6 rad]{within}: {changed}\n")
}

/// The lines over the dates with their header; nothing if there are none.
fn trends(trends: &[Trend]) -> String {
    let mut text = String::new();
    if !trends.is_empty() {
        text += "\n  over the dates, at mid range          slope   95 % interval          p\n";
    }
    for trend in trends {
        let (places, unit) = (places(trend.unit), format!("{}/year", trend.unit));
        let (name, slope, interval, p) = (trend.name(), trend.slope, slope_interval(trend), probability(trend));
        let _ = writeln!(text, "  {name:<24} {unit:>10} {slope:>8.places$} {interval:>15.places$} {p:>10}");
    }
    text
}
