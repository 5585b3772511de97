//! The automatic campaign on a virtual clock: with faults drawn from seeds, and step by step.

#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

mod course;
mod drawn;
mod orders;
mod pauses;
mod readings;
mod restarts;
mod turns;
