//! The report of the noise of an IMU: coefficients, curves with their intervals, and the model with its parts.

pub mod json;
pub mod text;

use super::page::{Cell, Column, NoteKind, Page};
use super::plot::{Plot, Style};
use super::quantity::{digits, divisor, fitting, with_unit};
use crate::parts::file_names;
use core::f64::consts::SQRT_2;
use isotherm_analysis::{
    Allan, AllanPoint, COEFFICIENTS, Coefficient, FLICKER_FLOOR, NoiseAnalysis, NoiseUnits, SensorNoise,
};
use maud::Markup;

/// What the report states in addition to the analysis; only the caller knows it.
#[derive(Clone, Debug)]
pub struct NoiseSource {
    /// Program and version.
    pub tool: String,
    /// Time of the analysis as RFC 3339 in UTC.
    pub time: String,
    /// Name of the recording.
    pub recording: String,
    /// Name of the table file and digest of the table, if there is one.
    pub table: Option<[String; 2]>,
    /// The IMU.
    pub imu: String,
}

/// The page as HTML.
#[must_use]
pub fn html(analysis: &NoiseAnalysis, source: &NoiseSource) -> String {
    let title = format!("Noise of {}", source.imu);
    let mut page = Page::new(&title, &format!("{} · {} · {}", file_names(&source.recording), source.time, source.tool));
    page.heading(2, "result", "Result");
    let [from, to] = analysis.used_s;
    page.paragraph(&format!("The noise of {} sensors, from {:.1} s at rest.", analysis.sensors.len(), to - from));
    for kind in analysis.sensors.chunk_by(|a, b| a.kind == b.kind) {
        summary(&mut page, kind);
    }
    let findings = analysis.findings();
    page.findings(&findings, |_| String::new());
    if findings.is_empty() {
        page.note(NoteKind::Good, "The model holds for every sensor", "");
    }
    for each in &analysis.sensors {
        sensor(&mut page, each, &analysis.temperature_unit);
    }
    deviations(&mut page, analysis);
    meaning(&mut page);
    page.heading(2, "provenance", "Provenance");
    let mut rows = vec![
        ("Tool", source.tool.clone()),
        ("Time", source.time.clone()),
        ("Recording", source.recording.clone()),
        ("Part of it", text::rows(analysis)),
    ];
    if let Some([file, digest]) = &source.table {
        rows.extend([("Table file", file.clone()), ("Table", digest.clone())]);
    }
    page.key_values(&rows);
    page.finish()
}

/// The page of rates whose unit is not known, by this program.
#[must_use]
pub fn rates_html(allan: &Allan, tool: &str) -> String {
    let mut page = Page::new("Noise of rates", tool);
    page.heading(2, "result", "Result");
    coefficients(&mut page, "the rates", allan, &json::RATES);
    page.figures(&[figure("Rates", allan, &json::RATES)]);
    meaning(&mut page);
    page.finish()
}

/// The coefficients of sensors of one kind, and the minima of their curves.
fn summary(page: &mut Page, sensors: &[SensorNoise]) {
    let units = sensors[0].kind.units();
    let curves = || sensors.iter().filter_map(|sensor| sensor.allan.as_ref());
    let all = |k: usize| curves().filter_map(move |allan| Some(allan.model.as_ref()?.coefficients[k].value));
    let (mut header, mut scales) = (vec!["Sensor".to_owned()], Vec::new());
    for (k, letter) in COEFFICIENTS.iter().enumerate() {
        let (unit, factor) = units.coefficients[k];
        let (fit, unit) = fitting(unit, all(k).fold(0.0, f64::max) * factor);
        header.push(format!("{letter} {} / {}", units.names[k], divisor(&unit)));
        scales.push(factor * fit);
    }
    let (factor, unit) = fitting(units.rate, curves().filter_map(Allan::minimum).map(|it| it.adev).fold(0.0, f64::max));
    header.push(format!("Minimum of the curve / {}", divisor(&unit)));
    let row = |sensor: &SensorNoise| {
        let allan = sensor.allan.as_ref();
        let cell = |(k, scale): (usize, &f64)| {
            let found = allan.and_then(|allan| Some((allan, &allan.model.as_ref()?.coefficients[k])));
            let words = found.map(|(allan, it)| in_print(allan, k, it, *scale));
            Cell::Number(words.map_or_else(
                || "not known".to_owned(),
                |[value, range]| match range.as_str() {
                    "" | "not given" => value,
                    range => format!("{value} ({range})"),
                },
            ))
        };
        let minimum = allan.and_then(Allan::minimum).map_or(f64::NAN, |it| it.adev * factor);
        let mut cells = vec![Cell::text(sensor.name)];
        cells.extend(scales.iter().enumerate().map(cell));
        cells.push(Cell::Number(digits(minimum, 3)));
        cells
    };
    let header: Vec<_> = header.iter().map(String::as_str).collect();
    page.compact_table("Coefficients, with their 95 % ranges", &header, sensors.iter().map(row).collect());
}

