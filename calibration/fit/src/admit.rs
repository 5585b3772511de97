//! What the options accept of the findings.

use crate::error::CalibrationError;
use crate::options::CalibrationOptions;
use crate::result::Calibration;
use isotherm_support::finding::{Admission, Finding};

/// What was found, as the options judge it.
pub(crate) struct AdmittedFindings<'a> {
    admission: Admission<'a>,
    pub findings: Vec<Finding>,
    /// Names of the faults that were accepted.
    pub accepted: Vec<&'static str>,
}

impl<'a> AdmittedFindings<'a> {
    pub(crate) const fn new(admission: Admission<'a>) -> Self {
        Self { admission, findings: Vec::new(), accepted: Vec::new() }
    }

    /// Adds findings; an error if one of them is a fault that is not accepted.
    pub(crate) fn add(&mut self, findings: impl IntoIterator<Item = Finding>) -> Result<(), CalibrationError> {
        let admitted = self.admission.admit(findings.into_iter().collect(), &mut self.accepted);
        self.findings.extend(admitted.map_err(|findings| CalibrationError::Faults { diagnosis: None, findings })?);
        Ok(())
    }
}

/// The findings as the options judge them, see [`Admission::admit`](isotherm_support::finding::Admission::admit); an
/// error if a fault is left.
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
