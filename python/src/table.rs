//! The Python classes `Table`, `Axis` and `Polynomial`.

use crate::curves::of_table;
use crate::errors::{TableError, faults, file};
use crate::records::{Values, screen};
use crate::value::{Reduced, Value, reduced};
use isotherm_fit::TableFile;
use isotherm_shared::document::MAX_BYTES;
use isotherm_shared::polynomial::Polynomial as Powers;
use isotherm_shared::table::{Axis as Coefficients, CoefficientTable};
use isotherm_shared::units::SensorKind;
use numpy::{PyArray1, PyArrayMethods as _};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::borrow::Cow;
use std::fs::File;
use std::hash::{Hash, Hasher};
use std::io::{self, Read as _};
use std::ops::Index;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A valid coefficient table. `str()` gives the text of its file, without provenance. Two are equal if their digests
/// are.
///
/// >>> table = isotherm.Table.load("imu-a.toml")
/// >>> table.imu, table.temperature_unit, [axis.name for axis in table.axes]
/// ('imu-a', 'V', ['A1', 'A2', 'A3'])
#[pyclass(frozen, module = "isotherm")]
pub struct Table(pub Arc<CoefficientTable>, Arc<str>);

impl Table {
    /// The table of a file with this text.
    pub fn new(table: CoefficientTable, text: &str) -> Self {
        Self(Arc::new(table), text.into())
    }

    /// The same table.
    pub fn share(&self) -> Self {
        Self(Arc::clone(&self.0), Arc::clone(&self.1))
    }

    /// The text of its file, with the provenance.
    pub fn text(&self) -> &str {
        &self.1
    }

    /// The table with what its provenance says.
    fn file(&self) -> PyResult<TableFile> {
        TableFile::from_toml("table", self.text()).map_err(|all| faults("table", &all))
    }
}

/// The coefficients of one accelerometer or gyroscope. Two are equal by name and coefficients, whatever table they are
/// of.
///
/// >>> axis = isotherm.Table.load("imu-a.toml").axes[0]
/// >>> axis.name, axis.bias.unit, axis.positive_scale_factor.unit
/// ('A1', 'ug0', 'pulse/(s*g0)')
#[pyclass(frozen, eq, hash, module = "isotherm")]
pub struct Axis {
    table: Arc<CoefficientTable>,
    kind: SensorKind,
    index: usize,
}

