//! Waiting without holding up other Python threads, and without missing Ctrl-C.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::time::{Duration, Instant};

/// How long Python's signals may have to wait.
pub const SLICE: Duration = Duration::from_millis(50);

/// Seconds from Python.
///
/// # Errors
/// If they are negative or no number.
pub fn seconds(name: &str, value: f64) -> PyResult<Duration> {
    if value.is_nan() || value < 0.0 {
        return Err(PyValueError::new_err(format!("{name} is {value}, give seconds from 0")));
    }
    Ok(Duration::try_from_secs_f64(value).unwrap_or(Duration::MAX))
}

/// Calls `turn` with at most [`SLICE`] at a time, Python's signals looked after in between, until it gives something or `timeout` has passed.
///
/// # Errors
/// As `turn`, or what a signal handler raised, such as `KeyboardInterrupt`.
pub fn until<T>(
    py: Python<'_>,
    timeout: Duration,
    mut turn: impl FnMut(Duration) -> PyResult<Option<T>>,
) -> PyResult<Option<T>> {
    let started = Instant::now();
    loop {
        let left = timeout.saturating_sub(started.elapsed());
        if let Some(value) = turn(left.min(SLICE))? {
            return Ok(Some(value));
        }
        py.check_signals()?;
        if started.elapsed() >= timeout {
            return Ok(None);
        }
    }
}
