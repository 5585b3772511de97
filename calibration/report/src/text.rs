//! Results as the text that the commands print.
//!
//! Over 400 lines: the lines of calibrations and of verifications, which have the same layout.

use super::parts;
use super::shown::{DEGREES_PER_HOUR, FLAGGED, FigureFormat, MICRO_G0, SOAKED, named_errors};
use isotherm_campaign::Dwell;
use isotherm_fit::{
    Accuracy, CalibratedTriad, Calibration, GyroscopeCalibration, Prediction, RampCalibration, Transients, TriadUnits,
    largest_band, largest_interval,
};
use isotherm_recording::Losses;
use isotherm_shared::table::{AXIS_NAMES, GYROSCOPE_NAMES};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{BINS, CONFIDENCE, Curve, QUANTITIES, band};
use isotherm_verification::{
    AxisStability, Errors, Estimate, Force, GyroscopeStability, Judgement, LoopBand, Loops, Stability, Window,
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
        "{} dwells{turns} at {} set points, {} fit, digest {}\n{losses}\n  curve                       order   95 % at a point   95 % of the whole  leave-one-set-point-out rms    residual sd  why\n",
        calibration.dwells.len(),
        calibration.set_points.len(),
        calibration.options.method.name(),
        calibration.table.digest(),
    );
    text.extend(triads.iter().map(curves));
    for (axis, line) in misalignments(&triads[0]).into_iter().enumerate() {
        text += &format!("{line}; residuals {:.3}e-6 g0 rms\n", calibration.residual_sd(axis) * 1e6);
    }
    if let (Some(found), Some(triad)) = (gyroscopes, triads.get(1)) {
        for (axis, line) in misalignments(triad).into_iter().enumerate() {
            text += &format!("{line}; random walk {:.5} deg/sqrt(h)\n", found.random_walk(axis));
        }
        text += &g_sensitivities(found);
    }
    if let Some([x, y]) = calibration.solution.tilt {
        text += &format!("  base tilted by {:.2} and {:.2} [1e-6 rad] about X and Y\n", x * 1e6, y * 1e6);
    }
    text.extend(gyroscopes.and_then(earth));
    text += &alignment(calibration);
    if let Some(found) = &calibration.transients {
        text.push('\n');
        text.extend(within(found.losses, "the ramps"));
        text += &transients(found, &calibration.table.content().temperature_unit);
    }
    text + "\n" + &accuracy(calibration, &triads)
}

/// The bottom line of each triad.
fn accuracy(calibration: &Calibration, triads: &[CalibratedTriad<'_>]) -> String {
    let line = |triad: &CalibratedTriad<'_>| {
        let accuracy = Accuracy::of_triad(calibration, triad);
        // Of one triad it is clear what is meant.
        let whose = if triads.len() > 1 { format!("{}s: ", triad.units.sensor) } else { String::new() };
        let caution = accuracy.caution().map_or_else(String::new, |caution| format!("  caution: {caution}\n"));
        format!("{whose}{accuracy}\n{caution}")
    };
    triads.iter().map(line).collect()
}

/// The line of what is missing within a recording or its parts, if anything is.
pub(super) fn within(losses: Losses, parts: &str) -> Option<String> {
    missing_within(losses, parts).map(|missing| format!("  {missing}\n"))
}

fn missing_within(losses: Losses, parts: &str) -> Option<String> {
    (!losses.is_none()).then(|| format!("within {parts}: {losses}"))
}

