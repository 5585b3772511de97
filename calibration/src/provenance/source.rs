//! Where a table comes from.

use isotherm_recording::Marks;
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
}

impl CampaignSource {
    /// This program, now; the files are still to be named.
    #[must_use]
    pub fn now() -> Self {
        Self { tool: tool(), time: now(), ..Self::default() }
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
