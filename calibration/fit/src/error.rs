//! Why no table can be made of a campaign.

use crate::diagnosis::Diagnosis;
use crate::joint::OneStageError;
use crate::transients::TransientsError;
use crate::tumble::error::TumbleError;
use isotherm_shared::table::ContentFault;
use isotherm_statistics::RegressionError;
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::finding::{Finding, Severity, name};
use std::path::Path;

/// Most findings that are listed without being asked for.
const SHOWN: usize = 10;

/// Why no table can be made of a campaign.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// The list of positions does not determine all parameters.
    #[error("{}", .0.join("\n"))]
    Positions(Vec<String>),
    /// There are no dwells.
    #[error("no rows; a campaign needs dwells")]
    Empty,
    /// Findings of the checks, at least one of them a fault.
    #[error("{}", lines(findings, diagnosis.as_deref(), false, |finding| finding.to_string()).join("\n"))]
    Faults {
        /// The single mistake that explains them, if there is one.
        diagnosis: Option<Box<Diagnosis>>,
        /// All other findings.
        findings: Vec<Finding>,
    },
    /// A dwell or turn to leave out does not exist.
    #[error("there is no dwell or turn at set point {0} degC with the number {1} to leave out")]
    NothingToExclude(f64, u32),
    /// The remaining dwells of a set point do not determine its parameters.
    #[error("set point {set_point_c} degC: {deficiency}")]
    SetPoint {
        /// The set point \[degC\].
        set_point_c: f64,
        /// The parameters that are not determined, and positions that would help.
        deficiency: String,
    },
    /// Too few set points for an order.
    #[error("{axis} {quantity}: {error}; take a lower order, or more set points")]
    Order {
        /// A1, A2 or A3.
        axis: &'static str,
        /// Name of the quantity, as in the table.
        quantity: &'static str,
        /// Why the order cannot be fitted.
        error: RegressionError,
    },
    /// An option is not for this campaign.
    #[error("{0}")]
    Options(String),
    /// The table `curves` is not for these ramps.
    #[error("{}", .0.join("\n"))]
    Curves(Vec<String>),
    /// Nothing can be estimated from the ramps.
    #[error(transparent)]
    Transients(#[from] TransientsError),
    /// The joint fit failed.
    #[error(transparent)]
    Fit(#[from] OneStageError),
    /// The static poses of a tumble do not give a table.
    #[error(transparent)]
    Tumble(#[from] TumbleError),
    /// The result is not a valid table.
    #[error("the result is not a valid table: {}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Table(Vec<ContentFault>),
}

impl CalibrationError {
    /// Names of the faults that are left, each of which must be accepted too; empty if one of them cannot be.
    #[must_use]
    pub fn acceptable(&self) -> Vec<&'static str> {
        let Self::Faults { diagnosis, findings } = self else { return Vec::new() };
        let faults = findings.iter().filter(|finding| finding.severity == Severity::Fault);
        let mut names: Vec<&'static str> = Vec::new();
        for finding in diagnosis.iter().map(|diagnosis| &diagnosis.finding).chain(faults) {
            if !names.contains(&finding.name) {
                names.push(finding.name);
            }
        }
        if names.iter().all(|name| name::acceptable(name).is_ok()) { names } else { Vec::new() }
    }

    /// The findings as lines, if they are the error. The diagnosis comes first; without `symptoms`, those that it
    /// explains are only counted, and of the others the first ten are listed.
    pub fn lines(&self, symptoms: bool, line: impl Fn(&Finding) -> String) -> Vec<String> {
        match self {
            Self::Faults { diagnosis, findings } => lines(findings, diagnosis.as_deref(), symptoms, line),
            _ => Vec::new(),
        }
    }

    /// The error as the failure of a program, with the file concerned. `campaign` is the campaign file and `samples`
    /// the recording; `locate` gives file and line of a row.
    #[must_use]
    pub fn failure(&self, campaign: &Path, samples: &Path, locate: impl Fn(u64) -> String) -> Failure {
        self.failure_with(campaign, samples, locate, false)
    }

    /// As [`failure`](Self::failure). With `symptoms`, the findings that a diagnosis explains are listed too.
    #[must_use]
    pub fn failure_with(
        &self,
        campaign: &Path,
        samples: &Path,
        locate: impl Fn(u64) -> String,
        symptoms: bool,
    ) -> Failure {
        let exit = match self {
            Self::Positions(_) | Self::Curves(_) => Exit::Config,
            Self::NothingToExclude(..) | Self::Options(_) => Exit::Usage,
            // Nothing is wrong with the data: they show too little for what they would replace.
            Self::Faults { diagnosis: None, findings }
                if findings.iter().all(|it| it.severity != Severity::Fault || it.name == name::ONE_DIRECTION) =>
            {
                Exit::Failed
            }
            Self::Fit(_) | Self::Table(_) | Self::Tumble(TumbleError::Table(_)) => Exit::Failed,
            // Options are wrong for these data; for those of another IMU they may be right.
            Self::Tumble(_) | Self::Empty | Self::Faults { .. } => Exit::Data,
            Self::SetPoint { .. } | Self::Order { .. } | Self::Transients(_) => Exit::Data,
        };
        let message = match self {
            Self::Faults { .. } => self.lines(symptoms, |finding| finding.tagged(&locate)).join("\n"),
            Self::NothingToExclude(..) | Self::Tumble(TumbleError::NothingToExclude(..)) => {
                format!("--exclude: {self}")
            }
            Self::Options(_) | Self::Tumble(_) => self.to_string(),
            // The message begins with the name of the recording, which may be all that was given.
            Self::Transients(_) if self.to_string().starts_with(&format!("{}: ", shown(campaign))) => self.to_string(),
            Self::Transients(_) => format!("{}: the ramps: {self}", shown(campaign)),
            Self::Positions(deficiencies) | Self::Curves(deficiencies) => {
                let line = |deficiency: &String| format!("{}: {deficiency}", shown(campaign));
                deficiencies.iter().map(line).collect::<Vec<_>>().join("\n")
            }
            _ => format!("{}: {self}", shown(samples)),
        };
        let failure = Failure::new(exit, message);
        match self {
            Self::Positions(_) | Self::Curves(_) | Self::Transients(_) => failure.at(campaign, None),
            Self::NothingToExclude(..) | Self::Options(_) | Self::Tumble(_) => failure,
            // Each finding has its own line.
            _ => failure.at(samples, None),
        }
    }
}

/// The findings as lines. The diagnosis comes first; without `symptoms`, those that it explains are only counted, and
/// of the others the first [`SHOWN`] are listed: faults come before warnings.
fn lines(
    findings: &[Finding],
    diagnosis: Option<&Diagnosis>,
    symptoms: bool,
    line: impl Fn(&Finding) -> String,
) -> Vec<String> {
    let is_symptom = |finding: &&Finding| diagnosis.is_some_and(|diagnosis| diagnosis.explains(finding));
    let (explained, mut others): (Vec<&Finding>, Vec<&Finding>) = findings.iter().partition(is_symptom);
    others.sort_by_key(|finding| finding.severity == Severity::Warning);
    let mut lines: Vec<String> = diagnosis.iter().map(|diagnosis| line(&diagnosis.finding)).collect();
    if symptoms {
        lines.extend(others.into_iter().chain(explained).map(&line));
        return lines;
    }
    let more = others.len().saturating_sub(SHOWN);
    lines.extend(others.into_iter().take(SHOWN).map(&line));
    let symptoms = explained.len();
    let noun = if symptoms == 1 { "symptom" } else { "symptoms" };
    let rest = match (more, symptoms) {
        (0, 0) => return lines,
        (0, _) => format!("{symptoms} {noun}"),
        (_, 0) => format!("{more} more"),
        _ => format!("{more} more, and {symptoms} {noun}"),
    };
    let them = if more + symptoms == 1 { "it" } else { "them" };
    lines.push(format!("... and {rest}; with -v isotherm calibrate lists {them}"));
    lines
}
