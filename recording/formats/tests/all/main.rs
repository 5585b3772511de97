//! Recordings and foreign data, as other programs write them.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

mod chunks;
mod continuity;
mod convert;
mod convert_clocks;
mod convert_logs;
mod convert_logs_damaged;
mod convert_logs_random;
mod convert_logs_undone;
mod convert_ros;
mod convert_rows;
mod convert_stamps;
mod convert_stamps_random;
mod convert_thermometers;
mod convert_time;
mod convert_vehicle;
mod foreign;
mod hostile;
mod joined;
mod layouts;
mod logs;
mod part;
mod proposals;
mod recognised;
mod split;
