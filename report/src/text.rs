//! Results as the text that the commands print.
//!
//! Over 400 lines: the lines of calibrations and of verifications, which have the same layout.

use isotherm_calibration::{
    Accuracy, CalibratedTriad, Calibration, GyroscopeCalibration, RampCalibration, Transients, TriadUnits,
    largest_interval,
};
use isotherm_campaign::Dwell;
use isotherm_recording::Losses;
use isotherm_shared::table::{AXIS_NAMES, GYROSCOPE_NAMES};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{BINS, CONFIDENCE, QUANTITIES, band};
use isotherm_verification::{
    AxisStability, Errors, Estimate, Force, GyroscopeStability, Judgement, LoopBand, Loops, Stability,
};
use std::fmt::Write as _;

/// A calibration in a few lines: orders, errors, misalignments, tilt; of gyroscopes also g-sensitivities and Earth's
/// rate.
#[must_use]
pub fn calibration(calibration: &Calibration) -> String {
    let triads: Vec<_> = CalibratedTriad::all(calibration).collect();
    let gyroscopes = calibration.gyroscopes.as_ref();
    let turns = gyroscopes.map_or_else(String::new, |found| format!(" and {} turns", found.turns()));
    let losses = calibration.dwells.iter().map(Dwell::losses).fold(Losses::default(), Losses::and);
    let losses = within(losses, "the dwells").unwrap_or_default();
    let mut text = format!(
        "{} dwells{turns} at {} set points, {} fit, digest {}\n{losses}\n  curve                       order   95 % interval  leave-one-set-point-out rms    residual sd  why\n",
        calibration.dwells.len(),
        calibration.set_points.len(),
        calibration.options.method.name(),
        calibration.table.digest(),
    );
    text.extend(triads.iter().map(curves));
    // Writing to a String cannot fail.
    for (axis, line) in misalignments(&triads[0]).into_iter().enumerate() {
        let _ = writeln!(text, "{line}; residuals {:.3}e-6 g0 rms", calibration.residual_sd(axis) * 1e6);
    }
    if let (Some(found), Some(triad)) = (gyroscopes, triads.get(1)) {
        for (axis, line) in misalignments(triad).into_iter().enumerate() {
            let _ = writeln!(text, "{line}; random walk {:.5} deg/sqrt(h)", found.random_walk(axis));
        }
        text += &g_sensitivities(found);
    }
    if let Some([x, y]) = calibration.solution.tilt {
        let _ = writeln!(text, "  base tilted by {:.2} and {:.2} [1e-6 rad] about X and Y", x * 1e6, y * 1e6);
    }
    text.extend(gyroscopes.and_then(earth));
    text += &alignment(calibration);
    if let Some(found) = &calibration.transients {
        text.push('\n');
        text.extend(within(found.losses, "the ramps"));
        text += &transients(found, &calibration.table.content().temperature_unit);
    }
    text.push('\n');
    for triad in &triads {
        let accuracy = Accuracy::of_triad(calibration, triad);
        // Of one triad it is clear what is meant.
        let whose = if triads.len() > 1 { format!("{}s: ", triad.units.sensor) } else { String::new() };
        let _ = writeln!(text, "{whose}{accuracy}");
        if let Some(caution) = accuracy.caution() {
            let _ = writeln!(text, "  caution: {caution}");
        }
    }
    text
}

/// The line of what is missing within a recording or its parts, if anything is.
pub(super) fn within(losses: Losses, parts: &str) -> Option<String> {
    (!losses.is_none()).then(|| format!("  within {parts}: {losses}\n"))
}

/// A calibration from ramps alone in a few lines: what the table does not know, and the transients.
#[must_use]
pub fn ramps(calibration: &RampCalibration) -> String {
    let (content, count) = (calibration.table.content(), calibration.recordings);
    let noun = if count == 1 { "recording" } else { "recordings" };
    let mut text = format!(
        "{count} {noun} of ramps alone, curves {}, digest {}\n\nnot known:\n",
        calibration.curves.digest(),
        calibration.table.digest()
    );
    for sentence in calibration.not_known() {
        text += &format!("  {sentence}\n");
    }
    text.push('\n');
    text.extend(within(calibration.transients.losses, "the ramps"));
    text += &transients(&calibration.transients, &content.temperature_unit);
    text + "\n" + &calibration.accuracy() + "\n"
}