/// Value and 95 % range of a coefficient.
fn in_print(allan: &Allan, k: usize, coefficient: &Coefficient, factor: f64) -> [String; 2] {
    let number = |value: f64| digits(value * factor, 3);
    match (coefficient.below(), coefficient.range) {
        _ if !allan.gives(k) => text::NOT_GIVEN.map(str::to_owned),
        (Some(below), _) => [format!("below {}", number(below)), String::new()],
        (None, Some([low, high])) => [number(coefficient.value), format!("{} to {}", number(low), number(high))],
        (None, None) => [number(coefficient.value), "not given".to_owned()],
    }
}

/// A sensor: its coefficients, its curve, and its line in head temperature.
fn sensor(page: &mut Page, sensor: &SensorNoise, temperature_unit: &str) {
    page.heading(2, sensor.name, sensor.name);
    let Some(allan) = &sensor.allan else {
        return page.paragraph("The counts never change.");
    };
    let units = sensor.kind.units();
    coefficients(page, sensor.name, allan, &units);
    let mut figures = vec![figure(sensor.name, allan, &units)];
    if let Some(line) = &sensor.line {
        let from = line.contaminated_from_s.map_or_else(
            || "no contamination shows".to_owned(),
            |from_s| format!("contaminated from tau = {from_s:.4} s: there the curve without it leaves the intervals"),
        );
        let (factor, unit) = fitting(units.rate, line.slope.abs());
        let interval = line.slope_error.map_or_else(String::new, |e| format!(" +- {}", digits(1.96 * e * factor, 2)));
        let slope = digits(line.slope * factor, 3);
        page.paragraph(&format!(
            "Slope over head temperature: {slope}{interval} {unit} per {temperature_unit}; {from}."
        ));
        if line.contaminated_from_s.is_some() {
            let without = format!("{} without the line in head temperature", sensor.name);
            coefficients(page, &without, &line.without, &units);
            figures.push(figure(&without, &line.without, &units));
        }
    }
    page.figures(&figures);
    page.paragraph(&text::width(sensor.name, allan).map_or_else(String::new, |sentence| sentence + "."));
}

/// The coefficients of a sensor, what belongs to them, and whether the model holds.
fn coefficients(page: &mut Page, what: &str, allan: &Allan, units: &NoiseUnits) {
    let mut facts = Vec::new();
    if let Some(model) = &allan.model {
        let fitted = |k: usize, it: &Coefficient| {
            let (unit, factor) = units.coefficients[k];
            let (fit, unit) = fitting(unit, it.below().unwrap_or(it.value) * factor);
            (in_print(allan, k, it, factor * fit), unit)
        };
        let columns: [Column<'_, (usize, &Coefficient)>; 4] = [
            ("Coefficient", &|(k, _)| Cell::text(format!("{} {}", COEFFICIENTS[*k], units.names[*k]))),
            ("Value", &|(k, it)| Cell::Number(fitted(*k, it).0[0].clone())),
            ("95 % range", &|(k, it)| Cell::Number(fitted(*k, it).0[1].clone())),
            ("Unit", &|(k, it)| Cell::text(fitted(*k, it).1)),
        ];
        page.columns(&format!("Coefficients of {what}"), model.coefficients.iter().enumerate(), &columns);
        let [_, white, flicker, _] = &model.coefficients;
        let either = |it: &Coefficient, factor: f64, unit: &str| match it.below() {
            Some(below) => format!("below {}", with_unit(below * factor, unit)),
            None => with_unit(it.value * factor, unit),
        };
        let density = |factor: f64| either(white, factor, units.density);
        let fit = format!("chi-square {:.1} for {} degrees of freedom", model.chi_square, model.freedom);
        facts.extend([
            ("Density of N, two-sided", density(1.0)),
            ("Density of N, one-sided as in data sheets", density(SQRT_2)),
            ("Floor of B, 0.664 B", either(flicker, FLICKER_FLOOR, units.rate)),
            (if model.holds() { "The model holds" } else { "The model does not hold" }, fit),
        ]);
    }
    if let Some(point) = allan.minimum() {
        let end = if allan.falls_to_the_end() { ", the longest tau" } else { "" };
        let minimum = format!("{} at tau = {} s{end}", with_unit(point.adev, units.rate), digits(point.tau_s, 4));
        facts.push(("Minimum of the curve", minimum));
    }
    page.key_values(&facts);
}

