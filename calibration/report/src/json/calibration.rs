//! A calibration, without its findings.

use super::transients::TransientsView;
use crate::view::view;
use isotherm_campaign::Dwell;
use isotherm_fit::{
    Accuracy, CalibratedTriad, Calibration, GyroscopeCalibration, TriadObservability, is_alignment_needed, is_needed,
    largest_band, largest_interval,
};
use isotherm_recording::Losses;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{CONFIDENCE, QUANTITIES};

impl<'a> CalibrationView<'a> {
    pub(super) fn new(calibration: &'a Calibration) -> Self {
        let triad = CalibratedTriad::accelerometers(calibration);
        Self::of(calibration, &triad, &Accuracy::of_triad(calibration, &triad))
    }
}

view! { pub(super) CalibrationView<'a>(
    calibration: &'a Calibration, triad: &CalibratedTriad<'a>, accuracy: &Accuracy
) {
    imu: &'a str = calibration.table.content().imu.as_str(),
    digest: String = calibration.table.digest().to_string(),
    method: &'a str = calibration.options.method.name(),
    set_points: usize = calibration.set_points.len(),
    dwells: usize = calibration.dwells.len(),
    accuracy: String = accuracy.to_string(),
    caution: Option<String> = accuracy.caution(),
    range_in_unit: [f64; 2] = accuracy.range,
    unit: &'a str = &calibration.table.content().temperature_unit,
    axes: [AxisView<'a>; AXES] = [0, 1, 2].map(|axis| AxisView::of(calibration, triad, accuracy, axis)),
    curves: Vec<CurveView<'a>> = curves(triad),
    tilt_rad: Option<[f64; 2]> = calibration.solution.tilt,
    alignment: bool = calibration.table.content().alignment.is_some(),
    alignment_needed: bool = is_needed(&calibration.solution),
    left_without_alignment_g0: Option<f64> = calibration.left_without_alignment(),
    accepted: &'a [&'static str] = &calibration.accepted,
    losses: Losses = calibration.dwells.iter().map(Dwell::losses).fold(Losses::default(), Losses::and),
    #[serde(skip_serializing_if = "Option::is_none")]
    gyroscopes: Option<GyroscopesView<'a>> =
        calibration.gyroscopes.as_ref().map(|found| GyroscopesView::new(calibration, found)),
    #[serde(skip_serializing_if = "Option::is_none")]
    transients: Option<TransientsView<'a>> = calibration.transients.as_ref().map(TransientsView::of),
}}

view! { AxisView<'a>(calibration: &Calibration, triad: &CalibratedTriad<'_>, accuracy: &Accuracy, axis: usize) {
    axis: &'a str = triad.names[axis],
    bias_interval_g0: Option<f64> = accuracy.bias[axis],
    scale_factor_interval_ppm: Option<f64> = accuracy.scale_factor[axis].map(|part| part * 1e6),
    bias_band_g0: Option<f64> = accuracy.bias_band[axis],
    scale_factor_band_ppm: Option<f64> = accuracy.scale_factor_band[axis].map(|part| part * 1e6),
    misalignment_rad: [f64; 2] = triad.misalignment[axis],
    misalignment_interval_rad: Option<[f64; 2]> = triad.misalignment_interval[axis],
    residual_sd_g0: f64 = calibration.residual_sd(axis),
}}

/// The curves of a triad.
fn curves<'a>(triad: &CalibratedTriad<'a>) -> Vec<CurveView<'a>> {
    (0..9).map(|index| CurveView::of(triad, index / 3, index % 3)).collect()
}

view! {
/// In the units of the fit.
CurveView<'a>(triad: &CalibratedTriad<'a>, axis: usize, quantity: usize) {
    axis: &'a str = triad.names[axis],
    quantity: &'a str = QUANTITIES[quantity],
    unit: &'a str = triad.units.in_fit(quantity),
    order: usize = triad.orders[axis][quantity].choice.order,
    reason: &'a str = &triad.orders[axis][quantity].choice.reason,
    leave_one_set_point_out_rms_in_unit: Option<f64> = triad.orders[axis][quantity].chosen().leave_one_out_rms,
    residual_sd_in_unit: Option<f64> = triad.orders[axis][quantity].chosen().residual_sd,
    largest_interval_in_unit: Option<f64> = largest_interval(&triad.curves[axis][quantity], false),
    largest_band_in_unit: Option<f64> = largest_band(&triad.curves[axis][quantity], false),
}}

