//! A comparison as JSON. Figures with `in_unit` are in the `unit` of the same object; those of `telemetry` in its own.

use isotherm_analysis::{
    AlignmentComparison, Comparison, ComparisonRequirement, CurveComparison, NOT_IN_THE_ERRORS, Trend,
};
use isotherm_calibration::TableFile;
use serde_json::{Value, json};

/// The document of `compare --json`. What is not known is null.
#[must_use]
pub fn document(comparison: &Comparison, required: Option<&ComparisonRequirement>) -> Value {
    let table = |table: &TableFile| {
        json!({
            "file": table.name,
            "imu": table.table.content().imu.to_string(),
            "time": table.origin.time,
            "digest": table.table.digest().to_string(),
        })
    };
    let telemetry_unit = &comparison.new_table().table.content().temperature_unit;
    let curve = |curve: &CurveComparison| {
        let (largest, at) = curve.largest();
        let bound = required.and_then(|required| required.of_curve(curve.unit));
        json!({
            "sensor": curve.sensor,
            "quantity": curve.quantity,
            "unit": curve.unit,
            "mean_in_unit": curve.mean(),
            "largest_in_unit": largest,
            "standard_error_in_unit": curve.standard_error(),
            "degrees_of_freedom": curve.band.as_ref().map(|band| band.freedom),
            "band_factor": curve.band.as_ref().map(|band| band.factor),
            "largest_ratio": curve.worst_ratio(),
            "changed": curve.is_changed(),
            "lower_in_unit": curve.lower(),
            "upper_in_unit": curve.upper(),
            "verdict": bound.map(|bound| curve.verdict(bound).name()),
            "differences_in_unit": curve.differences,
            "half_widths_in_unit": curve.half_widths().map(Iterator::collect::<Vec<_>>),
            "telemetry": {
                "unit": telemetry_unit,
                "range_in_unit": curve.range,
                "of_the_largest_in_unit": at,
                "points_in_unit": curve.telemetry,
            },
        })
    };
    let alignment = |alignment: &AlignmentComparison| {
        let bound = required.and_then(|required| required.alignment).map(|bound| bound * 1e6);
        json!({
            "triad": alignment.name(),
            "difference_urad": alignment.difference_urad,
            "half_width_urad": alignment.half_width_urad,
            "largest_urad": alignment.largest_urad(),
            "lower_urad": alignment.lower_urad(),
            "upper_urad": alignment.upper_urad(),
            "changed": alignment.is_changed(),
            "verdict": bound.map(|bound| alignment.verdict(bound).name()),
        })
    };
    let trend = |trend: &Trend| {
        json!({
            "sensor": trend.sensor,
            "quantity": trend.quantity,
            "unit": trend.unit,
            "years": trend.years,
            "values_in_unit": trend.values,
            "standard_errors_in_unit": trend.standard_errors,
            "slope_in_unit_per_year": trend.slope,
            "slope_standard_error_in_unit_per_year": trend.slope_error,
            "p": trend.p,
            "chi2": trend.chi2,
            "degrees_of_freedom": trend.freedom,
            "telemetry": { "unit": telemetry_unit, "at_in_unit": trend.telemetry },
        })
    };
    json!({
        "tables": comparison.tables.iter().map(table).collect::<Vec<_>>(),
        "old": comparison.old_table().name,
        "new": comparison.new_table().name,
        "convention": comparison.convention.name(),
        "curves": comparison.curves.iter().map(curve).collect::<Vec<_>>(),
        "alignments": comparison.alignments.iter().map(alignment).collect::<Vec<_>>(),
        "trends": comparison.trends.iter().map(trend).collect::<Vec<_>>(),
        "changed": comparison.changed(),
        "errors_known": comparison.has_errors(),
        "conclusion": comparison.conclusion(),
        "notes": comparison.notes,
        "findings": crate::json::findings(&comparison.findings, |line| line.to_string()),
        "not_in_the_errors": NOT_IN_THE_ERRORS,
        "judgements": required.map(|required| {
            let judgements = comparison.judge(required).into_iter();
            let judgement = |it: isotherm_analysis::Judgement| json!({ "name": it.name, "verdict": it.verdict.name(), "message": it.message });
            judgements.map(judgement).collect::<Vec<_>>()
        }),
        "verdict": required.and_then(|required| comparison.verdict(required)).map(|verdict| verdict.name()),
    })
}
