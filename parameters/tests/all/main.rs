//! Parameters of PX4 and ArduPilot: against the firmwares' own numbers, the kernel, and files that are broken.

mod common;
mod effects;
mod exported;
mod golden;
mod imported;
