//! The functions `compare` and `batch` on tables, and their results.

use crate::errors::{ComparisonError, faults, in_python};
use isotherm_pipeline::now;

use crate::records::{document, python, screen};
use crate::table::Table;
use crate::value::{Reduced, Value, reduced};
use crate::work::Work;
use isotherm_analysis::{Batch as Statistics, Comparison as Differences, ComparisonRequirement};
use isotherm_fit::{TableFile, tool};
use isotherm_report::batch::BatchSource;
use isotherm_report::comparison::ComparisonSource;
use isotherm_report::{batch as batch_report, comparison as report};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::borrow::Cow;
use std::path::PathBuf;

/// What has changed between tables. `str()` gives the text of `isotherm compare`.
///
/// >>> table = isotherm.Table.load("imu-a.toml")
/// >>> isotherm.compare(table, table).changed
/// []
#[pyclass(frozen, eq, hash, module = "isotherm")]
pub struct Comparison(Differences, (Named, bool));

/// The statistics of a batch of tables. `str()` gives them as text.
///
/// >>> isotherm.batch(["imu-a.toml", "imu-b.toml"]).devices
/// ['imu-a', 'imu-b']
#[pyclass(frozen, eq, hash, module = "isotherm")]
pub struct Batch(Statistics, Named);

/// The name of each table in messages, and its text. From these a result is made again: it takes no fit.
type Named = Vec<(String, String)>;

/// The tables with their names, as the library takes them.
fn files(named: &Named) -> PyResult<Vec<TableFile>> {
    let file =
        |(name, text): &(String, String)| TableFile::from_toml(name.clone(), text).map_err(|all| faults(name, &all));
    named.iter().map(file).collect()
}

fn texts(named: Vec<(String, PyRef<'_, Table>)>) -> Named {
    named.into_iter().map(|(name, table)| (name, table.text().to_owned())).collect()
}

/// Compares tables, each with the name that messages have.
#[pyfunction]
pub(crate) fn compare(
    py: Python<'_>,
    named: Vec<(String, PyRef<'_, Table>)>,
    other_device: bool,
) -> PyResult<Comparison> {
    let named = texts(named);
    Work::new(None).run(py, || Comparison::of((named, other_device)))?
}

/// The statistics of tables, each with the name that messages have.
#[pyfunction]
pub(crate) fn batch(py: Python<'_>, named: Vec<(String, PyRef<'_, Table>)>) -> PyResult<Batch> {
    let named = texts(named);
    Work::new(None).run(py, || Batch::of(named))?
}

impl Value for Comparison {
    const NAME: &'static str = "Comparison";
    type State = (Named, bool);

    fn state(&self) -> Cow<'_, Self::State> {
        Cow::Borrowed(&self.1)
    }

    fn of((named, other_device): Self::State) -> PyResult<Self> {
        let found = isotherm_analysis::compare(files(&named)?, other_device);
        let found = found.map_err(|error| ComparisonError::new_err(in_python(&error.to_string())))?;
        Ok(Self(found, (named, other_device)))
    }
}

impl Value for Batch {
    const NAME: &'static str = "Batch";
    type State = Named;

    fn state(&self) -> Cow<'_, Named> {
        Cow::Borrowed(&self.1)
    }

    fn of(named: Named) -> PyResult<Self> {
        let found = isotherm_analysis::batch(&files(&named)?);
        Ok(Self(found.map_err(|error| ComparisonError::new_err(error.to_string()))?, named))
    }
}

fn requirement(text: &str) -> PyResult<ComparisonRequirement> {
    text.parse().map_err(|message| PyValueError::new_err(format!("require: {message}")))
}

#[pymethods]
impl Comparison {
    /// The document of `isotherm compare --json`, without a requirement: curves, alignments, lines over the dates, and
    /// notes.
    #[getter]
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        document(py, &report::document(&self.0, None))
    }

    /// What has changed by more than the errors, for example ["A1 bias"].
    #[getter]
    fn changed(&self) -> Vec<String> {
        self.0.changed()
    }

    /// Judges each bound of `require`: (curve or triad, "within", "undecided" or "beyond", the judgement in words).
    ///
    /// `require` is as that of the command, for example "bias=20ug0,scale=50ppm,alignment=20urad,rate=0.05deg/h".
    fn judge(&self, require: &str) -> PyResult<Vec<(String, &'static str, String)>> {
        let judgements = self.0.judge(&requirement(require)?);
        Ok(judgements.into_iter().map(|it| (it.name, it.verdict.name(), it.message)).collect())
    }

    /// Raises ComparisonError where `isotherm compare --require` ends with exit code 1: a difference is not within its
    /// bound.
    fn check(&self, require: &str) -> PyResult<()> {
        let checked = self.0.check(&requirement(require)?);
        checked.map_err(|message| ComparisonError::new_err(format!("{}: {message}", self.0.new_table().name)))
    }

    /// The report as HTML, with the judgement of what is required.
    #[pyo3(signature = (*, require = None))]
    fn html(&self, require: Option<&str>) -> PyResult<String> {
        let required = require.map(requirement).transpose()?;
        Ok(report::html(&self.0, &ComparisonSource { tool: tool(), time: now(), required }))
    }

    /// Writes the report (HTML), with the judgement of what is required.
    #[pyo3(signature = (path, *, require = None))]
    fn report(&self, py: Python<'_>, path: PathBuf, require: Option<&str>) -> PyResult<()> {
        python(py, "_files", "write_text")?.call1((path, self.html(require)?)).map(drop)
    }

    fn _repr_html_(&self) -> PyResult<String> {
        Ok(screen(&self.html(None)?))
    }

    /// Draws the difference of each curve, new less old, with its band. Needs matplotlib; returns the axes.
    #[pyo3(signature = (**options))]
    fn plot<'py>(slf: &Bound<'py, Self>, options: Option<&Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
        python(slf.py(), "_plot", "comparison")?.call((slf,), options)
    }

    fn __str__(&self) -> String {
        report::text(&self.0, None)
    }

    fn __repr__(&self) -> String {
        format!("Comparison('{}')", self.0.conclusion())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduced(py, self)
    }
}

#[pymethods]
impl Batch {
    /// The statistics, as `isotherm calibrate turntable --batch --json` prints them: each quantity with its unit,
    /// median, standard deviation and range.
    #[getter]
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        document(py, &batch_report::document(&self.0))
    }

    /// The IMUs, in the order of the values.
    #[getter]
    fn devices(&self) -> Vec<String> {
        self.0.devices.clone()
    }

    /// (IMU, quantity, t) of each value that stands out from the others; None under five devices.
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

    /// The report as HTML.
    fn html(&self) -> String {
        let source = BatchSource {
            tool: tool(),
            time: now(),
            source: format!("{} tables", self.0.devices.len()),
            dropped: Vec::new(),
        };
        batch_report::html(Ok(&self.0), &source)
    }

    /// Writes the report (HTML).
    fn report(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        python(py, "_files", "write_text")?.call1((path, self.html())).map(drop)
    }

    fn _repr_html_(&self) -> String {
        screen(&self.html())
    }

    /// Draws how far each device is from the others, by quantity. Needs matplotlib; returns the axes.
    #[pyo3(signature = (**options))]
    fn plot<'py>(slf: &Bound<'py, Self>, options: Option<&Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
        python(slf.py(), "_plot", "batch")?.call((slf,), options)
    }

    fn __str__(&self) -> String {
        batch_report::text(&self.0)
    }

    fn __repr__(&self) -> String {
        format!("Batch({} devices)", self.0.devices.len())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduced(py, self)
    }
}
