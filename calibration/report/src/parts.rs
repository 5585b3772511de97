//! Parts that several pages have.

use crate::page::{Cell, NoteKind, Page};
use isotherm_campaign::Campaign;
use isotherm_fit::CampaignSource;
use isotherm_shared::table::CoefficientTable;
use isotherm_verification::OWN_RECORDING;

/// Column headings of a table whose rows [`navigation`] makes.
pub(crate) const NAVIGATION: [&str; 5] =
    ["Error", "1e-6 g0", "Level / arc seconds", "Velocity in 60 s / (mm/s)", "Position in 60 s / mm"];

/// The row for an acceleration error \[g0\]: the tilt error of a levelling, and the velocity and position errors after
/// 60 s.
pub(crate) fn navigation(what: &str, error: f64) -> Vec<Cell> {
    let acceleration = error * 9.80665e3;
    vec![
        Cell::text(what),
        Cell::number(error * 1e6, 3),
        Cell::number(error.to_degrees() * 3600.0, 3),
        Cell::number(acceleration * 60.0, 3),
        Cell::number(0.5 * acceleration * 3600.0, 1),
    ]
}

/// The first line of a text about a recording that made the table.
pub(crate) fn first_line(made_the_table: bool) -> String {
    if made_the_table { format!("{OWN_RECORDING}\n") } else { String::new() }
}

/// The note about a recording that made the table.
pub(crate) fn own_recording(page: &mut Page, made_the_table: bool) {
    if made_the_table {
        page.note(NoteKind::Bad, "No evidence", &format!("{OWN_RECORDING}."));
    }
}

/// Adds the line on what a method never shows, whatever was measured.
pub(crate) fn never_shown(page: &mut Page, parts: &[String]) {
    let parts: Vec<_> = parts.iter().map(|part| part.trim_end_matches('.')).collect();
    page.paragraph(&format!("What this method does not show: {}.", parts.join("; ")));
}

/// The section on where a table comes from. `samples` are lines on the samples of the positions.
pub(crate) fn provenance(
    page: &mut Page,
    campaign: &Campaign,
    source: &CampaignSource,
    samples: &[(&str, &str)],
    table: &CoefficientTable,
) {
    page.heading(2, "provenance", "Provenance");
    let digest = table.digest().to_string();
    let mut rows = vec![
        ("Tool", source.tool.as_str()),
        ("Time", &source.time),
        ("Campaign file", &source.campaign),
        ("its SHA-256", &source.campaign_sha256),
    ];
    rows.extend(samples);
    for (ramp, sha256) in campaign.ramps.iter().zip(&source.recordings_sha256) {
        rows.extend([("Ramp", ramp.samples.as_str()), ("its SHA-256", sha256)]);
    }
    let log_imu = source.log_imu.map(|imu| imu.to_string());
    rows.extend(log_imu.iter().map(|imu| ("In the logs", imu.as_str())));
    rows.extend(source.part.iter().map(|part| ("Part that was read", part.as_str())));
    rows.push(("Table", &digest));
    page.key_values(&rows);
}

/// The names of files without their folders, for a subtitle; `paths` are separated by commas.
pub(crate) fn file_names(paths: &str) -> String {
    let name = |path: &str| path.rsplit('/').next().unwrap_or_default().to_owned();
    paths.split(", ").map(name).collect::<Vec<_>>().join(", ")
}

/// Intervals between the points of a drawn curve.
pub(crate) const CURVE_INTERVALS: usize = 120;

/// Evenly spaced temperature over a range, both ends included, for drawing and averaging.
pub(crate) fn grid([low, high]: [f64; 2], intervals: usize) -> impl Iterator<Item = f64> {
    (0..=intervals).map(move |i| low + (high - low) * i as f64 / intervals as f64)
}
