//! Parameters of PX4 and ArduPilot: against the firmwares' own numbers, the kernel, and files that are broken.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

mod common;
mod effects;
mod exported;
mod golden;
mod imported;
