//! Results as the JSON that `--json` prints. Keys of figures have their unit at the end; `in_unit` is the `unit` of the
//! same object. The `value` and the half width `interval` of an estimate have the unit of its key. Counts, ratios and
//! texts have none. What is not known is null.

use isotherm_calibration::{
    Accuracy, BiasTransient, CalibratedTriad, Calibration, CalibrationError, Condition, GravityOnlyError,
    GyroscopeCalibration, RampCalibration, Transients, TriadObservability, TriadUnits, is_alignment_needed, is_needed,
    largest_interval,
};
use isotherm_campaign::Dwell;
use isotherm_failure::Failure;
use isotherm_finding::Finding;
use isotherm_recording::Losses;
use isotherm_shared::table::{AXIS_NAMES, GYROSCOPE_NAMES};
use isotherm_statistics::{CONFIDENCE, QUANTITIES, band};
use isotherm_verification::{Coverage, Errors, GyroscopeStability, LeftOut, Loops, Requirement, Stability};
use serde_json::{Value, json};

/// A calibration: digest, bottom line, curves, misalignments and findings; of an IMU with gyroscopes also theirs.
/// `locate` gives file and line of a row.
#[must_use]
pub fn calibration(calibration: &Calibration, locate: impl Fn(u64) -> String) -> Value {
    let triad = CalibratedTriad::accelerometers(calibration);
    let accuracy = Accuracy::of_triad(calibration, &triad);
    let (content, solution) = (calibration.table.content(), &calibration.solution);
    let axis = |axis: usize| {
        json!({
            "axis": AXIS_NAMES[axis],
            "bias_interval_g0": accuracy.bias[axis],
            "scale_factor_interval_ppm": accuracy.scale_factor[axis].map(|part| part * 1e6),
            "misalignment_rad": triad.misalignment[axis],
            "misalignment_interval_rad": triad.misalignment_interval[axis],
            "residual_sd_g0": calibration.residual_sd(axis),
        })
    };
    let mut document = json!({
        "imu": content.imu.to_string(),
        "digest": calibration.table.digest().to_string(),
        "method": calibration.options.method.name(),
        "set_points": calibration.set_points.len(),
        "dwells": calibration.dwells.len(),
        "accuracy": accuracy.to_string(),
        "caution": accuracy.caution(),
        "range_in_unit": accuracy.range,
        "unit": accuracy.unit,
        "axes": [axis(0), axis(1), axis(2)],
        "curves": curves(&triad),
        "tilt_rad": solution.tilt,
        "alignment": content.alignment.is_some(),
        "alignment_needed": is_needed(solution),
        "left_without_alignment_g0": calibration.left_without_alignment(),
        "accepted": calibration.accepted,
        "losses": losses(calibration.dwells.iter().map(Dwell::losses).fold(Losses::default(), Losses::and)),
        "findings": findings(&calibration.findings, &locate),
    });
    if let Some(found) = &calibration.gyroscopes {
        document["gyroscopes"] = gyroscopes(calibration, found);
    }
    if let Some(found) = &calibration.transients {
        document["transients"] = transients(found);
    }
    document
}

/// A calibration from ramps alone: digest, what the table does not know, transients and findings. `locate` gives file
/// and line of a row.
#[must_use]
pub fn ramps(calibration: &RampCalibration, locate: impl Fn(u64) -> String) -> Value {
    let content = calibration.table.content();
    json!({
        "imu": content.imu.to_string(),
        "digest": calibration.table.digest().to_string(),
        "curves_digest": calibration.curves.digest().to_string(),
        "method": "ramps",
        "ramps": calibration.recordings,
        "accuracy": calibration.accuracy(),
        "not_known": calibration.not_known(),
        "unit": content.temperature_unit,
        "transients": transients(&calibration.transients),
        "accepted": calibration.accepted,
        "findings": findings(&calibration.findings, &locate),
    })
}

