//! Calibration without a turntable: recorded and simulated standstills, what attitudes allow, and what is refused.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

mod accuracy;
mod attitudes;
mod common;
mod recorded;
mod traps;
