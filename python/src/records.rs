//! Samples and increments as bytes of NumPy's structured arrays, and the Python class `Increment`.

use crate::value::{Reduced, Value, reduced};
use core::ops::Deref;
use isotherm_shared::wire::{AXES, CompensatedIncrement, RawSample, Triad};
use numpy::{Element, PyArray1, PyReadonlyArray1};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use std::borrow::Cow;

/// Size of a raw sample \[bytes\].
pub(crate) const RAW: usize = size_of::<RawSample>();
/// Size of an increment \[bytes\].
pub(crate) const INCREMENT: usize = size_of::<CompensatedIncrement>();

/// Reads the fields of a record, one after the other.
pub(crate) struct Fields<'a>(pub &'a [u8]);

impl Fields<'_> {
    #[inline]
    fn next<const N: usize>(&mut self) -> [u8; N] {
        let Some((head, tail)) = self.0.split_first_chunk() else { return [0; N] };
        self.0 = tail;
        *head
    }

    #[inline]
    fn long(&mut self) -> u64 {
        u64::from_ne_bytes(self.next())
    }

    #[inline]
    fn pulses(&mut self) -> [u32; AXES] {
        [(); AXES].map(|()| u32::from_ne_bytes(self.next()))
    }

    #[inline]
    fn floats(&mut self) -> [f64; AXES] {
        [(); AXES].map(|()| self.float())
    }

    #[inline]
    pub(crate) fn float(&mut self) -> f64 {
        f64::from_ne_bytes(self.next())
    }

    #[inline]
    pub(crate) fn signed(&mut self) -> i64 {
        i64::from_ne_bytes(self.next())
    }

    /// A raw sample. Every byte is read once, because another thread may change the array at the same time.
    #[inline]
    pub(crate) fn raw(&mut self) -> RawSample {
        RawSample {
            session: self.long(),
            sequence: self.long(),
            timestamp_ns: self.long(),
            interval_ns: self.long(),
            sent_ns: self.long(),
            telemetry_ns: self.long(),
            lag_ns: self.long(),
            device: self.long(),
            accelerometers: self.triad(),
            gyroscopes: self.triad(),
        }
    }

    #[inline]
    fn triad(&mut self) -> Triad {
        Triad {
            positive_pulses: self.pulses(),
            negative_pulses: self.pulses(),
            head_temperature: self.floats(),
            board_temperature: self.floats(),
            head_lagged: self.floats(),
        }
    }

    /// An increment.
    pub(crate) fn increment(&mut self) -> CompensatedIncrement {
        CompensatedIncrement {
            session: self.long(),
            sequence: self.long(),
            timestamp_ns: self.long(),
            interval_ns: self.long(),
            velocity_increment: self.floats(),
            angle_increment: self.floats(),
            table: self.long(),
            flags: self.long(),
            latency_ns: self.long(),
        }
    }
}

/// The bytes of a raw sample.
pub(crate) fn raw_bytes(sample: &RawSample) -> [u8; RAW] {
    let mut record = [0; RAW];
    let head = [
        sample.session,
        sample.sequence,
        sample.timestamp_ns,
        sample.interval_ns,
        sample.sent_ns,
        sample.telemetry_ns,
        sample.lag_ns,
        sample.device,
    ];
    let triads = [&sample.accelerometers, &sample.gyroscopes];
    let bytes = head.iter().flat_map(|value| value.to_ne_bytes());
    let bytes = bytes.chain(triads.into_iter().flat_map(|triad| {
        let pulses = [triad.positive_pulses, triad.negative_pulses].into_iter().flatten();
        let temperature = [triad.head_temperature, triad.board_temperature, triad.head_lagged].into_iter().flatten();
        pulses.flat_map(u32::to_ne_bytes).chain(temperature.flat_map(f64::to_ne_bytes))
    }));
    record.iter_mut().zip(bytes).for_each(|(place, byte)| *place = byte);
    record
}

