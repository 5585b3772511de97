//! The results of a comparison of tables: the page, the text and the JSON.

mod json;
mod text;
mod words;

use crate::comparison::words::{dated, places, slope_interval, which, word};
pub use json::document;
pub use text::text;

use super::page::{Cell, NoteKind, Page};
use super::plot::{Plot, Style};
use isotherm_analysis::{
    AlignmentComparison, Comparison, ComparisonRequirement, CurveComparison, NOT_IN_THE_ERRORS, Trend, Verdict,
};
use isotherm_shared::table::AXIS_NAMES;

/// What the page states besides the comparison; only the caller knows it.
#[derive(Clone, Debug)]
pub struct ComparisonSource {
    /// Program and version.
    pub tool: String,
    /// Time of the comparison as RFC 3339 in UTC.
    pub time: String,
    /// What is required, if there is a requirement.
    pub required: Option<ComparisonRequirement>,
}

/// The page as HTML.
#[must_use]
pub fn html(comparison: &Comparison, source: &ComparisonSource) -> String {
    let new = comparison.new_table().table.content();
    let mut page = Page::new(&format!("Comparison of {}", new.imu), &format!("{} · {}", source.time, source.tool));
    result(&mut page, comparison, source);
    curves(&mut page, comparison);
    alignments(&mut page, comparison);
    trends(&mut page, comparison);
    page.heading(2, "provenance", "Provenance");
    let digests: Vec<_> =
        comparison.tables.iter().map(|table| (dated(table), table.table.digest().to_string())).collect();
    let mut rows = vec![("Tool".to_owned(), source.tool.clone()), ("Time".to_owned(), source.time.clone())];
    rows.extend(digests);
    page.key_values(&rows);
    page.finish()
}

fn result(page: &mut Page, comparison: &Comparison, source: &ComparisonSource) {
    page.heading(2, "result", "Result");
    page.paragraph(&format!("{}.", which(comparison)));
    let kind = match (comparison.changed().is_empty(), comparison.has_errors()) {
        (true, true) => NoteKind::Good,
        _ => NoteKind::Warning,
    };
    page.note(kind, "Changes", &comparison.conclusion());
    for judgement in source.required.iter().flat_map(|required| comparison.judge(required)) {
        let (kind, word) = match judgement.verdict {
            Verdict::Within => (NoteKind::Good, "Requirement met"),
            Verdict::Undecided => (NoteKind::Warning, "Undecided"),
            Verdict::Beyond => (NoteKind::Bad, "Requirement missed"),
        };
        page.note(kind, word, &judgement.message);
    }
    for finding in &comparison.findings {
        page.note(NoteKind::Warning, "Look at this", &finding.to_string());
    }
    for note in &comparison.notes {
        page.note(NoteKind::Warning, "Look at this", note);
    }
    page.paragraph(NOT_IN_THE_ERRORS);
}

fn curves(page: &mut Page, comparison: &Comparison) {
    page.heading(2, "curves", "Curves");
    let row = |curve: &CurveComparison| {
        let places = places(curve.unit);
        let (largest, at) = curve.largest();
        let number = |value: Option<f64>, places: usize| Cell::number(value.unwrap_or(f64::NAN), places);
        vec![
            Cell::text(curve.name()),
            Cell::text(curve.unit),
            Cell::number(curve.mean(), places),
            Cell::number(largest, places),
            Cell::number(at, 3),
            number(curve.standard_error(), places),
            number(curve.lower(), places),
            number(curve.upper(), places),
            Cell::text(word(curve.is_changed())),
        ]
    };
    let rows: Vec<_> = comparison.curves.iter().map(row).collect();
    let header =
        ["Curve", "Unit", "Mean", "Largest", "at", "Standard error", "At least", "At most", "By more than the errors"];
    page.table("Differences over the common range, new less old", &header, &rows);
    page.paragraph(
        "Biases in ug0 of 9.80665e-6 m/s2 or in deg/h, scale factors in ppm of the old one. At least, at most: the largest difference with the band \
         of both tables' errors, which holds the whole curve. Standard error: the median over the range.",
    );
    let unit = &comparison.new_table().table.content().temperature_unit;
    let figure = |curve: &CurveComparison| {
        let label = format!("New less old / {}", curve.unit);
        let points = || curve.telemetry.iter().copied().zip(curve.differences.iter().copied());
        let plot = Plot::new(&curve.name(), &format!("Telemetry / {unit}"), &label).zero_line();
        let mut plot = plot.series("Difference", Style::Line, points());
        if let Some(halves) = curve.half_widths() {
            plot = plot.band(points().zip(halves).map(|((u, d), half)| (u, d - half, d + half)));
        }
        (plot.svg(), String::new())
    };
    let figures: Vec<_> = comparison.curves.iter().map(figure).collect();
    for figures in figures.chunks(3) {
        page.figures(figures);
    }
}

