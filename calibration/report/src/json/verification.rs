//! A verification: table 4, the verdict and the judgement of what is required.

use crate::findings::records;
use crate::view::{value, view};
use isotherm_recording::Losses;
use isotherm_shared::table::{AXIS_NAMES, GYROSCOPE_NAMES};
use isotherm_shared::wire::AXES;
use isotherm_verification::{
    AxisStability, Coverage, Errors, Estimate, GyroscopeStability, Judgement, LeftOut, LoopBand, Loops, Requirement,
    Stability,
};
use serde::Serialize;
use serde_json::{Map, Value};

/// A verification: table 4, the verdict and the judgement of what is required. `window_s` is the length of the windows
/// \[s\].
#[must_use]
pub fn verification(stability: &Stability, window_s: f64, required: Option<Requirement>) -> Value {
    value(&StabilityView::of(
        stability,
        window_s,
        required.is_some(),
        JudgedView::of(required, &|it| it.judge(stability)),
    ))
}

view! { StabilityView<'a>(stability: &'a Stability, window_s: f64, is_required: bool, judged: JudgedView) {
    window_s: f64 = window_s,
    windows: usize = stability.windows.len(),
    windows_at_attitude: usize = stability.windows.iter().filter(|window| window.counts).count(),
    windows_left_out: LeftOutView = LeftOutView::of(&stability.windows_left_out),
    samples_left_out: u64 = stability.left_out,
    losses: Losses = stability.losses,
    made_the_table: bool = stability.made_the_table,
    findings: Value = records(&stability.findings(is_required)),
    time_warning: Option<String> = stability.time_fault.map(|fault| fault.to_string()),
    attitude_stated: bool = stability.stated,
    specific_force_g0: [f64; AXES] = stability.specific_force,
    gravity_local_m_s2: Option<f64> = stability.gravity_source.value(),
    gravity_source: &'a str = stability.gravity_source.name(),
    groups: usize = stability.verdict.groups,
    windows_in_group: usize = stability.verdict.windows,
    axes: [AxisView<'a>; AXES] = [0, 1, 2].map(|axis| AxisView::accelerometer(stability, axis)),
    length: Option<Figures> = stability.verdict.length.as_ref().map(|errors| with_unit(&ErrorsView::of(errors), "g0")),
    level: Figures = with_unit(&ErrorsView::of(&stability.verdict.level), "rad"),
    largest: Option<LargestView<'a>> =
        stability.nothing_claimed().is_none().then(|| LargestView::of(stability.verdict.largest(), "g0")),
    #[serde(flatten)]
    judged: JudgedView = judged,
    not_judged: Option<String> = stability.verdict.missing().map(|parts| parts.join("; ")),
    not_at_rest_or_other_imu: Option<String> = stability.gravity_mismatch(),
    not_the_whole_run: Option<String> = stability.unjudged(),
    too_short_for_a_requirement: Option<String> = stability.too_short(),
    interval_ratio: Option<f64> = stability.interval_ratio,
    interval_warning: Option<String> = stability.interval_warning(),
    attitude_warning: Option<String> = stability.attitude_warning(),
    hysteresis_left_out_s: Option<f64> = stability.unsettled_s,
    covered: CoverageView<'a> = CoverageView::of(&stability.covered),
    #[serde(skip_serializing_if = "Option::is_none")]
    gyroscopes: Option<JudgedGyroscopes<'a>> = stability.gyroscopes.as_ref().map(JudgedGyroscopes::of),
}}

view! {
/// What is required, and its judgement.
pub(crate) JudgedView(required: Option<Requirement>, judge: &dyn Fn(&Requirement) -> Vec<Judgement>) {
    judgements: Option<Vec<Judgement>> = required.as_ref().map(judge),
    met: Option<bool> = required.as_ref().map(|required| judge(required).iter().all(|judgement| judgement.met)),
    required: Option<String> = required.map(|required| required.to_string()),
}}

/// The gyroscopes, or why they are not judged.
#[derive(Serialize)]
#[serde(untagged)]
enum JudgedGyroscopes<'a> {
    Judged(Box<GyroscopesView<'a>>),
    NotJudged { not_judged: &'a str },
}

impl<'a> JudgedGyroscopes<'a> {
    fn of(found: &'a Result<GyroscopeStability, String>) -> Self {
        match found {
            Ok(found) => Self::Judged(Box::new(GyroscopesView::of(found))),
            Err(reason) => Self::NotJudged { not_judged: reason },
        }
    }
}

view! { GyroscopesView<'a>(found: &'a GyroscopeStability) {
    axes: [AxisView<'a>; AXES] = [0, 1, 2].map(|axis| AxisView::gyroscope(found, axis)),
    earth_rate_deg_h: Option<[f64; AXES]> = found.earth_rate.map(|earth| earth.rate),
    earth_rate_interval_deg_h: Option<[f64; AXES]> = found.earth_rate.and_then(|earth| earth.interval),
    windows_left_out: LeftOutView = LeftOutView::of(&found.windows_left_out),
    windows_at_rest: usize = found.windows.iter().filter(|window| window.counts).count(),
    groups: usize = found.groups,
    windows_in_group: usize = found.windows_in_group,
    largest: Option<LargestView<'a>> =
        found.unjudged().is_none().then(|| LargestView::of(found.largest(), "deg_h")),
    not_judged: Option<String> = found.missing().map(|parts| parts.join("; ")),
    not_the_whole_run: Option<String> = found.unjudged(),
    covered: CoverageView<'a> = CoverageView::of(&found.covered),
}}

impl AxisView<'_> {
    fn accelerometer(stability: &Stability, axis: usize) -> Self {
        let (errors, figures) = (&stability.verdict.axes[axis], &stability.axes[axis]);
        Self::of(AXIS_NAMES[axis], "g0", errors, figures, HysteresisView::of(&stability.loops, axis, "g0"), None)
    }

    fn gyroscope(found: &GyroscopeStability, axis: usize) -> Self {
        let (loops, walk) = (HysteresisView::of(&found.loops, axis, "deg_h"), Some(found.random_walk[axis]));
        Self::of(GYROSCOPE_NAMES[axis], "deg_h", &found.errors[axis], &found.axes[axis], loops, walk)
    }
}

