//! Results as the text that the commands print.

use crate::calibrate::Calibration;
use crate::order::QUANTITIES;
use crate::stability::{Force, Stability};
use isotherm_shared::table::AXIS_NAMES;
use std::fmt::Write as _;

/// A calibration in a few lines: orders, errors, misalignments, tilt.
#[must_use]
pub fn calibration(calibration: &Calibration) -> String {
    let mut text = format!(
        "{} dwells at {} set points, {} fit, digest {}\n\n  curve                       order  leave-one-set-point-out rms    residual sd  why\n",
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
                "  {} {:22}  {:5}  {:>23.3} {unit}  {:>9.3} {unit}  {}",
                AXIS_NAMES[axis],
                QUANTITIES[quantity],
                orders.choice.order,
                fit.leave_one_out_rms.unwrap_or(f64::NAN) * factor,
                fit.residual_sd.unwrap_or(f64::NAN) * factor,
                orders.choice.reason.split(';').next().unwrap_or_default()
            );
        }
    }
    for (axis, part) in calibration.solution.axes.iter().enumerate() {
        let error = part.misalignment_error.unwrap_or([f64::NAN; 2]);
        let _ = writeln!(
            text,
            "  {} misalignment onto {} {:.3} +- {:.3}, onto {} {:.3} +- {:.3} [1e-6 rad]; residuals {:.3}e-6 g0 rms",
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
    text
}

/// The stability of a recording: the paper's table 4. `window` is the length of the windows \[s\]; `aligned` says whether the
/// table has an alignment matrix.
#[must_use]
pub fn stability(stability: &Stability, window: f64, aligned: bool) -> String {
    let counted = stability.windows.iter().filter(|window| window.counts).count();
    let mut text = format!(
        "Output stability: means over {window} s of output minus specific force [1e-6 g0]\n          frozen at mid temperature        \
         full model\n          std. deviation  rms about zero   std. deviation  rms about zero   factor (std. dev.)\n"
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
    let origin =
        if stability.stated { "stated" } else { "the median of the output, so that a constant error does not show" };
    let _ = writeln!(text, "  specific force {}, {origin}", Force(stability.specific_force));
    if stability.stated && !aligned {
        text.push_str("  the table has no alignment matrix: the rms about zero includes what misalignments make of this attitude\n");
    }
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
    match &stability.modulus {
        Some(modulus) => {
            let _ = writeln!(
                text,
                "\nLength of the output against local gravity, {} still windows [1e-6 g0]: mean {:.3}, rms {:.3}, worst {:.3}{}",
                modulus.windows,
                modulus.mean * 1e6,
                modulus.rms * 1e6,
                modulus.worst * 1e6,
                if aligned { "" } else { "\n  (the table has no alignment matrix: misalignments are part of it)" }
            );
        }
        None => text.push_str("\nThe IMU was never still: its output cannot be compared with gravity.\n"),
    }
    let worst = stability.axes.iter().map(|axis| axis.rms_after).fold(0.0, f64::max);
    let _ = writeln!(
        text,
        "What is left, {:.2}e-6 g0 at most, tilts a level by {:.2} arc seconds.",
        worst * 1e6,
        worst.to_degrees() * 3600.0
    );
    text
}
