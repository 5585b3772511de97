//! The results of a batch: the page, the text and the JSON.

use super::page::{Cell, NoteKind, Page};
use super::plot::{Plot, Style};
use isotherm_analysis::{Batch, BatchCurve, Family, Quantity};
use serde_json::{Value, json};
use std::fmt::Write as _;

/// Most units whose curves are drawn each by itself; a picture of more shows nothing.
const MOST_DRAWN: usize = 12;

/// What the page states besides the statistics; only the caller knows it.
#[derive(Clone, Debug)]
pub struct BatchSource {
    /// Program and version.
    pub tool: String,
    /// Time as RFC 3339 in UTC.
    pub time: String,
    /// Name of the campaign file, or of the tables.
    pub source: String,
    /// IMUs that were dropped, with the reason.
    pub dropped: Vec<(String, String)>,
}

/// The page as HTML. Without `batch`, that is with fewer than two tables, it has the dropped IMUs alone; `reason` says
/// why.
#[must_use]
pub fn html(batch: Result<&Batch, &str>, source: &BatchSource) -> String {
    let mut page = Page::new("Batch of IMUs", &format!("{} · {} · {}", source.source, source.time, source.tool));
    page.heading(2, "result", "Result");
    for (imu, reason) in &source.dropped {
        page.note(NoteKind::Bad, &format!("{imu} is dropped"), reason);
    }
    match batch {
        Ok(batch) => statistics(&mut page, batch),
        Err(reason) => page.note(NoteKind::Warning, "No statistics", reason),
    }
    page.finish()
}

/// What a reader must know: notes, and what is not looked at.
fn looked_at(batch: &Batch) -> Vec<String> {
    batch.notes.iter().cloned().chain(batch.findings.iter().map(ToString::to_string)).collect()
}

fn statistics(page: &mut Page, batch: &Batch) {
    let kind = match &batch.stand_outs {
        Some(found) if found.is_empty() => NoteKind::Good,
        _ => NoteKind::Warning,
    };
    for line in batch.verdict() {
        page.note(kind, "Units that stand out", &line);
    }
    for line in looked_at(batch) {
        page.note(NoteKind::Warning, "Look at this", &line);
    }
    page.paragraph(&batch.power());
    page.key_values(&[("Units", batch.units.join(", ")), ("1 g0", format!("{} m/s2", batch.gravity))]);
    page.heading(2, "spread", "Spread of the units");
    let largest = |quantity: &Quantity| {
        let sizes = quantity.t.iter().zip(&batch.units).filter_map(|(t, unit)| Some(((*t)?, unit)));
        let farthest = sizes.max_by(|(a, _), (b, _)| a.abs().total_cmp(&b.abs()));
        farthest.map_or_else(|| "-".to_owned(), |(t, unit)| format!("{t:.2}, {unit}"))
    };
    let row = |quantity: &Quantity| {
        let places = quantity.places;
        let [low, high] = quantity.range();
        vec![
            Cell::text(&quantity.name),
            Cell::text(&quantity.unit),
            Cell::number(quantity.median(), places),
            Cell::number(quantity.sd(), places),
            Cell::number(low, places),
            Cell::number(high, places),
            Cell::Number(largest(quantity)),
        ]
    };
    let rows: Vec<_> = batch.quantities.iter().map(row).collect();
    let header = ["Quantity", "Unit", "Median", "Standard deviation", "Least", "Most", "Farthest, t"];
    page.table(
        &format!("{} units; curves at telemetry in {}", batch.units.len(), batch.temperature_unit),
        &header,
        &rows,
    );
    page.paragraph(
        "t: a unit's value less the mean of the others, over the standard deviation of such a difference. It is judged by Student's t with two degrees of \
         freedom less than there are units; 5 % are shared among all units and quantities. Units are taken out one at a time, a quarter at most.",
    );
    let numbered = |unit: usize| {
        let points = batch
            .quantities
            .iter()
            .enumerate()
            .filter_map(move |(q, quantity)| Some((q as f64 + 1.0, quantity.t[unit]?)));
        points.collect::<Vec<_>>()
    };
    let plot = Plot::new("Distance of each unit from the others", "Quantity, by its row", "t").zero_line();
    let plot = batch
        .units
        .iter()
        .enumerate()
        .take(MOST_DRAWN)
        .fold(plot, |plot, (index, unit)| plot.series(unit, Style::Points, numbered(index)));
    let caption =
        batch.limit().map_or_else(String::new, |limit| format!("A unit stands out beyond {limit:.1} to either side."));
    page.figure(&plot.svg(), &caption);
    page.heading(2, "family", "One curve for all");
    page.paragraph(
        "Each curve less its mid value, against the mean of the other units. A family curve is useful if it halves the rms and three quarters of the units \
         gain: then a new unit's constants with this curve are a coarse table.",
    );
    let row = |curve: &BatchCurve| {
        let family = curve.family.as_ref()?;
        let useful = if family.is_useful() { "useful" } else { "not useful" };
        let gains = format!("{} of {}", family.gains(), batch.units.len());
        Some(vec![Cell::text(&curve.name), Cell::number(family.ratio(), 2), Cell::Number(gains), Cell::text(useful)])
    };
    let rows: Vec<_> = batch.curves.iter().filter_map(row).collect();
    page.table("What the mean of the others leaves", &["Curve", "rms left / rms alone", "Units that gain", ""], &rows);
    let figure = |curve: &BatchCurve| {
        let label = format!("Less mid value / {}", curve.unit);
        let plot = Plot::new(&curve.name, &format!("Telemetry / {}", batch.temperature_unit), &label);
        let units = batch.units.iter().zip(&curve.curves).take(MOST_DRAWN);
        let plot = units.fold(plot, |plot, (unit, values)| {
            plot.series(unit, Style::Line, curve.telemetry.iter().copied().zip(values.iter().copied()))
        });
        (plot.svg(), String::new())
    };
    if batch.units.len() > MOST_DRAWN {
        page.paragraph(&format!("The figures show the first {MOST_DRAWN} units."));
    }
    let figures: Vec<_> = batch.curves.iter().map(figure).collect();
    for figures in figures.chunks(3) {
        page.figures(figures);
    }
}