/// The verdict of the ramps with its reasons, then the biases, a line each.
fn transients(found: &Transients, unit: &str) -> String {
    let mut text =
        "transients, rms of the sweeps left out, and hysteresis band without and with the estimate:\n".to_owned();
    // Writing to a String cannot fail.
    let _ = writeln!(
        text,
        "  {:4} {:<13} {:>12} {:>24} {:>13}   {:>10} {:>10} {:>10} {:>10}   {:>10} {:>10}",
        "",
        format!("unit, per {unit}"),
        "written",
        "estimate +- its error",
        "t tau / s",
        "static",
        "hysteresis",
        "with lag",
        "in a table",
        "without",
        "with"
    );
    for bias in &found.biases {
        let units = TriadUnits::of(bias.kind);
        let decimals = units.bias_decimals;
        let shown = |value: f64| format!("{:.decimals$}", value * units.bias_factor);
        let known = |value: Option<f64>| value.map_or_else(|| "not known".to_owned(), shown);
        let prediction = |of: fn(&isotherm_calibration::Prediction) -> f64| known(bias.prediction.as_ref().map(of));
        let _ = writeln!(
            text,
            "  {:4} {:<13} {:>12} {:>24} {:>13}   {:>10} {:>10} {:>10} {:>10}   {:>10} {:>10}",
            bias.name(),
            units.bias,
            shown(bias.transient),
            format!("{} +- {}", shown(bias.estimate), shown(bias.standard_error)),
            format!("{:.1}", bias.estimate * units.bias_factor * found.time_constant.value_s),
            prediction(|it| it.static_curve),
            prediction(|it| it.hysteresis),
            prediction(|it| it.lag_and_hysteresis),
            prediction(|it| it.written),
            known(band(&bias.before)),
            known(band(&bias.after)),
        );
    }
    for sentence in &found.words {
        let _ = writeln!(text, "  {sentence}");
    }
    text
}

/// The curves of a triad, a line each.
fn curves(triad: &CalibratedTriad<'_>) -> String {
    let mut text = String::new();
    for (axis, tables) in triad.orders.iter().enumerate() {
        for (quantity, orders) in tables.iter().enumerate() {
            let fit = &orders.regression.fits()[orders.choice.order];
            let size = fit.coefficients.first().map_or(1.0, |c| c.abs());
            // An interval of K is relative already.
            let (factor, of_interval, decimals, unit) = match quantity {
                0 => (
                    triad.units.bias_factor,
                    triad.units.bias_factor,
                    triad.units.bias_decimals,
                    triad.units.in_table(0),
                ),
                _ => (1e6 / size, 1e6, 3, "ppm"),
            };
            let shown = |value: f64| format!("{value:.decimals$} {unit}");
            let _ = writeln!(
                text,
                "  {} {:22}  {:5}  {:>14}  {:>27}  {:>13}  {}",
                triad.names[axis],
                QUANTITIES[quantity],
                orders.choice.order,
                figure(largest_interval(&triad.curves[axis][quantity], quantity > 0), &|interval| format!(
                    "+- {:>7.decimals$} {unit}",
                    interval * of_interval
                )),
                figure(fit.leave_one_out_rms, &|rms| shown(rms * factor)),
                figure(fit.residual_sd, &|sd| shown(sd * factor)),
                orders.choice.reason.split(';').next().unwrap_or_default()
            );
        }
    }
    text
}

/// The misalignments of each sensor of a triad, without the end of the line.
fn misalignments(triad: &CalibratedTriad<'_>) -> [String; AXES] {
    [0, 1, 2].map(|axis| {
        let ([next, after], errors) = (triad.misalignment[axis], triad.misalignment_interval[axis]);
        let error = errors.unwrap_or([f64::NAN; 2]);
        format!(
            "  {} misalignment onto {} {:.3} +- {:.3}, onto {} {:.3} +- {:.3} [1e-6 rad, 95 %]",
            triad.names[axis],
            triad.names[(axis + 1) % AXES],
            next * 1e6,
            error[0] * 1e6,
            triad.names[(axis + 2) % AXES],
            after * 1e6,
            error[1] * 1e6,
        )
    })
}

