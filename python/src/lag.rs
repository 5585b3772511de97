//! The lag of an acquisition: its option, sensors by name, and its state as numbers that JSON can keep.

use isotherm_client::{Lag, LagOption, LaggedReading, Sensor, TimeConstant};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The argument `lag`: "service", None or a time constant \[s\].
#[derive(Clone, Copy)]
pub(crate) struct LagArgument(pub LagOption);

impl<'py> FromPyObject<'_, 'py> for LagArgument {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if object.is_none() {
            return Ok(Self(LagOption::None));
        }
        if object.extract::<&str>().is_ok_and(|name| name == "service") {
            return Ok(Self(LagOption::Service));
        }
        let wrong = || PyValueError::new_err("lag: give \"service\", None or a time constant in s");
        let seconds: f64 = object.extract().map_err(|_| wrong())?;
        let constant = TimeConstant::from_seconds(seconds);
        constant
            .map(|constant| Self(LagOption::Fixed(constant)))
            .map_err(|error| PyValueError::new_err(error.to_string()))
    }
}

/// The sensor of a name.
///
/// # Errors
/// If it is not the name of a sensor.
pub(crate) fn sensor(name: &str) -> PyResult<Sensor> {
    name.parse().map_err(|error: isotherm_client::UnknownSensor| PyValueError::new_err(error.to_string()))
}

/// The state of a lag: for each sensor None, or time \[ns\], temperature and lagged temperature of its last reading,
/// and the share of an unknown start, and the machine's start that the time is of.
#[derive(IntoPyObject)]
#[pyo3(transparent)]
pub(crate) struct LagState(Vec<Option<Kept>>);

type Kept = (u64, f64, f64, f64, u64);

impl LagState {
    pub(crate) fn of(lag: &Lag) -> Self {
        let numbers = |(reading, unknown): (&Option<LaggedReading>, f64)| {
            reading.map(|reading| (reading.time_ns, reading.temperature, reading.lagged, unknown, lag.boot))
        };
        Self(lag.sensors.iter().zip(lag.unknown).map(numbers).collect())
    }

    pub(crate) fn lag(&self) -> Lag {
        let mut lag = Lag::new(0);
        for (sensor, numbers) in self.0.iter().enumerate() {
            if let Some((time_ns, temperature, lagged, unknown, boot)) = *numbers {
                lag.boot = boot;
                lag.sensors[sensor] = Some(LaggedReading { time_ns, temperature, lagged });
                lag.unknown[sensor] = unknown;
            }
        }
        lag
    }
}

/// Tuples, and the lists that JSON makes of them.
impl<'py> FromPyObject<'_, 'py> for LagState {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let wrong =
            || PyValueError::new_err("give what lag_state() returned: None, or five numbers, for each of six sensors");
        let reading = |item: Bound<'py, PyAny>| -> PyResult<Option<Kept>> {
            if item.is_none() {
                return Ok(None);
            }
            let numbers = item.try_iter()?.collect::<PyResult<Vec<_>>>()?;
            let (time_ns, temperature, lagged, unknown, boot) = match &numbers[..] {
                // As it was kept before the start of the machine was.
                [time_ns, temperature, lagged, unknown] => (time_ns, temperature, lagged, unknown, 0),
                [time_ns, temperature, lagged, unknown, boot] => {
                    (time_ns, temperature, lagged, unknown, boot.extract()?)
                }
                _ => return Err(wrong()),
            };
            Ok(Some((time_ns.extract()?, temperature.extract()?, lagged.extract()?, unknown.extract()?, boot)))
        };
        let sensors = object.try_iter()?.map(|item| reading(item?)).collect::<PyResult<Vec<_>>>()?;
        if sensors.len() == Sensor::NAMES.len() { Ok(Self(sensors)) } else { Err(wrong()) }
    }
}

/// The number of the device with this serial number, which every sample carries; 0 for blanks.
///
/// >>> isotherm.device(""), isotherm.device("SN 42") == isotherm.device("SN 43")
/// (0, False)
#[pyfunction]
pub(crate) fn device(serial: &str) -> u64 {
    isotherm_client::device(serial)
}
