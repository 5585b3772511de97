//! What a description has.

use super::rows::ImuSummary;
use isotherm_support::finding::Finding;
use isotherm_support::finding::name::explanations;
use serde::Serialize;

/// What a file has.
#[derive(Clone, Copy, Debug, Eq, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum DescribedKind {
    /// A recording of Isotherm.
    Recording,
    /// Data of another program: a log, a text with a mapping, messages of ROS.
    Data,
    /// Parameters of an autopilot.
    Parameters,
    /// A coefficient table.
    Table,
    /// A campaign file.
    Campaign,
    /// A mapping.
    Mapping,
    /// A campaign plan.
    Plan,
    /// The description of a source.
    Source,
    /// The description of a node of ROS 2.
    Node,
    /// A configuration of the service.
    Configuration,
    /// It is not known.
    Unknown,
}

/// A finding with what `explain` says of it.
#[derive(Clone, Debug, Serialize)]
pub struct FindingExplanation {
    /// The name.
    pub name: &'static str,
    /// `fault` or `warning`.
    pub severity: &'static str,
    /// What was found.
    pub message: String,
    /// What data look like that have it.
    pub meaning: &'static str,
    /// What to do.
    pub remedy: &'static str,
}

impl FindingExplanation {
    pub(super) fn of(finding: &Finding) -> Self {
        let explanation = explanations().find(|explanation| explanation.name == finding.name);
        Self {
            name: finding.name,
            severity: finding.severity.name(),
            message: finding.located(|line| line.to_string()),
            meaning: explanation.map_or("", |explanation| explanation.meaning.trim()),
            remedy: explanation.map_or("", |explanation| explanation.remedy),
        }
    }
}

/// What a file is, and what it is good for.
#[derive(Debug, Serialize)]
pub struct FileDescription {
    /// The file, as it was named.
    pub file: String,
    /// Its length.
    pub bytes: u64,
    /// What it has.
    pub kind: DescribedKind,
    /// Its format in words.
    pub format: String,
    /// The IMUs, each with its rows; of a table the one that it is of.
    pub imus: Vec<ImuSummary>,
    /// What it is good for, and what not.
    pub jobs: Vec<JobFitness>,
    /// What was found in it, of all IMUs.
    pub findings: Vec<FindingExplanation>,
    /// What else is to be known, a line each.
    pub notes: Vec<String>,
    /// Why it cannot be read, with the remedy, such as an option that is missing.
    pub error: Option<String>,
    /// The exit code of that.
    pub exit_code: u8,
}

/// Whether a file is good for a job.
#[derive(Clone, Debug, Serialize)]
pub struct JobFitness {
    /// The job: the name of the command, as `calibrate warm-up`.
    pub job: &'static str,
    /// Whether it is.
    pub good: bool,
    /// Why it is not, and what is needed; empty if it is.
    pub reason: String,
    /// The command line, with words in capitals for what has to be chosen; empty if it is not good for the job.
    pub command: String,
}
