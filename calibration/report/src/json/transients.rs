//! What ramps show.

use crate::view::view;
use isotherm_fit::{BiasTransient, Condition, Prediction, Transients, TriadUnits};
use isotherm_recording::Losses;
use isotherm_statistics::{LoopPoint, band};

view! { pub(crate) TransientsView<'a>(found: &'a Transients) {
    verdict: &'a str = found.verdict.name(),
    losses: Losses = found.losses,
    words: &'a [String] = &found.words,
    time_constant: TimeConstantView = TimeConstantView::of(found),
    conditions: Vec<ConditionView<'a>> = found.conditions.iter().map(ConditionView::of).collect(),
    biases: Vec<BiasView<'a>> =
        found.biases.iter().map(|it| BiasView::of(it, TriadUnits::of(it.kind), found.time_constant.value_s)).collect(),
    warnings: &'a [String] = &found.warnings,
}}

view! { TimeConstantView(found: &Transients) {
    value_s: f64 = found.time_constant.value_s,
    interval_s: [f64; 2] = found.time_constant.interval_s,
    given: bool = found.time_constant.given,
    kept: bool = found.time_constant.kept,
    at_end: bool = found.time_constant.at_end,
    search: Vec<SearchView> = found.time_constant.search.iter().map(SearchView::of).collect(),
}}

view! { SearchView(place: &(f64, f64)) {
    s: f64 = place.0,
    objective: f64 = place.1,
}}

view! { ConditionView<'a>(condition: &Condition) {
    name: &'a str = condition.name,
    figure: f64 = condition.figure,
    limit: f64 = condition.limit,
    must_be: &'a str = if condition.above { "above" } else { "below" },
    met: bool = condition.met,
    decides: bool = condition.decides,
}}

view! {
/// The figures are in its `unit`: `transient`, `estimate` and `standard_error` per unit of temperature, `t_tau` times
/// seconds per unit of temperature.
BiasView<'a>(bias: &'a BiasTransient, units: &'a TriadUnits, tau_s: f64) {
    name: &'a str = bias.name(),
    unit: &'a str = units.bias,
    transient: f64 = bias.transient * units.bias_factor,
    estimate: f64 = bias.estimate * units.bias_factor,
    standard_error: f64 = bias.standard_error * units.bias_factor,
    t_tau: f64 = bias.estimate * tau_s * units.bias_factor,
    prediction: Option<PredictionView> = bias.prediction.as_ref().map(|it| PredictionView::of(it, units)),
    band: BandView = BandView::of(&bias.before, &bias.after, units),
    curve_error: Option<f64> = bias.curve_error.as_ref().map(|band| band.half_width * units.bias_factor),
    curve_error_at: Option<f64> = bias.curve_error.as_ref().map(|band| band.at),
    carried_g0: f64 = bias.carried_g0,
    conditions: Vec<ConditionView<'a>> = bias.conditions.iter().map(ConditionView::of).collect(),
}}

view! { PredictionView(it: &Prediction, units: &TriadUnits) {
    r#static: f64 = it.static_curve * units.bias_factor,
    hysteresis: f64 = it.hysteresis * units.bias_factor,
    lag_and_hysteresis: f64 = it.lag_and_hysteresis * units.bias_factor,
    written: f64 = it.written * units.bias_factor,
}}

view! { BandView(before: &[LoopPoint], after: &[LoopPoint], units: &TriadUnits) {
    before: Option<f64> = band(before).map(|band| band * units.bias_factor),
    after: Option<f64> = band(after).map(|band| band * units.bias_factor),
}}
