//! A description of a file for people.

use super::model::{DescribedKind, FileDescription};
use super::rows::{ImuSummary, TemperatureSpan};
use std::fmt::Write as _;

/// Writing to a String cannot fail.
pub(super) fn text(of: &FileDescription) -> String {
    let mut text = String::new();
    let _ = writeln!(text, "{}: {}, {}", of.file, of.format, size(of.bytes));
    for imu in &of.imus {
        let _ = writeln!(text, "  {}", line(imu, of.kind));
    }
    for finding in &of.findings {
        let _ = writeln!(text, "  {} [{}]: {}", finding.severity, finding.name, finding.message);
        if !finding.remedy.is_empty() {
            let _ = writeln!(text, "    Remedy: {}", finding.remedy);
        }
    }
    for note in &of.notes {
        let _ = writeln!(text, "  {note}");
    }
    for job in of.jobs.iter().filter(|job| job.good) {
        let _ = writeln!(text, "  good for {:20} {}", job.job, job.command);
    }
    // One reason is enough for a file that cannot be read.
    let mut left: Vec<_> = of.jobs.iter().filter(|job| !job.good && of.error.is_none()).collect();
    while let Some(reason) = left.first().map(|job| job.reason.clone()) {
        let (same, others): (Vec<_>, _) = left.into_iter().partition(|job| job.reason == reason);
        let names: Vec<_> = same.iter().map(|job| job.job).collect();
        let _ = writeln!(text, "  not for {}: {reason}", names.join(", "));
        left = others;
    }
    text
}

fn line(imu: &ImuSummary, kind: DescribedKind) -> String {
    let mut parts = Vec::new();
    let name = imu.imu.clone().or_else(|| imu.instance.map(|instance| format!("IMU {instance}")));
    let devices = imu.devices.iter().flatten().map(u32::to_string).collect::<Vec<_>>();
    let devices = if devices.is_empty() { String::new() } else { format!(" (devices {})", devices.join(", ")) };
    parts.extend(name.map(|name| name + &devices));
    if let Some(rows) = imu.rows {
        parts.push(format!("{rows} rows"));
    }
    parts.extend(imu.rate_hz.map(|rate| format!("{rate:.4} Hz")));
    parts.extend(imu.duration_s.map(|duration| format!("{duration:.1} s")));
    parts.extend(imu.sessions.filter(|sessions| *sessions > 1).map(|sessions| format!("{sessions} sessions")));
    parts.extend(imu.temperature.as_ref().map(span));
    parts.extend(imu.gyroscope_temperature.as_ref().map(|of| format!("gyroscopes {}", span(of))));
    if kind != DescribedKind::Campaign {
        parts.push(if imu.gyroscopes { "with gyroscopes" } else { "without gyroscopes" }.to_owned());
    }
    parts.extend(imu.attitudes.filter(|attitudes| *attitudes > 1).map(|attitudes| format!("{attitudes} attitudes")));
    parts.join(", ")
}

fn span(of: &TemperatureSpan) -> String {
    let TemperatureSpan { low, high, unit, is_placeholder } = of;
    if *is_placeholder {
        return "no temperature".to_owned();
    }
    format!("{low:.2} to {high:.2} {}", unit.as_deref().unwrap_or("in the unit of its table"))
}

fn size(bytes: u64) -> String {
    match bytes {
        0..10_000 => format!("{bytes} bytes"),
        10_000..10_000_000 => format!("{:.0} kB", bytes as f64 / 1e3),
        _ => format!("{:.0} MB", bytes as f64 / 1e6),
    }
}
