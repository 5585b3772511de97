//! The native part of the Python package `isotherm`: streams, tables and arithmetic come from the Rust libraries. The
//! Python part is in `python/isotherm`: arrays of other layouts, data frames and files.

mod acquisition;
mod calibration;
mod compare;
mod connection;
mod convert;
mod curves;
mod errors;
mod files;
mod lag;
mod lengths;
mod noise;
mod offline;
mod owned;
mod parameters;
mod reader;
mod recordings;
mod records;
mod restored;
mod run;
mod table;
mod value;
mod wait;
mod work;

use isotherm_shared::wire::Flags;
use numpy::PyArray1;
use pyo3::prelude::*;

/// See `_isotherm.pyi`.
#[pymodule]
mod _isotherm {
    use super::{Bound, Flags, PyArray1, PyModule, PyModuleMethods as _, PyResult};

    #[pymodule_export]
    use crate::acquisition::{Acquisition, Loan, LoanTriad};
    #[pymodule_export]
    use crate::calibration::{Calibration, calibrate_campaign, calibrate_vehicle, calibrate_warm_up, read_text};
    #[pymodule_export]
    use crate::compare::{Batch, Comparison, batch, compare};
    #[pymodule_export]
    use crate::convert::{convert, write_ros};
    #[pymodule_export]
    use crate::curves::Curve;
    #[pymodule_export]
    use crate::files::write_texts;
    #[pymodule_export]
    use crate::lag::device;
    #[pymodule_export]
    use crate::lengths::lengths;
    #[pymodule_export]
    use crate::noise::{noise, noise_of_rates};
    #[pymodule_export]
    use crate::offline::{Stability, regress, replay, time_warnings, verify};
    #[pymodule_export]
    use crate::parameters::{Exported, export_parameters, export_vehicle, import_parameters};
    #[pymodule_export]
    use crate::reader::IncrementReader;
    #[pymodule_export]
    #[pymodule_export]
    use crate::recordings::{read_increments, read_recording, write_increments, write_recording};
    #[pymodule_export]
    use crate::records::{Increment, screen};
    #[pymodule_export]
    use crate::restored::restored;
    #[pymodule_export]
    use crate::table::{Axis, Polynomial, Table};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        // The first use of NumPy loads its C interface. It happens here, because an interrupt (Ctrl-C) during the load
        // would cause a panic.
        drop(PyArray1::<u8>::zeros(module.py(), 0, false));
        module.add("FLAGS", Flags::NAMES.to_vec())?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
