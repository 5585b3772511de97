//! How uncertain the published values are.
//!
//! A value is the mean over an interval T. Its variance is that of the white noise, of density N, and that of the
//! table's bias at this temperature:
//! ```text
//! var = N^2/T + s^2
//! ```
//! The first is new in each value, the second the same in all of them; a covariance cannot distinguish them. The errors
//! of scale factors, which grow with the motion, are not in it.

use isotherm_fit::TableFile;
use isotherm_shared::status::ImuStatus;
use isotherm_shared::units::{ARCSEC, SensorKind};
use isotherm_shared::wire::AXES;

/// The keys of Kalibr's file.
const ACCELEROMETER_KEY: &str = "accelerometer_noise_density";
const GYROSCOPE_KEY: &str = "gyroscope_noise_density";

/// Densities of the white noise, two-sided; `None`: not known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NoiseDensities {
    /// \[m/s2/sqrt(Hz)\]
    pub accelerometer: Option<f64>,
    /// \[rad/s/sqrt(Hz)\]
    pub gyroscope: Option<f64>,
}

impl NoiseDensities {
    /// Reads a file that `isotherm noise --kalibr` has written.
    ///
    /// ```
    /// use isotherm_ros2::NoiseDensities;
    ///
    /// let noise = NoiseDensities::from_yaml("rostopic: /imu0\naccelerometer_noise_density: 1.5e-3\n");
    /// assert_eq!(noise.map(|noise| noise.accelerometer), Ok(Some(1.5e-3)));
    /// ```
    ///
    /// # Errors
    /// If it has neither density, or one that is no positive number.
    pub fn from_yaml(text: &str) -> Result<Self, String> {
        let of = |key: &str| {
            let value = text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':'))?;
            let number = value.split('#').next().unwrap_or_default().trim();
            let right = number.parse::<f64>().ok().filter(|density| density.is_finite() && *density > 0.0);
            Some(right.ok_or_else(|| format!("{key}: {number:?} is not a positive number")))
        };
        let noise =
            Self { accelerometer: of(ACCELEROMETER_KEY).transpose()?, gyroscope: of(GYROSCOPE_KEY).transpose()? };
        let message =
            format!("has neither {ACCELEROMETER_KEY} nor {GYROSCOPE_KEY}; give what `isotherm noise --kalibr` writes");
        if noise == Self::default() { Err(message) } else { Ok(noise) }
    }
}

/// Standard errors of a table's biases at the present temperature.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TableErrors {
    /// Of the accelerometers \[m/s2\].
    pub accelerometer: Option<[f64; AXES]>,
    /// Of the gyroscopes \[rad/s\].
    pub gyroscope: Option<[f64; AXES]>,
}

impl TableErrors {
    /// Those that the provenance of a table says, at the temperature of an IMU's last sample. A triad of which one is
    /// not known has none.
    #[must_use]
    pub fn of(file: &TableFile, imu: &ImuStatus) -> Self {
        let gravity = file.table.content().gravity;
        let of_triad = |kind: SensorKind, heads: Option<[Option<f64>; AXES]>| {
            let mut errors = [0.0; AXES];
            for (axis, error) in errors.iter_mut().enumerate() {
                let (sensor, si) = match kind {
                    SensorKind::Accelerometer => (axis, gravity),
                    SensorKind::Gyroscope => (AXES + axis, ARCSEC),
                };
                let (curve, unit) = file.curve(sensor, 0)?;
                let (unit, _) = kind.bias_units().iter().find(|(_, name)| *name == unit)?;
                *error = curve.standard_error(heads?[axis]?)? * unit.factor() * si;
            }
            errors.iter().all(|error| error.is_finite()).then_some(errors)
        };
        Self {
            accelerometer: of_triad(SensorKind::Accelerometer, Some(imu.head_temperature)),
            gyroscope: of_triad(SensorKind::Gyroscope, imu.gyroscopes.as_ref().map(|triad| triad.head_temperature)),
        }
    }
}

/// The covariance of three means over an interval \[ns\], turned by a rotation; 0, which is unknown, if neither noise
/// nor errors are known.
pub(crate) fn covariance(
    density: Option<f64>,
    errors: Option<[f64; AXES]>,
    interval_ns: u64,
    rotation: &[[f64; 3]; 3],
) -> [f64; 9] {
    let white = density.map_or(0.0, |density| density * density * 1e9 / (interval_ns as f64).max(1.0));
    let variance = errors.unwrap_or_default().map(|error| error * error + white);
    std::array::from_fn(|place| {
        let (row, column) = (rotation[place / 3], rotation[place % 3]);
        (0..AXES).map(|axis| row[axis] * variance[axis] * column[axis]).sum()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_kalibr_is_read_and_a_wrong_one_refused() {
        let text =
            "rostopic: /imu0\naccelerometer_noise_density: 1.0e-3 # m/s^2/sqrt(Hz)\ngyroscope_noise_density:   2e-5\n";
        let noise = NoiseDensities::from_yaml(text).unwrap();
        assert_eq!(noise, NoiseDensities { accelerometer: Some(1e-3), gyroscope: Some(2e-5) });
        let text =
            "accelerometer_noise_density: 1e-3\n# gyroscope_noise_density: not written, the model does not hold\n";
        assert_eq!(NoiseDensities::from_yaml(text).unwrap().gyroscope, None);
        for wrong in ["", "accelerometer_noise_density: -1", "gyroscope_noise_density: NaN", "gyroscope_noise_density:"]
        {
            assert!(NoiseDensities::from_yaml(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn noise_and_errors_add_and_turn() {
        const TURNED: [[f64; 3]; 3] = [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]];
        let found = covariance(Some(1e-3), Some([1.0, 2.0, 3.0]), 2_500_000, &TURNED);
        let white = 1e-6 / 2.5e-3;
        let expected = [4.0 + white, 0.0, 0.0, 0.0, 1.0 + white, 0.0, 0.0, 0.0, 9.0 + white];
        assert!(found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-12), "{found:?}");
        assert_eq!(covariance(None, None, 1, &TURNED), [0.0; 9]);
    }
}
