//! A comparison as JSON. Figures with `in_unit` are in the `unit` of the same object; those of `temperature` in its
//! own.

use crate::findings::records;
use crate::view::{value, view};
use isotherm_analysis::{
    AlignmentComparison, Comparison, ComparisonRequirement, Compliance, CurveComparison, CurveJudgement,
    NOT_IN_THE_ERRORS, Trend,
};
use isotherm_fit::TableFile;
use serde_json::Value;

/// The document of `compare --json`. What is not known is null.
#[must_use]
pub fn document(comparison: &Comparison, required: Option<&ComparisonRequirement>) -> Value {
    let unit = &comparison.new_table().table.content().temperature_unit;
    value(&ComparisonView::of(comparison, unit, required))
}

type Required<'a> = Option<&'a ComparisonRequirement>;

view! { ComparisonView<'a>(comparison: &'a Comparison, temperature_unit: &'a str, required: Required<'_>) {
    tables: Vec<TableView<'a>> = comparison.tables.iter().map(TableView::of).collect(),
    old: &'a str = &comparison.old_table().name,
    new: &'a str = &comparison.new_table().name,
    convention: &'a str = comparison.convention.name(),
    curves: Vec<CurveView<'a>> =
        comparison.curves.iter().map(|curve| CurveView::of(curve, temperature_unit, required)).collect(),
    alignments: Vec<AlignmentView<'a>> =
        comparison.alignments.iter().map(|alignment| AlignmentView::of(alignment, required)).collect(),
    trends: Vec<TrendView<'a>> =
        comparison.trends.iter().map(|trend| TrendView::of(trend, temperature_unit)).collect(),
    changed: Vec<String> = comparison.changed(),
    errors_known: bool = comparison.has_errors(),
    conclusion: String = comparison.conclusion(),
    notes: &'a [String] = &comparison.notes,
    findings: Value = records(&comparison.findings),
    not_in_the_errors: &'a str = NOT_IN_THE_ERRORS,
    judgements: Option<Vec<JudgementView<'a>>> =
        required.map(|required| comparison.judge(required).into_iter().map(JudgementView::of).collect()),
    verdict: Option<&'a str> = required.and_then(|required| comparison.verdict(required)).map(Compliance::name),
}}

view! { TableView<'a>(file: &'a TableFile) {
    file: &'a str = &file.name,
    imu: &'a str = file.table.content().imu.as_str(),
    time: Option<&'a str> = file.origin.time.as_deref(),
    digest: String = file.table.digest().to_string(),
}}

view! { JudgementView<'a>(judgement: CurveJudgement) {
    verdict: &'a str = judgement.verdict.name(),
    name: String = judgement.name,
    message: String = judgement.message,
}}

view! { CurveView<'a>(curve: &'a CurveComparison, temperature_unit: &'a str, required: Required<'_>) {
    sensor: &'a str = curve.sensor,
    quantity: &'a str = curve.quantity,
    unit: &'a str = curve.unit,
    mean_in_unit: f64 = curve.mean(),
    largest_in_unit: f64 = curve.largest().0,
    standard_error_in_unit: Option<f64> = curve.standard_error(),
    degrees_of_freedom: Option<f64> = curve.band.as_ref().map(|band| band.freedom),
    band_factor: Option<f64> = curve.band.as_ref().map(|band| band.factor),
    largest_ratio: Option<f64> = curve.worst_ratio(),
    changed: Option<bool> = curve.is_changed(),
    lower_in_unit: Option<f64> = curve.lower(),
    upper_in_unit: Option<f64> = curve.upper(),
    verdict: Option<&'a str> =
        required.and_then(|required| required.of_curve(curve.unit)).map(|bound| curve.verdict(bound).name()),
    differences_in_unit: &'a [f64] = &curve.differences,
    half_widths_in_unit: Option<Vec<f64>> = curve.half_widths().map(Iterator::collect),
    temperature: CurveTemperature<'a> = CurveTemperature::of(curve, temperature_unit),
}}

view! { CurveTemperature<'a>(curve: &'a CurveComparison, unit: &'a str) {
    unit: &'a str = unit,
    range_in_unit: [f64; 2] = curve.range,
    of_the_largest_in_unit: f64 = curve.largest().1,
    points_in_unit: &'a [f64] = &curve.temperature,
}}

view! { AlignmentView<'a>(alignment: &AlignmentComparison, required: Required<'_>) {
    triad: &'a str = alignment.name(),
    difference_urad: [[f64; 3]; 3] = alignment.difference_urad,
    half_width_urad: Option<[[f64; 3]; 3]> = alignment.half_width_urad,
    largest_urad: f64 = alignment.largest_urad(),
    lower_urad: Option<f64> = alignment.lower_urad(),
    upper_urad: Option<f64> = alignment.upper_urad(),
    changed: Option<bool> = alignment.is_changed(),
    verdict: Option<&'a str> =
        required.and_then(|required| required.alignment).map(|bound| alignment.verdict(bound * 1e6).name()),
}}

view! { TrendView<'a>(trend: &'a Trend, temperature_unit: &'a str) {
    sensor: &'a str = trend.sensor,
    quantity: &'a str = trend.quantity,
    unit: &'a str = trend.unit,
    years: &'a [f64] = &trend.years,
    values_in_unit: &'a [f64] = &trend.values,
    standard_errors_in_unit: Option<&'a [f64]> = trend.standard_errors.as_deref(),
    slope_in_unit_per_year: f64 = trend.slope,
    slope_standard_error_in_unit_per_year: f64 = trend.slope_error,
    p: Option<f64> = trend.p,
    chi2: Option<f64> = trend.chi2,
    degrees_of_freedom: usize = trend.freedom,
    temperature: TrendTemperature<'a> = TrendTemperature::of(trend, temperature_unit),
}}

view! { TrendTemperature<'a>(trend: &Trend, unit: &'a str) {
    unit: &'a str = unit,
    at_in_unit: f64 = trend.temperature,
}}
