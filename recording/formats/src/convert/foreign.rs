//! What is known of foreign data, apart from the data themselves.

use super::mapping::Mapping;
use super::settings::{Settings, TimeSource};
use isotherm_autopilot::logs::GyroscopeTemperature;
use std::path::{Path, PathBuf};

/// What is known of foreign data: the options of `isotherm convert` about them.
#[derive(Clone, Debug, Default)]
pub struct Foreign {
    /// Name and text of the mapping file.
    pub mapping: Option<(PathBuf, String)>,
    /// What options say.
    pub settings: Settings,
}

impl Foreign {
    /// Name and text of the mapping file.
    #[must_use]
    pub fn named(&self) -> Option<(&Path, &str)> {
        self.mapping.as_ref().map(|(name, text)| (name.as_path(), text.as_str()))
    }

    /// Whether the mapping has gyroscopes, in the file of the accelerometers or in their own; `None` without a mapping
    /// of a text, or if it is faulty.
    pub(crate) fn maps_gyroscopes(&self) -> Option<bool> {
        let (_, text) = self.named()?;
        Mapping::of_two_files(text, None).ok().map(|mapping| mapping.gyroscope.is_some())
    }

    /// What is given, for messages. A recording needs none of it.
    #[must_use]
    pub fn given(&self) -> Vec<&'static str> {
        let Settings { temperature, interval_ns, time, topic, gyroscope_topic, gyroscope_file, .. } = &self.settings;
        let Settings { temperature_topic, instance, gyroscope_temperature, .. } = &self.settings;
        let all = [
            ("mapping", self.mapping.is_some()),
            ("temperature", temperature.is_some()),
            ("interval", interval_ns.is_some()),
            ("time", *time != TimeSource::Header),
            ("topic", topic.is_some()),
            ("gyroscope topic", gyroscope_topic.is_some()),
            ("gyroscope file", gyroscope_file.is_some()),
            ("temperature topic", temperature_topic.is_some()),
            ("instance", instance.is_some()),
            ("gyroscope temperature", *gyroscope_temperature != GyroscopeTemperature::Own),
        ];
        all.into_iter().filter_map(|(name, given)| given.then_some(name)).collect()
    }
}
