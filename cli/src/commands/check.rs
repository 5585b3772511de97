//! The laboratory's kinds of files, which `check` knows besides tables and configurations.

use isotherm_calibration::calibrate::observable;
use isotherm_calibration::campaign::Campaign;
use isotherm_campaign::plan::Plan;
use isotherm_failure::{Exit, Failure};
use isotherm_files::LoadError;
use isotherm_service::commands::check::FileKind;
use std::path::Path;

/// The plan is tried first, because it may have positions like a campaign.
pub const KINDS: [FileKind; 2] = [
    FileKind { name: "a campaign plan", mark: "[chamber]", is_meant: Plan::is_meant, check: plan },
    FileKind {
        name: "a campaign",
        mark: "[[position]]",
        is_meant: |document| ["position", "samples", "gravity_reference"].iter().any(|key| document.has(key)),
        check: campaign,
    },
];

fn plan(text: &str, path: &Path) -> Result<String, Failure> {
    let plan = Plan::from_toml(text, path.parent().unwrap_or(Path::new("")));
    let plan = plan.map_err(|faults| LoadError::Refused { path: path.to_owned(), faults })?;
    let (set_points, positions) = (plan.set_points_c.len(), plan.positions.len());
    Ok(format!("campaign plan of {}, {set_points} set points x {positions} positions", plan.imu))
}

fn campaign(text: &str, path: &Path) -> Result<String, Failure> {
    let campaign = Campaign::from_toml(text);
    let campaign = campaign.map_err(|faults| LoadError::Refused { path: path.to_owned(), faults })?;
    observable(&campaign).map_err(|error| Failure::new(Exit::Config, format!("{}: {error}", path.display())))?;
    Ok(format!("campaign of {}, {} positions that observe everything", campaign.imu, campaign.positions.len()))
}
