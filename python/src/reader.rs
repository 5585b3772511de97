//! The Python class `IncrementReader`.

use crate::connection::{imu_id, is_temporary, options};
use crate::errors::{Timeout, connecting};
use crate::owned::ThreadValue;
use crate::records::{Increment, array, increment_bytes, view};
use crate::wait::{poll_until, seconds};
use isotherm_client::IncrementReader as Client;
use pyo3::prelude::*;
use std::os::fd::AsRawFd as _;
use std::time::Duration;

/// Reads the increments of one IMU.
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

    #[getter]
    fn imu(&self) -> &str {
        &self.imu
    }

    #[getter]
    fn connected(&self) -> PyResult<bool> {
        Ok(self.owned.hold()?.open()?.is_connected())
    }

    #[getter]
    fn repeats(&self) -> PyResult<u64> {
        Ok(self.owned.hold()?.open()?.repeats())
    }

    #[getter]
    fn lost_before(&self) -> PyResult<Option<u64>> {
        Ok(self.owned.hold()?.open()?.lost_before())
    }

    fn fileno(&self) -> PyResult<i32> {
        Ok(self.owned.hold()?.open()?.descriptor().map_err(|error| connecting(&error))?.as_raw_fd())
    }

    fn heartbeat_age(&self) -> PyResult<Option<f64>> {
        let age = self.owned.hold()?.open()?.heartbeat_age().map_err(|error| connecting(&error))?;
        Ok(age.map(|age| age.as_secs_f64()))
    }

    #[getter]
    fn closed(&self) -> bool {
        self.owned.is_closed()
    }

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

    #[pyo3(signature = (timeout = 0.0))]
    fn receive(&self, py: Python<'_>, timeout: f64) -> PyResult<Option<Increment>> {
        self.next(py, seconds("timeout", timeout)?)
    }

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

    fn __iter__(this: Py<Self>) -> Py<Self> {
        this
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
