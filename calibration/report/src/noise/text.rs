//! The noise of an IMU as the text that the command prints.

use core::f64::consts::SQRT_2;
use isotherm_analysis::{
    Allan, COEFFICIENTS, Coefficient, FLICKER_FLOOR, ModelFit, NoiseAnalysis, NoiseUnits, SensorNoise, TemperatureLine,
};
use std::fmt::Write as _;

/// The rows, then each sensor's coefficients, then the Allan deviations with their intervals.
#[must_use]
pub fn text(analysis: &NoiseAnalysis) -> String {
    let mut text = format!("{}\n", rows(analysis));
    for sensor in &analysis.sensors {
        text += "\n";
        text += &self::sensor(sensor, &analysis.temperature_unit);
    }
    text + "\n" + &deviations(analysis)
}

/// Which rows are analysed.
pub(crate) fn rows(analysis: &NoiseAnalysis) -> String {
    let [from, to] = analysis.used_s;
    let mut text = format!(
        "rows {} to {} of {}, {from:.1} s to {to:.1} s, one every {:.6} s: the longest stretch at rest without a {}gap",
        analysis.used.start + 1,
        analysis.used.end,
        analysis.rows,
        analysis.interval_s,
        if analysis.bridged.rows > 0 { "long " } else { "" }
    );
    if !analysis.losses.is_none() {
        text += &format!("\nin the recording: {}", analysis.losses);
    }
    for finding in &analysis.of_recording {
        text += &format!("\n{finding}");
    }
    text
}

fn sensor(sensor: &SensorNoise, temperature_unit: &str) -> String {
    let units = sensor.kind.units();
    let Some(allan) = &sensor.allan else { return format!("{}: the counts never change\n", sensor.name) };
    let mut text = format!("{:30} {:>11}   {:24} unit\n", sensor.name, "value", "95 % range");
    text += &curve(allan, &units, "  ");
    if let Some(steps) = sensor.limit_cycle() {
        let _ =
            writeln!(text, "  the noise is smaller than a step of the counts, {steps:.2} steps a row (limit cycle)");
    }
    if let Some(line) = &sensor.line {
        let slope = format!("  slope over head temperature {} per {temperature_unit}", slope(line, &units));
        if let Some(from_s) = line.contaminated_from_s {
            let _ = writeln!(text, "{slope}; contaminated from tau = {from_s:.4} s. Without the slope:");
            text += &curve(&line.without, &units, "    ");
        } else {
            let _ = writeln!(text, "{slope}; no contamination shows");
        }
    }
    text
}

/// A slope with its 95 % interval, less the unit of the temperature.
pub(crate) fn slope(line: &TemperatureLine, units: &NoiseUnits) -> String {
    let interval = line.slope_error.map_or_else(String::new, |error| format!(" +- {:.1e}", 1.96 * error));
    format!("{:.3e}{interval} {}", line.slope, units.rate)
}

/// The coefficients, what is to be said of them, and the minimum of the curve.
fn curve(allan: &Allan, units: &NoiseUnits, indent: &str) -> String {
    let mut lines = match &allan.model {
        Some(model) => fit(allan, model, units, indent),
        None => vec!["the model cannot be fitted: the counts repeat a pattern".to_owned()],
    };
    if let Some(point) = allan.minimum() {
        let interval = point.interval.map_or_else(String::new, |[low, high]| format!(" ({low:.3e} .. {high:.3e})"));
        let end = if allan.falls_to_the_end() { ", the longest tau: it may fall further" } else { "" };
        let (adev, tau_s, rate) = (point.adev, point.tau_s, units.rate);
        lines.push(format!("minimum of the curve: {adev:.3e}{interval} {rate} at tau = {tau_s:.4} s{end}"));
    }
    lines.iter().map(|line| format!("{indent}{line}\n")).collect()
}