impl<'a> GyroscopesView<'a> {
    fn new(calibration: &'a Calibration, found: &'a GyroscopeCalibration) -> Self {
        let triad = CalibratedTriad::gyroscopes(calibration, found);
        Self::of(calibration, found, &triad, &Accuracy::of_triad(calibration, &triad))
    }
}

view! { GyroscopesView<'a>(
    calibration: &Calibration, found: &'a GyroscopeCalibration, triad: &CalibratedTriad<'a>, accuracy: &Accuracy
) {
    turns: usize = found.turns(),
    accuracy: String = accuracy.to_string(),
    caution: Option<String> = accuracy.caution(),
    range_in_unit: [f64; 2] = accuracy.range,
    axes: [GyroscopeView<'a>; AXES] = [0, 1, 2].map(|axis| GyroscopeView::of(found, triad, accuracy, axis)),
    curves: Vec<CurveView<'a>> = curves(triad),
    earth: Option<EarthView> =
        found.earth.map(|earth| EarthView::of(found, [earth.found, earth.expected], earth.along_z)),
    left_over: Option<LeftOverView<'a>> = found.left_over.as_ref().map(|left| {
        LeftOverView::of([left.bias, left.scale_factor, left.g_sensitivity, left.misalignment], &left.from)
    }),
    alignment_needed: bool = is_alignment_needed(&found.solution),
    left_without_alignment_rad: Option<f64> = found.left_without_alignment(&calibration.table),
    observability: ObservabilityView = ObservabilityView::of(&found.observability),
}}

view! { GyroscopeView<'a>(
    found: &GyroscopeCalibration, triad: &CalibratedTriad<'_>, accuracy: &Accuracy, axis: usize
) {
    axis: &'a str = triad.names[axis],
    bias_interval_deg_h: Option<f64> = accuracy.bias[axis],
    scale_factor_interval_ppm: Option<f64> = accuracy.scale_factor[axis].map(|part| part * 1e6),
    bias_band_deg_h: Option<f64> = accuracy.bias_band[axis],
    scale_factor_band_ppm: Option<f64> = accuracy.scale_factor_band[axis].map(|part| part * 1e6),
    misalignment_rad: [f64; 2] = triad.misalignment[axis],
    misalignment_interval_rad: Option<[f64; 2]> = triad.misalignment_interval[axis],
    g_sensitivity_deg_h_g0: [f64; AXES] = found.solution.gyroscopes[axis].g_sensitivity,
    g_sensitivity_interval_deg_h_g0: Option<[f64; AXES]> =
        found.solution.gyroscopes[axis].g_sensitivity_interval(CONFIDENCE),
    random_walk_deg_sqrt_h: f64 = found.random_walk(axis),
}}

view! { EarthView(found: &GyroscopeCalibration, horizontal: [f64; 2], along_z: f64) {
    rate_deg_h: Option<[f64; AXES]> = found.solution.earth.map(|[x, y]| [x, y, along_z]),
    rate_standard_error_deg_h: Option<[f64; 2]> = found.solution.earth_error,
    horizontal_rate_deg_h: f64 = horizontal[0],
    horizontal_rate_interval_deg_h: Option<f64> = found.horizontal_rate_interval(CONFIDENCE),
    horizontal_rate_of_latitude_deg_h: f64 = horizontal[1],
}}

view! { LeftOverView<'a>(left: [f64; 4], from: &'a [String]) {
    bias_deg_h: f64 = left[0],
    scale_factor_ppm: f64 = left[1] * 1e6,
    g_sensitivity_deg_h_g0: f64 = left[2],
    misalignment_rad: f64 = left[3],
    from: &'a [String] = from,
}}

view! { ObservabilityView(found: &TriadObservability) {
    rank: usize = found.rank,
    unknowns: usize = found.unknowns,
    condition: f64 = found.condition,
}}
