//! The commands as a user types them.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

mod batch;
mod calibration;
mod cli;
mod clocks;
mod common;
mod compare;
mod describe;
mod findings;
mod foreign;
mod gyroscopes;
mod joined;
mod laboratory;
mod noise;
mod parameters;
mod part;
mod pieces;
mod ramps;
mod simulate;
mod simulate_ramps;
mod time;
mod tumble;
mod vehicle;
mod warm_up;