view! { AxisView<'a>(
    name: &'a str, unit: &str, errors: &Errors, figures: &AxisStability, hysteresis: HysteresisView,
    random_walk: Option<Estimate>
) {
    axis: &'a str = name,
    #[serde(flatten)]
    errors: Figures = with_unit(&ErrorsView::of(errors), unit),
    #[serde(flatten)]
    figures: Figures = with_unit(&FiguresView::of(figures), unit),
    factor: f64 = figures.factor(),
    hysteresis: HysteresisView = hysteresis,
    #[serde(skip_serializing_if = "Option::is_none")]
    random_walk_deg_sqrt_h: Option<Estimate> = random_walk,
}}

view! { ErrorsView(errors: &Errors) {
    constant: Option<Estimate> = errors.constant,
    variation: Estimate = errors.variation,
    worst: Estimate = errors.worst,
    noise_of_window: f64 = errors.noise,
    largest_window: f64 = errors.largest_window,
}}

view! { FiguresView(figures: &AxisStability) {
    sd_before: f64 = figures.sd_before,
    rms_before: f64 = figures.rms_before,
    sd_after: f64 = figures.sd_after,
    rms_after: f64 = figures.rms_after,
}}

view! {
/// The hysteresis band of an axis for the static and the full model, or why it is not judged.
HysteresisView(loops: &Loops, axis: usize, unit: &str) {
    #[serde(flatten)]
    bands: Figures = with_unit(&BandsView::of(loops.band(axis).ok()), unit),
    shared_bins: Option<usize> = loops.band(axis).ok().map(|band| band.bins),
    not_judged: Option<&'static str> = loops.band(axis).err(),
}}

view! { BandsView(band: Option<LoopBand>) {
    r#static: Option<f64> = band.and_then(|band| band.static_model),
    full: Option<f64> = band.map(|band| band.full),
}}

view! { LargestView<'a>(largest: (&'a str, Estimate), unit: &str) {
    of: &'a str = largest.0,
    #[serde(flatten)]
    error: Figures = with_unit(&largest.1, unit),
}}

view! {
/// The windows that are not judged, by cause; in words even if there are none.
LeftOutView(left_out: &LeftOut) {
    count: usize = left_out.count(),
    not_a_number: usize = left_out.not_a_number,
    not_still: usize = left_out.moved,
    elsewhere: usize = left_out.elsewhere,
    by_accelerometers: usize = left_out.by_accelerometers,
    words: String = left_out.to_string(),
}}

view! {
/// The channels that the run drives, and what it covers of each axis.
CoverageView<'a>(covered: &'a Coverage) {
    unit: &'a str = &covered.unit,
    axes: [AxisCoverage<'a>; AXES] = [0, 1, 2].map(|axis| AxisCoverage::of(covered, axis)),
    channels: Vec<String> = covered.channels(),
    hole: Option<String> = covered.hole(),
    words: String = covered.to_string(),
}}

view! { AxisCoverage<'a>(covered: &Coverage, axis: usize) {
    axis: &'a str = covered.kind.names()[axis],
    bias: SensorCoverage = SensorCoverage::of(covered, axis, 0),
    scale_factor: SensorCoverage = SensorCoverage::of(covered, axis, 1),
}}

view! {
/// The temperature of run and table, and the part of the table's range that the run covers.
SensorCoverage(covered: &Coverage, axis: usize, sensor: usize) {
    run_in_unit: [f64; 2] = covered.temperature[axis][sensor],
    table_in_unit: [f64; 2] = covered.occupancy[axis][sensor].range,
    part: f64 = covered.parts()[axis][sensor],
    largest_hole_in_unit: Option<[f64; 2]> = covered.occupancy[axis][sensor].largest_hole(),
}}

/// Figures whose keys end with their unit.
pub(crate) type Figures = Map<String, Value>;

/// The figures of a view, whose keys have no unit.
pub(crate) fn with_unit(view: &impl Serialize, unit: &str) -> Figures {
    let Value::Object(figures) = value(view) else { return Figures::new() };
    figures.into_iter().map(|(key, figure)| (format!("{key}_{unit}"), figure)).collect()
}
