//! Which findings the options accept.

use crate::checks::{Finding, Severity};
use crate::error::CalibrationError;
use crate::options::CalibrationOptions;
use crate::result::Calibration;

/// Turns accepted faults into warnings, and adds their names to `accepted`. With `strict` every warning was a fault
/// before.
pub(crate) fn accept(findings: &mut [Finding], options: &CalibrationOptions, accepted: &mut Vec<&'static str>) {
    for finding in findings.iter_mut() {
        if (finding.severity == Severity::Fault || options.strict) && options.accept.contains(&finding.name) {
            finding.severity = Severity::Warning;
            finding.message += "; accepted";
            if !accepted.contains(&finding.name) {
                accepted.push(finding.name);
            }
        }
    }
}

/// The findings as the options judge them: accepted faults are warnings, and with `strict` every other warning is a
/// fault. Adds the names of those that are accepted to `accepted`; an error if a fault is left.
pub(crate) fn admit(
    mut findings: Vec<Finding>,
    options: &CalibrationOptions,
    accepted: &mut Vec<&'static str>,
) -> Result<Vec<Finding>, CalibrationError> {
    findings.sort_by_key(|finding| (finding.severity == Severity::Warning, finding.line));
    accept(&mut findings, options, accepted);
    if options.strict {
        for finding in findings.iter_mut().filter(|finding| !options.accept.contains(&finding.name)) {
            finding.severity = Severity::Fault;
        }
    }
    if any_fault(&findings) {
        return Err(CalibrationError::Faults { diagnosis: None, findings });
    }
    Ok(findings)
}

/// Whether one of the findings is a fault.
pub(crate) fn any_fault(findings: &[Finding]) -> bool {
    findings.iter().any(|finding| finding.severity == Severity::Fault)
}

/// Adds findings to those of a calibration; an error if one of them is a fault that is not accepted.
pub(crate) fn add_findings(calibration: &mut Calibration, findings: Vec<Finding>) -> Result<(), CalibrationError> {
    let Calibration { options, accepted, findings: known, .. } = calibration;
    known.extend(admit(findings, options, accepted)?);
    Ok(())
}
