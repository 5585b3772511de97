//! Names of IMUs and domains as Python gives them, and which failures to connect pass by themselves.

use isotherm_client::{ConnectError, ImuId, Options, domain};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::time::Duration;

/// The name of an IMU.
pub fn imu_id(imu: &str) -> PyResult<ImuId> {
    imu.parse().map_err(|error: isotherm_shared::stream::InvalidName| PyValueError::new_err(error.to_string()))
}

/// How to reach a service.
pub fn options(name: Option<&str>, timeout: Duration) -> PyResult<Options> {
    let domain = domain(name).map_err(|error| PyValueError::new_err(error.to_string()))?;
    Ok(Options { domain, timeout })
}

/// Whether the failure may pass by itself while one waits.
pub fn is_temporary(error: &ConnectError) -> bool {
    !matches!(error, ConnectError::Permission { .. } | ConnectError::Domain(_) | ConnectError::Exhausted(_))
}
