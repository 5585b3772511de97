//! The Python classes `Table`, `Axis` and `Polynomial`.

use crate::errors::{TableError, faults, file};
use crate::records::Values;
use isotherm_shared::document::MAX_BYTES;
use isotherm_shared::polynomial::Polynomial as Curve;
use isotherm_shared::table::{Axis as Coefficients, CoefficientTable};
use isotherm_shared::units::SensorKind;
use numpy::{PyArray1, PyArrayMethods as _};
use pyo3::prelude::*;
use std::fs::File;
use std::io::{self, Read as _};
use std::ops::Index;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A valid coefficient table, and the text of its file with the provenance.
#[pyclass(frozen, module = "isotherm")]
pub struct Table(pub Arc<CoefficientTable>, Arc<str>);

impl Table {
    /// The table of a file with this text.
    pub fn new(table: CoefficientTable, text: &str) -> Self {
        Self(Arc::new(table), text.into())
    }

    /// The text of its file, with the provenance.
    pub fn text(&self) -> &str {
        &self.1
    }
}

/// The coefficients of one accelerometer or gyroscope.
#[pyclass(frozen, module = "isotherm")]
pub struct Axis {
    name: &'static str,
    kind: SensorKind,
    axis: Coefficients,
    g_sensitivity: Option<[f64; 3]>,
}

/// A polynomial of temperature.
#[pyclass(frozen, module = "isotherm")]
pub struct Polynomial {
    curve: Curve,
    unit: &'static str,
}

/// The text of a table or campaign file.
///
/// # Errors
/// If the file cannot be read, is not a regular file, is too large, or is not UTF-8.
pub(crate) fn read_text(path: &Path) -> PyResult<String> {
    let refused = |message: String| {
        TableError::new_err((format!("{}: {message}", path.display()), vec![(1, String::new(), message)]))
    };
    let read = || -> io::Result<Option<Vec<u8>>> {
        let file = File::open(path)?;
        if !file.metadata()?.is_file() {
            return Ok(None);
        }
        let mut bytes = Vec::new();
        file.take(MAX_BYTES + 1).read_to_end(&mut bytes)?;
        Ok(Some(bytes))
    };
    let bytes = read().map_err(|error| file(path, &error))?;
    let bytes = bytes.ok_or_else(|| refused("not a regular file".to_owned()))?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(refused(format!("over {MAX_BYTES} bytes; no table or campaign file is that large")));
    }
    String::from_utf8(bytes).map_err(|_| refused("not UTF-8; save it as UTF-8 text".to_owned()))
}

#[pymethods]
impl Table {
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        parse(&read_text(&path)?, &path.display().to_string())
    }

    #[staticmethod]
    fn parse(text: &str) -> PyResult<Self> {
        parse(text, "table")
    }

    #[getter]
    fn imu(&self) -> &str {
        self.0.content().imu.as_str()
    }

    #[getter]
    fn serial(&self) -> Option<&str> {
        self.0.content().serial.as_deref()
    }

    #[getter]
    fn gravity(&self) -> f64 {
        self.0.content().gravity
    }

    #[getter]
    fn gravity_local(&self) -> Option<f64> {
        self.0.gravity_local()
    }

    #[getter]
    fn temperature_unit(&self) -> &str {
        &self.0.content().temperature_unit
    }

    #[getter]
    fn out_of_range(&self) -> &'static str {
        self.0.content().out_of_range.name()
    }

    #[getter]
    fn max_age_s(&self) -> Option<f64> {
        self.0.content().max_age_s
    }

    #[getter]
    fn digest(&self) -> String {
        self.0.digest().to_string()
    }

    #[getter]
    fn id(&self) -> u64 {
        self.0.id()
    }

    #[getter]
    fn lag_s(&self) -> Option<f64> {
        self.0.content().lag_s
    }

    #[getter]
    fn nominal_interval_s(&self) -> Option<f64> {
        self.0.content().nominal_interval_s
    }

    #[getter]
    fn device(&self) -> u64 {
        self.0.device()
    }

    #[getter]
    fn axes(&self) -> (Axis, Axis, Axis) {
        axes(SensorKind::Accelerometer, &self.0.content().axes, [None; 3])
    }

    #[getter]
    fn alignment(&self) -> Option<[[f64; 3]; 3]> {
        self.0.content().alignment.as_ref().map(rows)
    }

    #[getter]
    fn gyroscopes(&self) -> Option<(Axis, Axis, Axis)> {
        let gyroscopes = self.0.content().gyroscopes.as_ref()?;
        Some(axes(SensorKind::Gyroscope, &gyroscopes.axes, gyroscopes.g_sensitivity))
    }

    #[getter]
    fn gyroscope_alignment(&self) -> Option<[[f64; 3]; 3]> {
        self.0.content().gyroscopes.as_ref()?.alignment.as_ref().map(rows)
    }

    fn __str__(&self) -> String {
        self.0.to_toml()
    }

    fn __repr__(&self) -> String {
        format!("Table('{}', {})", self.imu(), self.digest())
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.0.digest() == other.0.digest()
    }

    fn __hash__(&self) -> u64 {
        self.0.id()
    }
}

