//! The report of only ramps.

use super::page::Page;
use super::plot::{Plot, Style};
use crate::parts::{CURVE_INTERVALS, grid, never_shown, provenance};
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
    super::transients::verdict(&mut page, &calibration.transients);
    page.findings(&calibration.findings, |_| String::new());
    super::transients::before_after(&mut page, &calibration.transients);
    curves(&mut page, calibration);
    super::transients::sections(&mut page, &calibration.transients, &campaign.temperature_unit);
    let curves_digest = calibration.curves.digest().to_string();
    page.heading(2, "measurement", "Measurement");
    page.key_values(&[
        ("IMU", campaign.imu.to_string()),
        ("Recordings", calibration.recordings.to_string()),
        ("1 g0", format!("{} m/s2", campaign.gravity_reference)),
    ]);
    provenance(&mut page, campaign, source, &[("Curves", curves_digest.as_str())], &calibration.table);
    never_shown(&mut page, &calibration.not_known());
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
        figures.push(plot.series("Ramps", Style::Line, line(new)).series("Curves", Style::Line, line(old)));
        let title = format!("{}: ramps less curves", bias.name());
        let label = format!("Difference / {}", units.bias_on_page);
        let both = line(new).into_iter().zip(line(old));
        let difference = both.map(|((u, new), (_, old))| (u, new - old));
        let plot = Plot::new(&title, &format!("Head temperature / {unit}"), &label).zero_line();
        figures.push(plot.series("Difference", Style::Line, difference));
    }
    page.plots(&figures);
}
