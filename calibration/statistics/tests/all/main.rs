//! Regressions, against figures that are known to 30 digits.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

mod linear_columns;
mod nist;
mod regression;
mod tails;