/// The curve with its band, the model and its parts.
fn figure(what: &str, allan: &Allan, units: &NoiseUnits) -> (Markup, String) {
    let points: Vec<_> = allan.points.iter().map(|point| (point.tau_s, point.adev)).collect();
    let band = allan.points.iter().filter_map(|point| point.interval.map(|[low, high]| (point.tau_s, low, high)));
    let label = format!("Allan deviation / {}", divisor(units.rate));
    let mut plot = Plot::new(what, "tau / s", &label).series("Measured", Style::Both, points).band(band);
    // Parts far from the curve would only make the figure higher.
    let measured = || allan.points.iter().map(|point| point.adev).filter(|adev| *adev > 0.0);
    let lowest = 0.3 * measured().fold(f64::INFINITY, f64::min);
    let highest = 3.0 * measured().fold(0.0, f64::max);
    if let Some(model) = &allan.model {
        let times = || allan.points.iter().map(|point| point.tau_s);
        plot = plot.series("Model", Style::Line, times().map(|tau| (tau, model.deviation(tau).0)));
        for (k, name) in COEFFICIENTS.iter().enumerate() {
            let part = times().map(|tau| (tau, model.deviation(tau).1[k]));
            let part: Vec<_> = part.filter(|(_, value)| *value > lowest && *value < highest).collect();
            if !part.is_empty() {
                plot = plot.series(name, Style::Line, part);
            }
        }
    }
    (plot.logarithmic().svg(), "The band is the 95 % interval of each point.".to_owned())
}

fn meaning(page: &mut Page) {
    page.heading(2, "meaning", "What the letters are");
    page.paragraph("AVAR = 3 Q^2/tau^2 + N^2/tau + B^2 2 ln 2/pi + K^2 tau/3, with the letters of IEEE Std 952.");
    page.paragraph(
        "N is the root of a two-sided spectral density. A data sheet's density is one-sided, the root of 2 times as large. \
         B, its floor 0.664 B and the minimum of the curve are three different figures: the minimum also has white noise and random walk in it, and \
         data sheets often call it bias instability.",
    );
    page.paragraph(
        "A coefficient whose 95 % range includes 0 is given as below the end of the range. Near the end of the curve the intervals are wide: few \
         independent averages are as long.",
    );
}

/// The points of all sensors.
fn deviations(page: &mut Page, analysis: &NoiseAnalysis) {
    page.heading(2, "points", "Allan deviations");
    for sensor in &analysis.sensors {
        let Some(allan) = &sensor.allan else { continue };
        let least = allan.minimum().map_or(1.0, |point| point.adev);
        let (factor, unit) = fitting(sensor.kind.units().rate, least);
        let in_unit = |value: Option<f64>| Cell::Number(digits(value.unwrap_or(f64::NAN) * factor, 4));
        let columns: [Column<'_, &AllanPoint>; 5] = [
            ("tau / s", &|it| Cell::Number(digits(it.tau_s, 5))),
            ("Allan deviation", &|it| in_unit(Some(it.adev))),
            ("from", &|it| in_unit(it.interval.map(|[from, _]| from))),
            ("to", &|it| in_unit(it.interval.map(|[_, to]| to))),
            ("Degrees of freedom", &|it| Cell::known(it.freedom, 1)),
        ];
        page.columns(&format!("{} [{unit}]", sensor.name), &allan.points, &columns);
    }
}
