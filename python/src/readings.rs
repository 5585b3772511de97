//! The Python class `Readings`.

use crate::acquisition::Loan;
use crate::records::{NUMBERS, triple};
use crate::value::{Reduced, Value, reduced};
use isotherm_client::{RawSample, ReadingError, Readings as Client, Resolution};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::borrow::Cow;

/// Turns readings in m/s2 and rad/s into the pulses of a sample. What rounding leaves is carried to the next sample, so
/// that nothing is lost over time.
///
/// `accelerometer` [m/s2] and `gyroscope` [rad/s], 1e-15 to 1e6, are what a pulse stands for over the nominal interval
/// `interval_ns`; the table's nominal scale factors are g0 / (resolution * interval). Raises ValueError if they cannot
/// be.
///
/// >>> readings = isotherm.Readings(accelerometer=1e-6, gyroscope=1e-7, interval_ns=2_500_000)
/// >>> with isotherm.Acquisition("imu-a") as acquisition:
/// ...     sample = acquisition.loan()
/// ...     readings.fill(sample, (0.12, -0.3, 9.81))
/// ...     print(sample.accelerometers.positive_pulses, sample.accelerometers.negative_pulses)
/// ...     sample.cancel()
/// (120000, 0, 9810000) (0, 300000, 0)
#[pyclass(eq, module = "isotherm")]
#[derive(PartialEq)]
pub struct Readings(Client);

fn refused(error: ReadingError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

impl Value for Readings {
    const NAME: &'static str = "Readings";
    /// Both resolutions, the interval, and what rounding has left.
    type State = (f64, f64, u64, [f64; 6]);

    fn state(&self) -> Cow<'_, Self::State> {
        let Client { resolution: Resolution { accelerometer, gyroscope }, interval_ns, remainders } = self.0;
        Cow::Owned((accelerometer, gyroscope, interval_ns, remainders))
    }

    fn of((accelerometer, gyroscope, interval_ns, remainders): Self::State) -> PyResult<Self> {
        Ok(Self(Client { remainders, ..Self::new(accelerometer, gyroscope, interval_ns)?.0 }))
    }
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

    /// What one pulse of an accelerometer stands for [m/s2].
    #[getter]
    fn accelerometer(&self) -> f64 {
        self.0.resolution.accelerometer
    }

    /// What one pulse of a gyroscope stands for [rad/s].
    #[getter]
    fn gyroscope(&self) -> f64 {
        self.0.resolution.gyroscope
    }

    /// The nominal interval between two samples [ns].
    #[getter]
    fn interval_ns(&self) -> u64 {
        self.0.interval_ns
    }

    /// Writes the pulses of a sample: three of `specific_force` [m/s2], and of `angular_rate` [rad/s], each the mean
    /// over the sample's interval. Without `angular_rate` the gyroscopes become absent: no pulses, and temperature NaN.
    ///
    /// An `interval_ns` of 0, as a loan has, becomes the nominal one; another one is kept, and the pulses are those of
    /// that interval. Raises ValueError with the name of the sensor, and changes nothing, for a reading that is not
    /// finite or over 2**32 - 1 pulses.
    #[pyo3(signature = (sample, specific_force, angular_rate = None))]
    fn fill(
        &mut self,
        sample: &Bound<'_, Loan>,
        specific_force: &Bound<'_, PyAny>,
        angular_rate: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let force = triple("specific_force", NUMBERS, specific_force)?;
        let rate = angular_rate.map(|rate| triple("angular_rate", NUMBERS, rate)).transpose()?;
        sample.get().with(|raw| self.0.fill(raw, force, rate))?.map_err(refused)
    }

    /// Forgets what rounding has left: for a new session, and after a gap.
    fn reset(&mut self) {
        self.0.reset();
    }

    fn __repr__(&self) -> String {
        let Client { resolution: Resolution { accelerometer, gyroscope }, interval_ns, .. } = self.0;
        format!("Readings(accelerometer={accelerometer:e}, gyroscope={gyroscope:e}, interval_ns={interval_ns})")
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduced(py, self)
    }
}
