//! What is known of a log, apart from the log itself.

use isotherm_recording::{LogImu, Progress};

/// The temperature that the gyroscopes of an autopilot's log have.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum GyroscopeTemperature {
    /// Their own. Where they have none, the rows have no gyroscopes.
    #[default]
    Own,
    /// That of the accelerometers.
    Accelerometer,
}

/// What is known of a log, apart from the log itself.
#[derive(Clone, Debug, Default)]
pub struct LogSettings {
    /// The IMU, if there are several: its number in the log, from 0.
    pub instance: Option<u32>,
    /// The IMU that is taken of several, if none is named: that of a table.
    pub preferred: Option<LogImu>,
    /// The temperature of the gyroscopes.
    pub gyroscope_temperature: GyroscopeTemperature,
    /// Advances by the bytes read. A log is read twice; then it begins anew.
    pub progress: Progress,
}