/// The bytes of an increment.
#[inline]
pub(crate) fn increment_bytes(increment: &CompensatedIncrement) -> [u8; INCREMENT] {
    let [v1, v2, v3] = increment.velocity_increment.map(f64::to_bits);
    let [a1, a2, a3] = increment.angle_increment.map(f64::to_bits);
    let head = [increment.session, increment.sequence, increment.timestamp_ns, increment.interval_ns];
    let tail = [increment.table, increment.flags, increment.latency_ns];
    let mut record = [0; INCREMENT];
    let values = head.into_iter().chain([v1, v2, v3, a1, a2, a3]).chain(tail);
    record.chunks_exact_mut(8).zip(values).for_each(|(place, value)| place.copy_from_slice(&value.to_ne_bytes()));
    record
}

/// The first screen of a report, as a notebook shows it.
#[pyfunction]
pub(crate) fn screen(html: &str) -> String {
    isotherm_report::framed(&isotherm_report::first_screen(html))
}

/// The values of a contiguous array. They are copied: while the interpreter's lock is released, another thread may
/// write into the array.
#[derive(Debug, Default)]
pub(crate) struct Values<T>(Vec<T>);

impl<'py, T: Element + Copy> FromPyObject<'_, 'py> for Values<T> {
    type Error = PyErr;

    fn extract(array: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let array: PyReadonlyArray1<'py, T> = array.extract()?;
        Ok(Self(array.as_slice()?.to_vec()))
    }
}

impl<T> Deref for Values<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.0
    }
}

/// A function or value of a module of this package that is written in Python.
pub(crate) fn python<'py>(py: Python<'py>, module: &str, name: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import(format!("isotherm.{module}"))?.getattr(name)
}

/// A JSON document as Python's dictionaries, lists and numbers.
pub(crate) fn document<'py>(py: Python<'py>, document: &serde_json::Value) -> PyResult<Bound<'py, PyAny>> {
    parsed(py, &document.to_string())
}

/// The text of a JSON document as Python's dictionaries, lists and numbers.
pub(crate) fn parsed<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (text,))
}

/// The bytes of the records of `samples` (an array or a data frame): `isotherm._records.sample_bytes`.
pub(crate) fn sample_bytes(samples: &Bound<'_, PyAny>) -> PyResult<Values<u8>> {
    static FUNCTION: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let py = samples.py();
    let function = FUNCTION.get_or_try_init(py, || python(py, "_records", "sample_bytes").map(Bound::unbind))?;
    function.bind(py).call1((samples,))?.extract()
}

/// One raw sample from a record, or from an array of one: `isotherm._records.one_sample`.
pub(crate) fn one_sample(sample: &Bound<'_, PyAny>) -> PyResult<RawSample> {
    static FUNCTION: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let py = sample.py();
    let function = FUNCTION.get_or_try_init(py, || python(py, "_records", "one_sample").map(Bound::unbind))?;
    let bytes = function.bind(py).call1((sample,))?;
    Ok(Fields(bytes.extract()?).raw())
}

/// Bytes as an array of records, without a copy; `name` is the name of their type in `isotherm._records`.
pub(crate) fn view<'py>(bytes: Bound<'py, PyArray1<u8>>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    let dtype = python(bytes.py(), "_records", name)?;
    bytes.call_method1("view", (dtype,))
}

