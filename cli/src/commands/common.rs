//! What several commands do with their arguments.

use isotherm_client::{Domain, ImuId, Options};
use isotherm_recording_formats::read::ImuChoice;
use isotherm_shared::table::CoefficientTable;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The options of a client.
pub fn options(domain: Domain, timeout: Duration) -> Options {
    Options { domain, timeout }
}

/// The files of a recording, as [`refuse_overlap`](isotherm_files::refuse_overlap) takes them.
pub fn inputs(recording: &[PathBuf]) -> Vec<(&Path, &'static str)> {
    recording.iter().map(|path| (path.as_path(), "the recording")).collect()
}

/// The IMU whose samples are read for a table: `imu` if it is given, or else the table's.
pub fn choice(imu: Option<ImuId>, table: &CoefficientTable) -> ImuChoice {
    imu.map_or_else(|| ImuChoice::Prefer(table.content().imu.clone()), ImuChoice::Only)
}
