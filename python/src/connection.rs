//! Arguments for connecting: names of IMUs and domains. Also which errors of connecting may be temporary.

use isotherm_client::{ConnectError, ImuId, Options, domain};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::time::Duration;

/// Parses the name of an IMU.
pub(crate) fn imu_id(imu: &str) -> PyResult<ImuId> {
    imu.parse().map_err(|error: isotherm_shared::names::InvalidName| PyValueError::new_err(error.to_string()))
}

/// The options for connecting to a service.
pub(crate) fn options(name: Option<&str>, timeout: Duration) -> PyResult<Options> {
    let domain = domain(name).map_err(|error| PyValueError::new_err(error.to_string()))?;
    Ok(Options::new(domain, timeout))
}

/// Whether connecting may still succeed after this error if the caller waits.
pub(crate) fn is_temporary(error: &ConnectError) -> bool {
    !error.is_permanent()
}
