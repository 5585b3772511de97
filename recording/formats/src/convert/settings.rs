//! What is known of foreign data, apart from a mapping.

use super::mapping::Mapping;
use isotherm_autopilot::logs::{GyroscopeTemperature, LogSettings};
use isotherm_recording::{LogImu, Progress};
use isotherm_shared::table::PulseScale;
use isotherm_support::source::DataSource;

/// Where the times of rows come from.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum TimeSource {
    /// The stamps of the rows: the column of the time, or the `header.stamp` of a message.
    #[default]
    Header,
    /// When the messages of a bag were recorded.
    Log,
    /// The nominal interval, which has to be known: the rows are one interval apart.
    Rate,
}

/// What is known of foreign data, apart from a mapping.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// The mapping of texts, where it has been read: that of a campaign file.
    pub mapping: Option<Mapping>,
    /// The temperature of all rows, in the unit of the table.
    pub temperature: Option<f64>,
    /// The nominal interval \[ns\].
    pub interval_ns: Option<u64>,
    /// Where the times of the rows of a text or a bag come from.
    pub time: TimeSource,
    /// The topic of the `sensor_msgs/msg/Imu`, if there are several.
    pub topic: Option<String>,
    /// The topic of the gyroscopes, if accelerometers and gyroscopes have a topic each.
    pub gyroscope_topic: Option<String>,
    /// The file of the gyroscopes, if accelerometers and gyroscopes have a text each.
    pub gyroscope_file: Option<DataSource>,
    /// The topic of the `sensor_msgs/msg/Temperature`, if there are several.
    pub temperature_topic: Option<String>,
    /// The table that the samples are for: readings become pulses of its nominal interval.
    pub table: Option<PulseScale>,
    /// The session of the samples; 0 unless given. Where the clock of the stamps starts again, the next one follows.
    pub session: u64,
    /// The IMU of an autopilot's log, if there are several: its number there, from 0.
    pub instance: Option<u32>,
    /// The temperature of the gyroscopes of an autopilot's log.
    pub gyroscope_temperature: GyroscopeTemperature,
    /// The IMU that is taken of an autopilot's log with several, if none is named: that of a table.
    pub preferred: Option<LogImu>,
    /// Whether the pieces of a recording keep the given order where no clock shows theirs.
    pub in_order: bool,
    /// The nominal interval of the pieces of a recording \[ns\], and the number of rows that it was found from. It is
    /// taken where that of the data is the same but for jitter.
    pub of_pieces: Option<(u64, u64)>,
    /// Of a table in memory, which is read as a text: the line of its first row. Messages then count rows from 0.
    pub first_row: Option<u64>,
    /// Advances by the bytes read. Some formats are read twice; then it begins anew.
    pub progress: Progress,
}

impl Settings {
    /// What concerns the log of an autopilot.
    pub(super) fn of_log(&self) -> LogSettings {
        let Self { instance, preferred, gyroscope_temperature, progress, .. } = self;
        LogSettings {
            instance: *instance,
            preferred: *preferred,
            gyroscope_temperature: *gyroscope_temperature,
            progress: progress.clone(),
        }
    }
}
