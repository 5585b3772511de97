//! The Python classes `Acquisition`, `Loan` and `Triad`.
//!
//! Over 400 lines: every property of the classes needs its own function here, and a loan is accessed only through its
//! acquisition.

use crate::connection::{imu_id, is_temporary, options};
use crate::errors::{Closed, Full, IsothermError, SequenceError, Timeout, connecting, transport};
use crate::lag::{LagArgument, LagState, sensor};
use crate::owned::ThreadValue;
use crate::records::{Increment, RAW, array, increments, one_sample, raw_bytes, sample_bytes, triple, view};
use crate::run::{End, Run};
use crate::wait::{SLICE, poll_until, seconds};
use isotherm_client::{
    Acquisition as Client, ClosingNote, CompensateError, LagOption, Loan as ClientLoan, Options, RawSample, SendError,
    Triad,
};
use numpy::PyArrayMethods as _;
use pyo3::exceptions::{PyOverflowError, PyValueError};
use pyo3::prelude::*;
use std::time::{Duration, Instant};

/// How long a call waits for an answer without releasing the GIL; releasing it and taking it again would take longer.
const HOLD_GIL: Duration = Duration::from_micros(20);
const NAME: &str = "Acquisition";

/// A client and the samples on loan from it, by their ids.
struct OwnedAcquisition {
    // Loans must be dropped before the client; fields are dropped in this order.
    loans: Vec<(u64, ClientLoan)>,
    next: u64,
    client: Client,
}

impl OwnedAcquisition {
    fn take(&mut self, id: u64) -> PyResult<ClientLoan> {
        let place = self.loans.iter().position(|(other, _)| *other == id).ok_or_else(gone)?;
        Ok(self.loans.swap_remove(place).1)
    }

    fn loan(&mut self, id: u64) -> PyResult<&mut RawSample> {
        self.loans.iter_mut().find(|(other, _)| *other == id).map(|(_, loan)| &mut **loan).ok_or_else(gone)
    }

    fn keep(&mut self, loan: ClientLoan) -> u64 {
        self.next += 1;
        self.loans.push((self.next, loan));
        self.next
    }
}

fn gone() -> PyErr {
    Closed::new_err("this sample has been sent; loan another")
}

/// The one acquisition process of an IMU.
#[pyclass(frozen, module = "isotherm")]
pub struct Acquisition {
    owned: ThreadValue<OwnedAcquisition>,
    imu: String,
    depth: usize,
}

/// A raw sample in shared memory, to be filled in and sent.
#[pyclass(frozen, module = "isotherm")]
pub struct Loan {
    acquisition: Py<Acquisition>,
    id: u64,
}

/// A sample to send: a loan of this acquisition, by its id, or a record.
#[expect(clippy::large_enum_variant, reason = "it lives for one call; a box would be an allocation")]
enum Sample {
    Loan(u64),
    Record(RawSample),
}