/// What the ramps show. The figures of a bias are in its `unit`: `transient`, `estimate` and `standard_error` per unit
/// of telemetry, `t_tau` times seconds.
fn transients(found: &Transients) -> Value {
    let tau = &found.time_constant;
    let condition = |condition: &Condition| {
        json!({
            "name": condition.name,
            "figure": condition.figure,
            "limit": condition.limit,
            "must_be": if condition.above { "above" } else { "below" },
            "met": condition.met,
            "decides": condition.decides,
        })
    };
    let conditions = |all: &[Condition]| all.iter().map(condition).collect::<Vec<_>>();
    let bias = |bias: &BiasTransient| {
        let units = TriadUnits::of(bias.kind);
        let shown = |value: f64| value * units.bias_factor;
        json!({
            "name": bias.name(),
            "unit": units.bias,
            "transient": shown(bias.transient),
            "estimate": shown(bias.estimate),
            "standard_error": shown(bias.standard_error),
            "t_tau": shown(bias.estimate * tau.value_s),
            "prediction": bias.prediction.map(|it| json!({
                "static": shown(it.static_curve),
                "hysteresis": shown(it.hysteresis),
                "lag_and_hysteresis": shown(it.lag_and_hysteresis),
                "written": shown(it.written),
            })),
            "band": { "before": band(&bias.before).map(shown), "after": band(&bias.after).map(shown) },
            "carried_g0": bias.carried_g0,
            "conditions": conditions(&bias.conditions),
        })
    };
    json!({
        "verdict": found.verdict.name(),
        "losses": losses(found.losses),
        "words": found.words,
        "time_constant": {
            "value_s": tau.value_s,
            "interval_s": tau.interval_s,
            "given": tau.given,
            "kept": tau.kept,
            "at_end": tau.at_end,
            "search": tau.search.iter().map(|(s, objective)| json!({ "s": s, "objective": objective })).collect::<Vec<_>>(),
        },
        "conditions": conditions(&found.conditions),
        "biases": found.biases.iter().map(bias).collect::<Vec<_>>(),
        "warnings": found.warnings,
    })
}

/// The curves of a triad, in the units of the fit.
fn curves(triad: &CalibratedTriad<'_>) -> Vec<Value> {
    let curve = |axis: usize, quantity: usize| {
        let orders = &triad.orders[axis][quantity];
        let fit = &orders.regression.fits()[orders.choice.order];
        json!({
            "axis": triad.names[axis],
            "quantity": QUANTITIES[quantity],
            "unit": triad.units.in_fit(quantity),
            "order": orders.choice.order,
            "reason": orders.choice.reason,
            "leave_one_set_point_out_rms_in_unit": fit.leave_one_out_rms,
            "residual_sd_in_unit": fit.residual_sd,
            "largest_interval_in_unit": largest_interval(&triad.curves[axis][quantity], false),
        })
    };
    (0..9).map(|index| curve(index / 3, index % 3)).collect()
}

/// The part of a calibration that the gyroscopes are.
fn gyroscopes(calibration: &Calibration, found: &GyroscopeCalibration) -> Value {
    let triad = CalibratedTriad::gyroscopes(calibration, found);
    let accuracy = Accuracy::of_triad(calibration, &triad);
    let axis = |axis: usize| {
        let part = &found.solution.gyroscopes[axis];
        json!({
            "axis": triad.names[axis],
            "bias_interval_deg_h": accuracy.bias[axis],
            "scale_factor_interval_ppm": accuracy.scale_factor[axis].map(|part| part * 1e6),
            "misalignment_rad": triad.misalignment[axis],
            "misalignment_interval_rad": triad.misalignment_interval[axis],
            "g_sensitivity_deg_h_g0": part.g_sensitivity,
            "g_sensitivity_interval_deg_h_g0": part.g_sensitivity_interval(CONFIDENCE),
            "random_walk_deg_sqrt_h": found.random_walk(axis),
        })
    };
    let earth = found.earth.as_ref().map(|earth| {
        json!({
            "rate_deg_h": found.solution.earth.map(|[x, y]| [x, y, earth.along_z]),
            "rate_standard_error_deg_h": found.solution.earth_error,
            "horizontal_rate_deg_h": earth.found,
            "horizontal_rate_interval_deg_h": found.horizontal_rate_interval(CONFIDENCE),
            "horizontal_rate_of_latitude_deg_h": earth.expected,
        })
    });
    let left_over = found.left_over.as_ref().map(|left| {
        json!({
            "bias_deg_h": left.bias,
            "scale_factor_ppm": left.scale_factor * 1e6,
            "g_sensitivity_deg_h_g0": left.g_sensitivity,
            "misalignment_rad": left.misalignment,
            "from": left.from,
        })
    });
    let TriadObservability { rank, unknowns, condition, .. } = found.observability;
    json!({
        "turns": found.turns(),
        "accuracy": accuracy.to_string(),
        "caution": accuracy.caution(),
        "range_in_unit": accuracy.range,
        "axes": [axis(0), axis(1), axis(2)],
        "curves": curves(&triad),
        "earth": earth,
        "left_over": left_over,
        "alignment_needed": is_alignment_needed(&found.solution),
        "left_without_alignment_rad": found.left_without_alignment(&calibration.table),
        "observability": { "rank": rank, "unknowns": unknowns, "condition": condition },
    })
}

