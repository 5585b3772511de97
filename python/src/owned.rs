//! Values that belong to the thread that created them, as the transport's ports do.

use crate::errors::{Closed, IsothermError, WrongThread};
use isotherm_client::Process;
use pyo3::exceptions::PyResourceWarning;
use pyo3::prelude::*;
use send_wrapper::SendWrapper;
use std::ffi::CString;
use std::mem::ManuallyDrop;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};

/// A value that only the thread that created it may use; other threads get an exception. Empty after it has been
/// closed.
pub(crate) struct ThreadValue<T> {
    name: &'static str,
    thread: ThreadId,
    process: Process,
    value: Mutex<Option<SendWrapper<T>>>,
}

/// Exclusive access to the value of an [`ThreadValue`].
pub(crate) struct ThreadGuard<'a, T>(MutexGuard<'a, Option<SendWrapper<T>>>, &'static str);

impl<T> ThreadValue<T> {
    pub(crate) fn new(name: &'static str, value: T) -> Self {
        let (thread, process) = (thread::current().id(), Process::current());
        Self { name, thread, process, value: Mutex::new(Some(SendWrapper::new(value))) }
    }

    /// # Errors
    /// In another thread, and in a forked child.
    fn check(&self) -> PyResult<()> {
        // A child with a copy of the memory has its parent's files too, and must not use the parent's ports.
        if !self.process.is_current() {
            let message =
                format!("this {} belongs to the process that was forked; open one in this process", self.name);
            return Err(WrongThread::new_err(message));
        }
        if self.thread != thread::current().id() {
            let message =
                format!("this {} belongs to another thread; open and close it in the thread that uses it", self.name);
            return Err(WrongThread::new_err(message));
        }
        Ok(())
    }

    /// Gives exclusive access to the value.
    ///
    /// # Errors
    /// In another thread, in a forked child, and while another call has access.
    pub(crate) fn hold(&self) -> PyResult<ThreadGuard<'_, T>> {
        self.check()?;
        let busy = |_| IsothermError::new_err(format!("this {} is in use by a call that has not returned", self.name));
        self.value.try_lock().map(|guard| ThreadGuard(guard, self.name)).map_err(busy)
    }

    pub(crate) fn is_closed(&self) -> bool {
        self.value.lock().unwrap_or_else(PoisonError::into_inner).is_none()
    }

    /// Drops the value; a second call does nothing.
    ///
    /// # Errors
    /// As [`hold`](Self::hold).
    pub(crate) fn close(&self) -> PyResult<()> {
        let value = self.hold()?.0.take();
        drop(value);
        Ok(())
    }
}

impl<T> ThreadGuard<'_, T> {
    /// # Errors
    /// If it has been closed.
    pub(crate) fn open(&mut self) -> PyResult<&mut SendWrapper<T>> {
        let name = self.1;
        self.0.as_mut().ok_or_else(|| Closed::new_err(format!("this {name} is closed")))
    }
}

impl<T> Drop for ThreadValue<T> {
    fn drop(&mut self) {
        let value = self.value.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        if value.is_none() || self.check().is_ok() {
            return;
        }
        // Only its own thread may drop the value. So it is leaked, and stays until the process ends.
        let _kept = ManuallyDrop::new(value);
        if !self.process.is_current() {
            return;
        }
        Python::attach(|py| {
            let pending = PyErr::take(py);
            let message = format!(
                "an {} was dropped by another thread than its own and stays connected until the process ends; close it in its thread",
                self.name
            );
            let warned = CString::new(message)
                .map_err(PyErr::from)
                .and_then(|message| PyErr::warn(py, &py.get_type::<PyResourceWarning>(), &message, 1));
            if let Err(error) = warned {
                error.write_unraisable(py, None);
            }
            if let Some(pending) = pending {
                pending.restore(py);
            }
        });
    }
}
