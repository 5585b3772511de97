//! The Allan deviation and the model of it, on simulated noise with a known truth.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

mod coverage;
mod recording;
mod simulated;
