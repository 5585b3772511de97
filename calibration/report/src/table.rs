//! A table as a page: what it says of itself, and its curves.

use crate::page::Page;
use crate::parts::{CURVE_INTERVALS, grid};
use crate::plot::{Plot, Style};
use isotherm_fit::TableFile;
use isotherm_shared::table::{AXIS_NAMES, GYROSCOPE_NAMES};
use isotherm_statistics::CONFIDENCE;

/// The quantities of a sensor, and the temperature that each is over.
const QUANTITIES: [(&str, &str); 3] = [("Bias", "Head"), ("K+", "Board"), ("K-", "Board")];

/// The page as HTML.
#[must_use]
pub fn html(file: &TableFile) -> String {
    let content = file.table.content();
    let mut page = Page::new(&format!("Table of {}", content.imu), &file.table.digest().to_string());
    page.heading(2, "result", "Table");
    let known = |value: Option<String>| value.unwrap_or_else(|| "not stated".to_owned());
    let number = |value: Option<f64>, unit: &str| known(value.map(|value| format!("{value} {unit}")));
    let aligned = |has: bool| if has { "yes" } else { "no" }.to_owned();
    let mut rows = vec![
        ("IMU", content.imu.to_string()),
        ("Serial", known(content.serial.clone())),
        ("Made", known(file.origin.time.clone())),
        ("1 g0", format!("{} m/s2", content.gravity)),
        ("Gravity at the station", number(file.table.gravity_local(), "m/s2")),
        ("Unit of temperature", content.temperature_unit.clone()),
        ("Outside the range", content.out_of_range.name().to_owned()),
        ("Alignment matrix", aligned(content.alignment.is_some())),
        ("Lag", number(content.lag_s, "s")),
        ("Nominal interval", number(content.nominal_interval_s, "s")),
    ];
    if let Some(gyroscopes) = &content.gyroscopes {
        rows.push(("Alignment matrix of the gyroscopes", aligned(gyroscopes.alignment.is_some())));
    }
    page.key_values(&rows);
    page.heading(2, "curves", "Curves");
    page.paragraph("Band: 95 % for the whole curve at once, where the provenance has the errors.");
    let names = AXIS_NAMES.into_iter().chain(GYROSCOPE_NAMES).enumerate();
    for (sensor, name) in names {
        let plots: Vec<_> =
            (0..QUANTITIES.len()).filter_map(|quantity| curve(file, (sensor, name), quantity)).collect();
        page.plots(&plots);
    }
    page.finish()
}

/// A curve with its band; `None` if the table has no such sensor.
fn curve(file: &TableFile, (sensor, name): (usize, &str), quantity: usize) -> Option<Plot> {
    let (curve, unit) = file.curve(sensor, quantity)?;
    let (title, temperature) = QUANTITIES[quantity];
    let label = format!("{temperature} temperature / {}", file.table.content().temperature_unit);
    let quantile = curve.band_quantile(CONFIDENCE);
    let points = || grid(curve.range(), CURVE_INTERVALS);
    let band = points().filter_map(|u| {
        let half = curve.half_width(u, quantile?)?;
        Some((u, curve.at(u) - half, curve.at(u) + half))
    });
    let plot = Plot::new(&format!("{title} of {name}"), &label, &format!("{title} / ({unit})"));
    Some(plot.series("Table", Style::Line, points().map(|u| (u, curve.at(u)))).band(band))
}