/// A polynomial of temperature. A call evaluates it as the service does, inside its range or outside: a number gives a
/// number, an array of any shape an array of that shape.
///
/// `coefficients`, 1 to 8, are those of (temperature - `center`) / `scale`, c0 first; `range` is where it is
/// calibrated, everywhere unless given; `unit` is that of its value. Raises ValueError for what cannot be. Two are
/// equal if all of these are.
///
/// >>> line = isotherm.Polynomial([1.5, 2.0], unit="mg0")
/// >>> line(2.0), line(np.array([0.0, 1.0]))
/// (5.5, array([1.5, 3.5]))
#[pyclass(frozen, eq, hash, module = "isotherm")]
pub struct Polynomial {
    curve: Powers,
    unit: Cow<'static, str>,
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
    /// Reads a table file. Raises TableError with all its faults.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        parse(&read_text(&path)?, &path.display().to_string())
    }

    /// Reads a table file's text. Raises TableError with all its faults.
    #[staticmethod]
    fn parse(text: &str) -> PyResult<Self> {
        parse(text, "table")
    }

    /// The IMU that it is of.
    #[getter]
    fn imu(&self) -> &str {
        self.0.content().imu.as_str()
    }

    /// The serial number of the device, if it names one.
    #[getter]
    fn serial(&self) -> Option<&str> {
        self.0.content().serial.as_deref()
    }

    /// The value of 1 g0 [m/s2].
    #[getter]
    fn gravity(&self) -> f64 {
        self.0.content().gravity
    }

    /// Local gravity where the table was measured [m/s2], of its provenance. It is not part of the digest.
    #[getter]
    fn gravity_local(&self) -> Option<f64> {
        self.0.gravity_local()
    }

    /// The unit of all its temperatures, for example V or degC.
    #[getter]
    fn temperature_unit(&self) -> &str {
        &self.0.content().temperature_unit
    }

    /// clamp, extrapolate or reject.
    #[getter]
    fn out_of_range(&self) -> &'static str {
        self.0.content().out_of_range.name()
    }

    /// How old temperatures may be before increments are flagged TELEMETRY_STALE [s]; None for no limit.
    #[getter]
    fn max_age_s(&self) -> Option<f64> {
        self.0.content().max_age_s
    }

    /// `sha256:` and 64 hexadecimal digits.
    #[getter]
    fn digest(&self) -> String {
        self.0.digest().to_string()
    }

    /// The first 8 bytes of the digest; every increment carries this number.
    #[getter]
    fn id(&self) -> u64 {
        self.0.id()
    }

    /// Time constant of the lagged temperature [s].
    #[getter]
    fn lag_s(&self) -> Option<f64> {
        self.0.content().lag_s
    }

    /// The control period that the scale factors are of [s]; None if they are of none.
    #[getter]
    fn nominal_interval_s(&self) -> Option<f64> {
        self.0.content().nominal_interval_s
    }

    /// The number of the device that it belongs to: `device(serial)`; 0 without a serial number.
    #[getter]
    fn device(&self) -> u64 {
        self.0.device()
    }

    /// A1, A2, A3.
    #[getter]
    fn axes(&self) -> (Axis, Axis, Axis) {
        axes(&self.0, SensorKind::Accelerometer)
    }

    /// Body-frame increment = matrix * sensor increment.
    #[getter]
    fn alignment(&self) -> Option<[[f64; 3]; 3]> {
        self.0.content().alignment.as_ref().map(rows)
    }

    /// G1, G2, G3, or None.
    #[getter]
    fn gyroscopes(&self) -> Option<(Axis, Axis, Axis)> {
        self.0.content().gyroscopes.as_ref()?;
        Some(axes(&self.0, SensorKind::Gyroscope))
    }

    /// Body-frame angle increment = matrix * sensor increment.
    #[getter]
    fn gyroscope_alignment(&self) -> Option<[[f64; 3]; 3]> {
        self.0.content().gyroscopes.as_ref()?.alignment.as_ref().map(rows)
    }

    /// Writes the table file, sealed by its digest, with the provenance of the text that it was read from.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        crate::records::python(py, "_files", "write_text")?.call1((path, self.file()?.sealed(self.text()))).map(drop)
    }

    /// The curves by sensor and quantity, as curves["A1", "bias"], with the errors that the provenance has.
    #[getter]
    fn curves<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let curves = of_table(&slf.get().file()?);
        crate::records::python(slf.py(), "_curves", "by_name")?.call1((curves,))
    }

    /// The table as a page of HTML, with its curves.
    fn html(&self) -> PyResult<String> {
        Ok(isotherm_report::table::html(&self.file()?))
    }

    fn _repr_html_(&self) -> PyResult<String> {
        Ok(screen(&self.html()?))
    }

    /// Draws the curves with their bands: a row of axes for each sensor. Needs matplotlib; returns the axes.
    #[pyo3(signature = (**options))]
    fn plot<'py>(slf: &Bound<'py, Self>, options: Option<&Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
        crate::records::python(slf.py(), "_plot", "table")?.call((slf,), options)
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

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduced(py, self)
    }
}

fn axes(table: &Arc<CoefficientTable>, kind: SensorKind) -> (Axis, Axis, Axis) {
    [0, 1, 2].map(|index| Axis { table: Arc::clone(table), kind, index }).into()
}

impl Axis {
    /// Its coefficients; those of the accelerometer of this index for a gyroscope that is not there.
    fn axis(&self) -> &Coefficients {
        let content = self.table.content();
        let gyroscopes = content.gyroscopes.as_ref().filter(|_| self.kind == SensorKind::Gyroscope);
        &gyroscopes.map_or(&content.axes, |gyroscopes| &gyroscopes.axes)[self.index]
    }

    /// Of a gyroscope.
    fn g_sensitivities(&self) -> Option<[f64; 3]> {
        let gyroscopes = self.table.content().gyroscopes.as_ref().filter(|_| self.kind == SensorKind::Gyroscope)?;
        gyroscopes.g_sensitivity[self.index]
    }

    fn curve(&self, curve: Powers, unit: &'static str) -> Polynomial {
        Polynomial { curve, unit: unit.into() }
    }
}

/// Axes are equal by name and coefficients, whatever table they are of.
impl PartialEq for Axis {
    fn eq(&self, other: &Self) -> bool {
        (self.kind, self.index, self.axis(), self.g_sensitivities())
            == (other.kind, other.index, other.axis(), other.g_sensitivities())
    }
}

impl Hash for Axis {
    fn hash<H: Hasher>(&self, hasher: &mut H) {
        self.kind.names()[self.index].hash(hasher);
        self.axis().bias.coefficients().iter().for_each(|value| value.to_bits().hash(hasher));
    }
}

