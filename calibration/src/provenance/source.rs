//! Where a table comes from.

/// Facts about the source that only the caller knows.
#[derive(Clone, Debug)]
pub struct CampaignSource {
    /// Program and version.
    pub tool: String,
    /// Time of the calibration, RFC 3339 in UTC.
    pub time: String,
    /// Name of the campaign file.
    pub campaign: String,
    /// SHA-256 of the campaign file, in hexadecimal.
    pub campaign_sha256: String,
    /// SHA-256 of the samples, in hexadecimal; empty with ramps alone.
    pub samples_sha256: String,
    /// SHA-256 of each ramp's recording, in hexadecimal, in the order of the campaign file.
    pub ramps_sha256: Vec<String>,
}
