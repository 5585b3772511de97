//! Where a table comes from.

use isotherm_recording::{LogImu, Marks};
use serde::Serialize;
use std::time::SystemTime;

/// Facts about the source that only the caller knows.
#[derive(Clone, Debug, Default)]
pub struct CampaignSource {
    /// Program and version.
    pub tool: String,
    /// Time of the calibration, RFC 3339 in UTC.
    pub time: String,
    /// Name of the campaign file; empty if there is none.
    pub campaign: String,
    /// SHA-256 of the campaign file, in hexadecimal; empty if there is none.
    pub campaign_sha256: String,
    /// SHA-256 of the samples of positions, in hexadecimal; empty without positions.
    pub samples_sha256: String,
    /// SHA-256 of each recording of ramps, or of an IMU that was put down by hand, in hexadecimal, in their order.
    pub recordings_sha256: Vec<String>,
    /// The marks of all recordings, in their order, as far as they have any.
    pub rows: Vec<Marks>,
    /// The part of the recordings that was read, in words; `None` for all of them.
    pub part: Option<String>,
    /// The IMU, as the logs of an autopilot name it.
    pub log_imu: Option<LogImu>,
}

/// What a provenance says of what was read of the recordings.
#[derive(Serialize)]
pub(crate) struct ReadRecord<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    part: Option<&'a str>,
    /// Of the logs of an autopilot. Device numbers are the same on all boards of a model: no serial numbers.
    #[serde(skip_serializing_if = "Option::is_none")]
    instance: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    device_id: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    gyroscope_device_id: Option<u32>,
}

impl CampaignSource {
    /// This program, now; the files are still to be named.
    #[must_use]
    pub fn now() -> Self {
        Self { tool: tool(), time: now(), ..Self::default() }
    }

    /// What was read of the recordings, as the provenance has it.
    pub(crate) fn read(&self) -> ReadRecord<'_> {
        let [device_id, gyroscope_device_id] = self.log_imu.map(|imu| imu.devices).unwrap_or_default();
        let instance = self.log_imu.map(|imu| imu.instance);
        ReadRecord { part: self.part.as_deref(), instance, device_id, gyroscope_device_id }
    }

    /// The marks as the provenance has them.
    pub(crate) fn marks(&self) -> Vec<String> {
        self.rows.iter().map(ToString::to_string).filter(|marks| !marks.is_empty()).collect()
    }
}

/// Name and version of this program, for [`CampaignSource::tool`].
#[must_use]
pub fn tool() -> String {
    format!("isotherm {}", env!("CARGO_PKG_VERSION"))
}

/// The current time to the second, RFC 3339 in UTC, for [`CampaignSource::time`].
#[must_use]
pub fn now() -> String {
    humantime::format_rfc3339_seconds(SystemTime::now()).to_string()
}
