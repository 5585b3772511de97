//! What `noise`, `compare` and `batch` say of data whose truth is known.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

mod allan;
mod batch;
mod compare;
