//! Logs of autopilots: ULog of PX4, and DataFlash of ArduPilot, binary, as text or as JSON.
//!
//! A log is read twice: first for its IMUs, for what was corrected, and for the times that can be; then for the rows.
//! No more than a few messages are in memory. Bytes that are no messages are left out, and reported with their place.
//! So are rows that cannot be used.

mod ardupilot;
mod dataflash;
mod dataflash_format;
mod dataflash_json;
mod imu;
mod left_out;
mod px4;
mod reports;
mod settings;
mod survey;
mod timeline;
mod ulog;
mod ulog_format;
mod undo;
mod window;

pub use ardupilot::DataFlashSource;
pub use dataflash::LogEncoding;
pub use dataflash_json::first_message;
pub use imu::{FoundImu, LOG_ACCELERATION_PULSE, LOG_RATE_PULSE, found_listed};
pub use px4::UlogSource;
pub use settings::{GyroscopeTemperature, LogSettings};
pub use ulog::is_ulog;
