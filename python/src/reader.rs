//! The Python class `IncrementReader`.

use crate::connection::{imu_id, is_temporary, options};
use crate::errors::{NoService, Timeout, connecting};
use crate::owned::ThreadValue;
use crate::records::{Increment, array, increment_bytes, python, view};
use crate::value::stays;
use crate::wait::{poll_until, seconds};
use isotherm_client::IncrementReader as Client;
use pyo3::prelude::*;
use std::os::fd::AsRawFd as _;
use std::thread;
use std::time::Duration;

/// How often a status is looked for while there is none.
const LOOK: Duration = Duration::from_millis(10);

/// Reads the increments of one IMU as they are published. Only the thread that created it may use it.
///
/// Waits up to `timeout` seconds for the service. With None it does not wait: it connects at once if the service is
/// there, and otherwise in a later call. What is published before it is `connected` is not received.
///
/// >>> with isotherm.IncrementReader("imu-a") as reader, isotherm.Acquisition("imu-a") as acquisition:
/// ...     sent = acquisition.run(isotherm.read_recording("run.csv")[:3])
/// ...     print(len(reader.read_available()), reader.receive(timeout=0.1))
/// 3 None
#[pyclass(frozen, module = "isotherm")]
pub struct IncrementReader {
    owned: ThreadValue<Client>,
    imu: String,
}

#[pymethods]
impl IncrementReader {
    #[new]
    #[pyo3(signature = (imu, domain = None, timeout = Some(5.0)), text_signature = "(imu, domain=None, timeout=5.0)")]
    fn new(py: Python<'_>, imu: &str, domain: Option<&str>, timeout: Option<f64>) -> PyResult<Self> {
        let id = imu_id(imu)?;
        let client = match timeout {
            None => Client::new(id, &options(domain, Duration::ZERO)?),
            Some(timeout) => connect(py, &id, domain, seconds("timeout", timeout)?)?,
        };
        Ok(Self { owned: ThreadValue::new("IncrementReader", client), imu: imu.to_owned() })
    }

    /// The IMU.
    #[getter]
    fn imu(&self) -> &str {
        &self.imu
    }

    /// Whether the stream has been found. Stays true when the service stops.
    #[getter]
    fn connected(&self) -> PyResult<bool> {
        Ok(self.owned.hold()?.open()?.is_connected())
    }

    /// Increments that came again after a resend and were not returned.
    #[getter]
    fn repeats(&self) -> PyResult<u64> {
        Ok(self.owned.hold()?.open()?.repeats())
    }

    /// The control periods that are missing right before the increment that was returned last. None if that is unknown:
    /// where time steps, between sessions of different clocks, and before the first one. After `read_available` it is
    /// of the last one of the array.
    #[getter]
    fn lost_before(&self) -> PyResult<Option<u64>> {
        Ok(self.owned.hold()?.open()?.lost_before())
    }

    /// A descriptor for `select`, `selectors` and `asyncio`: readable when increments may have come. Then call
    /// `receive` until it returns None, or `read_available`. Wait for at most some 0.1 s at once. Raises NoService
    /// while the reader is not connected.
    fn fileno(&self) -> PyResult<i32> {
        Ok(self.owned.hold()?.open()?.descriptor().map_err(|error| connecting(&error))?.as_raw_fd())
    }

    /// How long ago the service was last seen at work for this IMU [s]: under 0.3 while it lives.
    ///
    /// The first call waits for the service's status, up to about 1 s. Raises NoService if no service was seen at work
    /// within `timeout` seconds.
    #[pyo3(signature = (timeout = 2.0))]
    fn heartbeat_age(&self, py: Python<'_>, timeout: f64) -> PyResult<f64> {
        // A service publishes its status once a second while nobody reads it.
        let age = poll_until(py, seconds("timeout", timeout)?, |left| {
            let age = self.owned.hold()?.open()?.heartbeat_age().map_err(|error| connecting(&error))?;
            if age.is_none() {
                py.detach(|| thread::sleep(left.min(LOOK)));
            }
            Ok(age)
        })?;
        age.map(|age| age.as_secs_f64()).ok_or_else(|| {
            NoService::new_err(format!(
                "no service of {} was seen at work within {timeout} s: start it, for example with isotherm serve",
                self.imu
            ))
        })
    }

    /// Whether it has been closed.
    #[getter]
    fn closed(&self) -> bool {
        self.owned.is_closed()
    }

    /// Leaves the stream. A second call does nothing.
    fn close(&self) -> PyResult<()> {
        self.owned.close()
    }

    fn __enter__(this: Py<Self>) -> Py<Self> {
        this
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, _exception: &Bound<'_, pyo3::types::PyTuple>) -> PyResult<()> {
        self.close()
    }

    /// The next increment, or None if none comes within `timeout` seconds.
    #[pyo3(signature = (timeout = 0.0))]
    fn receive(&self, py: Python<'_>, timeout: f64) -> PyResult<Option<Increment>> {
        self.next(py, seconds("timeout", timeout)?)
    }

    /// All increments that have come and were not read yet, at most `limit`; an empty array if there is none.
    #[pyo3(signature = (limit = None))]
    fn read_available<'py>(&self, py: Python<'py>, limit: Option<usize>) -> PyResult<Bound<'py, PyAny>> {
        let mut bytes = Vec::new();
        let mut held = self.owned.hold()?;
        let reader = held.open()?;
        for _ in 0..limit.unwrap_or(usize::MAX) {
            let Some(increment) = reader.receive().map_err(|error| connecting(&error))? else { break };
            bytes.extend_from_slice(&increment_bytes(&increment));
        }
        view(array(py, bytes), "INCREMENT")
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(stays("IncrementReader", "give the worker the name of the IMU, and open a reader there"))
    }

    fn __iter__(this: Py<Self>) -> Py<Self> {
        this
    }

    fn __aiter__<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        python(this.py(), "_asynchronous", "increments")?.call1((this,))
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Increment>> {
        if self.owned.is_closed() { Ok(None) } else { self.next(py, Duration::MAX) }
    }

    fn __repr__(&self) -> String {
        format!("IncrementReader('{}'{})", self.imu, if self.owned.is_closed() { ", closed" } else { "" })
    }
}

impl IncrementReader {
    fn next(&self, py: Python<'_>, timeout: Duration) -> PyResult<Option<Increment>> {
        let now = self.owned.hold()?.open()?.receive().map_err(|error| connecting(&error))?;
        if now.is_some() || timeout.is_zero() {
            return Ok(now.map(Increment));
        }
        let increment = poll_until(py, timeout, |left| {
            let mut held = self.owned.hold()?;
            let reader = held.open()?;
            py.detach(|| reader.receive_timeout(left)).map_err(|error| connecting(&error))
        })?;
        Ok(increment.map(Increment))
    }
}

fn connect(py: Python<'_>, id: &isotherm_client::ImuId, domain: Option<&str>, timeout: Duration) -> PyResult<Client> {
    let mut last = None;
    let client = poll_until(py, timeout, |left| {
        let options = options(domain, left)?;
        match py.detach(|| Client::connect(id.clone(), &options).map(send_wrapper::SendWrapper::new)) {
            Ok(client) => Ok(Some(client.take())),
            Err(error) if is_temporary(&error) => {
                last = Some(error);
                Ok(None)
            }
            Err(error) => Err(connecting(&error)),
        }
    })?;
    client.ok_or_else(|| last.map_or_else(|| Timeout::new_err("connecting took too long"), |error| connecting(&error)))
}