#[pymethods]
impl Acquisition {
    #[new]
    #[pyo3(
        signature = (imu, domain = None, timeout = 5.0, *, serial = None, lag = LagArgument(LagOption::Service)),
        text_signature = "(imu, domain=None, timeout=5.0, *, serial=None, lag='service')"
    )]
    fn new(
        py: Python<'_>,
        imu: &str,
        domain: Option<&str>,
        timeout: f64,
        serial: Option<String>,
        lag: LagArgument,
    ) -> PyResult<Self> {
        let (id, timeout) = (imu_id(imu)?, seconds("timeout", timeout)?);
        let mut last = None;
        let client = poll_until(py, timeout, |left| {
            let options = Options { serial: serial.clone(), lag: lag.0, ..options(domain, left)? };
            match py.detach(|| Client::connect(&id, &options).map(send_wrapper::SendWrapper::new)) {
                Ok(client) => Ok(Some(client.take())),
                Err(error) if is_temporary(&error) => {
                    last = Some(error);
                    Ok(None)
                }
                Err(error) => Err(connecting(&error)),
            }
        })?;
        match (client, last) {
            (Some(client), _) => {
                let depth = client.depth();
                let state = OwnedAcquisition { loans: Vec::with_capacity(8), next: 0, client };
                Ok(Self { owned: ThreadValue::new(NAME, state), imu: imu.to_owned(), depth })
            }
            (None, Some(error)) => Err(connecting(&error)),
            (None, None) => Err(Timeout::new_err("connecting took too long")),
        }
    }

    #[getter]
    fn imu(&self) -> &str {
        &self.imu
    }

    #[getter]
    fn depth(&self) -> usize {
        self.depth
    }

    #[getter]
    fn session(&self) -> PyResult<u64> {
        Ok(self.owned.hold()?.open()?.client.session())
    }

    #[getter]
    fn in_flight(&self) -> PyResult<usize> {
        Ok(self.owned.hold()?.open()?.client.in_flight())
    }

    #[getter]
    fn closed(&self) -> bool {
        self.owned.is_closed()
    }

    /// Control periods that were lost, and samples that are unanswered.
    fn close(&self, py: Python<'_>) -> PyResult<(u64, u64)> {
        if self.owned.is_closed() {
            return Ok((0, 0));
        }
        // Loans that were not sent count as lost; they are dropped with the client.
        let ClosingNote { lost, unanswered } = self.owned.hold()?.open()?.client.closing();
        self.owned.close()?;
        if lost > 0 || unanswered > 0 {
            let message = format!(
                "IMU {}: closed with {lost} control periods that were not sent, and {unanswered} unanswered samples",
                self.imu
            );
            py.import("logging")?.call_method1("getLogger", ("isotherm",))?.call_method1("warning", (message,))?;
        }
        Ok((lost, unanswered))
    }

    #[getter]
    fn lost(&self) -> PyResult<u64> {
        Ok(self.owned.hold()?.open()?.client.lost())
    }

    #[getter]
    fn dropped_answers(&self) -> PyResult<u64> {
        Ok(self.owned.hold()?.open()?.client.late().dropped())
    }

    fn __enter__(this: Py<Self>) -> Py<Self> {
        this
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, pyo3::types::PyTuple>) -> PyResult<()> {
        self.close(py).map(drop)
    }

    fn begin_session(&self) -> PyResult<()> {
        let begun = self.owned.hold()?.open()?.client.begin_session();
        begun.map_err(|error| IsothermError::new_err(error.to_string()))
    }

    fn reading(&self, name: &str, temperature: f64, time_ns: u64) -> PyResult<()> {
        let sensor = sensor(name)?;
        self.owned.hold()?.open()?.client.lag().read(sensor, temperature, time_ns);
        Ok(())
    }

    #[getter]
    fn lag_ns(&self) -> PyResult<u64> {
        Ok(self.owned.hold()?.open()?.client.lag().state().lag_ns)
    }

    fn lag_state(&self) -> PyResult<LagState> {
        Ok(LagState::of(self.owned.hold()?.open()?.client.lag().state()))
    }

    fn restore_lag(&self, state: LagState) -> PyResult<()> {
        self.owned.hold()?.open()?.client.lag().restore(&state.lag());
        Ok(())
    }

    fn forget_lag(&self) -> PyResult<()> {
        self.owned.hold()?.open()?.client.lag().forget();
        Ok(())
    }

    fn prepare(&self) -> PyResult<()> {
        self.owned.hold()?.open()?.client.prepare();
        Ok(())
    }

    fn loan(this: &Bound<'_, Self>) -> PyResult<Loan> {
        let mut held = this.get().owned.hold()?;
        let state = held.open()?;
        let loan = state.client.loan().map_err(transport)?;
        Ok(Loan { id: state.keep(loan), acquisition: this.clone().unbind() })
    }

    fn send(&self, sample: &Bound<'_, PyAny>) -> PyResult<()> {
        let given = self.sample(sample)?;
        let mut held = self.owned.hold()?;
        let state = held.open()?;
        let (id, loan) = prepare(state, &given)?;
        state.client.send(loan).map_err(|error| unsent(state, id, error, sample))
    }

    fn keep(&self, sample: &Bound<'_, PyAny>) -> PyResult<()> {
        let given = self.sample(sample)?;
        let mut held = self.owned.hold()?;
        let state = held.open()?;
        let (id, loan) = prepare(state, &given)?;
        state.client.keep(loan).map_err(|error| unsent(state, id, error, sample))
    }

    fn send_kept(&self) -> PyResult<()> {
        self.owned.hold()?.open()?.client.send_kept().map_err(transport)
    }

    #[getter]
    fn kept(&self) -> PyResult<u64> {
        Ok(self.owned.hold()?.open()?.client.kept())
    }

    #[pyo3(signature = (timeout = 0.0))]
    fn receive(&self, py: Python<'_>, timeout: f64) -> PyResult<Option<Increment>> {
        let timeout = seconds("timeout", timeout)?;
        let now = self.owned.hold()?.open()?.client.receive_timeout(timeout.min(HOLD_GIL)).map_err(transport)?;
        if now.is_some() || timeout <= HOLD_GIL {
            return Ok(now.map(Increment));
        }
        let answer = poll_until(py, timeout, |left| {
            let mut held = self.owned.hold()?;
            let state = held.open()?;
            py.detach(|| state.client.receive_timeout(left)).map_err(transport)
        })?;
        Ok(answer.map(Increment))
    }

    #[pyo3(signature = (sample, timeout = 1.0))]
    fn compensate(&self, py: Python<'_>, sample: &Bound<'_, PyAny>, timeout: f64) -> PyResult<Increment> {
        let timeout = seconds("timeout", timeout)?;
        let given = self.sample(sample)?;
        let started = Instant::now();
        let sequence;
        {
            let mut held = self.owned.hold()?;
            let state = held.open()?;
            let (id, loan) = prepare(state, &given)?;
            sequence = loan.sequence;
            match state.client.compensate(loan, timeout.min(HOLD_GIL)) {
                Ok(answer) => return Ok(Increment(answer)),
                Err(CompensateError::Timeout) => {}
                Err(CompensateError::Send(error)) => return Err(unsent(state, id, error, sample)),
                Err(CompensateError::Receive(error)) => return Err(transport(error)),
            }
        }
        let answer = poll_until(py, timeout.saturating_sub(started.elapsed()), |left| {
            let mut held = self.owned.hold()?;
            let state = held.open()?;
            py.detach(|| state.client.late().receive(sequence, left)).map_err(transport)
        })?;
        answer.map(Increment).ok_or_else(|| Timeout::new_err(CompensateError::Timeout.to_string()))
    }

    #[pyo3(signature = (samples, *, window = None, timeout = 15.0, rate = None, new_session = true))]
    fn run<'py>(
        &self,
        py: Python<'py>,
        samples: &Bound<'py, PyAny>,
        window: Option<usize>,
        timeout: f64,
        rate: Option<f64>,
        new_session: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let samples = sample_bytes(samples)?;
        let out = increments(py, samples.len() / RAW);
        let mut writable = out.readwrite();
        let window = window.map_or(self.depth, |window| window.min(self.depth));
        let mut run =
            Run::new(&samples, writable.as_slice_mut()?, window, seconds("timeout", timeout)?, rate, new_session)?;
        let end = loop {
            let mut held = self.owned.hold()?;
            let state = held.open()?;
            match py.detach(|| run.step(&mut state.client, SLICE)) {
                Ok(End::Slice) => {}
                Ok(End::Done) => break None,
                Ok(End::Silent) => {
                    break Some("no answer from the service in time; `isotherm status` shows whether it runs");
                }
                Err(message) => return Err(IsothermError::new_err(message)),
            }
            drop(held);
            py.check_signals()?;
        };
        let received = run.received();
        drop(writable);
        let all = view(out, "INCREMENT")?;
        let Some(message) = end else { return Ok(all) };
        let part = all.get_item(pyo3::types::PySlice::new(py, 0, received.cast_signed(), 1))?;
        Err(Timeout::new_err((message, part.unbind())))
    }

    fn __repr__(&self) -> String {
        format!("Acquisition('{}'{})", self.imu, if self.owned.is_closed() { ", closed" } else { "" })
    }
}