/// The lines that `calibrate --batch` prints.
#[must_use]
pub fn text(batch: &Batch) -> String {
    let mut text = format!("batch of {} units\n", batch.units.len());
    text += "  quantity                                              unit          median        std. dev.           least            most\n";
    for quantity in &batch.quantities {
        let places = quantity.places;
        let [low, high] = quantity.range();
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "  {:<40} {:>17} {:>15.places$} {:>16.places$} {low:>15.places$} {high:>15.places$}",
            quantity.name,
            quantity.unit,
            quantity.median(),
            quantity.sd()
        );
    }
    for line in batch.verdict().iter().chain(&looked_at(batch)).chain([&batch.power()]).chain(&batch.families()) {
        let _ = writeln!(text, "{line}");
    }
    text
}

/// The statistics as JSON. Figures with `in_unit` are in the `unit` of the same object, in the order of `units`.
#[must_use]
pub fn document(batch: &Batch) -> Value {
    let quantity = |quantity: &Quantity| {
        json!({
            "name": quantity.name,
            "unit": quantity.unit,
            "median_in_unit": quantity.median(),
            "standard_deviation_in_unit": quantity.sd(),
            "range_in_unit": quantity.range(),
            "values_in_unit": quantity.values,
            "t": quantity.t,
        })
    };
    let curve = |curve: &BatchCurve| {
        json!({
            "name": curve.name,
            "unit": curve.unit,
            "rms_alone_in_unit": curve.family.as_ref().map(|family| &family.alone),
            "rms_left_in_unit": curve.family.as_ref().map(|family| &family.left),
            "ratio": curve.family.as_ref().map(Family::ratio),
            "gains": curve.family.as_ref().map(Family::gains),
            "useful": curve.family.as_ref().map(Family::is_useful),
        })
    };
    let stand_outs = batch.stand_outs.as_ref().map(|found| {
        let one = |it: &isotherm_analysis::StandOut| {
            json!({ "unit": batch.units[it.unit], "quantity": batch.quantities[it.quantity].name, "t": it.t, "limit_t": it.limit })
        };
        found.iter().map(one).collect::<Vec<_>>()
    });
    json!({
        "units": batch.units,
        "gravity_m_s2": batch.gravity,
        "telemetry_unit": batch.temperature_unit,
        "quantities": batch.quantities.iter().map(quantity).collect::<Vec<_>>(),
        "families": batch.curves.iter().map(curve).collect::<Vec<_>>(),
        "limit_t": batch.limit(),
        "stand_outs": stand_outs,
        "verdict": batch.verdict(),
        "power": batch.power(),
        "notes": batch.notes,
        "findings": crate::json::findings(&batch.findings, |line| line.to_string()),
    })
}