fn axes(kind: SensorKind, axes: &[Coefficients; 3], g_sensitivity: [Option<[f64; 3]>; 3]) -> (Axis, Axis, Axis) {
    let axis = |index: usize| Axis {
        name: kind.names()[index],
        kind,
        axis: axes[index].clone(),
        g_sensitivity: g_sensitivity[index],
    };
    [0, 1, 2].map(axis).into()
}

fn rows(matrix: &impl Index<(usize, usize), Output = f64>) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| matrix[(i, j)]))
}

fn parse(text: &str, source: &str) -> PyResult<Table> {
    let table = CoefficientTable::from_toml(text, None).map_err(|all| faults(source, &all))?;
    Ok(Table::new(table, text))
}

#[pymethods]
impl Axis {
    #[getter]
    fn name(&self) -> &'static str {
        self.name
    }

    #[getter]
    fn bias(&self) -> Polynomial {
        Polynomial { curve: self.axis.bias, unit: self.axis.bias_unit.name() }
    }

    #[getter]
    fn transient(&self) -> f64 {
        self.axis.transient
    }

    #[getter]
    fn positive_scale_factor(&self) -> Polynomial {
        Polynomial { curve: self.axis.positive_scale_factor, unit: self.kind.scale_factor_unit() }
    }

    #[getter]
    fn negative_scale_factor(&self) -> Polynomial {
        Polynomial { curve: self.axis.negative_scale_factor, unit: self.kind.scale_factor_unit() }
    }

    #[getter]
    fn max_rate(&self) -> Option<f64> {
        self.axis.max_rate
    }

    #[getter]
    fn g_sensitivity(&self) -> Option<(f64, f64, f64)> {
        self.g_sensitivity.map(Into::into)
    }

    fn __repr__(&self) -> String {
        format!("Axis('{}')", self.name)
    }
}

#[pymethods]
impl Polynomial {
    #[getter]
    fn unit(&self) -> &'static str {
        self.unit
    }

    #[getter]
    fn coefficients<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.curve.coefficients())
    }

    #[getter]
    fn center(&self) -> f64 {
        self.curve.center()
    }

    #[getter]
    fn scale(&self) -> f64 {
        self.curve.scale()
    }

    #[getter]
    fn range(&self) -> (f64, f64) {
        self.curve.range().into()
    }

    /// The value at one temperature, or at each temperature of an array.
    fn __call__<'py>(&self, temperature: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let py = temperature.py();
        if let Ok(value) = temperature.extract::<f64>() {
            return Ok(self.curve.at(value).into_pyobject(py)?.into_any());
        }
        let flat = crate::records::python(py, "_records", "flat_doubles")?.call1((temperature,))?;
        let values: Values<f64> = flat.extract()?;
        let out = PyArray1::zeros(py, values.len(), false);
        {
            let mut writable = out.readwrite();
            let results = writable.as_slice_mut()?;
            py.detach(|| results.iter_mut().zip(&*values).for_each(|(result, value)| *result = self.curve.at(*value)));
        }
        out.call_method1("reshape", (temperature.getattr("shape")?,))
    }

    fn __repr__(&self) -> String {
        format!("Polynomial({:?}, range={:?}, unit='{}')", self.curve.coefficients(), self.curve.range(), self.unit)
    }
}