fn g_sensitivities(found: &GyroscopeCalibration) -> String {
    let mut text = String::new();
    for (name, part) in GYROSCOPE_NAMES.iter().zip(&found.solution.gyroscopes) {
        let errors = part.g_sensitivity_interval(CONFIDENCE).unwrap_or([f64::NAN; AXES]);
        let values = part.g_sensitivity.iter().zip(errors).zip(AXIS_NAMES);
        let values = values.map(|((s, error), along)| format!("along {along} {s:.4} +- {error:.4}"));
        let _ = writeln!(text, "  {name} g-sensitivity {} [deg/h/g0, 95 %]", values.collect::<Vec<_>>().join(", "));
    }
    text
}

/// Earth's horizontal rate beside that of the latitude, if there are angles.
fn earth(found: &GyroscopeCalibration) -> Option<String> {
    let earth = found.earth?;
    let interval = found.horizontal_rate_interval(CONFIDENCE).unwrap_or(f64::NAN);
    Some(format!(
        "  Earth's horizontal rate {:.4} +- {interval:.4} [deg/h, 95 %], at the stated latitude {:.4}\n",
        earth.found, earth.expected
    ))
}

/// Whether the table has alignment matrices, and what it leaves without.
fn alignment(calibration: &Calibration) -> String {
    let of_gyroscopes = calibration.gyroscopes.as_ref().map(|found| found.left_without_alignment(&calibration.table));
    let aligned = calibration.table.content().alignment.is_some();
    let lacks = |left: String| {
        format!("  without an alignment matrix, which this IMU needs: misalignments leave up to {left} (--alignment)\n")
    };
    let of_rate = |left: f64| format!("{:.2}e-6 of the rate", left * 1e6);
    match (calibration.left_without_alignment().map(|left| format!("{:.2}e-6 g0", left * 1e6)), of_gyroscopes) {
        _ if aligned && of_gyroscopes.is_some() => {
            "  with alignment matrices of both triads; how the IMU sat on the fixture is part of them\n".to_owned()
        }
        _ if aligned => "  with an alignment matrix; how the IMU sat on the fixture is part of it\n".to_owned(),
        (Some(left), Some(Some(rate))) => lacks(format!("{left} and {}", of_rate(rate))),
        (Some(left), _) => lacks(left),
        (None, Some(Some(rate))) => lacks(of_rate(rate)),
        (None, _) => {
            "  without an alignment matrix: no misalignment exceeds its 99 % interval and 1e-6 rad\n".to_owned()
        }
    }
}

/// A figure that does not exist without degrees of freedom.
fn figure(value: Option<f64>, text: &dyn Fn(f64) -> String) -> String {
    value.map_or_else(|| "not known".to_owned(), text)
}

/// The stability of a recording: how many windows are judged, the paper's table 4, the hysteresis band, then the
/// verdict. `window` is the length of the windows \[s\]; `aligned` says whether the table has an alignment matrix.
#[must_use]
pub fn stability(stability: &Stability, window: f64, aligned: bool) -> String {
    let counted = stability.windows.iter().filter(|window| window.counts).count();
    let mut text = format!(
        "{}\nLocal gravity {}\n\nOutput stability: means over {window} s of output minus specific force [1e-6 g0]\n{}",
        stability.judged_windows(),
        stability.gravity_source,
        figures(&AXIS_NAMES, &stability.axes, MICRO_G0)
    );
    // Writing to a String cannot fail.
    let origin = match (stability.stated, stability.verdict.gravity_known) {
        (true, true) => "stated",
        (true, false) => "its direction stated, its length the median of the output",
        (false, _) => "the median of the output",
    };
    let _ = writeln!(text, "  specific force {}, {origin}", Force(stability.specific_force));
    let _ = writeln!(text, "  {counted} of {} windows at this attitude", stability.windows.len());
    if stability.left_out > 0 {
        let _ = writeln!(text, "  {} samples left out: their interval is 0 or over an hour", stability.left_out);
    }
    text.extend(within(stability.losses, "the recording"));
    let flagged = stability.windows.iter().filter(|window| window.flagged).count();
    if flagged > 0 {
        let _ = writeln!(
            text,
            "  {flagged} windows have flagged samples: telemetry out of the table's range or not plausible, or a lag that is not the table's"
        );
    }
    let _ = writeln!(text, "  covered: {}", stability.covered);
    let time = stability.time_fault.map(|fault| fault.to_string());
    for warning in time.into_iter().chain(stability.interval_warning()).chain(stability.attitude_warning()) {
        let _ = writeln!(text, "  {warning}");
    }
    text.push_str(&hysteresis(&AXIS_NAMES, &stability.loops, stability.unsettled_s, MICRO_G0, "1e-6 g0"));
    text.push('\n');
    text.push_str(&verdict(stability, aligned));
    match &stability.gyroscopes {
        Some(Ok(found)) => text.push_str(&gyroscopes(found, window, stability.unsettled_s)),
        Some(Err(reason)) => {
            let _ = writeln!(text, "The gyroscopes are not judged: {reason}.");
        }
        None => {}
    }
    text
}

