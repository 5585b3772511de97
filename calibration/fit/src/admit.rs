//! What the options accept of the findings.

use crate::error::CalibrationError;
use crate::options::CalibrationOptions;
use crate::result::Calibration;
use isotherm_support::finding::Finding;

/// The findings as the options judge them, see [`Admission::admit`](isotherm_support::finding::Admission::admit); an error if a
/// fault is left.
pub(crate) fn admit(
    findings: Vec<Finding>,
    options: &CalibrationOptions,
    accepted: &mut Vec<&'static str>,
) -> Result<Vec<Finding>, CalibrationError> {
    let admitted = options.admission().admit(findings, accepted);
    admitted.map_err(|findings| CalibrationError::Faults { diagnosis: None, findings })
}

/// Adds findings to those of a calibration; an error if one of them is a fault that is not accepted.
pub(crate) fn add_findings(calibration: &mut Calibration, findings: Vec<Finding>) -> Result<(), CalibrationError> {
    let Calibration { options, accepted, findings: known, .. } = calibration;
    known.extend(admit(findings, options, accepted)?);
    Ok(())
}