impl Acquisition {
    fn sample(&self, sample: &Bound<'_, PyAny>) -> PyResult<Sample> {
        let Ok(loan) = sample.cast::<Loan>() else { return Ok(Sample::Record(one_sample(sample)?)) };
        let loan = loan.get();
        if std::ptr::eq(loan.acquisition.get(), self) {
            Ok(Sample::Loan(loan.id))
        } else {
            Err(PyValueError::new_err("this sample was loaned by another Acquisition; send it there"))
        }
    }
}

/// The sample to send as a loan, with its id if it is the caller's loan.
#[inline]
fn prepare(state: &mut OwnedAcquisition, sample: &Sample) -> PyResult<(Option<u64>, ClientLoan)> {
    match sample {
        Sample::Loan(id) => Ok((Some(*id), state.take(*id)?)),
        Sample::Record(raw) => Ok((None, state.client.loan_record(raw).map_err(transport)?)),
    }
}

/// The exception for a sample that was not sent. A loan stays the caller's.
fn unsent(state: &mut OwnedAcquisition, id: Option<u64>, error: SendError, sample: &Bound<'_, PyAny>) -> PyErr {
    let message = error.to_string();
    let full = matches!(error, SendError::Full(_));
    let (SendError::Full(loan) | SendError::Sequence(loan)) = error else { return transport(message) };
    if let Some(id) = id {
        state.loans.push((id, loan));
    }
    if full { Full::new_err((message, sample.clone().unbind())) } else { SequenceError::new_err(message) }
}

