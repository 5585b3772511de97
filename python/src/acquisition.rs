//! The Python classes `Acquisition`, `Loan` and `Triad`.
//!
//! Over 400 lines: every property of the classes needs its own function here, and a loan is accessed only through its
//! acquisition.

use crate::connection::{imu_id, is_temporary, options};
use crate::errors::{Closed, Full, IsothermError, SequenceError, Timeout, connecting, transport};
use crate::lag::{LagArgument, LagState, sensor};
use crate::owned::ThreadValue;
use crate::records::{
    Increment, NUMBERS, PULSES, RAW, array, increment_bytes, increments, one_sample, raw_bytes, sample_bytes, triple,
    view,
};
use crate::run::{End, Run};
use crate::value::stays;
use crate::wait::{SLICE, poll_until, seconds};
use isotherm_client::{
    Acquisition as Client, ClosingNote, CompensateError, CompensatedIncrement, ExchangeError, KEPT_RANGE, LagOption,
    Loan as ClientLoan, MOST_KEPT, Options, RawSample, Resolution, SendError, Triad,
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
    /// Increments that `exchange` has received and not returned, since the wait was interrupted.
    arrived: Vec<CompensatedIncrement>,
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

/// The one acquisition process of an IMU. Only the thread that created it may use it.
///
/// Waits up to `timeout` seconds for the service of `domain` (without a name that of ISOTHERM_DOMAIN, otherwise
/// "default").
///
/// `serial` is the serial number of the device whose samples it sends. `lag` says which time constant their lagged
/// temperature has: "service" that of the table in force, a number [s], or None: the library keeps no lag then. `kept`
/// is how many control periods wait at most for a service that has no room or is away; each takes 256 bytes.
/// `resolution` is what one pulse over the nominal interval of the table stands for [m/s2, rad/s], such as (1e-6,
/// 1e-7), if the samples are readings: then `fill` makes their pulses. Raises IsothermError if those are not the
/// table's.
///
/// >>> samples = isotherm.read_recording("run.csv")
/// >>> with isotherm.Acquisition("imu-a", timeout=5.0) as acquisition:
/// ...     increments = acquisition.run(samples[:5])
/// >>> increments["sequence"] == samples["sequence"][:5]
/// array([ True,  True,  True,  True,  True])
#[pyclass(frozen, module = "isotherm")]
pub struct Acquisition {
    owned: ThreadValue<OwnedAcquisition>,
    imu: String,
}

/// A raw sample in shared memory, which is yours until it is sent. Every later use raises Closed.
///
/// >>> with isotherm.Acquisition("imu-a") as acquisition:
/// ...     sample = acquisition.loan()
/// ...     sample.timestamp_ns = sample.interval_ns = 2_500_000
/// ...     sample.accelerometers.positive_pulses = (140, 0, 150)
/// ...     increment = acquisition.compensate(sample)
/// ...     print(sample.sent, increment.interval_ns)
/// True 2500000
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
        signature = (
            imu, domain = None, timeout = 5.0, *, serial = None, lag = LagArgument(LagOption::Service), kept = MOST_KEPT, resolution = None
        ),
        text_signature = "(imu, domain=None, timeout=5.0, *, serial=None, lag='service', kept=16384, resolution=None)"
    )]
    #[expect(clippy::too_many_arguments, reason = "those of the class, which have names there")]
    fn new(
        py: Python<'_>,
        imu: &str,
        domain: Option<&str>,
        timeout: f64,
        serial: Option<String>,
        lag: LagArgument,
        kept: usize,
        resolution: Option<(f64, f64)>,
    ) -> PyResult<Self> {
        if !KEPT_RANGE.contains(&kept) {
            return Err(PyValueError::new_err(format!("kept is {kept}, give 1 to {}", KEPT_RANGE.end())));
        }
        let (id, timeout) = (imu_id(imu)?, seconds("timeout", timeout)?);
        let resolution = resolution.map(|(accelerometer, gyroscope)| Resolution { accelerometer, gyroscope });
        let mut last = None;
        let client = poll_until(py, timeout, |left| {
            let options = Options { serial: serial.clone(), lag: lag.0, kept, resolution, ..options(domain, left)? };
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
                let state = OwnedAcquisition { loans: Vec::with_capacity(8), next: 0, arrived: Vec::new(), client };
                Ok(Self { owned: ThreadValue::new(NAME, state), imu: imu.to_owned() })
            }
            (None, Some(error)) => Err(connecting(&error)),
            (None, None) => Err(Timeout::new_err("connecting took too long")),
        }
    }

    /// The IMU.
    #[getter]
    fn imu(&self) -> &str {
        &self.imu
    }

    /// The most samples that can be unanswered at once.
    #[getter]
    fn depth(&self) -> PyResult<usize> {
        Ok(self.owned.hold()?.open()?.client.depth())
    }

    /// The session of all samples; a new random number for each connection.
    #[getter]
    fn session(&self) -> PyResult<u64> {
        Ok(self.owned.hold()?.open()?.client.session())
    }

    /// Samples that have been sent and whose answers have not been received.
    #[getter]
    fn in_flight(&self) -> PyResult<usize> {
        Ok(self.owned.hold()?.open()?.client.in_flight())
    }

    /// Whether it has been closed.
    #[getter]
    fn closed(&self) -> bool {
        self.owned.is_closed()
    }

    /// Leaves the streams. Loans that have not been sent become invalid. A second call does nothing.
    ///
    /// Returns `lost`, and how many samples are unanswered; if either is not 0 it is logged ("isotherm") and kept in
    /// the service's status.
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

    /// Control periods that have a sequence and are gone, in all sessions: loans that were dropped, are still on loan,
    /// or failed, and periods for which the waiting line had no room. What waits is not lost: `kept`.
    #[getter]
    fn lost(&self) -> PyResult<u64> {
        Ok(self.owned.hold()?.open()?.client.lost())
    }

    /// Late answers that were dropped because `depth` of them waited for `receive` already.
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

    /// Writes the pulses of a sample of readings: three of `specific_force` [m/s2], and of `angular_rate` [rad/s], each
    /// the mean over the interval of the sample. Without `angular_rate` the gyroscopes become absent: no pulses, and
    /// temperature NaN. What rounding leaves is carried to the next sample, so that nothing is lost over time.
    ///
    /// The pulses are those of the table in force, with the `resolution` of the acquisition, whatever your own interval
    /// is: the increment is right at any rate. An `interval_ns` of 0, as a loan has, becomes the nominal one. While no
    /// table is known, or its pulses stand for something else, samples are invalid: they are sent with temperatures of
    /// NaN, and a line on stderr says why.
    ///
    /// Raises ValueError with the name of the sensor, and changes nothing, for a reading that is not finite or over
    /// 2**32 - 1 pulses.
    #[pyo3(signature = (sample, specific_force, angular_rate = None))]
    fn fill(
        &self,
        sample: &Bound<'_, Loan>,
        specific_force: &Bound<'_, PyAny>,
        angular_rate: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let force = triple("specific_force", NUMBERS, specific_force)?;
        let rate = angular_rate.map(|rate| triple("angular_rate", NUMBERS, rate)).transpose()?;
        let mut raw = sample.get().with(|raw| *raw)?;
        let filled = self.owned.hold()?.open()?.client.fill(&mut raw, force, rate);
        filled.map_err(|error| PyValueError::new_err(error.to_string()))?;
        sample.get().with(|of_loan| *of_loan = raw)
    }

    /// Begins a new session: the next sample may have any sequence. What the temperatures have been is not known then,
    /// unless the lag is restored, or the IMU said to be soaked, after this.
    ///
    /// Raises IsothermError if samples are unanswered or kept.
    fn begin_session(&self) -> PyResult<()> {
        let begun = self.owned.hold()?.open()?.client.begin_session();
        begun.map_err(|error| IsothermError::new_err(error.to_string()))
    }

    /// Takes a new reading of the head temperature of a sensor, A1 to G3, measured at `time_ns` on the acquisition's
    /// clock.
    ///
    /// Call it once for each new measurement, not for each sample. Every sample that is sent later carries the lagged
    /// temperature.
    fn reading(&self, name: &str, temperature: f64, time_ns: u64) -> PyResult<()> {
        let sensor = sensor(name)?;
        self.owned.hold()?.open()?.client.lag().read(sensor, temperature, time_ns);
        Ok(())
    }

    /// Takes a new reading of one head temperature that all sensors share, as of an IMU with one thermometer: as
    /// `reading` once for each of the six.
    fn reading_of_all(&self, temperature: f64, time_ns: u64) -> PyResult<()> {
        self.owned.hold()?.open()?.client.lag().reading_of_all(temperature, time_ns);
        Ok(())
    }

    /// The time constant that samples are sent with [ns]; 0 while there is none.
    #[getter]
    fn lag_ns(&self) -> PyResult<u64> {
        Ok(self.owned.hold()?.open()?.client.lag().state().lag_ns)
    }

    /// The state of the lag, which `json` can keep: for each sensor None, or time, temperature and lagged temperature
    /// of its last reading, the share of an unknown start, and the number of the machine's start that the time is of.
    fn lag_state(&self) -> PyResult<LagState> {
        Ok(LagState::of(self.owned.hold()?.open()?.client.lag().state()))
    }

    /// Goes on with a state of `lag_state`, on the same clock, as if the temperature had gone straight on in the pause.
    ///
    /// A sensor that is None, or whose next reading is earlier than the kept one, is unknown as after `forget_lag`. So
    /// are all of a state that was kept before the machine was started anew. If your clock goes on over that, set the
    /// last number of each sensor to 0.
    fn restore_lag(&self, state: LagState) -> PyResult<()> {
        self.owned.hold()?.open()?.client.lag().restore(&state.lag());
        Ok(())
    }

    /// Informs the library that what the temperatures have been is not known, as is so already when the acquisition
    /// connects, and when it begins a session.
    ///
    /// Increments are flagged LAG_UNKNOWN, and computed without the transient terms, until the readings span three time
    /// constants.
    fn forget_lag(&self) -> PyResult<()> {
        self.owned.hold()?.open()?.client.lag().forget();
        Ok(())
    }

    /// Informs the library that the IMU is soaked: its temperatures have been those of the next readings for three time
    /// constants.
    ///
    /// Only what has just been powered, or has stood long enough, is. If it is not, the lagged temperature is wrong by
    /// the difference, which decays with the time constant, and no flag shows it.
    fn soaked(&self) -> PyResult<()> {
        self.owned.hold()?.open()?.client.lag().soaked();
        Ok(())
    }

    /// Goes through the motions of sending a sample and receiving its increment, so that the next sample finds its way
    /// warm.
    ///
    /// Nobody else sees anything of it. Call it while you wait for the end of a control period, some tens of
    /// microseconds before it.
    fn prepare(&self) -> PyResult<()> {
        self.owned.hold()?.open()?.client.prepare();
        Ok(())
    }

    /// Loans a sample in shared memory, to be filled in; session and sequence are set already, and every temperature is
    /// NaN. At most 4 at once.
    ///
    /// It stands for a control period. Its sequence is one above the highest that was loaned or sent; if it is not
    /// sent, the service flags the gap. `Loan.cancel` gives back one that stands for none.
    fn loan(this: &Bound<'_, Self>) -> PyResult<Loan> {
        let mut held = this.get().owned.hold()?;
        let state = held.open()?;
        let loan = state.client.loan().map_err(transport)?;
        Ok(Loan { id: state.keep(loan), acquisition: this.clone().unbind() })
    }

    /// Serves a control period: sends all that waits, then `sample`, waits up to `timeout` seconds for its increment,
    /// and returns all increments that have arrived, each once and in the order of sending, as an array of INCREMENT.
    ///
    /// What the service has no room for waits in the memory of this process (`kept`), and a later call sends it. So a
    /// loop of only this call loses no control period while the service stalls, is away for as many periods as may be
    /// kept, or is replaced: fewer increments come then, or none, and later more than one. Give a time-out that is
    /// shorter than the control period. Raises SequenceError if the sequence is not above the last one sent or kept.
    fn exchange<'py>(&self, py: Python<'py>, sample: &Bound<'py, PyAny>, timeout: f64) -> PyResult<Bound<'py, PyAny>> {
        let timeout = seconds("timeout", timeout)?;
        let given = self.sample(sample)?;
        let started = Instant::now();
        let sequence;
        {
            let mut held = self.owned.hold()?;
            let state = held.open()?;
            let (id, loan) = prepare(state, &given)?;
            sequence = loan.sequence;
            let OwnedAcquisition { client, arrived, .. } = &mut **state;
            let take = |increment| arrived.push(increment);
            match client.exchange_each(loan, timeout.min(HOLD_GIL), usize::MAX, take) {
                Ok(()) => {}
                Err(ExchangeError::Forked(loan) | ExchangeError::Sequence(loan)) => {
                    return Err(unsent(state, id, SendError::Sequence(loan), sample));
                }
            }
        }
        let is_there = |arrived: &[CompensatedIncrement]| arrived.last().is_some_and(|last| last.sequence == sequence);
        if timeout > HOLD_GIL && !is_there(&self.owned.hold()?.open()?.arrived) {
            poll_until(py, timeout.saturating_sub(started.elapsed()), |left| {
                let mut held = self.owned.hold()?;
                let state = held.open()?;
                // A failure of the transport is a silence, which has the streams joined anew.
                let received = py.detach(|| state.client.receive_timeout(left));
                state.arrived.extend(received.unwrap_or_default());
                Ok(is_there(&state.arrived).then_some(()))
            })?;
        }
        let arrived = std::mem::take(&mut self.owned.hold()?.open()?.arrived);
        let bytes = arrived.iter().flat_map(increment_bytes).collect();
        view(array(py, bytes), "INCREMENT")
    }

    /// Sends a sample: a loan, or a record of RAW_SAMPLE, which is copied and keeps its sequence. Never waits.
    ///
    /// Raises Full, with the sample, if `depth` samples are unanswered, or samples are kept, which go first, or the
    /// service's queue may still be full of samples that were sent again after restarts. `keep` it then.
    fn send(&self, sample: &Bound<'_, PyAny>) -> PyResult<()> {
        let given = self.sample(sample)?;
        let mut held = self.owned.hold()?;
        let state = held.open()?;
        let (id, loan) = prepare(state, &given)?;
        state.client.send(loan).map_err(|error| unsent(state, id, error, sample))
    }

    /// Keeps a control period for which the service has no room: it waits in memory of this process, and is sent before
    /// all that comes later. `exchange` does this by itself.
    ///
    /// Beyond the number that the acquisition was given, the oldest is dropped and counts as `lost`: a gap for every
    /// reader. Raises SequenceError if the sequence is not above the last one sent or kept.
    fn keep(&self, sample: &Bound<'_, PyAny>) -> PyResult<()> {
        let given = self.sample(sample)?;
        let mut held = self.owned.hold()?;
        let state = held.open()?;
        let (id, loan) = prepare(state, &given)?;
        state.client.keep(loan).map_err(|error| unsent(state, id, error, sample))
    }

    /// Sends what is kept, oldest first, as far as the service takes it now; after an outage no faster than readers and
    /// recorders take it.
    ///
    /// Never waits. Every sending call begins with it.
    fn send_kept(&self) -> PyResult<()> {
        self.owned.hold()?.open()?.client.send_kept().map_err(transport)
    }

    /// Control periods that wait: they are kept, and not sent yet.
    #[getter]
    fn kept(&self) -> PyResult<u64> {
        Ok(self.owned.hold()?.open()?.client.kept())
    }

    /// The answer to the oldest unanswered sample, or None if it does not come within `timeout` seconds.
    ///
    /// First come the late answers that `compensate` has kept aside.
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

    /// The round trip of one sample: sends it and waits for its increment. Raises Full or Timeout.
    ///
    /// After Timeout the increment may come late: it is kept aside for `receive`, at most `depth` of them, and comes
    /// after later ones. Where order matters, use `exchange`.
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

    /// Sends an array of RAW_SAMPLE, or a data frame, and returns the increments in the same order, as `isotherm feed`
    /// does.
    ///
    /// At most `window` samples are in flight; `rate` is in samples per second. Raises Timeout if no answer comes for
    /// `timeout` seconds. If no sample has a `lag_ns`, their temperature is followed: a value that differs from the
    /// last one is a reading. With `new_session` the run is a session of its own; without it, its sequences must rise
    /// above those sent before.
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
        let depth = self.depth()?;
        let window = window.map_or(depth, |window| window.min(depth));
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

    fn __reduce__(&self) -> PyResult<()> {
        Err(stays("Acquisition", "give the worker the samples, or open the acquisition there"))
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
    /// The session of the sample: that of the acquisition.
    #[getter]
    fn session(&self) -> PyResult<u64> {
        self.with(|raw| raw.session)
    }

    /// Raise it if samples were lost before they could be sent; the service then flags the gap.
    #[getter]
    fn sequence(&self) -> PyResult<u64> {
        self.with(|raw| raw.sequence)
    }

    #[setter]
    fn set_sequence(&self, value: u64) -> PyResult<()> {
        self.with(|raw| raw.sequence = value)
    }

    /// End of the control period on the acquisition's clock [ns].
    #[getter]
    fn timestamp_ns(&self) -> PyResult<u64> {
        self.with(|raw| raw.timestamp_ns)
    }

    #[setter]
    fn set_timestamp_ns(&self, value: u64) -> PyResult<()> {
        self.with(|raw| raw.timestamp_ns = value)
    }

    /// Control period, the measured gate length [ns], 1 to 3 600 000 000 000.
    #[getter]
    fn interval_ns(&self) -> PyResult<u64> {
        self.with(|raw| raw.interval_ns)
    }

    #[setter]
    fn set_interval_ns(&self, value: u64) -> PyResult<()> {
        self.with(|raw| raw.interval_ns = value)
    }

    /// When the temperatures were read, on the acquisition's clock [ns]; 0 = unknown. The highest bit marks stale ones.
    #[getter]
    fn telemetry_ns(&self) -> PyResult<u64> {
        self.with(|raw| raw.telemetry_ns)
    }

    #[setter]
    fn set_telemetry_ns(&self, value: u64) -> PyResult<()> {
        self.with(|raw| raw.telemetry_ns = value)
    }

    /// Time constant of the lagged temperature [ns]. 0 until it is sent, unless you fill it in.
    #[getter]
    fn lag_ns(&self) -> PyResult<u64> {
        self.with(|raw| raw.lag_ns)
    }

    #[setter]
    fn set_lag_ns(&self, value: u64) -> PyResult<()> {
        self.with(|raw| raw.lag_ns = value)
    }

    /// Which unit this is: `device` of its serial number. 0 until it is sent, unless you fill it in.
    #[getter]
    fn device(&self) -> PyResult<u64> {
        self.with(|raw| raw.device)
    }

    #[setter]
    fn set_device(&self, value: u64) -> PyResult<()> {
        self.with(|raw| raw.device = value)
    }

    /// A1, A2, A3.
    #[getter]
    fn accelerometers(this: Py<Self>) -> LoanTriad {
        LoanTriad { loan: this, of: |raw| &mut raw.accelerometers }
    }

    /// G1, G2, G3; where the IMU has none, no pulses and temperature NaN (or 0).
    #[getter]
    fn gyroscopes(this: Py<Self>) -> LoanTriad {
        LoanTriad { loan: this, of: |raw| &mut raw.gyroscopes }
    }

    /// Copies all fields except the session from a record of RAW_SAMPLE, the sequence included.
    fn fill(&self, sample: &Bound<'_, PyAny>) -> PyResult<()> {
        let sample = one_sample(sample)?;
        self.with(|raw| *raw = RawSample { session: raw.session, ..sample })
    }

    /// Gives the loan back, as it stands for no control period: takes its sequence back, if it is the last loan's.
    fn cancel(&self) -> PyResult<()> {
        let mut held = self.acquisition.get().owned.hold()?;
        let state = held.open()?;
        let loan = OwnedAcquisition::take(state, self.id)?;
        state.client.cancel(loan);
        Ok(())
    }

    /// Adds the next control period: pulses and intervals are summed, timestamp and temperature become the later ones.
    ///
    /// A loan that is merged is cancelled. Raises OverflowError, and changes nothing, if a sum overflows. If the sum is
    /// dropped, that is one sequence, whatever it holds. For devices that sum by themselves.
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

    /// Whether it has been sent.
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

    fn __reduce__(&self) -> PyResult<()> {
        Err(stays("Loan", "give to_numpy(), a copy"))
    }

    fn __repr__(&self) -> String {
        match self.with(|raw| *raw) {
            Ok(raw) => format!("Loan(sequence={}, timestamp_ns={})", raw.sequence, raw.timestamp_ns),
            Err(_) => "Loan(sent)".to_owned(),
        }
    }
}

