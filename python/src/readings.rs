//! The Python class `Readings`.

use crate::acquisition::Loan;
use crate::records::triple;
use isotherm_client::{RawSample, ReadingError, Readings as Client, Resolution};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Turns readings into pulses, sample after sample.
#[pyclass(module = "isotherm")]
pub struct Readings(Client);

fn refused(error: ReadingError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

#[pymethods]
impl Readings {
    #[new]
    #[pyo3(signature = (*, accelerometer, gyroscope, interval_ns))]
    fn new(accelerometer: f64, gyroscope: f64, interval_ns: u64) -> PyResult<Self> {
        let readings = Client::new(Resolution { accelerometer, gyroscope }, interval_ns);
        // A sample that nobody sends: it refuses what cannot be.
        { readings }.fill(&mut RawSample::default(), [0.0; 3], None).map_err(refused)?;
        Ok(Self(readings))
    }

    #[getter]
    fn accelerometer(&self) -> f64 {
        self.0.resolution.accelerometer
    }

    #[getter]
    fn gyroscope(&self) -> f64 {
        self.0.resolution.gyroscope
    }

    #[getter]
    fn interval_ns(&self) -> u64 {
        self.0.interval_ns
    }

    #[pyo3(signature = (sample, specific_force, angular_rate = None))]
    fn fill(
        &mut self,
        sample: &Bound<'_, Loan>,
        specific_force: &Bound<'_, PyAny>,
        angular_rate: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let force = triple("specific_force", specific_force)?;
        let rate = angular_rate.map(|rate| triple("angular_rate", rate)).transpose()?;
        sample.get().with(|raw| self.0.fill(raw, force, rate))?.map_err(refused)
    }

    fn reset(&mut self) {
        self.0.reset();
    }

    fn __repr__(&self) -> String {
        let Client { resolution: Resolution { accelerometer, gyroscope }, interval_ns, .. } = self.0;
        format!("Readings(accelerometer={accelerometer:e}, gyroscope={gyroscope:e}, interval_ns={interval_ns})")
    }
}
