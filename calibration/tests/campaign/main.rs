//! Simulated campaigns, from their rows to their tables.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

mod accuracy;
mod batch;
mod causes;
mod checks;
mod common;
mod coverage;
mod laboratories;
mod report;
