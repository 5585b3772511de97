//! The results of a comparison of tables: the page, the text and the JSON.

mod json;
mod text;
mod words;

use crate::comparison::words::{dated, places, slope_interval, word};
use crate::parts::file_names;
pub use json::document;
pub use text::text;

use super::page::{Cell, Column, NoteKind, Page};
use super::plot::{Plot, Style};
use isotherm_analysis::{Comparison, ComparisonRequirement, Compliance, CurveComparison, NOT_IN_THE_ERRORS, Trend};
use isotherm_shared::table::AXIS_NAMES;

/// What the page states in addition to the comparison; only the caller knows it.
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
    let mut rows = vec![("Tool".to_owned(), source.tool.clone()), ("Time".to_owned(), source.time.clone())];
    rows.extend(comparison.tables.iter().map(|table| (dated(table), table.table.digest().to_string())));
    page.key_values(&rows);
    page.paragraph(NOT_IN_THE_ERRORS);
    page.finish()
}

fn result(page: &mut Page, comparison: &Comparison, source: &ComparisonSource) {
    page.heading(2, "result", "Result");
    let [new, old] = [comparison.new_table(), comparison.old_table()].map(|table| file_names(&dated(table)));
    page.paragraph(&match comparison.tables.len() {
        2 => format!("The new table, {new}, less the old one, {old}."),
        count => format!("The newest of {count} tables, {new}, less the oldest, {old}."),
    });
    let kind = match (comparison.changed().is_empty(), comparison.has_errors()) {
        (true, true) => NoteKind::Good,
        _ => NoteKind::Warning,
    };
    page.note(kind, "Changes", &comparison.conclusion());
    for judgement in source.required.iter().flat_map(|required| comparison.judge(required)) {
        let (kind, word) = match judgement.verdict {
            Compliance::Within => (NoteKind::Good, "Requirement met"),
            Compliance::Undecided => (NoteKind::Warning, "Undecided"),
            Compliance::Beyond => (NoteKind::Bad, "Requirement missed"),
        };
        page.note(kind, word, &judgement.message);
    }
    page.findings(&comparison.findings, |_| String::new());
    for note in &comparison.notes {
        page.note(NoteKind::Warning, "Warning", note);
    }
    let at = format!("at / {}", comparison.new_table().table.content().temperature_unit);
    let columns: [Column<'_, &CurveComparison>; 9] = [
        ("Curve", &|it| Cell::text(it.name())),
        ("Unit", &|it| Cell::text(it.unit)),
        ("Mean", &|it| Cell::number(it.mean(), places(it.unit))),
        ("Largest", &|it| Cell::number(it.largest().0, places(it.unit))),
        (&at, &|it| Cell::number(it.largest().1, 3)),
        ("Standard error", &|it| Cell::known(it.standard_error(), places(it.unit))),
        ("At least", &|it| Cell::known(it.lower(), places(it.unit))),
        ("At most", &|it| Cell::known(it.upper(), places(it.unit))),
        ("By more than the errors", &|it| Cell::text(word(it.is_changed()))),
    ];
    page.columns("Differences over the common range, new less old", &comparison.curves, &columns);
}

fn curves(page: &mut Page, comparison: &Comparison) {
    page.heading(2, "curves", "Curves");
    page.paragraph(
        "Biases in ug0 of 9.80665e-6 m/s2 or in deg/h, scale factors in ppm of the old one. At least, at most: the largest difference with the band \
         of both tables' errors, which holds the whole curve. Standard error: the median over the range.",
    );
    let unit = &comparison.new_table().table.content().temperature_unit;
    let figure = |curve: &CurveComparison| {
        let points = || curve.temperature.iter().copied().zip(curve.differences.iter().copied());
        let label = format!("New less old / {}", curve.unit);
        let plot = Plot::new(&curve.name(), &format!("Temperature / {unit}"), &label).zero_line();
        let plot = plot.series("Difference", Style::Line, points());
        match curve.half_widths() {
            Some(halves) => plot.band(points().zip(halves).map(|((u, d), half)| (u, d - half, d + half))),
            None => plot,
        }
    };
    page.rows_of_plots(&comparison.curves.iter().map(figure).collect::<Vec<_>>());
}

fn alignments(page: &mut Page, comparison: &Comparison) {
    page.heading(2, "alignment", "Alignment");
    for alignment in &comparison.alignments {
        let entry = |i: usize, j: usize| {
            let value = alignment.difference_urad[i][j];
            let half = alignment.half_width_urad.map_or_else(String::new, |halves| format!(" ± {:.3}", halves[i][j]));
            Cell::Number(format!("{value:.3}{half}"))
        };
        let columns: [Column<'_, usize>; 4] = [
            ("Row", &|i| Cell::text((i + 1).to_string())),
            ("Column 1", &|i| entry(*i, 0)),
            ("Column 2", &|i| entry(*i, 1)),
            ("Column 3", &|i| entry(*i, 2)),
        ];
        let caption =
            format!("Matrix of the {}, new less old [1e-6 rad]: {}", alignment.name(), word(alignment.is_changed()));
        page.columns(&caption, 0..AXIS_NAMES.len(), &columns);
    }
}

fn trends(page: &mut Page, comparison: &Comparison) {
    if comparison.trends.is_empty() {
        return;
    }
    page.heading(2, "trends", "Over the dates");
    let slope = |it: &Trend| {
        let places = places(it.unit);
        Cell::Number(format!("{:.places$} ± {:.places$}", it.slope, slope_interval(it)))
    };
    let columns: [Column<'_, &Trend>; 5] = [
        ("Curve", &|it| Cell::text(it.name())),
        ("Unit", &|it| Cell::text(format!("{}/year", it.unit))),
        ("Slope", &|it| slope(it)),
        ("Standard error", &|it| Cell::number(it.slope_error, places(it.unit))),
        ("At temperature", &|it| Cell::number(it.temperature, 3)),
    ];
    let caption = "Straight lines over the dates, at the middle of the common range";
    page.columns(caption, &comparison.trends, &columns);
    let weighted = comparison.trends.iter().all(|trend| trend.standard_errors.is_some());
    page.paragraph(if weighted {
        "Each value weighs by its error. The slope's interval is 95 %; its error is that of the scatter where this is larger."
    } else {
        "Not all errors are known, so all values weigh the same. The slope's interval is 95 %, from the scatter."
    });
    let first = comparison.old_table().origin.time.as_deref().unwrap_or_default();
    let figure = |trend: &Trend| {
        let points = trend.years.iter().copied().zip(trend.values.iter().copied());
        let line = trend.years.iter().map(|year| (*year, trend.intercept + trend.slope * year));
        let label = format!("Less the first / {}", trend.unit);
        let plot = Plot::new(&trend.name(), &format!("Years since {first}"), &label);
        let plot = plot.series("Table", Style::Points, points).errors(trend.standard_errors.iter().flatten().copied());
        plot.series("Line", Style::Line, line)
    };
    page.rows_of_plots(&comparison.trends.iter().map(figure).collect::<Vec<_>>());
}
