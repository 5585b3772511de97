//! The functions `compare` and `batch` on tables, and their results.

use crate::errors::{ComparisonError, faults};
use isotherm_pipeline::now;

use crate::records::{document, python};
use crate::table::Table;
use isotherm_analysis::{Batch as Statistics, Comparison as Differences, ComparisonRequirement};
use isotherm_fit::{TableFile, tool};
use isotherm_report::batch::BatchSource;
use isotherm_report::comparison::ComparisonSource;
use isotherm_report::{batch as batch_report, comparison as report};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::path::PathBuf;

/// What has changed between tables.
#[pyclass(frozen, module = "isotherm")]
pub struct Comparison(Differences);

/// The statistics of a batch of tables.
#[pyclass(frozen, module = "isotherm")]
pub struct Batch(Statistics);

/// The tables with their names, as the library takes them.
fn files(named: &[(String, PyRef<'_, Table>)]) -> PyResult<Vec<TableFile>> {
    let file = |(name, table): &(String, PyRef<'_, Table>)| {
        TableFile::from_toml(name.clone(), table.text()).map_err(|all| faults(name, &all))
    };
    named.iter().map(file).collect()
}

/// Compares tables, each with the name that messages have.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "an argument of a Python function")]
pub(crate) fn compare(
    py: Python<'_>,
    named: Vec<(String, PyRef<'_, Table>)>,
    other_device: bool,
) -> PyResult<Comparison> {
    let files = files(&named)?;
    let found = py.detach(|| isotherm_analysis::compare(files, other_device));
    found.map(Comparison).map_err(|error| ComparisonError::new_err(error.to_string()))
}

/// The statistics of tables, each with the name that messages have.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "an argument of a Python function")]
pub(crate) fn batch(py: Python<'_>, named: Vec<(String, PyRef<'_, Table>)>) -> PyResult<Batch> {
    let files = files(&named)?;
    let found = py.detach(|| isotherm_analysis::batch(&files));
    found.map(Batch).map_err(|error| ComparisonError::new_err(error.to_string()))
}

fn requirement(text: &str) -> PyResult<ComparisonRequirement> {
    text.parse().map_err(|message| PyValueError::new_err(format!("require: {message}")))
}

#[pymethods]
impl Comparison {
    /// The document of `isotherm compare --json`, without a requirement.
    #[getter]
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        document(py, &report::document(&self.0, None))
    }

    #[getter]
    fn changed(&self) -> Vec<String> {
        self.0.changed()
    }

    /// For each curve or triad with a bound: its name, the verdict, and the judgement in words.
    fn judge(&self, require: &str) -> PyResult<Vec<(String, &'static str, String)>> {
        let judgements = self.0.judge(&requirement(require)?);
        Ok(judgements.into_iter().map(|it| (it.name, it.verdict.name(), it.message)).collect())
    }

    /// Raises an exception where the command ends with exit code 1.
    fn check(&self, require: &str) -> PyResult<()> {
        let checked = self.0.check(&requirement(require)?);
        checked.map_err(|message| ComparisonError::new_err(format!("{}: {message}", self.0.new_table().name)))
    }

    #[pyo3(signature = (path, *, require = None))]
    fn report(&self, py: Python<'_>, path: PathBuf, require: Option<&str>) -> PyResult<()> {
        let required = require.map(requirement).transpose()?;
        let time = now();
        let page = report::html(&self.0, &ComparisonSource { tool: tool(), time, required });
        python(py, "_files", "write_text")?.call1((path, page)).map(drop)
    }

    fn __str__(&self) -> String {
        report::text(&self.0, None)
    }

    fn __repr__(&self) -> String {
        format!("Comparison('{}')", self.0.conclusion())
    }
}

#[pymethods]
impl Batch {
    /// The statistics as `isotherm calibrate turntable --batch --json` prints them.
    #[getter]
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        document(py, &batch_report::document(&self.0))
    }

    #[getter]
    fn devices(&self) -> Vec<String> {
        self.0.devices.clone()
    }

    /// Device, quantity and t of each value that stands out; None under five devices.
    #[getter]
    fn stand_outs(&self) -> Option<Vec<(String, String, f64)>> {
        let found = self.0.stand_outs.as_ref()?.iter();
        let name =
            |unit: usize, quantity: usize| (self.0.devices[unit].clone(), self.0.quantities[quantity].name.clone());
        Some(
            found
                .map(|it| {
                    let (unit, quantity) = name(it.unit, it.quantity);
                    (unit, quantity, it.t)
                })
                .collect(),
        )
    }

    fn report(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let source = BatchSource {
            tool: tool(),
            time: now(),
            source: format!("{} tables", self.0.devices.len()),
            dropped: Vec::new(),
        };
        let page = batch_report::html(Ok(&self.0), &source);
        python(py, "_files", "write_text")?.call1((path, page)).map(drop)
    }

    fn __str__(&self) -> String {
        batch_report::text(&self.0)
    }

    fn __repr__(&self) -> String {
        format!("Batch({} devices)", self.0.devices.len())
    }
}
