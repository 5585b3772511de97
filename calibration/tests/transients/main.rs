//! Transients: ramps with a known truth, from their rows to the decision.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

mod campaign;
mod consumer;
mod data;
mod rates;
mod simulated;
mod traps;
