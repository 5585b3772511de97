//! Results travel between processes: each has a state of which it is made anew, without a fit. It is pickled and copied
//! by that state, and compared by it.

use crate::calibration::Calibration;
use crate::compare::{Batch, Comparison};
use crate::curves::Curve;
use crate::offline::Stability;
use crate::parameters::Exported;
use crate::readings::Readings;
use crate::records::{Increment, python};
use crate::table::{Axis, Polynomial, Table};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::borrow::Cow;

/// A result with a state.
pub(crate) trait Value: Sized {
    /// The name of its class.
    const NAME: &'static str;
    /// All that it is made of.
    type State: Serialize + DeserializeOwned + Clone;

    /// The state.
    fn state(&self) -> Cow<'_, Self::State>;

    /// The value with this state.
    ///
    /// # Errors
    /// If there is none.
    fn of(state: Self::State) -> PyResult<Self>;

    /// The state as bytes.
    fn bytes(&self) -> Vec<u8> {
        // Every state is of numbers, texts and lists of known length, which cannot fail.
        postcard::to_allocvec(&*self.state()).unwrap_or_default()
    }
}

/// Equal values have the same state, bit for bit: NaN equals itself.
macro_rules! equal_by_state {
    ($($class:ty),*) => {$(
        impl PartialEq for $class {
            fn eq(&self, other: &Self) -> bool {
                self.bytes() == other.bytes()
            }
        }

        impl std::hash::Hash for $class {
            fn hash<H: std::hash::Hasher>(&self, hasher: &mut H) {
                self.bytes().hash(hasher);
            }
        }
    )*};
}
equal_by_state!(Batch, Calibration, Comparison, Curve, Exported, Increment, Polynomial, Stability);

/// What `__reduce__` returns: a function, and the arguments of which it makes the value.
pub(crate) type Reduced<'py> = (Bound<'py, PyAny>, (&'static str, Bound<'py, PyBytes>));

/// The result of `__reduce__`.
///
/// # Errors
/// If the function is not found.
pub(crate) fn reduced<'py, T: Value>(py: Python<'py>, value: &T) -> PyResult<Reduced<'py>> {
    Ok((python(py, "_isotherm", "restored")?, (T::NAME, PyBytes::new(py, &value.bytes()))))
}

/// The value of a class with a state: what `pickle` and `copy` call.
#[pyfunction]
pub(crate) fn restored<'py>(py: Python<'py>, kind: &str, state: &[u8]) -> PyResult<Bound<'py, PyAny>> {
    fn of<'py, T>(py: Python<'py>, state: &[u8]) -> PyResult<Bound<'py, PyAny>>
    where
        T: Value + IntoPyObject<'py, Error = PyErr, Target = T, Output = Bound<'py, T>>,
    {
        let state = postcard::from_bytes(state).map_err(|error| {
            PyValueError::new_err(format!("the pickled {} is of another version: {error}", T::NAME))
        })?;
        Ok(T::of(state)?.into_pyobject(py)?.into_any())
    }
    match kind {
        Axis::NAME => of::<Axis>(py, state),
        Batch::NAME => of::<Batch>(py, state),
        Calibration::NAME => of::<Calibration>(py, state),
        Comparison::NAME => of::<Comparison>(py, state),
        Curve::NAME => of::<Curve>(py, state),
        Exported::NAME => of::<Exported>(py, state),
        Increment::NAME => of::<Increment>(py, state),
        Polynomial::NAME => of::<Polynomial>(py, state),
        Readings::NAME => of::<Readings>(py, state),
        Stability::NAME => of::<Stability>(py, state),
        Table::NAME => of::<Table>(py, state),
        _ => Err(PyValueError::new_err(format!("no value has the class {kind}"))),
    }
}

/// The exception of `__reduce__` of what belongs to a process; `remedy` says what to do instead.
pub(crate) fn stays(class: &str, remedy: &str) -> PyErr {
    PyTypeError::new_err(format!("{class} belongs to this process and cannot be pickled or copied: {remedy}"))
}
