//! Formats whose columns are known, so that they need no mapping. Each is recognised by its first bytes.

use super::novatel::{self, NovatelSource};
use super::ros::RosSource;
use super::settings::{Settings, TimeSource};
use isotherm_autopilot::logs::{DataFlashSource, FoundImu, GyroscopeTemperature, LogEncoding, UlogSource, is_ulog};
use isotherm_recording::columns::MCAP_MAGIC;
use isotherm_recording::foreign::{ForeignRows, OpenData};
use isotherm_shared::content::FileContent;
use isotherm_support::failure::{Exit, Failure, shown};
use std::path::Path;

/// A format whose columns are known.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum KnownFormat {
    /// ROS messages.
    Mcap,
    Novatel,
    /// Of PX4.
    Ulog,
    /// Of ArduPilot.
    DataFlash(LogEncoding),
}

impl KnownFormat {
    /// The format of data that begin with these bytes.
    pub(super) fn of(beginning: &[u8]) -> Option<Self> {
        if beginning.starts_with(MCAP_MAGIC) {
            return Some(Self::Mcap);
        }
        if is_ulog(beginning) {
            return Some(Self::Ulog);
        }
        if novatel::is_log(beginning) {
            return Some(Self::Novatel);
        }
        LogEncoding::of(beginning).map(Self::DataFlash)
    }

    /// Its name in messages.
    const fn name(self) -> &'static str {
        match self {
            Self::Mcap => FileContent::Mcap.name(),
            Self::Novatel => "logs of NovAtel (ASCII)",
            Self::Ulog => FileContent::Ulog.name(),
            Self::DataFlash(_) => FileContent::DataFlash.name(),
        }
    }

    /// The rows of the data. ROS messages may have other units, one of which is `units` \[m/s2, rad/s\].
    pub(super) fn rows(
        self,
        data: OpenData<'_>,
        settings: &Settings,
        temperature: Option<f64>,
        units: [f64; 2],
    ) -> Result<Box<dyn ForeignRows>, Failure> {
        Ok(match self {
            Self::Mcap => RosSource::open(data, settings, temperature, units)?,
            Self::Novatel => Box::new(NovatelSource::new(data.bytes, temperature)),
            Self::Ulog => Box::new(UlogSource::open(data, &settings.of_log(), temperature)?),
            Self::DataFlash(encoding) => {
                Box::new(DataFlashSource::open(data, &settings.of_log(), temperature, encoding)?)
            }
        })
    }

    /// The IMUs of an autopilot's log; none of other data.
    ///
    /// # Errors
    /// If a log has no rows of an IMU; of reading.
    pub(super) fn imus(self, data: OpenData<'_>) -> Result<Vec<FoundImu>, Failure> {
        match self {
            Self::Ulog => UlogSource::imus(data),
            Self::DataFlash(encoding) => DataFlashSource::imus(data, encoding),
            Self::Mcap | Self::Novatel => Ok(Vec::new()),
        }
    }
}

/// The name of the format of data that begin with these bytes, if its columns are known.
#[must_use]
pub fn known_format(beginning: &[u8]) -> Option<&'static str> {
    KnownFormat::of(beginning).map(KnownFormat::name)
}

/// Refuses settings of another format than the data's.
pub(super) fn check(settings: &Settings, path: &Path, format: Option<KnownFormat>) -> Result<(), Failure> {
    let refused = |message: &str| Err(Failure::new(Exit::Usage, format!("{}: {message}", shown(path))));
    let topics = [&settings.topic, &settings.gyroscope_topic, &settings.temperature_topic];
    if format != Some(KnownFormat::Mcap) && topics.iter().any(|topic| topic.is_some()) {
        return refused("a topic is named, but this is not MCAP");
    }
    if format.is_some() && settings.gyroscope_file.is_some() {
        return refused("a file of the gyroscopes is named, but this is not a text with a mapping");
    }
    let is_log = matches!(format, Some(KnownFormat::Ulog | KnownFormat::DataFlash(_)));
    if is_log && settings.time != TimeSource::Header {
        return refused(
            "--time is for texts and bags, but this is the log of an autopilot, whose times are fixed anyhow",
        );
    }
    if format != Some(KnownFormat::Mcap) && settings.time == TimeSource::Log {
        return refused(
            "--time log takes the times at which messages were recorded, but this is not MCAP; leave it out, or give \
             --time rate --interval S for rows that are S seconds apart",
        );
    }
    if !is_log && settings.instance.is_some() {
        return refused("an instance is named, but this is not a log of an autopilot");
    }
    if !is_log && settings.gyroscope_temperature != GyroscopeTemperature::Own {
        return refused("the temperature of the gyroscopes is named, but this is not a log of an autopilot");
    }
    Ok(())
}
