//! Gyroscopes: campaigns with turns, from their rows to the table.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

mod by_hand;
mod coverage;
mod data;
mod gate;
mod refused;
mod simulated;
mod station;
mod traps;
mod verification;
