//! Verification by the length of gravity over static poses, on arrays.

use crate::errors::{StabilityError, in_python};
use crate::offline::with_lag;
use crate::recordings::refuse_disorder;
use crate::records::{RAW, Values, document};
use crate::table::Table;
use crate::work::Work;
use isotherm_campaign::STATIC_POSE_WINDOW_S;
use isotherm_fit::{Origin, tool};
use isotherm_pipeline::now;
use isotherm_report::magnitudes as report;
use isotherm_report::verification::VerificationSource;
use isotherm_verification::{LocalGravity, Magnitudes, Requirement};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Compares the lengths over the static poses of samples with local gravity: the document of `isotherm
/// verify --static-poses --json`.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, clippy::too_many_arguments, reason = "those of the function of the package")]
pub(crate) fn lengths<'py>(
    py: Python<'py>,
    table: &Table,
    samples: Values<u8>,
    window: Option<f64>,
    gravity_local: Option<f64>,
    other_device: bool,
    require: Option<&str>,
    recording: String,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Bound<'py, PyAny>, String)> {
    let required: Option<Requirement> =
        require.map(str::parse).transpose().map_err(|message| PyValueError::new_err(format!("require: {message}")))?;
    let work = Work::new(progress);
    let found = work.run(py, || {
        refuse_disorder("array", &samples)?;
        let rows: Vec<_> = work.rows(samples.len() / RAW, with_lag(&samples, &table.0)).collect();
        let lengths = Magnitudes::of(&table.0, &rows, window, LocalGravity::of(gravity_local, &table.0), other_device);
        let lengths = lengths.map_err(|error| StabilityError::new_err(in_python(&error.to_string())))?;
        let origin = Origin::of_toml(table.text(), &table.0);
        let made_the_table = origin.is_made_from(&rows.into_iter().collect(), "");
        Ok::<_, PyErr>(Magnitudes { made_the_table, ..lengths })
    })??;
    let window_s = window.unwrap_or(STATIC_POSE_WINDOW_S);
    let imu = table.0.content().imu.to_string();
    let source = VerificationSource { tool: tool(), time: now(), table: imu, recording, window_s, required };
    let html = report::html(&table.0, &found, &source);
    Ok((document(py, &report::json(&found, window_s, required))?, html))
}