/// A failure: what is printed to stderr, the exit code, and file and line of the cause where they are known.
///
/// ```
/// use isotherm_failure::{Exit, Failure};
/// use isotherm_report::json;
/// use std::path::Path;
///
/// let failure = Failure::new(Exit::Data, "samples.csv:7: no number").at(Path::new("samples.csv"), Some(7));
/// let document = json::failure(&failure);
/// assert_eq!((&document["exit_code"], &document["line"]), (&65.into(), &7.into()));
/// ```
#[must_use]
pub fn failure(failure: &Failure) -> Value {
    let (file, line) =
        failure.place.as_ref().map_or((None, None), |(file, line)| (Some(file.to_string_lossy()), *line));
    json!({
        "error": failure.message,
        "exit_code": failure.exit as u8,
        "file": file,
        "line": line,
    })
}

/// Why there is no table: the failure as above, the diagnosis and all findings. `locate` gives file and line of a row.
#[must_use]
pub fn refusal(error: &CalibrationError, failure: &Failure, locate: impl Fn(u64) -> String) -> Value {
    let (diagnosis, findings) = match error {
        CalibrationError::Faults { diagnosis, findings } => (diagnosis.as_deref(), findings.as_slice()),
        _ => (None, &[][..]),
    };
    let mut document = self::failure(failure);
    document["diagnosis"] = json!(diagnosis.map(|diagnosis| diagnosis.finding.record(&locate)));
    document["findings"] = self::findings(findings, &locate);
    if let CalibrationError::GravityOnly(error) = error {
        let (parameters, attitude) = match error {
            GravityOnlyError::Attitudes { parameters, attitude, .. } => (Some(parameters), Some(attitude)),
            _ => (None, None),
        };
        document["parameters"] = json!(parameters);
        document["attitude"] = json!(attitude);
    }
    document
}

/// The findings as JSON documents have them. `locate` gives file and line of a row.
pub fn findings<'a>(all: impl IntoIterator<Item = &'a Finding>, locate: impl Fn(u64) -> String) -> Value {
    all.into_iter().map(|finding| json!(finding.record(&locate))).collect()
}

/// A verification: table 4, the verdict and the judgement of what is required. `window_s` is the length of the windows
/// \[s\].
#[must_use]
pub fn verification(stability: &Stability, window_s: f64, required: Option<Requirement>) -> Value {
    let verdict = &stability.verdict;
    let axis = |axis: usize| {
        let figures = &stability.axes[axis];
        let mut value = errors(&verdict.axes[axis], "g0");
        value["axis"] = json!(AXIS_NAMES[axis]);
        value["sd_before_g0"] = json!(figures.sd_before);
        value["rms_before_g0"] = json!(figures.rms_before);
        value["sd_after_g0"] = json!(figures.sd_after);
        value["rms_after_g0"] = json!(figures.rms_after);
        value["factor"] = json!(figures.factor());
        value["hysteresis"] = hysteresis(&stability.loops, axis, "g0");
        value
    };
    let (name, worst) = verdict.largest();
    let claimed = stability.nothing_claimed().is_none();
    let largest = claimed.then(|| json!({ "of": name, "value_g0": worst.value, "interval_g0": worst.interval }));
    let judgements = required.map(|required| required.judge(stability));
    let mut document = json!({
        "window_s": window_s,
        "windows": stability.windows.len(),
        "windows_at_attitude": stability.windows.iter().filter(|window| window.counts).count(),
        "windows_left_out": left_out(&stability.windows_left_out),
        "samples_left_out": stability.left_out,
        "losses": losses(stability.losses),
        "findings": findings(&stability.findings(required.is_some()), |line| line.to_string()),
        "time_warning": stability.time_fault.map(|fault| fault.to_string()),
        "attitude_stated": stability.stated,
        "specific_force_g0": stability.specific_force,
        "gravity_local_m_s2": stability.gravity_source.value(),
        "gravity_source": stability.gravity_source.name(),
        "groups": verdict.groups,
        "windows_in_group": verdict.windows,
        "axes": [axis(0), axis(1), axis(2)],
        "length": verdict.length.as_ref().map(|length| errors(length, "g0")),
        "level": errors(&verdict.level, "rad"),
        "largest": largest,
        "required": required.map(|required| required.to_string()),
        "judgements": judgements.as_ref().map(|judgements| json!(judgements)),
        "met": judgements.map(|judgements| judgements.iter().all(|judgement| judgement.met)),
        "not_judged": verdict.missing().map(|parts| parts.join("; ")),
        "not_at_rest_or_other_imu": stability.gravity_mismatch(),
        "not_the_whole_run": stability.unjudged(),
        "too_short_for_a_requirement": stability.too_short(),
        "interval_ratio": stability.interval_ratio,
        "interval_warning": stability.interval_warning(),
        "attitude_warning": stability.attitude_warning(),
        "hysteresis_left_out_s": stability.unsettled_s,
        "covered": covered(&stability.covered),
    });
    match &stability.gyroscopes {
        Some(Ok(found)) => document["gyroscopes"] = gyroscope_stability(found),
        Some(Err(reason)) => document["gyroscopes"] = json!({ "not_judged": reason }),
        None => {}
    }
    document
}

