//! The results of a batch: the page, the text and the JSON.

use super::page::{Cell, Column, NoteKind, Page};
use super::plot::{Plot, Style};
use super::view::{value, view};
use crate::findings::records;
use isotherm_analysis::{Batch, BatchCurve, Family, Quantity, StandOut};
use serde_json::Value;
use std::fmt::Write as _;

/// Most devices whose curves are drawn each by itself; a picture of more shows nothing.
const MOST_DRAWN: usize = 12;

/// What the page states in addition to the statistics; only the caller knows it.
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

/// The page as HTML. Without `batch`, that is with fewer than two tables, it has only the dropped IMUs; `reason` says
/// why.
#[must_use]
pub fn html(batch: Result<&Batch, &str>, source: &BatchSource) -> String {
    let mut page = Page::new("Batch of IMUs", &format!("{} · {} · {}", source.source, source.time, source.tool));
    page.heading(2, "result", "Result");
    for (imu, reason) in &source.dropped {
        page.note(NoteKind::Bad, &format!("{imu} is dropped"), reason);
    }
    match batch {
        Ok(batch) => {
            verdict(&mut page, batch);
            distances(&mut page, batch);
            families(&mut page, batch);
            page.heading(2, "measurement", "Measurement");
            let gravity = format!("{} m/s2", batch.gravity);
            page.key_values(&[("Devices", batch.devices.join(", ")), ("1 g0", gravity)]);
        }
        Err(reason) => page.note(NoteKind::Warning, "No statistics", reason),
    }
    page.finish()
}

/// What a reader must know: notes, and what is not looked at.
fn looked_at(batch: &Batch) -> Vec<String> {
    batch.notes.iter().cloned().chain(batch.findings.iter().map(ToString::to_string)).collect()
}

fn verdict(page: &mut Page, batch: &Batch) {
    let is_good = batch.stand_outs.as_ref().is_some_and(Vec::is_empty);
    let kind = if is_good { NoteKind::Good } else { NoteKind::Warning };
    for line in batch.verdict() {
        page.note(kind, "Devices that stand out", &line);
    }
    for line in looked_at(batch) {
        page.note(NoteKind::Warning, "Warning", &line);
    }
    page.paragraph(&batch.power());
    let number = |it: &Quantity, value: f64| Cell::number(value, it.places);
    let farthest = |it: &Quantity| {
        let sizes = it.t.iter().zip(&batch.devices).filter_map(|(t, unit)| Some(((*t)?, unit)));
        let farthest = sizes.max_by(|(a, _), (b, _)| a.abs().total_cmp(&b.abs()));
        Cell::Number(farthest.map_or_else(|| "-".to_owned(), |(t, unit)| format!("{t:.2}, {unit}")))
    };
    let columns: [Column<'_, &Quantity>; 7] = [
        ("Quantity", &|it| Cell::text(&it.name)),
        ("Unit", &|it| Cell::text(&it.unit)),
        ("Median", &|it| number(it, it.median())),
        ("Standard deviation", &|it| number(it, it.sd())),
        ("Least", &|it| number(it, it.range()[0])),
        ("Most", &|it| number(it, it.range()[1])),
        ("Farthest, t", &|it| farthest(it)),
    ];
    let caption = format!("{} devices; curves at temperature in {}", batch.devices.len(), batch.temperature_unit);
    page.columns(&caption, &batch.quantities, &columns);
}

fn distances(page: &mut Page, batch: &Batch) {
    page.heading(2, "spread", "Spread of the devices");
    page.paragraph(
        "t: a device's value less the mean of the others, over the standard deviation of such a difference. It is judged by Student's t with two degrees of \
         freedom less than there are devices; 5 % are shared among all devices and quantities. Devices are taken out one at a time, a quarter at most.",
    );
    let mut plot = Plot::new("Distance of each device from the others", "Quantity, by its row", "t").zero_line();
    for (index, unit) in batch.devices.iter().enumerate().take(MOST_DRAWN) {
        let rows = (1..).map(f64::from).zip(&batch.quantities);
        plot = plot.series(unit, Style::Points, rows.filter_map(|(row, it)| Some((row, it.t[index]?))));
    }
    let caption = |limit: f64| format!("A device stands out beyond {limit:.1} to either side.");
    page.figure(&plot.svg(), &batch.limit().map_or_else(String::new, caption));
}