fn alignments(page: &mut Page, comparison: &Comparison) {
    page.heading(2, "alignment", "Alignment");
    let row = |alignment: &AlignmentComparison, i: usize| {
        let entry = |j: usize| {
            let value = alignment.difference_urad[i][j];
            Cell::Number(match alignment.half_width_urad {
                Some(halves) => format!("{value:.3} ± {:.3}", halves[i][j]),
                None => format!("{value:.3}"),
            })
        };
        let mut row = vec![Cell::text(format!("Row {}", i + 1))];
        row.extend((0..AXIS_NAMES.len()).map(entry));
        row
    };
    for alignment in &comparison.alignments {
        let rows: Vec<_> = (0..AXIS_NAMES.len()).map(|i| row(alignment, i)).collect();
        let caption =
            format!("Matrix of the {}, new less old [1e-6 rad]: {}", alignment.name(), word(alignment.is_changed()));
        page.table(&caption, &["", "Column 1", "Column 2", "Column 3"], &rows);
    }
}

fn trends(page: &mut Page, comparison: &Comparison) {
    if comparison.trends.is_empty() {
        return;
    }
    page.heading(2, "trends", "Over the dates");
    let row = |trend: &Trend| {
        let places = places(trend.unit);
        vec![
            Cell::text(trend.name()),
            Cell::text(format!("{}/year", trend.unit)),
            Cell::Number(format!("{:.places$} ± {:.places$}", trend.slope, slope_interval(trend))),
            Cell::number(trend.slope_error, places),
            Cell::Number(trend.p.map_or_else(|| "-".to_owned(), |p| format!("{p:.2e}"))),
            Cell::number(trend.telemetry, 3),
        ]
    };
    let rows: Vec<_> = comparison.trends.iter().map(row).collect();
    let header = ["Curve", "Unit", "Slope", "Standard error", "p", "At telemetry"];
    page.table("Straight lines over the dates, at the middle of the common range", &header, &rows);
    let weighted = comparison.trends.iter().all(|trend| trend.standard_errors.is_some());
    page.paragraph(if weighted {
        "Each value weighs by its error. The slope's interval is 95 %; its error is that of the scatter where this is larger. p: the probability of \
         such a slope where there is none."
    } else {
        "Not all errors are known, so all values weigh the same. The slope's interval is 95 %, from the scatter. p: the probability of such a slope \
         where there is none."
    });
    let first = comparison.old_table().origin.time.as_deref().unwrap_or_default();
    let figure = |trend: &Trend| {
        let points = trend.years.iter().copied().zip(trend.values.iter().copied());
        let line = trend.years.iter().map(|year| (*year, trend.intercept + trend.slope * year));
        let label = format!("Less the first / {}", trend.unit);
        let plot = Plot::new(&trend.name(), &format!("Years since {first}"), &label);
        let plot = plot.series("Table", Style::Points, points).errors(trend.standard_errors.iter().flatten().copied());
        (plot.series("Line", Style::Line, line).svg(), String::new())
    };
    let figures: Vec<_> = comparison.trends.iter().map(figure).collect();
    for figures in figures.chunks(3) {
        page.figures(figures);
    }
}
