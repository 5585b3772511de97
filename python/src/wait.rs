//! Waiting that lets other Python threads run and handles Ctrl-C.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::time::{Duration, Instant};

/// Longest time between two checks for Python's signals.
pub(crate) const SLICE: Duration = Duration::from_millis(50);

/// Converts seconds from Python.
///
/// # Errors
/// If `value` is negative or NaN.
pub(crate) fn seconds(name: &str, value: f64) -> PyResult<Duration> {
    if value.is_nan() || value < 0.0 {
        return Err(PyValueError::new_err(format!("{name} is {value}, give seconds from 0")));
    }
    Ok(Duration::try_from_secs_f64(value).unwrap_or(Duration::MAX))
}

/// Calls `poll` with at most [`SLICE`] at a time until it returns a value or `timeout` has passed. Handles Python's
/// signals after each call.
///
/// # Errors
/// The errors of `poll`, or the exception of a signal handler, such as `KeyboardInterrupt`.
pub(crate) fn poll_until<T>(
    py: Python<'_>,
    timeout: Duration,
    mut poll: impl FnMut(Duration) -> PyResult<Option<T>>,
) -> PyResult<Option<T>> {
    let started = Instant::now();
    loop {
        let left = timeout.saturating_sub(started.elapsed());
        if let Some(value) = poll(left.min(SLICE))? {
            return Ok(Some(value));
        }
        py.check_signals()?;
        if started.elapsed() >= timeout {
            return Ok(None);
        }
    }
}
