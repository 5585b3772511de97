//! Results as the JSON that `--json` prints. Keys of figures have their unit at the end; `in_unit` is the `unit` of the
//! same object. The `value` and the half width `interval` of an estimate have the unit of its key. Counts, ratios and
//! texts have none. What is not known is null.

mod calibration;
pub(crate) mod transients;
mod verification;

pub use verification::verification;
pub(crate) use verification::{Figures, JudgedView, with_unit};

pub use crate::findings::findings;
use crate::view::{value, view};
use calibration::CalibrationView;
use isotherm_fit::{Calibration, CalibrationError, RampCalibration, TumbleError};
use isotherm_support::failure::Failure;
use serde_json::{Value, json};
use std::borrow::Cow;
use transients::TransientsView;

/// A calibration: digest, bottom line, curves, misalignments and findings; of an IMU with gyroscopes also theirs.
/// `locate` gives file and line of a row.
#[must_use]
pub fn calibration(calibration: &Calibration, locate: impl Fn(u64) -> String) -> Value {
    let mut document = value(&CalibrationView::new(calibration));
    document["findings"] = findings(&calibration.findings, locate);
    document
}

/// A calibration from ramps only: digest, what the table does not know, transients and findings. `locate` gives file
/// and line of a row.
#[must_use]
pub fn ramps(calibration: &RampCalibration, locate: impl Fn(u64) -> String) -> Value {
    let mut document = value(&RampsView::of(calibration));
    document["findings"] = findings(&calibration.findings, locate);
    document
}

view! { RampsView<'a>(calibration: &'a RampCalibration) {
    imu: &'a str = calibration.table.content().imu.as_str(),
    digest: String = calibration.table.digest().to_string(),
    curves_digest: String = calibration.curves.digest().to_string(),
    method: &'a str = "ramps",
    ramps: usize = calibration.recordings,
    accuracy: String = calibration.accuracy(),
    not_known: Vec<String> = calibration.not_known(),
    unit: &'a str = &calibration.table.content().temperature_unit,
    transients: TransientsView<'a> = TransientsView::of(&calibration.transients),
    accepted: &'a [&'static str] = &calibration.accepted,
}}

/// A failure: what is printed to stderr, the exit code, and file and line of the cause where they are known.
///
/// ```
/// use isotherm_support::failure::{Exit, Failure};
/// use isotherm_report::json;
/// use std::path::Path;
///
/// let failure = Failure::new(Exit::Data, "samples.csv:7: no number").at(Path::new("samples.csv"), Some(7));
/// let document = json::failure(&failure);
/// assert_eq!((&document["exit_code"], &document["line"]), (&65.into(), &7.into()));
/// ```
#[must_use]
pub fn failure(failure: &Failure) -> Value {
    value(&FailureView::of(failure))
}

view! { FailureView<'a>(failure: &'a Failure) {
    error: &'a str = &failure.message,
    exit_code: u8 = failure.exit as u8,
    file: Option<Cow<'a, str>> = failure.place.as_ref().map(|(file, _)| file.to_string_lossy()),
    line: Option<u64> = failure.place.as_ref().and_then(|(_, line)| *line),
}}

/// Why there is no table: the failure as above, the diagnosis and all findings. `locate` gives file and line of a row.
#[must_use]
pub fn refusal(error: &CalibrationError, failure: &Failure, locate: impl Fn(u64) -> String) -> Value {
    let (diagnosis, findings) = match error {
        CalibrationError::Faults { diagnosis, findings } => (diagnosis.as_deref(), findings.as_slice()),
        _ => (None, &[][..]),
    };
    let mut document = self::failure(failure);
    document["diagnosis"] = json!(diagnosis.map(|diagnosis| diagnosis.finding.record(&locate)));
    document["findings"] = crate::findings::findings(findings, &locate);
    if let CalibrationError::Tumble(error) = error {
        let (parameters, attitude) = match error {
            TumbleError::Attitudes { parameters, attitude, .. } => (Some(parameters), Some(attitude)),
            _ => (None, None),
        };
        document["parameters"] = json!(parameters);
        document["attitude"] = json!(attitude);
    }
    document
}