/// Factor from a triad's base unit to that of a table, and its decimals.
type Shown = (f64, usize);
const MICRO_G0: Shown = (1e6, 3);
const DEGREES_PER_HOUR: Shown = (1.0, 4);

/// Table 4 of the paper for a triad, with its header.
fn figures(names: &[&str; AXES], axes: &[AxisStability; AXES], (factor, places): Shown) -> String {
    let mut text = "          frozen at mid temperature        full model\n          std. deviation  rms about zero   std. deviation  \
                    rms about zero   factor (std. dev.)\n"
        .to_owned();
    for (name, axis) in names.iter().zip(axes) {
        let _ = writeln!(
            text,
            "  {name} {:>18.places$} {:>15.places$} {:>16.places$} {:>15.places$} {:>12.2}",
            axis.sd_before * factor,
            axis.rms_before * factor,
            axis.sd_after * factor,
            axis.rms_after * factor,
            axis.factor()
        );
    }
    text
}

/// The hysteresis bands of a triad, with their header. If no axis is judged, a line says why.
fn hysteresis(
    names: &[&str; AXES],
    loops: &Loops,
    unsettled_s: Option<f64>,
    (factor, places): Shown,
    unit: &str,
) -> String {
    let bands = [0, 1, 2].map(|axis| loops.band(axis));
    if let [Err(a), Err(b), Err(c)] = bands
        && a == b
        && b == c
    {
        return format!("  hysteresis band not judged: {a}\n");
    }
    let mut text = format!(
        "\nHysteresis band: error in heating less that in cooling, rms over the bins of telemetry that have both [{unit}]\n          static model   \
         full model   bins\n"
    );
    // Writing to a String cannot fail.
    for (name, band) in names.iter().zip(bands) {
        let _ = match band {
            Ok(LoopBand { static_model, full, bins }) => {
                let static_model =
                    static_model.map_or_else(|| "-".to_owned(), |it| format!("{:.places$}", it * factor));
                let full = full * factor;
                writeln!(text, "  {name} {static_model:>17} {full:>12.places$} {bins:>3} of {BINS}")
            }
            Err(why) => writeln!(text, "  {name} not judged: {why}"),
        };
    }
    if loops.static_model.is_some() {
        text.push_str("  static model: the table without its transients\n");
    } else {
        text.push_str("  the table has no lag: there is one model only\n");
    }
    if let Some(seconds) = unsettled_s {
        let _ = writeln!(
            text,
            "  the first {seconds} s are left out of it, 3 time constants: there the lagged telemetry begins soaked, which the IMU may not have been"
        );
    }
    text
}

const ERRORS_HEADER: &str =
    "          constant            largest variation   worst               noise of a window   largest window";

/// A line of the table below that header, without its end.
fn errors_line(name: &str, errors: &Errors, (factor, places): Shown) -> String {
    let estimate = |it: Estimate| format!("{:.places$} +- {:.places$}", it.value * factor, it.interval * factor);
    format!(
        "  {name:<6}  {:<19} {:<19} {:<19} {:<19.places$} {:.places$}",
        errors.constant.map_or_else(|| "not judged".to_owned(), estimate),
        estimate(errors.variation),
        estimate(errors.worst),
        errors.noise * factor,
        errors.largest_window * factor
    )
}