/// A new array of bytes for `count` increments, to be filled in and then converted by [`view`].
pub(crate) fn increments(py: Python<'_>, count: usize) -> Bound<'_, PyArray1<u8>> {
    PyArray1::zeros(py, count * INCREMENT, false)
}

/// An array that takes over `bytes` without a copy.
pub(crate) fn array(py: Python<'_>, bytes: Vec<u8>) -> Bound<'_, PyArray1<u8>> {
    PyArray1::from_vec(py, bytes)
}

/// Exactly three values, from any sequence or array; `name` is that of the argument, `allowed` says what it may be.
///
/// # Errors
/// `TypeError` or `ValueError` with both.
pub(crate) fn triple<'py, T: for<'a> FromPyObject<'a, 'py, Error: Into<PyErr>>>(
    name: &str,
    allowed: &str,
    values: &Bound<'py, PyAny>,
) -> PyResult<[T; AXES]> {
    let list = || -> PyResult<Vec<T>> {
        values.try_iter()?.take(AXES + 1).map(|value| value?.extract().map_err(Into::into)).collect()
    };
    let wrong = || format!("{name} is {values}, give three {allowed}, one for each sensor of the triad");
    let list = list().map_err(|error| match error.is_instance_of::<PyTypeError>(values.py()) {
        true => PyTypeError::new_err(wrong()),
        false => PyValueError::new_err(wrong()),
    })?;
    list.try_into().map_err(|_| PyValueError::new_err(wrong()))
}

/// What pulses may be.
pub(crate) const PULSES: &str = "whole numbers from 0 to 4294967295";
/// What temperatures and readings may be.
pub(crate) const NUMBERS: &str = "numbers";

/// One increment.
///
/// >>> samples = isotherm.read_recording("run.csv")
/// >>> with isotherm.Acquisition("imu-a") as acquisition:
/// ...     increment = acquisition.compensate(samples[0])
/// >>> increment.sequence == int(samples[0]["sequence"]), bool(increment.flags & isotherm.Flags.INVALID)
/// (True, False)
#[pyclass(frozen, eq, hash, module = "isotherm", name = "Increment")]
pub struct Increment(pub CompensatedIncrement);

impl Value for Increment {
    const NAME: &'static str = "Increment";
    /// Its record.
    type State = Vec<u8>;

    fn state(&self) -> Cow<'_, Vec<u8>> {
        Cow::Owned(increment_bytes(&self.0).to_vec())
    }

    fn of(record: Vec<u8>) -> PyResult<Self> {
        Ok(Self(Fields(&record).increment()))
    }
}

#[pymethods]
impl Increment {
    /// The session of the acquisition that sent the sample.
    #[getter]
    fn session(&self) -> u64 {
        self.0.session
    }

    /// The number of the sample in its session.
    #[getter]
    fn sequence(&self) -> u64 {
        self.0.sequence
    }

    /// End of the control period on the acquisition's clock [ns].
    #[getter]
    fn timestamp_ns(&self) -> u64 {
        self.0.timestamp_ns
    }

    /// Control period [ns].
    #[getter]
    fn interval_ns(&self) -> u64 {
        self.0.interval_ns
    }

    /// Along A1, A2, A3 [m/s]; NaN where it could not be computed.
    #[getter]
    fn velocity_increment(&self) -> (f64, f64, f64) {
        self.0.velocity_increment.into()
    }

    /// About G1, G2, G3 [rad]; NaN where it could not be computed, and where the table has no gyroscopes.
    #[getter]
    fn angle_increment(&self) -> (f64, f64, f64) {
        self.0.angle_increment.into()
    }

    /// The mean over the interval [m/s2]; NaN where the velocity increment is NaN, and for an interval of 0.
    #[getter]
    fn specific_force(&self) -> (f64, f64, f64) {
        self.0.specific_force().into()
    }

    /// The mean over the interval [rad/s]; NaN where the angle increment is NaN, and for an interval of 0. Earth's rate
    /// is in it.
    #[getter]
    fn angular_rate(&self) -> (f64, f64, f64) {
        self.0.angular_rate().into()
    }

    /// The `Table.id` of the table that was used; 0 without one.
    #[getter]
    fn table(&self) -> u64 {
        self.0.table
    }

    /// The bits of `Flags`.
    #[getter]
    fn flags(&self) -> u64 {
        self.0.flags
    }

    /// Time from sending the sample to just before publishing [ns].
    #[getter]
    fn latency_ns(&self) -> u64 {
        self.0.latency_ns
    }

    /// The same values as an array without dimensions.
    fn to_numpy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        view(array(py, increment_bytes(&self.0).to_vec()), "INCREMENT")?.call_method1("reshape", ((),))
    }

    fn __repr__(&self) -> String {
        let CompensatedIncrement { sequence, velocity_increment: dv, angle_increment: da, flags, table, .. } = self.0;
        let flags = isotherm_shared::wire::Flags(flags);
        // Without gyroscopes every angle is NaN, and not worth a word.
        let angle = if da.iter().all(|da| da.is_nan()) { String::new() } else { format!(", angle_increment={da:?}") };
        format!("Increment(sequence={sequence}, velocity_increment={dv:?}{angle}, flags='{flags}', table={table:016x})")
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduced(py, self)
    }
}
