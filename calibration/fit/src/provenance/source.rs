//! Where a table comes from.

use super::document::view;
use isotherm_recording::{LogImu, Marks};

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
    /// SHA-256 of each recording of ramps, or of a tumble, in hexadecimal, in their order.
    pub recordings_sha256: Vec<String>,
    /// The marks of all recordings, in their order, as far as they have any.
    pub rows: Vec<Marks>,
    /// The part of the recordings that was read, in words; `None` for all of them.
    pub part: Option<String>,
    /// The IMU, as the logs of an autopilot name it.
    pub log_imu: Option<LogImu>,
}

view! {
/// What a provenance says of what was read of the recordings.
pub(super) ReadRecord<'a>(source: &'a CampaignSource) {
    /// Hashes of some of the rows, see [`Marks`](isotherm_recording::Marks).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    rows: Vec<String> = source.rows.iter().map(ToString::to_string).filter(|marks| !marks.is_empty()).collect(),
    part: Option<&'a str> = source.part.as_deref(),
    /// Of the logs of an autopilot. Device numbers are the same on all boards of a model: no serial numbers.
    instance: Option<u32> = source.log_imu.map(|imu| imu.instance),
    device_id: Option<u32> = source.log_imu.and_then(|imu| imu.devices[0]),
    gyroscope_device_id: Option<u32> = source.log_imu.and_then(|imu| imu.devices[1]),
}}

impl CampaignSource {
    /// This program, at a time as RFC 3339 in UTC; the files are still to be named.
    #[must_use]
    pub fn at(time: impl Into<String>) -> Self {
        Self { tool: tool(), time: time.into(), ..Self::default() }
    }
}

/// Name and version of this program, for [`CampaignSource::tool`].
#[must_use]
pub fn tool() -> String {
    format!("isotherm {}", env!("CARGO_PKG_VERSION"))
}
