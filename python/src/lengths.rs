//! Verification by the length of gravity over static poses, on arrays.

use crate::errors::{StabilityError, in_python};
use crate::offline::with_lag;
use crate::recordings::refuse_disorder;
use crate::records::{Values, document};
use crate::table::Table;
use isotherm_campaign::STATIC_POSE_WINDOW_S;
use isotherm_fit::Origin;
use isotherm_report::magnitudes as report;
use isotherm_verification::{LocalGravity, Magnitudes, MagnitudesError, Requirement};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Compares the lengths over the static poses of samples with local gravity: the document of `isotherm
/// verify --static-poses --json`.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "an argument of a Python function")]
pub(crate) fn lengths<'py>(
    py: Python<'py>,
    table: &Table,
    samples: Values<u8>,
    window: Option<f64>,
    gravity_local: Option<f64>,
    other_device: bool,
    require: Option<&str>,
) -> PyResult<Bound<'py, PyAny>> {
    let required: Option<Requirement> =
        require.map(str::parse).transpose().map_err(|message| PyValueError::new_err(format!("require: {message}")))?;
    py.detach(|| refuse_disorder("array", &samples))?;
    let found = py.detach(|| {
        let rows: Vec<_> = with_lag(&samples, &table.0).collect();
        let lengths = Magnitudes::of(&table.0, &rows, window, LocalGravity::of(gravity_local, &table.0), other_device)?;
        let origin = Origin::of_toml(table.text(), &table.0);
        let made_the_table = origin.is_made_from(&rows.into_iter().collect(), "");
        Ok::<_, MagnitudesError>(Magnitudes { made_the_table, ..lengths })
    });
    let found = found.map_err(|error| StabilityError::new_err(in_python(&error.to_string())))?;
    document(py, &report::json(&found, window.unwrap_or(STATIC_POSE_WINDOW_S), required))
}
