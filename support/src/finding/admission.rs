//! Which findings a user accepts.

use super::record::{Finding, Severity};

/// Which faults a user accepts, and whether a warning is enough to refuse.
#[derive(Clone, Copy, Debug, Default)]
pub struct Admission<'a> {
    /// Names of faults that are only warnings.
    pub accept: &'a [&'static str],
    /// Whether every warning that is not accepted is a fault.
    pub strict: bool,
}

impl Admission<'_> {
    /// Turns accepted faults into warnings, and adds their names to `accepted`. With `strict` every warning was a fault
    /// before.
    pub fn accept(&self, findings: &mut [Finding], accepted: &mut Vec<&'static str>) {
        for finding in findings.iter_mut() {
            if (finding.severity == Severity::Fault || self.strict) && self.accept.contains(&finding.name) {
                finding.severity = Severity::Warning;
                finding.message += "; accepted";
                if !accepted.contains(&finding.name) {
                    accepted.push(finding.name);
                }
            }
        }
    }

    /// The findings as the user judges them, faults first, each kind in the order of the rows: accepted faults are
    /// warnings, and with `strict` every other warning is a fault. Adds the names of those that are accepted to
    /// `accepted`.
    ///
    /// # Errors
    /// All findings, if a fault is left.
    pub fn admit(
        &self,
        mut findings: Vec<Finding>,
        accepted: &mut Vec<&'static str>,
    ) -> Result<Vec<Finding>, Vec<Finding>> {
        findings.sort_by_key(|finding| (finding.severity == Severity::Warning, finding.line));
        self.accept(&mut findings, accepted);
        if self.strict {
            for finding in findings.iter_mut().filter(|finding| !self.accept.contains(&finding.name)) {
                finding.severity = Severity::Fault;
            }
        }
        if any_fault(&findings) { Err(findings) } else { Ok(findings) }
    }
}

/// Whether one of the findings is a fault.
#[must_use]
pub fn any_fault(findings: &[Finding]) -> bool {
    findings.iter().any(|finding| finding.severity == Severity::Fault)
}
