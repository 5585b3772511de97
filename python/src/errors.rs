//! Converts errors of the libraries to exceptions of `isotherm._errors`.

use crate::records::python;
use isotherm_client::ConnectError;
use isotherm_shared::document::Faults;
use pyo3::exceptions::PyOSError;
use pyo3::import_exception;
use pyo3::prelude::*;
use std::fmt::Display;
use std::io;
use std::path::Path;

import_exception!(isotherm._errors, CalibrationError);
import_exception!(isotherm._errors, Closed);
import_exception!(isotherm._errors, ComparisonError);
import_exception!(isotherm._errors, Full);
import_exception!(isotherm._errors, IsothermError);
import_exception!(isotherm._errors, NoService);
import_exception!(isotherm._errors, NoSuchImu);
import_exception!(isotherm._errors, NoiseError);
import_exception!(isotherm._errors, Occupied);
import_exception!(isotherm._errors, RecordingFault);
import_exception!(isotherm._errors, SequenceError);
import_exception!(isotherm._errors, StabilityError);
import_exception!(isotherm._errors, TableError);
import_exception!(isotherm._errors, Timeout);
import_exception!(isotherm._errors, TransportError);
import_exception!(isotherm._errors, WrongThread);

pub(crate) fn connecting(error: &ConnectError) -> PyErr {
    let message = error.to_string();
    match error {
        ConnectError::NoService(_) => NoService::new_err(message),
        ConnectError::NoSuchImu { .. } => NoSuchImu::new_err(message),
        ConnectError::Occupied { .. } | ConnectError::NoRoom { .. } => Occupied::new_err(message),
        ConnectError::Transport { .. } => TransportError::new_err(message),
        ConnectError::Permission { .. }
        | ConnectError::Foreign(_)
        | ConnectError::Domain(_)
        | ConnectError::Exhausted(_)
        | ConnectError::OtherVersion { .. }
        | ConnectError::OtherClock { .. }
        | ConnectError::OtherMemory
        | ConnectError::Pulses { .. } => IsothermError::new_err(message),
    }
}

pub(crate) fn transport(error: impl Display) -> PyErr {
    TransportError::new_err(error.to_string())
}

/// A message of a library with the arguments of Python in the place of the command's options.
pub(crate) fn in_python(message: &str) -> String {
    let said = Python::attach(|py| python(py, "_errors", "in_python")?.call1((message,))?.extract());
    said.unwrap_or_else(|_: PyErr| message.to_owned())
}

/// The exception for all faults of a text from `source`: its message has one line for each, and it has a list of (line,
/// key, message).
pub(crate) fn faults(source: &str, faults: &Faults) -> PyErr {
    let line = |fault: &isotherm_shared::document::Fault| {
        let colon = if fault.key.is_empty() { "" } else { ": " };
        format!("{source}:{}: {}{colon}{}", fault.line, fault.key, fault.message)
    };
    let message = faults.0.iter().map(line).collect::<Vec<_>>().join("\n");
    let list: Vec<_> = faults.0.iter().map(|fault| (fault.line, fault.key.clone(), fault.message.clone())).collect();
    TableError::new_err((message, list))
}

/// The `OSError` that Python itself would raise for a file that could not be read or written.
pub(crate) fn file(path: &Path, error: &io::Error) -> PyErr {
    match error.raw_os_error() {
        Some(number) => {
            let text = error.to_string();
            let text = text.split(" (os error").next().unwrap_or_default().to_owned();
            PyOSError::new_err((number, text, path.to_owned()))
        }
        None => PyOSError::new_err(format!("{}: {error}", path.display())),
    }
}