impl Value for Table {
    const NAME: &'static str = "Table";
    type State = String;

    fn state(&self) -> Cow<'_, String> {
        Cow::Owned(self.text().to_owned())
    }

    fn of(text: String) -> PyResult<Self> {
        parse(&text, "table")
    }
}

impl Value for Axis {
    const NAME: &'static str = "Axis";
    /// The table, and which sensor.
    type State = (String, SensorKind, usize);

    fn state(&self) -> Cow<'_, Self::State> {
        Cow::Owned((self.table.to_toml(), self.kind, self.index))
    }

    fn of((table, kind, index): Self::State) -> PyResult<Self> {
        let Table(table, _) = parse(&table, "table")?;
        Ok(Self { table, kind, index: index.min(2) })
    }
}

impl Value for Polynomial {
    const NAME: &'static str = "Polynomial";
    /// Coefficients, center, scale, range and unit.
    type State = (Vec<f64>, f64, f64, [f64; 2], String);

    fn state(&self) -> Cow<'_, Self::State> {
        let coefficients = self.curve.coefficients().to_vec();
        Cow::Owned((coefficients, self.curve.center(), self.curve.scale(), self.curve.range(), self.unit.to_string()))
    }

    fn of((coefficients, center, scale, range, unit): Self::State) -> PyResult<Self> {
        let wrong =
            "give 1 to 8 finite coefficients, a finite center, a scale that is not 0, and a range from low to high";
        let curve = Powers::new(&coefficients, center, scale, range).ok_or_else(|| {
            PyValueError::new_err(format!(
                "coefficients are {coefficients:?}, center is {center}, scale is {scale}, range is {range:?}: {wrong}"
            ))
        })?;
        Ok(Self { curve, unit: unit.into() })
    }
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
    /// A1, A2, A3, G1, G2 or G3.
    #[getter]
    fn name(&self) -> &'static str {
        self.kind.names()[self.index]
    }

    /// Bias against head temperature.
    #[getter]
    fn bias(&self) -> Polynomial {
        self.curve(self.axis().bias, self.axis().bias_unit.name())
    }

    /// What the bias has in addition for each unit of (lagged - present) head temperature, in `bias.unit`; 0 for none.
    #[getter]
    fn transient(&self) -> f64 {
        self.axis().transient
    }

    /// K+ against board temperature.
    #[getter]
    fn positive_scale_factor(&self) -> Polynomial {
        self.curve(self.axis().positive_scale_factor, self.kind.scale_factor_unit())
    }

    /// K- against board temperature, negative.
    #[getter]
    fn negative_scale_factor(&self) -> Polynomial {
        self.curve(self.axis().negative_scale_factor, self.kind.scale_factor_unit())
    }

    /// Plausibility limit [pulse/s].
    #[getter]
    fn max_rate(&self) -> Option<f64> {
        self.axis().max_rate
    }

    /// Of a gyroscope: what it indicates for specific force along each of the IMU's axes [deg/h/g0].
    #[getter]
    fn g_sensitivity(&self) -> Option<(f64, f64, f64)> {
        self.g_sensitivities().map(Into::into)
    }

    fn __repr__(&self) -> String {
        format!("Axis('{}')", self.name())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduced(py, self)
    }
}

#[pymethods]
impl Polynomial {
    #[new]
    #[pyo3(signature = (coefficients, *, center = 0.0, scale = 1.0, range = None, unit = ""))]
    fn new(coefficients: Vec<f64>, center: f64, scale: f64, range: Option<[f64; 2]>, unit: &str) -> PyResult<Self> {
        let range = range.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        // A curve has a finite range.
        Self::of((coefficients, center, scale, range.map(|end| end.clamp(f64::MIN, f64::MAX)), unit.to_owned()))
    }

    /// The unit of its value.
    #[getter]
    fn unit(&self) -> &str {
        &self.unit
    }

    /// The coefficients of (temperature - center) / scale, c0 first.
    #[getter]
    fn coefficients<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.curve.coefficients())
    }

    /// The temperature that is subtracted first.
    #[getter]
    fn center(&self) -> f64 {
        self.curve.center()
    }

    /// What the difference from `center` is divided by.
    #[getter]
    fn scale(&self) -> f64 {
        self.curve.scale()
    }

    /// Lower and upper end of the calibrated temperature.
    #[getter]
    fn range(&self) -> (f64, f64) {
        let infinite = |end: f64| if end.abs() == f64::MAX { end.signum() * f64::INFINITY } else { end };
        self.curve.range().map(infinite).into()
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

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduced(py, self)
    }
}
