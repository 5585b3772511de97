//! The report of ramps alone.

use super::page::{NoteKind, Page};
use super::plot::{Plot, Style};
use crate::parts::{CURVE_INTERVALS, grid, provenance};
use isotherm_campaign::Campaign;
use isotherm_fit::{CampaignSource, RampCalibration, TriadUnits, axis_of};
use isotherm_shared::table::Axis;

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
    page.findings(&calibration.findings);
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
        let contents = [calibration.table.content(), calibration.curves.content()];
        let [Some(new), Some(old)] = contents.map(|content| axis_of(content, bias.kind, bias.axis)) else { continue };
        let line = |axis: &Axis| -> Vec<(f64, f64)> {
            let value = |u: f64| axis.bias_at(axis.bias.clamp(u)).0 * units.bias_factor;
            grid(new.bias.range(), CURVE_INTERVALS).map(|u| (u, value(u))).collect()
        };
        let title = format!("Bias of {}", bias.name());
        let plot = Plot::new(&title, &format!("Head temperature / {unit}"), &format!("Bias / {}", units.bias_on_page));
        let plot = plot.series("Ramps", Style::Line, line(new)).series("Curves", Style::Line, line(old));
        figures.push((plot.svg(), String::new()));
    }
    page.figures(&figures);
}