fn families(page: &mut Page, batch: &Batch) {
    page.heading(2, "family", "One curve for all");
    page.paragraph(
        "Each curve less its mid value, against the mean of the other devices. A family curve is useful if it halves the rms and three quarters of the devices \
         gain: then a new device's constants with this curve are a coarse table.",
    );
    let gains = |family: &Family| format!("{} of {}", family.gains(), batch.devices.len());
    let columns: [Column<'_, (&String, &Family)>; 4] = [
        ("Curve", &|(name, _)| Cell::text(*name)),
        ("rms left / rms by itself", &|(_, family)| Cell::number(family.ratio(), 2)),
        ("Devices that gain", &|(_, family)| Cell::Number(gains(family))),
        ("Verdict", &|(_, family)| Cell::text(if family.is_useful() { "useful" } else { "not useful" })),
    ];
    let families = batch.curves.iter().filter_map(|curve| Some((&curve.name, curve.family.as_ref()?)));
    page.columns("What the mean of the others leaves", families, &columns);
    if batch.devices.len() > MOST_DRAWN {
        page.paragraph(&format!("The figures show the first {MOST_DRAWN} devices."));
    }
    let figure = |curve: &BatchCurve| {
        let label = format!("Less mid value / {}", curve.unit);
        let plot = Plot::new(&curve.name, &format!("Temperature / {}", batch.temperature_unit), &label);
        let devices = batch.devices.iter().zip(&curve.curves).take(MOST_DRAWN);
        devices.fold(plot, |plot, (unit, values)| {
            plot.series(unit, Style::Line, curve.temperature.iter().copied().zip(values.iter().copied()))
        })
    };
    page.rows_of_plots(&batch.curves.iter().map(figure).collect::<Vec<_>>());
}

/// The lines that `calibrate turntable --batch` prints.
#[must_use]
pub fn text(batch: &Batch) -> String {
    let mut text = format!("batch of {} devices\n", batch.devices.len());
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

/// The statistics as JSON. Figures with `in_unit` are in the `unit` of the same object, in the order of `devices`.
#[must_use]
pub fn document(batch: &Batch) -> Value {
    value(&BatchView::of(batch))
}

view! { BatchView<'a>(batch: &'a Batch) {
    devices: &'a [String] = &batch.devices,
    gravity_m_s2: f64 = batch.gravity,
    temperature_unit: &'a str = &batch.temperature_unit,
    quantities: Vec<QuantityView<'a>> = batch.quantities.iter().map(QuantityView::of).collect(),
    families: Vec<FamilyView<'a>> =
        batch.curves.iter().map(|curve| FamilyView::of(curve, curve.family.as_ref())).collect(),
    limit_t: Option<f64> = batch.limit(),
    stand_outs: Option<Vec<StandOutView<'a>>> =
        batch.stand_outs.as_ref().map(|all| all.iter().map(|it| StandOutView::of(batch, it)).collect()),
    verdict: Vec<String> = batch.verdict(),
    power: String = batch.power(),
    notes: &'a [String] = &batch.notes,
    findings: Value = records(&batch.findings),
}}

view! { QuantityView<'a>(quantity: &'a Quantity) {
    name: &'a str = &quantity.name,
    unit: &'a str = &quantity.unit,
    median_in_unit: f64 = quantity.median(),
    standard_deviation_in_unit: f64 = quantity.sd(),
    range_in_unit: [f64; 2] = quantity.range(),
    values_in_unit: &'a [f64] = &quantity.values,
    t: &'a [Option<f64>] = &quantity.t,
}}

view! { FamilyView<'a>(curve: &'a BatchCurve, family: Option<&'a Family>) {
    name: &'a str = &curve.name,
    unit: &'a str = curve.unit,
    rms_alone_in_unit: Option<&'a [f64]> = family.map(|family| &family.alone[..]),
    rms_left_in_unit: Option<&'a [f64]> = family.map(|family| &family.left[..]),
    ratio: Option<f64> = family.map(Family::ratio),
    gains: Option<usize> = family.map(Family::gains),
    useful: Option<bool> = family.map(Family::is_useful),
}}

view! { StandOutView<'a>(batch: &'a Batch, found: &StandOut) {
    unit: &'a str = &batch.devices[found.unit],
    quantity: &'a str = &batch.quantities[found.quantity].name,
    t: f64 = found.t,
    limit_t: f64 = found.limit,
}}