/// A calibration from ramps only, in a few lines: what the table does not know, and the transients.
#[must_use]
pub fn ramps(calibration: &RampCalibration) -> String {
    let (content, count) = (calibration.table.content(), calibration.recordings);
    let noun = if count == 1 { "recording" } else { "recordings" };
    let mut text = format!(
        "{}\n{count} {noun} of only ramps, curves {}, digest {}\n\nnot known:\n",
        calibration.transients.curve_errors(),
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
pub(crate) fn transients(found: &Transients, unit: &str) -> String {
    let line = |[name, unit, written, estimate, t_tau, fixed, hysteresis, lag, table, without, with]: [&str; 11]| {
        format!(
            "  {name:4} {unit:<13} {written:>12} {estimate:>24} {t_tau:>13}   {fixed:>10} {hysteresis:>10} {lag:>10} {table:>10}   \
             {without:>10} {with:>10}\n"
        )
    };
    let mut text =
        "transients, rms of the sweeps left out, and hysteresis band without and with the estimate:\n".to_owned();
    let (unit, estimate) = (format!("unit, per {unit}"), "estimate +- its error");
    let [fixed, hysteresis, lag, table] = ["static", "hysteresis", "with lag", "in a table"];
    text += &line(["", &unit, "written", estimate, "t tau / s", fixed, hysteresis, lag, table, "without", "with"]);
    for bias in &found.biases {
        let units = TriadUnits::of(bias.kind);
        let shown = |value: f64| format!("{:.*}", units.bias_decimals, value * units.bias_factor);
        let known = |value: Option<f64>| value.map_or_else(|| "not known".to_owned(), shown);
        let prediction = |of: fn(&Prediction) -> f64| known(bias.prediction.as_ref().map(of));
        text += &line([
            bias.name(),
            units.bias,
            &shown(bias.transient),
            &format!("{} +- {}", shown(bias.estimate), shown(bias.standard_error)),
            &format!("{:.1}", bias.estimate * units.bias_factor * found.time_constant.value_s),
            &prediction(|it| it.static_curve),
            &prediction(|it| it.hysteresis),
            &prediction(|it| it.lag_and_hysteresis),
            &prediction(|it| it.written),
            &known(band(&bias.before)),
            &known(band(&bias.after)),
        ]);
    }
    text.extend(found.words.iter().map(|sentence| format!("  {sentence}\n")));
    text
}

/// The curves of a triad, a line each.
fn curves(triad: &CalibratedTriad<'_>) -> String {
    (0..9).map(|index| curve(triad, index / 3, index % 3)).collect()
}

fn curve(triad: &CalibratedTriad<'_>, axis: usize, quantity: usize) -> String {
    let orders = &triad.orders[axis][quantity];
    let fit = orders.chosen();
    let (units, size) = (triad.units, fit.coefficients.first().map_or(1.0, |c| c.abs()));
    // An interval of K is relative already.
    let (factor, of_interval, decimals, unit) = match quantity {
        0 => (units.bias_factor, units.bias_factor, units.bias_decimals, units.in_table(0)),
        _ => (1e6 / size, 1e6, 3, "ppm"),
    };
    // A figure does not exist without degrees of freedom.
    let known = |value: Option<String>| value.unwrap_or_else(|| "not known".to_owned());
    let shown = |value: Option<f64>| known(value.map(|value| format!("{:.decimals$} {unit}", value * factor)));
    let widest = |of: fn(&Curve, bool) -> Option<f64>| {
        let half = of(&triad.curves[axis][quantity], quantity > 0);
        known(half.map(|half| format!("+- {:>7.decimals$} {unit}", half * of_interval)))
    };
    format!(
        "  {} {:22}  {:5}  {:>16}  {:>18}  {:>27}  {:>13}  {}\n",
        triad.names[axis],
        QUANTITIES[quantity],
        orders.choice.order,
        widest(largest_interval),
        widest(largest_band),
        shown(fit.leave_one_out_rms),
        shown(fit.residual_sd),
        orders.choice.reason.split(';').next().unwrap_or_default()
    )
}

/// The misalignments of each sensor of a triad, without the end of the line.
fn misalignments(triad: &CalibratedTriad<'_>) -> [String; AXES] {
    [0, 1, 2].map(|axis| {
        let ([next, after], errors) = (triad.misalignment[axis], triad.misalignment_interval[axis]);
        let [to_next, to_after] = [1, 2].map(|k| triad.names[(axis + k) % AXES]);
        let [next, after] = [next, after].map(|m| m * 1e6);
        let name = triad.names[axis];
        match errors.map(|errors| errors.map(|error| error * 1e6)) {
            Some([a, b]) => format!(
                "  {name} misalignment onto {to_next} {next:.3} +- {a:.3}, onto {to_after} {after:.3} +- {b:.3} [1e-6 rad, 95 %]"
            ),
            None => format!(
                "  {name} misalignment onto {to_next} {next:.3}, onto {to_after} {after:.3} [1e-6 rad], errors not known"
            ),
        }
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

/// Earth's horizontal rate next to that of the latitude, if there are angles.
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

/// The stability of a recording: how many windows are judged, the paper's table 4, the hysteresis band, then the
/// verdict. `window` is the length of the windows \[s\]; `aligned` says whether the table has an alignment matrix.
#[must_use]
pub fn stability(stability: &Stability, window: f64, aligned: bool) -> String {
    let mut text = parts::first_line(stability.made_the_table);
    text += &format!(
        "{}\nLocal gravity {}\n\nOutput stability: means over {window} s of output minus specific force [1e-6 g0]\n{}",
        stability.judged_windows(),
        stability.gravity_source,
        figures(AXIS_NAMES, &stability.axes, MICRO_G0)
    );
    text += &lines(remarks(stability));
    text += &hysteresis(AXIS_NAMES, &stability.loops, stability.unsettled_s, MICRO_G0);
    text.push('\n');
    text += &verdict(stability, aligned);
    match &stability.gyroscopes {
        Some(Ok(found)) => text + &gyroscopes(found, window, stability.unsettled_s),
        Some(Err(reason)) => text + &format!("The gyroscopes are not judged: {reason}.\n"),
        None => text,
    }
}

/// What is said of a recording below its figures, a line each.
fn remarks(stability: &Stability) -> [Option<String>; 9] {
    let origin = match (stability.stated, stability.verdict.gravity_known) {
        (true, true) => "stated",
        (true, false) => "its direction stated, its length the median of the output",
        (false, _) => "the median of the output",
    };
    let count = |of: fn(&Window) -> bool| stability.windows.iter().filter(|window| of(window)).count();
    let (counted, flagged, left_out) = (count(|it| it.counts), count(|it| it.flagged), stability.left_out);
    [
        Some(format!("specific force {}, {origin}", Force(stability.specific_force))),
        Some(format!("{counted} of {} windows at this attitude", stability.windows.len())),
        (left_out > 0).then(|| format!("{left_out} samples left out: their interval is 0 or over an hour")),
        missing_within(stability.losses, "the recording"),
        (flagged > 0).then(|| format!("{flagged} windows have flagged samples: {FLAGGED}")),
        Some(format!("covered: {}", stability.covered)),
        stability.time_fault.map(|fault| fault.to_string()),
        stability.interval_warning(),
        stability.attitude_warning(),
    ]
}

/// Remarks that there are, a line each.
fn lines<const COUNT: usize>(remarks: [Option<String>; COUNT]) -> String {
    remarks.into_iter().flatten().map(|remark| format!("  {remark}\n")).collect()
}

/// Table 4 of the paper for a triad, with its header.
fn figures(
    names: [&str; AXES],
    axes: &[AxisStability; AXES],
    FigureFormat { factor, places, .. }: FigureFormat,
) -> String {
    let mut text = "          frozen at mid temperature        full model\n          std. deviation  rms about zero   std. deviation  \
                    rms about zero   factor (std. dev.)\n"
        .to_owned();
    for (name, axis) in names.into_iter().zip(axes) {
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
fn hysteresis(names: [&str; AXES], loops: &Loops, unsettled_s: Option<f64>, shown: FigureFormat) -> String {
    let FigureFormat { factor, places, unit, .. } = shown;
    let bands = [0, 1, 2].map(|axis| loops.band(axis));
    if let [Err(a), Err(b), Err(c)] = bands
        && a == b
        && b == c
    {
        return format!("  hysteresis band not judged: {a}\n");
    }
    let line = |(name, band): (&str, Result<LoopBand, &str>)| match band {
        Ok(LoopBand { static_model, full, bins }) => {
            let static_model = static_model.map_or_else(|| "-".to_owned(), |it| format!("{:.places$}", it * factor));
            format!("  {name} {static_model:>17} {:>12.places$} {bins:>3} of {BINS}\n", full * factor)
        }
        Err(why) => format!("  {name} not judged: {why}\n"),
    };
    let lines: String = names.into_iter().zip(bands).map(line).collect();
    let models = match loops.static_model {
        Some(_) => "static model: the table without its transients",
        None => "the table has no lag: there is one model only",
    };
    let left_out = unsettled_s.map_or_else(String::new, |seconds| {
        format!("  the first {seconds} s are left out of it, 3 time constants: {SOAKED}\n")
    });
    format!(
        "\nHysteresis band: error in heating less that in cooling, rms over the bins of temperature that have both [{unit}]\n          static model   \
         full model   bins\n{lines}  {models}\n{left_out}"
    )
}

const ERRORS_HEADER: &str =
    "          constant            largest variation   worst               noise of a window   largest window";

/// A line of the table below that header, without its end.
fn errors_line(name: &str, errors: &Errors, FigureFormat { factor, places, .. }: FigureFormat) -> String {
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
    let count = |of: fn(&Window) -> bool| found.windows.iter().filter(|window| of(window)).count();
    let (counted, flagged) = (count(|it| it.counts), count(|it| it.flagged));
    let mut text = format!(
        "\nGyroscopes: means over {window} s of output minus {what} [deg/h]\n{}",
        figures(GYROSCOPE_NAMES, &found.axes, DEGREES_PER_HOUR)
    );
    let remarks = [
        found.earth_rate.map(|earth_rate| format!("Earth's rate {earth_rate}")),
        Some(format!("{counted} of {} windows at rest", found.windows.len())),
        (flagged > 0).then(|| format!("{flagged} windows have flagged samples of the gyroscopes")),
        Some(format!("covered: {}", found.covered)),
    ];
    text += &lines(remarks);
    text += &hysteresis(GYROSCOPE_NAMES, &found.loops, unsettled_s, DEGREES_PER_HOUR);
    text += &gyroscope_errors(found);
    text + &found.conclusion() + "\n"
}

/// The errors of the gyroscopes, and what is to be said of them.
fn gyroscope_errors(found: &GyroscopeStability) -> String {
    let mut text = format!(
        "\nErrors of the full model, means of {} groups of {} windows in order of time, 95 % [deg/h]\n{ERRORS_HEADER}      random walk [deg/sqrt(h)]\n",
        found.groups, found.windows_in_group
    );
    for ((name, errors), walk) in GYROSCOPE_NAMES.iter().zip(&found.errors).zip(found.random_walk) {
        let line = errors_line(name, errors, DEGREES_PER_HOUR);
        text += &format!("{line:<109} {:.5} +- {:.5}\n", walk.value, walk.interval);
    }
    let misaligned = "the table has no alignment matrix of the gyroscopes: misalignments are part of these errors";
    let intervals = "intervals: as above, those of constant and worst with the errors of Earth's rate";
    let remarks = [
        (!found.aligned).then(|| misaligned.to_owned()),
        found.earth_rate.map(|_| intervals.to_owned()),
        found.missing().map(|parts| parts.join("; ")),
    ];
    text += &lines(remarks);
    text
}

/// The errors that the run shows, with intervals, and the largest of them in words.
fn verdict(stability: &Stability, aligned: bool) -> String {
    let verdict = &stability.verdict;
    let mut text = format!(
        "Errors of the full model, means of {} groups of {} windows in order of time, 95 % [1e-6 g0]\n{ERRORS_HEADER}\n",
        verdict.groups, verdict.windows
    );
    text.extend(named_errors(stability).map(|(name, errors)| errors_line(name, errors, MICRO_G0) + "\n"));
    let still = stability.windows.iter().filter(|window| window.still).count();
    let length = match (&verdict.length, stability.gravity_source.value()) {
        (Some(_), _) => format!(
            "length: |output| minus local gravity, {still} still windows; level: across the specific force, 1e-6 rad"
        ),
        (None, Some(_)) => "the IMU was never still: the length of its output is not judged".to_owned(),
        (None, None) => "local gravity is unknown: the length of the output is not judged".to_owned(),
    };
    let misaligned = "the table has no alignment matrix: misalignments are part of these errors";
    let intervals = "intervals: of constant from slow changes of the run too, of variation and worst from the noise";
    let remarks = [
        Some(length),
        (!aligned).then(|| misaligned.to_owned()),
        Some(intervals.to_owned()),
        verdict.missing().map(|parts| parts.join("; ")),
    ];
    text += &lines(remarks);
    match stability.nothing_claimed() {
        Some(reason) => text + &format!("Nothing can be claimed: {reason}.\n"),
        None => text + &verdict.conclusion() + "\n",
    }
}

/// The judgement of each bound of a requirement, a line each.
#[must_use]
pub fn judgements(judgements: &[Judgement]) -> String {
    judgements.iter().fold(String::new(), |text, judgement| text + &judgement.message + "\n")
}
