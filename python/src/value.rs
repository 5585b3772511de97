//! Results travel between processes: each has a state of which it is made anew, without a fit. It is pickled and copied
//! by that state, and compared by it.

use pyo3::exceptions::PyTypeError;
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

/// Classes that are their own states.
macro_rules! own_states {
    ($($class:ident),*) => {$(
        impl $crate::value::Value for $class {
            const NAME: &'static str = stringify!($class);
            type State = Self;

            fn state(&self) -> std::borrow::Cow<'_, Self> {
                std::borrow::Cow::Borrowed(self)
            }

            fn of(state: Self) -> pyo3::PyResult<Self> {
                Ok(state)
            }
        }
    )*};
}
pub(crate) use own_states;

/// Equal values have the same state, bit for bit: NaN equals itself.
macro_rules! equal_by_state {
    ($($class:ty),*) => {$(
        impl PartialEq for $class {
            fn eq(&self, other: &Self) -> bool {
                $crate::value::Value::bytes(self) == $crate::value::Value::bytes(other)
            }
        }

        impl std::hash::Hash for $class {
            fn hash<H: std::hash::Hasher>(&self, hasher: &mut H) {
                $crate::value::Value::bytes(self).hash(hasher);
            }
        }
    )*};
}
pub(crate) use equal_by_state;

/// What `__reduce__` returns: a function, and the arguments of which it makes the value.
pub(crate) type Reduced<'py> = (Bound<'py, PyAny>, (&'static str, Bound<'py, PyBytes>));

/// The result of `__reduce__`.
///
/// # Errors
/// If the function is not found.
pub(crate) fn reduced<'py, T: Value>(py: Python<'py>, value: &T) -> PyResult<Reduced<'py>> {
    Ok((py.import("isotherm._isotherm")?.getattr("restored")?, (T::NAME, PyBytes::new(py, &value.bytes()))))
}

/// The exception of `__reduce__` of what belongs to a process; `remedy` says what to do instead.
pub(crate) fn stays(class: &str, remedy: &str) -> PyErr {
    PyTypeError::new_err(format!("{class} belongs to this process and cannot be pickled or copied: {remedy}"))
}