/// The stability of the gyroscopes, then their errors.
fn gyroscopes(found: &GyroscopeStability, window: f64, unsettled_s: Option<f64>) -> String {
    let what = if found.earth_rate.is_some() { "Earth's rate" } else { "its median" };
    let mut text = format!(
        "\nGyroscopes: means over {window} s of output minus {what} [deg/h]\n{}",
        figures(&GYROSCOPE_NAMES, &found.axes, DEGREES_PER_HOUR)
    );
    if let Some(earth_rate) = found.earth_rate {
        let _ = writeln!(text, "  Earth's rate {earth_rate}");
    }
    let counted = found.windows.iter().filter(|window| window.counts).count();
    let _ = writeln!(text, "  {counted} of {} windows at rest", found.windows.len());
    let flagged = found.windows.iter().filter(|window| window.flagged).count();
    if flagged > 0 {
        let _ = writeln!(text, "  {flagged} windows have flagged samples of the gyroscopes");
    }
    let _ = writeln!(text, "  covered: {}", found.covered);
    text.push_str(&hysteresis(&GYROSCOPE_NAMES, &found.loops, unsettled_s, DEGREES_PER_HOUR, "deg/h"));
    let _ = writeln!(
        text,
        "\nErrors of the full model, means of {} groups of {} windows in order of time, 95 % [deg/h]\n{ERRORS_HEADER}      random walk [deg/sqrt(h)]",
        found.groups, found.windows_in_group
    );
    for ((name, errors), walk) in GYROSCOPE_NAMES.iter().zip(&found.errors).zip(found.random_walk) {
        let line = errors_line(name, errors, DEGREES_PER_HOUR);
        let _ = writeln!(text, "{line:<109} {:.5} +- {:.5}", walk.value, walk.interval);
    }
    if !found.aligned {
        text.push_str(
            "  the table has no alignment matrix of the gyroscopes: misalignments are part of these errors\n",
        );
    }
    if found.earth_rate.is_some() {
        text.push_str("  intervals: as above, those of constant and worst with the errors of Earth's rate\n");
    }
    if let Some([missing, remedy]) = found.missing() {
        let _ = writeln!(text, "  {missing}; {remedy}");
    }
    let _ = writeln!(text, "{}", found.conclusion());
    text
}

/// The errors that the run shows, with intervals, and the largest of them in words.
fn verdict(stability: &Stability, aligned: bool) -> String {
    let verdict = &stability.verdict;
    let mut text = format!(
        "Errors of the full model, means of {} groups of {} windows in order of time, 95 % [1e-6 g0]\n{ERRORS_HEADER}\n",
        verdict.groups, verdict.windows
    );
    let length = verdict.length.iter().map(|errors| ("length", errors));
    for (name, errors) in AXIS_NAMES.iter().copied().zip(&verdict.axes).chain(length).chain([("level", &verdict.level)])
    {
        let _ = writeln!(text, "{}", errors_line(name, errors, MICRO_G0));
    }
    match (&verdict.length, stability.gravity_source.value()) {
        (Some(_), _) => {
            let still = stability.windows.iter().filter(|window| window.still).count();
            let _ = writeln!(
                text,
                "  length: |output| minus local gravity, {still} still windows; level: across the specific force, 1e-6 rad"
            );
        }
        (None, Some(_)) => text.push_str("  the IMU was never still: the length of its output is not judged\n"),
        (None, None) => text.push_str("  local gravity is unknown: the length of the output is not judged\n"),
    }
    if !aligned {
        text.push_str("  the table has no alignment matrix: misalignments are part of these errors\n");
    }
    text.push_str("  intervals: of constant from slow changes of the run too, of variation and worst from the noise\n");
    if let Some([missing, remedy]) = verdict.missing() {
        let _ = writeln!(text, "  {missing}; {remedy}");
    }
    let _ = match stability.nothing_claimed() {
        Some(reason) => writeln!(text, "Nothing can be claimed: {reason}."),
        None => writeln!(text, "{}", verdict.conclusion()),
    };
    text
}

/// The judgement of each bound of a requirement, a line each.
#[must_use]
pub fn judgements(judgements: &[Judgement]) -> String {
    judgements.iter().fold(String::new(), |text, judgement| text + &judgement.message + "\n")
}