impl Loan {
    pub(crate) fn with<T>(&self, access: impl FnOnce(&mut RawSample) -> T) -> PyResult<T> {
        let mut held = self.acquisition.get().owned.hold()?;
        Ok(access(held.open()?.loan(self.id)?))
    }
}

#[pymethods]
impl Loan {
    #[getter]
    fn session(&self) -> PyResult<u64> {
        self.with(|raw| raw.session)
    }

    #[getter]
    fn sequence(&self) -> PyResult<u64> {
        self.with(|raw| raw.sequence)
    }

    #[setter]
    fn set_sequence(&self, value: u64) -> PyResult<()> {
        self.with(|raw| raw.sequence = value)
    }

    #[getter]
    fn timestamp_ns(&self) -> PyResult<u64> {
        self.with(|raw| raw.timestamp_ns)
    }

    #[setter]
    fn set_timestamp_ns(&self, value: u64) -> PyResult<()> {
        self.with(|raw| raw.timestamp_ns = value)
    }

    #[getter]
    fn interval_ns(&self) -> PyResult<u64> {
        self.with(|raw| raw.interval_ns)
    }

    #[setter]
    fn set_interval_ns(&self, value: u64) -> PyResult<()> {
        self.with(|raw| raw.interval_ns = value)
    }

    #[getter]
    fn telemetry_ns(&self) -> PyResult<u64> {
        self.with(|raw| raw.telemetry_ns)
    }

    #[setter]
    fn set_telemetry_ns(&self, value: u64) -> PyResult<()> {
        self.with(|raw| raw.telemetry_ns = value)
    }

    #[getter]
    fn lag_ns(&self) -> PyResult<u64> {
        self.with(|raw| raw.lag_ns)
    }

    #[setter]
    fn set_lag_ns(&self, value: u64) -> PyResult<()> {
        self.with(|raw| raw.lag_ns = value)
    }

    #[getter]
    fn device(&self) -> PyResult<u64> {
        self.with(|raw| raw.device)
    }

    #[setter]
    fn set_device(&self, value: u64) -> PyResult<()> {
        self.with(|raw| raw.device = value)
    }

    #[getter]
    fn accelerometers(this: Py<Self>) -> LoanTriad {
        LoanTriad { loan: this, of: |raw| &mut raw.accelerometers }
    }

    #[getter]
    fn gyroscopes(this: Py<Self>) -> LoanTriad {
        LoanTriad { loan: this, of: |raw| &mut raw.gyroscopes }
    }

    /// Copies all fields except the session from a record.
    fn fill(&self, sample: &Bound<'_, PyAny>) -> PyResult<()> {
        let sample = one_sample(sample)?;
        self.with(|raw| *raw = RawSample { session: raw.session, ..sample })
    }

    /// Gives the loan back, and takes its sequence back if it is the last one's.
    fn cancel(&self) -> PyResult<()> {
        let mut held = self.acquisition.get().owned.hold()?;
        let state = held.open()?;
        let loan = OwnedAcquisition::take(state, self.id)?;
        state.client.cancel(loan);
        Ok(())
    }

