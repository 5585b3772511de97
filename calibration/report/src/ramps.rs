//! The report of ramps alone.

use super::page::{NoteKind, Page};
use super::plot::{Plot, Style};
use crate::parts::provenance;
use isotherm_campaign::Campaign;
use isotherm_fit::{CampaignSource, RampCalibration, TriadUnits};
use isotherm_shared::table::{Axis, CoefficientTable};
use isotherm_shared::units::SensorKind;

/// Intervals between the points of a drawn curve.
const CURVE_INTERVALS: usize = 120;

/// The page as HTML.
#[must_use]
pub fn html(campaign: &Campaign, calibration: &RampCalibration, source: &CampaignSource) -> String {
    let title = format!("Ramps of {}", campaign.imu);
    let mut page = Page::new(&title, &format!("{} · {} · {}", source.campaign, source.time, source.tool));
    page.heading(2, "result", "Result");
    page.paragraph(&format!("The table has {}.", calibration.accuracy()));
    for sentence in calibration.not_known() {
        page.note(NoteKind::Warning, "Not known", &sentence);
    }
    for finding in &calibration.findings {
        page.note(NoteKind::Warning, "Look at this", &finding.to_string());
    }
    page.key_values(&[
        ("Table", calibration.table.digest().to_string()),
        ("IMU", campaign.imu.to_string()),
        ("Recordings", calibration.recordings.to_string()),
        ("Curves", calibration.curves.digest().to_string()),
        ("1 g0", format!("{} m/s2", campaign.gravity_reference)),
    ]);
    curves(&mut page, calibration);
    super::transients::sections(&mut page, &calibration.transients, &campaign.temperature_unit);
    provenance(&mut page, campaign, source, &[], &calibration.table);
    page.finish()
}

/// The biases before and after.
fn curves(page: &mut Page, calibration: &RampCalibration) {
    page.heading(2, "curves", "Bias over temperature");
    page.paragraph("The constant is that of curves, at mid range of the ramps.");
    let unit = &calibration.table.content().temperature_unit;
    let mut figures = Vec::new();
    for bias in &calibration.transients.biases {
        let units = TriadUnits::of(bias.kind);
        let axis = |table| of_table(table, bias.kind, bias.axis);
        let (Some(new), Some(old)) = (axis(&calibration.table), axis(&calibration.curves)) else { continue };
        let [low, high] = new.bias.range();
        let line = |axis: &Axis| -> Vec<(f64, f64)> {
            let at = |i: usize| low + (high - low) * i as f64 / CURVE_INTERVALS as f64;
            let value = |u: f64| axis.bias_at(axis.bias.clamp(u)).0 * units.bias_factor;
            (0..=CURVE_INTERVALS).map(at).map(|u| (u, value(u))).collect()
        };
        let title = format!("Bias of {}", bias.name());
        let plot = Plot::new(&title, &format!("Head telemetry / {unit}"), &format!("Bias / {}", units.bias_on_page));
        let plot = plot.series("Ramps", Style::Line, line(new)).series("Curves", Style::Line, line(old));
        figures.push((plot.svg(), String::new()));
    }
    page.figures(&figures);
}

fn of_table(table: &CoefficientTable, kind: SensorKind, axis: usize) -> Option<&Axis> {
    let content = table.content();
    match kind {
        SensorKind::Accelerometer => Some(&content.axes[axis]),
        SensorKind::Gyroscope => content.gyroscopes.as_ref().map(|gyroscopes| &gyroscopes.axes[axis]),
    }
}
