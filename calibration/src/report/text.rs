//! Results as the text that the commands print.

use crate::accuracy::{Accuracy, largest_interval};
use crate::calibrate::Calibration;
use crate::curve::CONFIDENCE;
use crate::order::QUANTITIES;
use crate::requirement::Judgement;
use crate::stability::{Force, Stability};
use crate::verdict::Estimate;
use isotherm_shared::table::AXIS_NAMES;
use std::fmt::Write as _;

/// A calibration in a few lines: orders, errors, misalignments, tilt.
#[must_use]
pub fn calibration(calibration: &Calibration) -> String {
    let mut text = format!(
        "{} dwells at {} set points, {} fit, digest {}\n\n  curve                       order   95 % interval  leave-one-set-point-out rms    residual sd  why\n",
        calibration.dwells.len(),
        calibration.set_points.len(),
        calibration.options.method.name(),
        calibration.table.digest(),
    );
    // Writing to a String cannot fail.
    for (axis, tables) in calibration.orders.iter().enumerate() {
        for (quantity, orders) in tables.iter().enumerate() {
            let fit = &orders.regression.fits()[orders.choice.order];
            let size = fit.coefficients.first().map_or(1.0, |c| c.abs());
            let (factor, unit) = if quantity == 0 { (1e6, "ug0") } else { (1e6 / size, "ppm") };
            let _ = writeln!(
                text,
                "  {} {:22}  {:5}  {:>14}  {:>27}  {:>13}  {}",
                AXIS_NAMES[axis],
                QUANTITIES[quantity],
                orders.choice.order,
                figure(
                    largest_interval(&calibration.solution.axes[axis].curves[quantity], quantity > 0),
                    &|interval| format!("+- {:>7.3} {unit}", interval * 1e6)
                ),
                figure(fit.leave_one_out_rms, &|rms| format!("{:.3} {unit}", rms * factor)),
                figure(fit.residual_sd, &|sd| format!("{:.3} {unit}", sd * factor)),
                orders.choice.reason.split(';').next().unwrap_or_default()
            );
        }
    }
    for (axis, part) in calibration.solution.axes.iter().enumerate() {
        let error = part.misalignment_interval(CONFIDENCE).unwrap_or([f64::NAN; 2]);
        let _ = writeln!(
            text,
            "  {} misalignment onto {} {:.3} +- {:.3}, onto {} {:.3} +- {:.3} [1e-6 rad, 95 %]; residuals {:.3}e-6 g0 rms",
            AXIS_NAMES[axis],
            AXIS_NAMES[(axis + 1) % 3],
            part.misalignment[0] * 1e6,
            error[0] * 1e6,
            AXIS_NAMES[(axis + 2) % 3],
            part.misalignment[1] * 1e6,
            error[1] * 1e6,
            calibration.residual_sd(axis) * 1e6
        );
    }
    if let Some([x, y]) = calibration.solution.tilt {
        let _ = writeln!(text, "  base tilted by {:.2} and {:.2} [1e-6 rad] about X and Y", x * 1e6, y * 1e6);
    }
    let _ = match (calibration.table.content().alignment, calibration.left_without_alignment()) {
        (Some(_), _) => writeln!(text, "  with an alignment matrix; how the IMU sat on the fixture is part of it"),
        (None, Some(left)) => {
            let left = left * 1e6;
            writeln!(
                text,
                "  without an alignment matrix, which this IMU needs: misalignments leave up to {left:.2}e-6 g0 (--alignment)"
            )
        }
        (None, None) => {
            writeln!(text, "  without an alignment matrix: no misalignment exceeds its 99 % interval and 1e-6 rad")
        }
    };
    let accuracy = Accuracy::of(calibration);
    let _ = writeln!(text, "\n{accuracy}");
    if let Some(caution) = accuracy.caution() {
        let _ = writeln!(text, "  caution: {caution}");
    }
    text
}

/// A figure that does not exist without degrees of freedom.
fn figure(value: Option<f64>, text: &dyn Fn(f64) -> String) -> String {
    value.map_or_else(|| "not known".to_owned(), text)
}

/// The stability of a recording: the paper's table 4, then the verdict. `window` is the length of the windows \[s\]; `aligned` says
/// whether the table has an alignment matrix.
#[must_use]
pub fn stability(stability: &Stability, window: f64, aligned: bool) -> String {
    let counted = stability.windows.iter().filter(|window| window.counts).count();
    let mut text = format!(
        "Local gravity {}\n\nOutput stability: means over {window} s of output minus specific force [1e-6 g0]\n          frozen at mid temperature        \
         full model\n          std. deviation  rms about zero   std. deviation  rms about zero   factor (std. dev.)\n",
        stability.gravity_source
    );
    // Writing to a String cannot fail.
    for (name, axis) in AXIS_NAMES.iter().zip(&stability.axes) {
        let _ = writeln!(
            text,
            "  {name} {:>18.3} {:>15.3} {:>16.3} {:>15.3} {:>12.2}",
            axis.sd_before * 1e6,
            axis.rms_before * 1e6,
            axis.sd_after * 1e6,
            axis.rms_after * 1e6,
            axis.factor()
        );
    }
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
    let flagged = stability.windows.iter().filter(|window| window.flagged).count();
    if flagged > 0 {
        let _ = writeln!(
            text,
            "  {flagged} windows have flagged samples: telemetry out of the table's range, or not plausible"
        );
    }
    let _ = writeln!(text, "  covered: {}", stability.covered);
    if let Some(warning) = stability.interval_warning() {
        let _ = writeln!(text, "  {warning}");
    }
    text.push('\n');
    text.push_str(&verdict(stability, aligned));
    text
}

/// The errors that the run shows, with intervals, and the largest of them in words.
fn verdict(stability: &Stability, aligned: bool) -> String {
    let verdict = &stability.verdict;
    let mut text = format!(
        "Errors of the full model, means of {} groups of {} windows in order of time, 95 % [1e-6 g0]\n          constant            \
         largest variation   worst               noise of a window   largest window\n",
        verdict.groups, verdict.windows
    );
    let estimate = |estimate: Estimate| format!("{:.3} +- {:.3}", estimate.value * 1e6, estimate.interval * 1e6);
    let length = verdict.length.iter().map(|errors| ("length", errors));
    for (name, errors) in AXIS_NAMES.iter().copied().zip(&verdict.axes).chain(length).chain([("level", &verdict.level)])
    {
        let _ = writeln!(
            text,
            "  {name:<6}  {:<19} {:<19} {:<19} {:<19.3} {:.3}",
            errors.constant.map_or_else(|| "not judged".to_owned(), estimate),
            estimate(errors.variation),
            estimate(errors.worst),
            errors.noise * 1e6,
            errors.largest_window * 1e6
        );
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