    /// Adds the next control period, given as a loan, which is cancelled, or as a record.
    fn merge(&self, later: &Bound<'_, PyAny>) -> PyResult<()> {
        let loan = later.cast::<Self>().ok();
        let sample = match &loan {
            Some(loan) if std::ptr::eq(loan.get(), self) => {
                return Err(PyValueError::new_err("a loan cannot be merged into itself"));
            }
            Some(loan) => loan.get().with(|raw| *raw)?,
            None => one_sample(later)?,
        };
        self.with(|raw| raw.merge(&sample))?.map_err(|error| PyOverflowError::new_err(error.to_string()))?;
        loan.map_or(Ok(()), |loan| loan.get().cancel())
    }

    #[getter]
    fn sent(&self) -> PyResult<bool> {
        let mut held = self.acquisition.get().owned.hold()?;
        Ok(held.open().is_ok_and(|state| state.loan(self.id).is_err()))
    }

    /// A copy, as an array without dimensions.
    fn to_numpy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let bytes = self.with(|raw| raw_bytes(raw))?;
        view(array(py, bytes.to_vec()), "RAW_SAMPLE")?.call_method1("reshape", ((),))
    }

    fn __repr__(&self) -> String {
        match self.with(|raw| *raw) {
            Ok(raw) => format!("Loan(sequence={}, timestamp_ns={})", raw.sequence, raw.timestamp_ns),
            Err(_) => "Loan(sent)".to_owned(),
        }
    }
}

/// The accelerometers or the gyroscopes of a loan.
#[pyclass(frozen, module = "isotherm", name = "Triad")]
pub struct LoanTriad {
    loan: Py<Loan>,
    of: fn(&mut RawSample) -> &mut Triad,
}

impl LoanTriad {
    fn with<T>(&self, access: impl FnOnce(&mut Triad) -> T) -> PyResult<T> {
        self.loan.get().with(|raw| access((self.of)(raw)))
    }
}

#[pymethods]
impl LoanTriad {
    #[getter]
    fn positive_pulses(&self) -> PyResult<(u32, u32, u32)> {
        self.with(|triad| triad.positive_pulses.into())
    }

    #[setter]
    fn set_positive_pulses(&self, values: &Bound<'_, PyAny>) -> PyResult<()> {
        let values = triple("positive_pulses", values)?;
        self.with(|triad| triad.positive_pulses = values)
    }

    #[getter]
    fn negative_pulses(&self) -> PyResult<(u32, u32, u32)> {
        self.with(|triad| triad.negative_pulses.into())
    }

    #[setter]
    fn set_negative_pulses(&self, values: &Bound<'_, PyAny>) -> PyResult<()> {
        let values = triple("negative_pulses", values)?;
        self.with(|triad| triad.negative_pulses = values)
    }

    #[getter]
    fn head_temperature(&self) -> PyResult<(f64, f64, f64)> {
        self.with(|triad| triad.head_temperature.into())
    }

    #[setter]
    fn set_head_temperature(&self, values: &Bound<'_, PyAny>) -> PyResult<()> {
        let values = triple("head_temperature", values)?;
        self.with(|triad| triad.head_temperature = values)
    }

    #[getter]
    fn board_temperature(&self) -> PyResult<(f64, f64, f64)> {
        self.with(|triad| triad.board_temperature.into())
    }

    #[setter]
    fn set_board_temperature(&self, values: &Bound<'_, PyAny>) -> PyResult<()> {
        let values = triple("board_temperature", values)?;
        self.with(|triad| triad.board_temperature = values)
    }

    #[getter]
    fn head_lagged(&self) -> PyResult<(f64, f64, f64)> {
        self.with(|triad| triad.head_lagged.into())
    }

    #[setter]
    fn set_head_lagged(&self, values: &Bound<'_, PyAny>) -> PyResult<()> {
        let values = triple("head_lagged", values)?;
        self.with(|triad| triad.head_lagged = values)
    }

    fn __repr__(&self) -> String {
        match self.with(|triad| *triad) {
            Ok(triad) => format!("{triad:?}"),
            Err(_) => "Triad(sent)".to_owned(),
        }
    }
}

impl Drop for Loan {
    /// Gives a loan that was not sent back: its control period is lost.
    fn drop(&mut self) {
        if let Ok(mut held) = self.acquisition.get().owned.hold()
            && let Ok(state) = held.open()
        {
            let _unsent = OwnedAcquisition::take(state, self.id);
        }
    }
}
