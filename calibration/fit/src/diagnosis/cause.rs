//! The mistake that a diagnosis names, and what it explains.

use isotherm_support::finding::{Finding, Severity, name};

/// Residuals of good data are not larger \[g0\].
pub(super) const MAX_GOOD: f64 = 5e-3;

/// A single mistake that explains the data.
#[derive(Clone, Debug, PartialEq)]
pub struct Diagnosis {
    /// The mistake with its remedy. Its name can be accepted as that of other findings.
    pub finding: Finding,
    /// Names of the findings that it explains, apart from warnings.
    pub(super) explains: &'static [&'static str],
    /// Index among the findings of the one that is the diagnosis itself.
    pub(super) promoted: Option<usize>,
}

impl Diagnosis {
    /// Whether `finding` is a consequence of the mistake.
    #[must_use]
    pub fn explains(&self, finding: &Finding) -> bool {
        finding.severity == Severity::Warning || self.explains.contains(&finding.name)
    }
}

/// Findings that wrong positions, cables or channels cause.
pub(super) const OF_FORCES: &[&str] =
    &[name::WRONG_POSITION, name::NO_PULSES, name::POSITION_OFF, name::CHANNELS_DIFFER, name::LEVEL, name::OUTLIER];

/// A diagnosis in one line, without a place.
pub(super) fn diagnosis(name: &'static str, message: String, explains: &'static [&'static str]) -> Diagnosis {
    Diagnosis { finding: Finding::whole(Severity::Fault, name, message), explains, promoted: None }
}