/// The accelerometers or the gyroscopes of a loan: three values each. It is part of the loan, and ends with it.
///
/// >>> with isotherm.Acquisition("imu-a") as acquisition:
/// ...     sample = acquisition.loan()
/// ...     triad = sample.accelerometers
/// ...     triad.positive_pulses = (140, 0, 150)
/// ...     print(triad.positive_pulses)
/// ...     sample.cancel()
/// (140, 0, 150)
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
    /// Pulses of the positive channels in the period.
    #[getter]
    fn positive_pulses(&self) -> PyResult<(u32, u32, u32)> {
        self.with(|triad| triad.positive_pulses.into())
    }

    #[setter]
    fn set_positive_pulses(&self, values: &Bound<'_, PyAny>) -> PyResult<()> {
        let values = triple("positive_pulses", PULSES, values)?;
        self.with(|triad| triad.positive_pulses = values)
    }

    /// Pulses of the negative channels in the period, counted upwards from 0.
    #[getter]
    fn negative_pulses(&self) -> PyResult<(u32, u32, u32)> {
        self.with(|triad| triad.negative_pulses.into())
    }

    #[setter]
    fn set_negative_pulses(&self, values: &Bound<'_, PyAny>) -> PyResult<()> {
        let values = triple("negative_pulses", PULSES, values)?;
        self.with(|triad| triad.negative_pulses = values)
    }

    /// Temperature of the sensing elements, in the table's unit.
    #[getter]
    fn head_temperature(&self) -> PyResult<(f64, f64, f64)> {
        self.with(|triad| triad.head_temperature.into())
    }

    #[setter]
    fn set_head_temperature(&self, values: &Bound<'_, PyAny>) -> PyResult<()> {
        let values = triple("head_temperature", NUMBERS, values)?;
        self.with(|triad| triad.head_temperature = values)
    }

    /// Temperature of the converter boards, in the table's unit.
    #[getter]
    fn board_temperature(&self) -> PyResult<(f64, f64, f64)> {
        self.with(|triad| triad.board_temperature.into())
    }

    #[setter]
    fn set_board_temperature(&self, values: &Bound<'_, PyAny>) -> PyResult<()> {
        let values = triple("board_temperature", NUMBERS, values)?;
        self.with(|triad| triad.board_temperature = values)
    }

    /// The head temperature behind its lag. It is filled in when the sample is sent, if `lag_ns` is 0 then.
    #[getter]
    fn head_lagged(&self) -> PyResult<(f64, f64, f64)> {
        self.with(|triad| triad.head_lagged.into())
    }

    #[setter]
    fn set_head_lagged(&self, values: &Bound<'_, PyAny>) -> PyResult<()> {
        let values = triple("head_lagged", NUMBERS, values)?;
        self.with(|triad| triad.head_lagged = values)
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(stays("Triad", "give to_numpy() of its loan, a copy"))
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
