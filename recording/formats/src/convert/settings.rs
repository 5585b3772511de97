//! What is known of foreign data besides a mapping.

use super::known::Known;
use indicatif::ProgressBar;
use isotherm_failure::{Exit, Failure};
use std::io::Read;
use std::path::Path;

/// What is known of foreign data besides a mapping.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// The telemetry of all rows, in the unit of the table.
    pub temperature: Option<f64>,
    /// The nominal interval \[ns\].
    pub interval_ns: Option<u64>,
    /// The topic of the `sensor_msgs/msg/Imu`, if there are several.
    pub topic: Option<String>,
    /// The topic of the `sensor_msgs/msg/Temperature`, if there are several.
    pub temperature_topic: Option<String>,
    /// The session of all samples; 0 unless given.
    pub session: u64,
    /// The IMU of an autopilot's log, if there are several: its number there, from 0.
    pub instance: Option<u32>,
    /// Advances by the bytes read. Some formats are read twice; then it begins anew.
    pub progress: Option<ProgressBar>,
}

impl Settings {
    /// The source, whose bytes the progress shows from their beginning.
    pub(super) fn watched(&self, source: Box<dyn Read>) -> Box<dyn Read> {
        match &self.progress {
            Some(progress) => {
                progress.set_position(0);
                Box::new(progress.wrap_read(source))
            }
            None => source,
        }
    }

    /// Refuses settings of another format than the data's.
    pub(super) fn check(&self, path: &Path, format: Option<Known>) -> Result<(), Failure> {
        let refused = |message: &str| Err(Failure::new(Exit::Usage, format!("{}: {message}", path.display())));
        if format != Some(Known::Mcap) && (self.topic.is_some() || self.temperature_topic.is_some()) {
            return refused("a topic is named, but this is not MCAP");
        }
        if !matches!(format, Some(Known::Ulog | Known::DataFlash { .. })) && self.instance.is_some() {
            return refused("an instance is named, but this is no log of an autopilot");
        }
        Ok(())
    }
}
