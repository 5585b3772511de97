//! Samples and increments as bytes of NumPy's structured arrays, and the Python class `Increment`.

use isotherm_shared::wire::{AXES, CompensatedIncrement, RawSample};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

/// Size of a raw sample \[bytes\].
pub const RAW: usize = size_of::<RawSample>();
/// Size of an increment \[bytes\].
pub const INCREMENT: usize = size_of::<CompensatedIncrement>();

/// Reads the fields of a record, one after the other.
pub struct Fields<'a>(pub &'a [u8]);

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
    pub fn float(&mut self) -> f64 {
        f64::from_ne_bytes(self.next())
    }

    #[inline]
    pub fn signed(&mut self) -> i64 {
        i64::from_ne_bytes(self.next())
    }

    /// A raw sample. Every byte is read once, because another thread may change the array at the same time.
    #[inline]
    pub fn raw(&mut self) -> RawSample {
        RawSample {
            session: self.long(),
            sequence: self.long(),
            timestamp_ns: self.long(),
            interval_ns: self.long(),
            sent_ns: self.long(),
            telemetry_ns: self.long(),
            positive_pulses: self.pulses(),
            negative_pulses: self.pulses(),
            head_temperature: self.floats(),
            board_temperature: self.floats(),
        }
    }

    /// An increment.
    pub fn increment(&mut self) -> CompensatedIncrement {
        CompensatedIncrement {
            session: self.long(),
            sequence: self.long(),
            timestamp_ns: self.long(),
            interval_ns: self.long(),
            velocity_increment: self.floats(),
            table: self.long(),
            flags: u32::from_ne_bytes(self.next()),
            latency_ns: u32::from_ne_bytes(self.next()),
        }
    }
}

/// The bytes of a raw sample.
pub fn raw_bytes(sample: &RawSample) -> [u8; RAW] {
    let mut record = [0; RAW];
    let head =
        [sample.session, sample.sequence, sample.timestamp_ns, sample.interval_ns, sample.sent_ns, sample.telemetry_ns];
    let pulses = [sample.positive_pulses, sample.negative_pulses];
    let telemetry = [sample.head_temperature, sample.board_temperature];
    let bytes = head.iter().flat_map(|value| value.to_ne_bytes());
    let bytes = bytes.chain(pulses.iter().flatten().flat_map(|value| value.to_ne_bytes()));
    let bytes = bytes.chain(telemetry.iter().flatten().flat_map(|value| value.to_ne_bytes()));
    record.iter_mut().zip(bytes).for_each(|(place, byte)| *place = byte);
    record
}

/// The bytes of an increment.
#[inline]
pub fn increment_bytes(increment: &CompensatedIncrement) -> [u8; INCREMENT] {
    let [a1, a2, a3] = increment.velocity_increment.map(f64::to_bits);
    let head = [increment.session, increment.sequence, increment.timestamp_ns, increment.interval_ns];
    let mut record = [0; INCREMENT];
    let (longs, last) = record.split_at_mut(64);
    let values = head.into_iter().chain([a1, a2, a3, increment.table]);
    longs.chunks_exact_mut(8).zip(values).for_each(|(place, value)| place.copy_from_slice(&value.to_ne_bytes()));
    last[..4].copy_from_slice(&increment.flags.to_ne_bytes());
    last[4..].copy_from_slice(&increment.latency_ns.to_ne_bytes());
    record
}

/// A function or value of a module of this package that is written in Python.
pub fn python<'py>(py: Python<'py>, module: &str, name: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import(format!("isotherm.{module}"))?.getattr(name)
}

/// A JSON document as Python's dictionaries, lists and numbers.
pub fn document<'py>(py: Python<'py>, document: &serde_json::Value) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (document.to_string(),))
}

/// The records of `samples` (an array or a data frame) as the bytes of one contiguous array: `isotherm._records.sample_bytes`.
pub fn sample_bytes<'py>(samples: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArray1<'py, u8>> {
    static FUNCTION: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let py = samples.py();
    let function = FUNCTION.get_or_try_init(py, || python(py, "_records", "sample_bytes").map(Bound::unbind))?;
    function.bind(py).call1((samples,))?.extract()
}

/// One raw sample from a record, or from an array of one: `isotherm._records.one_sample`.
pub fn one_sample(sample: &Bound<'_, PyAny>) -> PyResult<RawSample> {
    static FUNCTION: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let py = sample.py();
    let function = FUNCTION.get_or_try_init(py, || python(py, "_records", "one_sample").map(Bound::unbind))?;
    let bytes = function.bind(py).call1((sample,))?;
    Ok(Fields(bytes.extract()?).raw())
}

/// Bytes as an array of records, without a copy; `name` is the name of their type in `isotherm._records`.
pub fn view<'py>(bytes: Bound<'py, PyArray1<u8>>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    let dtype = python(bytes.py(), "_records", name)?;
    bytes.call_method1("view", (dtype,))
}

/// A new array of bytes for `count` increments, to be filled in and then converted by [`view`].
pub fn increments(py: Python<'_>, count: usize) -> Bound<'_, PyArray1<u8>> {
    PyArray1::zeros(py, count * INCREMENT, false)
}

/// An array that takes over `bytes` without a copy.
pub fn array(py: Python<'_>, bytes: Vec<u8>) -> Bound<'_, PyArray1<u8>> {
    PyArray1::from_vec(py, bytes)
}

/// Exactly three values, from any sequence or array.
pub fn triple<'py, T: for<'a> FromPyObject<'a, 'py, Error: Into<PyErr>>>(
    name: &str,
    values: &Bound<'py, PyAny>,
) -> PyResult<[T; AXES]> {
    let wrong = || pyo3::exceptions::PyValueError::new_err(format!("{name}: give three values, for A1, A2, A3"));
    let list = values.try_iter()?.map(|value| value?.extract::<T>().map_err(Into::into));
    let list = list.take(AXES + 1).collect::<PyResult<Vec<_>>>()?;
    list.try_into().map_err(|_| wrong())
}

/// One velocity increment, the answer of the service.
#[pyclass(frozen, module = "isotherm", name = "Increment")]
pub struct Increment(pub CompensatedIncrement);

#[pymethods]
impl Increment {
    #[getter]
    fn session(&self) -> u64 {
        self.0.session
    }

    #[getter]
    fn sequence(&self) -> u64 {
        self.0.sequence
    }

    #[getter]
    fn timestamp_ns(&self) -> u64 {
        self.0.timestamp_ns
    }

    #[getter]
    fn interval_ns(&self) -> u64 {
        self.0.interval_ns
    }

    #[getter]
    fn velocity_increment(&self) -> (f64, f64, f64) {
        let [a1, a2, a3] = self.0.velocity_increment;
        (a1, a2, a3)
    }

    #[getter]
    fn table(&self) -> u64 {
        self.0.table
    }

    #[getter]
    fn flags(&self) -> u32 {
        self.0.flags
    }

    #[getter]
    fn latency_ns(&self) -> u32 {
        self.0.latency_ns
    }

    /// The same values as an array without dimensions.
    fn to_numpy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        view(array(py, increment_bytes(&self.0).to_vec()), "INCREMENT")?.call_method1("reshape", ((),))
    }

    fn __repr__(&self) -> String {
        let CompensatedIncrement { sequence, velocity_increment: dv, flags, table, .. } = self.0;
        let flags = isotherm_shared::wire::Flags(flags);
        format!("Increment(sequence={sequence}, velocity_increment={dv:?}, flags='{flags}', table={table:016x})")
    }
}