/// The part of a verification about the gyroscopes.
fn gyroscope_stability(found: &GyroscopeStability) -> Value {
    let axis = |axis: usize| {
        let figures = &found.axes[axis];
        let mut value = errors(&found.errors[axis], "deg_h");
        value["axis"] = json!(GYROSCOPE_NAMES[axis]);
        value["random_walk_deg_sqrt_h"] = json!(found.random_walk[axis]);
        value["hysteresis"] = hysteresis(&found.loops, axis, "deg_h");
        value["sd_before_deg_h"] = json!(figures.sd_before);
        value["rms_before_deg_h"] = json!(figures.rms_before);
        value["sd_after_deg_h"] = json!(figures.sd_after);
        value["rms_after_deg_h"] = json!(figures.rms_after);
        value["factor"] = json!(figures.factor());
        value
    };
    let claimed = found.unjudged().is_none();
    let (name, worst) = found.largest();
    json!({
        "axes": [axis(0), axis(1), axis(2)],
        "earth_rate_deg_h": found.earth_rate.map(|earth| earth.rate),
        "earth_rate_interval_deg_h": found.earth_rate.and_then(|earth| earth.interval),
        "windows_left_out": left_out(&found.windows_left_out),
        "windows_at_rest": found.windows.iter().filter(|window| window.counts).count(),
        "groups": found.groups,
        "windows_in_group": found.windows_in_group,
        "largest": claimed.then(|| json!({ "of": name, "value_deg_h": worst.value, "interval_deg_h": worst.interval })),
        "not_judged": found.missing().map(|parts| parts.join("; ")),
        "not_the_whole_run": found.unjudged(),
        "covered": covered(&found.covered),
    })
}

/// The windows that are not judged, by cause; in words even if there are none.
fn left_out(left_out: &LeftOut) -> Value {
    json!({
        "count": left_out.count(),
        "not_a_number": left_out.not_a_number,
        "not_still": left_out.moved,
        "elsewhere": left_out.elsewhere,
        "by_accelerometers": left_out.by_accelerometers,
        "words": left_out.to_string(),
    })
}

/// Rows that are missing by their sequences, and steps of time.
pub(super) fn losses(found: Losses) -> Value {
    json!({ "missing": found.missing, "gaps": found.gaps, "time_steps": found.time_steps })
}

/// The hysteresis band of an axis for the static and the full model, or why it is not judged.
fn hysteresis(loops: &Loops, axis: usize, unit: &str) -> Value {
    let band = loops.band(axis);
    let found = band.ok();
    let keys = [
        (format!("static_{unit}"), json!(found.map(|band| band.static_model))),
        (format!("full_{unit}"), json!(found.map(|band| band.full))),
        ("shared_bins".to_owned(), json!(found.map(|band| band.bins))),
        ("not_judged".to_owned(), json!(band.err())),
    ];
    keys.into_iter().collect()
}

/// Of each axis the telemetry of run and table, and the part of the table's range that the run covers; the channels
/// that the run drives.
fn covered(covered: &Coverage) -> Value {
    let sensor = |axis: usize, k: usize| {
        json!({
            "run_in_unit": covered.telemetry[axis][k],
            "table_in_unit": covered.table[axis][k],
            "part": covered.parts()[axis][k],
        })
    };
    let axis = |axis: usize| json!({ "axis": covered.kind.names()[axis], "bias": sensor(axis, 0), "scale_factor": sensor(axis, 1) });
    json!({
        "unit": covered.unit,
        "axes": [axis(0), axis(1), axis(2)],
        "channels": covered.channels(),
        "words": covered.to_string(),
    })
}

fn errors(errors: &Errors, unit: &str) -> Value {
    let figures = [
        ("constant", json!(errors.constant)),
        ("variation", json!(errors.variation)),
        ("worst", json!(errors.worst)),
        ("noise_of_window", json!(errors.noise)),
        ("largest_window", json!(errors.largest_window)),
    ];
    figures.into_iter().map(|(key, value)| (format!("{key}_{unit}"), value)).collect()
}
