//! The kinds of files that `check` reads with the laboratory and the service: campaign plans, descriptions of sources,
//! configurations.

use isotherm_acquire::Description;
use isotherm_automation::plan::Plan;
use isotherm_command::check::CheckedFiles;
use isotherm_documents::LoadError;
use isotherm_offline::commands::CHECKED_FILES;
use isotherm_ros2::NodeDescription;
use isotherm_service::commands::check::configuration;
use isotherm_shared::kind::FileKind;
use isotherm_support::failure::{Failure, shown};
use std::path::Path;
use tracing::warn;

/// All kinds of files.
pub(super) const ALL_FILES: CheckedFiles = CheckedFiles { laboratory: laboratory_file, configuration, ..CHECKED_FILES };

/// Validates a file of the laboratory.
fn laboratory_file(kind: FileKind, text: &str, path: &Path) -> Result<String, Failure> {
    match kind {
        FileKind::Plan => plan(text, path),
        FileKind::Source => source(text, path),
        FileKind::Node => node(text, path),
        other => (CHECKED_FILES.laboratory)(other, text, path),
    }
}

fn source(text: &str, path: &Path) -> Result<String, Failure> {
    let description = Description::from_toml(text);
    let description = description.map_err(|faults| LoadError::Refused { path: path.to_owned(), faults })?;
    Ok(description.summary())
}

fn node(text: &str, path: &Path) -> Result<String, Failure> {
    let description = NodeDescription::from_toml(text, path.parent().unwrap_or(Path::new("")));
    let description = description.map_err(|faults| LoadError::Refused { path: path.to_owned(), faults })?;
    Ok(description.summary())
}

fn plan(text: &str, path: &Path) -> Result<String, Failure> {
    let plan = Plan::from_toml(text, path.parent().unwrap_or(Path::new("")));
    let plan = plan.map_err(|faults| LoadError::Refused { path: path.to_owned(), faults })?;
    for warning in plan.warnings() {
        warn!("{}: warning: {warning}", shown(path));
    }
    for finding in plan.findings() {
        warn!("warning [{}]: {}: {finding}", finding.name, shown(path));
    }
    Ok(format!("campaign plan of {}, {}", plan.names(), plan.size()))
}
