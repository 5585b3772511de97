//! The report of the noise of an IMU: coefficients, curves with their intervals, and the model with its parts.

pub mod json;
pub mod text;

use super::page::{Cell, Column, NoteKind, Page};
use super::plot::{Plot, Style};
use crate::parts::file_names;
use core::f64::consts::SQRT_2;
use isotherm_analysis::{
    Allan, AllanPoint, COEFFICIENTS, Coefficient, FLICKER_FLOOR, NoiseAnalysis, NoiseUnits, SensorNoise,
};
use maud::Markup;

/// What the report states besides the analysis; only the caller knows it.
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
    page.paragraph(&format!("{}.", text::rows(analysis)));
    let findings = analysis.findings();
    for finding in &findings {
        page.note(NoteKind::Warning, "To be known before the figures are used", &finding.to_string());
    }
    if findings.is_empty() {
        page.note(NoteKind::Good, "The model holds for every sensor", "");
    }
    for each in &analysis.sensors {
        sensor(&mut page, each, &analysis.temperature_unit);
    }
    meaning(&mut page);
    deviations(&mut page, analysis);
    page.heading(2, "provenance", "Provenance");
    let mut rows =
        vec![("Tool", source.tool.clone()), ("Time", source.time.clone()), ("Recording", source.recording.clone())];
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
        let slope = text::slope(line, &units);
        page.paragraph(&format!("Slope over head temperature: {slope} per {temperature_unit}; {from}."));
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
        let shown = |k: usize, it: &Coefficient| match allan.gives(k) {
            true => text::shown(it, units.coefficients[k].1),
            false => text::NOT_GIVEN.map(str::to_owned),
        };
        let columns: [Column<'_, (usize, &Coefficient)>; 4] = [
            ("Coefficient", &|(k, _)| Cell::text(format!("{} {}", COEFFICIENTS[*k], units.names[*k]))),
            ("Value", &|(k, it)| Cell::Number(shown(*k, it)[0].clone())),
            ("95 % range", &|(k, it)| Cell::Number(shown(*k, it)[1].clone())),
            ("Unit", &|(k, _)| Cell::text(units.coefficients[*k].0)),
        ];
        page.columns(&format!("Coefficients of {what}"), model.coefficients.iter().enumerate(), &columns);
        let [_, white, flicker, _] = &model.coefficients;
        let density = |factor: f64| format!("{} {}", text::either(white, factor), units.density);
        let fit = format!("chi-square {:.1} for {} degrees of freedom", model.chi_square, model.freedom);
        facts.extend([
            ("Density of N, two-sided", density(1.0)),
            ("Density of N, one-sided as in data sheets", density(SQRT_2)),
            ("Floor of B, 0.664 B", format!("{} {}", text::either(flicker, FLICKER_FLOOR), units.rate)),
            (if model.holds() { "The model holds" } else { "The model does not hold" }, fit),
        ]);
    }
    if let Some(point) = allan.minimum() {
        let end = if allan.falls_to_the_end() { ", the longest tau" } else { "" };
        let minimum = format!("{:.3e} {} at tau = {:.4} s{end}", point.adev, units.rate, point.tau_s);
        facts.push(("Minimum of the curve", minimum));
    }
    page.key_values(&facts);
}

/// The curve with its band, the model and its parts.
fn figure(what: &str, allan: &Allan, units: &NoiseUnits) -> (Markup, String) {
    let points: Vec<_> = allan.points.iter().map(|point| (point.tau_s, point.adev)).collect();
    let band = allan.points.iter().filter_map(|point| point.interval.map(|[low, high]| (point.tau_s, low, high)));
    let unit = if units.rate.contains('/') { format!("({})", units.rate) } else { units.rate.to_owned() };
    let label = format!("Allan deviation / {unit}");
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
    let known = |value: Option<String>| Cell::Number(value.unwrap_or_else(|| "–".to_owned()));
    let end = |it: &AllanPoint, end: usize| known(it.interval.map(|ends| format!("{:.3e}", ends[end])));
    let columns: [Column<'_, &AllanPoint>; 5] = [
        ("tau / s", &|it| Cell::Number(format!("{:.4}", it.tau_s))),
        ("Allan deviation", &|it| Cell::Number(format!("{:.3e}", it.adev))),
        ("from", &|it| end(it, 0)),
        ("to", &|it| end(it, 1)),
        ("Degrees of freedom", &|it| known(it.freedom.map(|freedom| format!("{freedom:.1}")))),
    ];
    for sensor in &analysis.sensors {
        let Some(allan) = &sensor.allan else { continue };
        page.columns(&format!("{} [{}]", sensor.name, sensor.kind.units().rate), &allan.points, &columns);
    }
}