/// The lines of a model, which will be indented.
fn fit(allan: &Allan, model: &ModelFit, units: &NoiseUnits, indent: &str) -> Vec<String> {
    let coefficient = |(k, coefficient): (usize, &Coefficient)| {
        let (unit, factor) = units.coefficients[k];
        let [value, range] = if allan.gives(k) { shown(coefficient, factor) } else { NOT_GIVEN.map(str::to_owned) };
        let (name, width) = (format!("{} {}", COEFFICIENTS[k], units.names[k]), 30 - indent.len());
        format!("{name:width$} {value:>11}   {range:24} {unit}")
    };
    let mut lines: Vec<_> = model.coefficients.iter().enumerate().map(coefficient).collect();
    let [_, white, flicker, _] = &model.coefficients;
    let (two_sided, one_sided) = (either(white, 1.0), either(white, SQRT_2));
    let holds = if model.holds() { "holds" } else { "does not hold, no ranges are given" };
    let [from_s, to_s] = model.fitted_s;
    lines.extend([
        format!("density of N: two-sided {two_sided}, one-sided (data sheets) {one_sided} {}", units.density),
        format!("floor of B, 0.664 B: {} {}", either(flicker, FLICKER_FLOOR), units.rate),
        format!(
            "the model {holds}: chi-square {:.1} for {} degrees of freedom, tau from {from_s:.4} s to {to_s:.4} s",
            model.chi_square, model.freedom
        ),
    ]);
    lines
}

/// Value and range of a coefficient that the curve does not give.
pub(crate) const NOT_GIVEN: [&str; 2] = ["not given", ""];

/// Value and range of a coefficient.
pub(crate) fn shown(coefficient: &Coefficient, factor: f64) -> [String; 2] {
    match (coefficient.below(), coefficient.range) {
        (Some(below), _) => ["below".to_owned(), format!("{:.3e}", below * factor)],
        (None, Some([low, high])) => {
            [format!("{:.3e}", coefficient.value * factor), format!("{:.3e} .. {:.3e}", low * factor, high * factor)]
        }
        (None, None) => [format!("{:.3e}", coefficient.value * factor), "not given".to_owned()],
    }
}

/// The value of a coefficient, or what it is below.
pub(crate) fn either(coefficient: &Coefficient, factor: f64) -> String {
    match coefficient.below() {
        Some(below) => format!("below {:.3e}", below * factor),
        None => format!("{:.3e}", coefficient.value * factor),
    }
}

/// The Allan deviations of all sensors, a line for each tau, and how wide the last intervals are.
fn deviations(analysis: &NoiseAnalysis) -> String {
    let shown: Vec<_> = analysis.sensors.iter().filter_map(|sensor| Some((sensor, sensor.allan.as_ref()?))).collect();
    let mut text = "Allan deviation (95 % interval)\n".to_owned();
    let _ = write!(text, "{:>12}", "tau / s");
    for (sensor, _) in &shown {
        let _ = write!(text, "   {:33}", format!("{} [{}]", sensor.name, sensor.kind.units().rate));
    }
    let lines = shown.first().map_or(0, |(_, allan)| allan.points.len());
    for line in 0..lines {
        let _ = write!(text, "\n{:>12.4}", shown[0].1.points[line].tau_s);
        for (_, allan) in &shown {
            let point = &allan.points[line];
            let interval = point.interval.map_or_else(String::new, |[low, high]| format!("({low:.3e} .. {high:.3e})"));
            let _ = write!(text, "   {:9.3e} {interval:23}", point.adev);
        }
    }
    text.push('\n');
    for sentence in shown.iter().filter_map(|(sensor, allan)| width(sensor.name, allan)) {
        let _ = writeln!(text, "{sentence}");
    }
    text.lines().map(str::trim_end).collect::<Vec<_>>().join("\n") + "\n"
}

/// How wide the interval of the last point is.
pub(crate) fn width(name: &str, allan: &Allan) -> Option<String> {
    let point = allan.points.last()?;
    let [low, high] = point.interval?;
    Some(format!(
        "{name}: at tau = {:.4} s, a third of the stretch, the ends of the interval are {:.1} times apart",
        point.tau_s,
        high / low
    ))
}
