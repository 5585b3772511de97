//! The parameters of one instance, as the firmware has them.

use crate::autopilot::{Autopilot, InstanceError};
use crate::firmware::{ArduPilotTriad, Px4Triad};
use crate::lines::Lines;
use crate::{ardupilot, px4};
use isotherm_shared::document::Faults;
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;

/// The parameters of one instance: of accelerometers, and of gyroscopes if there are any.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Parameters {
    /// Those of PX4.
    Px4(Px4Triad, Option<Px4Triad>),
    /// Those of ArduPilot.
    ArduPilot(ArduPilotTriad, Option<ArduPilotTriad>),
}

/// Why parameters cannot be read.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
pub enum ReadError {
    /// The autopilot does not have this instance.
    #[error(transparent)]
    Instance(#[from] InstanceError),
    /// All that is wrong with the text, with line and parameter.
    #[error(transparent)]
    Text(#[from] Faults),
}

impl Parameters {
    /// Reads the parameters of an instance, the first one without a number. All other parameters of the text are passed
    /// over. Each number is rounded to float32, which is what the firmware has.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_autopilot::{Autopilot, Parameters};
    /// use isotherm_shared::units::SensorKind;
    ///
    /// let text = include_str!("../tests/data/full.params");
    /// let parameters = Parameters::read(text, Autopilot::Px4, None)?;
    /// let offset = parameters.offset(SensorKind::Accelerometer, 0.0); // m/s2 at 0 degC
    /// assert!(offset.is_some_and(|[_, _, z]| (z - 0.127_67).abs() < 1e-5));
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// All that is wrong with the parameters of the instance, with line and name.
    pub fn read(text: &str, autopilot: Autopilot, instance: Option<u8>) -> Result<Self, ReadError> {
        let instance = autopilot.instance(instance)?;
        let mut lines = Lines::parse(text);
        let (accelerometer, gyroscope) = (SensorKind::Accelerometer, SensorKind::Gyroscope);
        // Both triads are read, so that all faults are found.
        let found = match autopilot {
            Autopilot::Px4 => {
                let read = [accelerometer, gyroscope].map(|kind| px4::read(&mut lines, kind, instance));
                both(read).map(|(accelerometers, gyroscopes)| Self::Px4(accelerometers, gyroscopes))
            }
            Autopilot::ArduPilot => {
                let read = [accelerometer, gyroscope].map(|kind| ardupilot::read(&mut lines, kind, instance));
                both(read).map(|(accelerometers, gyroscopes)| Self::ArduPilot(accelerometers, gyroscopes))
            }
        };
        Ok(lines.finish(found)?)
    }

    /// What the firmware subtracts from the readings of one kind of sensor at a temperature \[degC\], in m/s2 or rad/s,
    /// by its own formula in float32; `None` without these sensors.
    #[must_use]
    pub fn offset(&self, kind: SensorKind, temperature: f32) -> Option<[f32; AXES]> {
        match (self, kind) {
            (Self::Px4(triad, _), SensorKind::Accelerometer) => Some(triad.offset(temperature)),
            (Self::Px4(_, triad), SensorKind::Gyroscope) => Some(triad.as_ref()?.offset(temperature)),
            (Self::ArduPilot(triad, _), SensorKind::Accelerometer) => Some(triad.offset(temperature)),
            (Self::ArduPilot(_, triad), SensorKind::Gyroscope) => Some(triad.as_ref()?.offset(temperature)),
        }
    }
}

/// The name of the parameter that the bias of a sensor begins with.
pub(crate) fn bias_name(autopilot: Autopilot, instance: u8, kind: SensorKind, axis: usize) -> String {
    match autopilot {
        Autopilot::Px4 => px4::bias_name(kind, instance, axis),
        Autopilot::ArduPilot => ardupilot::bias_name(kind, instance, axis),
    }
}

/// Accelerometers that must be there, and gyroscopes that need not.
fn both<T>([accelerometers, gyroscopes]: [Option<Option<T>>; 2]) -> Option<(T, Option<T>)> {
    Some((accelerometers??, gyroscopes?))
}
