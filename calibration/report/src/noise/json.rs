//! The noise of an IMU as JSON, with keys as in the parent's [`json`](crate::json): `in_unit` is the `unit` of the same
//! object.

use crate::findings::records;
use crate::view::{value, view};
use core::f64::consts::SQRT_2;
use isotherm_analysis::{
    Allan, BridgedRows, COEFFICIENTS, Coefficient, FLICKER_FLOOR, ModelFit, NoiseAnalysis, NoiseUnits, SensorNoise,
    Step, TemperatureLine,
};
use isotherm_recording::Losses;
use serde_json::Value;

/// The document of `isotherm noise --json`. Rows are counted from 1.
#[must_use]
pub fn document(analysis: &NoiseAnalysis) -> Value {
    value(&NoiseView::of(analysis))
}

/// The units of rates whose unit is not known.
pub(super) const RATES: NoiseUnits = NoiseUnits {
    rate: "unit",
    coefficients: [("unit s", 1.0), ("unit/sqrt(Hz)", 1.0), ("unit", 1.0), ("unit/(s sqrt(Hz))", 1.0)],
    density: "unit/sqrt(Hz)",
    names: ["quantisation noise", "white noise", "bias instability", "random walk of the rate"],
};

/// The noise of rates whose unit is not known, which is called "unit", next to their line in temperature.
#[must_use]
pub fn rates(allan: &Allan, line: Option<&TemperatureLine>) -> Value {
    value(&RatesView::of(allan, line, &RATES))
}

view! { NoiseView<'a>(analysis: &'a NoiseAnalysis) {
    rows: usize = analysis.used.len(),
    bridged: BridgedView = BridgedView::of(&analysis.bridged),
    first_row: usize = analysis.used.start + 1,
    last_row: usize = analysis.used.end,
    recorded_rows: usize = analysis.rows,
    from_s: f64 = analysis.used_s[0],
    to_s: f64 = analysis.used_s[1],
    interval_s: f64 = analysis.interval_s,
    losses: Losses = analysis.losses,
    sensors: Vec<SensorView<'a>> =
        analysis.sensors.iter().map(|it| SensorView::of(it, &it.kind.units(), &analysis.temperature_unit)).collect(),
    findings: Value = records(&analysis.findings()),
}}

view! {
/// The rows that are missing in the stretch.
BridgedView(bridged: &BridgedRows) {
    rows: usize = bridged.rows,
    gaps: usize = bridged.gaps,
    not_a_number: usize = bridged.not_a_number,
    part: f64 = bridged.share(),
    too_many: bool = bridged.is_too_much(),
}}

view! { RatesView(allan: &Allan, line: Option<&TemperatureLine>, units: &NoiseUnits) {
    #[serde(flatten)]
    curve: CurveView = CurveView::of(allan, units),
    temperature: Option<TemperatureView> = line.map(|it| TemperatureView::of(it, units, "unit of the temperature")),
}}

view! {
/// One sensor: its curve, the noise of a row, and its rate against temperature.
SensorView<'a>(sensor: &SensorNoise, units: &NoiseUnits, temperature_unit: &str) {
    axis: &'a str = sensor.name,
    unit: &'a str = units.rate,
    #[serde(flatten)]
    curve: Option<CurveView> = sensor.allan.as_ref().map(|allan| CurveView::of(allan, units)),
    white_noise_counts: Option<f64> = sensor.white_counts,
    limit_cycle: bool = sensor.limit_cycle().is_some(),
    temperature: Option<TemperatureView> =
        sensor.line.as_ref().map(|line| TemperatureView::of(line, units, temperature_unit)),
}}

view! { TemperatureView(line: &TemperatureLine, units: &NoiseUnits, temperature_unit: &str) {
    unit: String = format!("{} per {temperature_unit}", units.rate),
    slope_in_unit: f64 = line.slope,
    standard_error_in_unit: Option<f64> = line.slope_error,
    contaminated_from_s: Option<f64> = line.contaminated_from_s,
    without: CurveView = CurveView::of(&line.without, units),
}}

view! {
/// The points as columns, the minimum and the model.
CurveView(allan: &Allan, units: &NoiseUnits) {
    unit: &'static str = units.rate,
    tau_s: Vec<f64> = allan.points.iter().map(|point| point.tau_s).collect(),
    adev_in_unit: Vec<f64> = allan.points.iter().map(|point| point.adev).collect(),
    interval_in_unit: Vec<Option<[f64; 2]>> = allan.points.iter().map(|point| point.interval).collect(),
    degrees_of_freedom: Vec<Option<f64>> = allan.points.iter().map(|point| point.freedom).collect(),
    minimum: Option<MinimumView> = allan.minimum().map(|_| MinimumView::of(allan, units)),
    steps: Vec<StepView> = allan.steps.iter().map(|step| StepView::of(step, units)).collect(),
    model: Option<ModelView> = allan.model.as_ref().map(|fit| ModelView::of(allan, fit, units)),
}}

view! {
/// A step that is taken out of the rates.
StepView(step: &Step, units: &NoiseUnits) {
    unit: &'static str = units.rate,
    at_s: f64 = step.at_s,
    size_in_unit: f64 = step.size,
}}

view! { MinimumView(allan: &Allan, units: &NoiseUnits) {
    unit: &'static str = units.rate,
    tau_s: Option<f64> = allan.minimum().map(|point| point.tau_s),
    adev_in_unit: Option<f64> = allan.minimum().map(|point| point.adev),
    interval_in_unit: Option<[f64; 2]> = allan.minimum().and_then(|point| point.interval),
    at_end: bool = allan.falls_to_the_end(),
}}

view! { ModelView(allan: &Allan, model: &ModelFit, units: &NoiseUnits) {
    holds: bool = model.holds(),
    chi_square: f64 = model.chi_square,
    degrees_of_freedom: usize = model.freedom,
    fitted_s: [f64; 2] = model.fitted_s,
    coefficients: [NamedView; 4] = [0, 1, 2, 3].map(|k| NamedView::of(&model.coefficients[k], units, k, allan.gives(k))),
    two_sided_density: CoefficientView = CoefficientView::of(&model.coefficients[1], units.density, 1.0),
    one_sided_density: CoefficientView = CoefficientView::of(&model.coefficients[1], units.density, SQRT_2),
    flicker_floor: CoefficientView = CoefficientView::of(&model.coefficients[2], units.rate, FLICKER_FLOOR),
}}

view! {
/// A coefficient; without figures where the curve does not give it.
NamedView(coefficient: &Coefficient, units: &NoiseUnits, k: usize, given: bool) {
    letter: &'static str = COEFFICIENTS[k],
    name: &'static str = units.names[k],
    #[serde(flatten)]
    coefficient: Option<CoefficientView> =
        given.then(|| CoefficientView::of(coefficient, units.coefficients[k].0, units.coefficients[k].1)),
}}

view! {
/// A coefficient times a factor: value and range, or what it is below.
CoefficientView(coefficient: &Coefficient, unit: &'static str, factor: f64) {
    unit: &'static str = unit,
    value_in_unit: f64 = coefficient.value * factor,
    range_in_unit: Option<[f64; 2]> = coefficient.range.map(|range| range.map(|end| end * factor)),
    below_in_unit: Option<f64> = coefficient.below().map(|below| below * factor),
}}
