//! The values of all classes, made anew of their states, and compared by them.

use crate::calibration::Calibration;
use crate::compare::{Batch, Comparison};
use crate::curves::Curve;
use crate::offline::Stability;
use crate::parameters::Exported;
use crate::records::Increment;
use crate::table::{Axis, Polynomial, Table};
use crate::value::{Value, equal_by_state, own_states};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

own_states!(Calibration, Curve, Exported);
equal_by_state!(Batch, Calibration, Comparison, Curve, Exported, Increment, Polynomial, Stability);

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
        Stability::NAME => of::<Stability>(py, state),
        Table::NAME => of::<Table>(py, state),
        _ => Err(PyValueError::new_err(format!("no value has the class {kind}"))),
    }
}
