//! Logs of autopilots: ULog of PX4, and DataFlash of ArduPilot, binary or as text.
//!
//! A log is read twice: first for its IMUs, and for what was corrected; then for the rows. No more than a few messages
//! are in memory. Bytes that are no messages are left out, and told with their place.

mod ardupilot;
mod dataflash;
mod dataflash_format;
mod imu;
mod px4;
mod ulog;
mod ulog_format;
mod undo;
mod vehicle;
mod window;

pub(super) use ardupilot::DataFlashSource;
pub(super) use dataflash::{is_binary_log, is_text_log};
pub use imu::{LOG_ACCELERATION_PULSE, LOG_RATE_PULSE};
pub(super) use px4::UlogSource;
pub(super) use ulog::is_ulog;
pub use vehicle::VehicleState;
