//! Tables, and the kernel that answers by them.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

mod difference;
mod format_2;
mod format_3;
mod gate;
mod properties;
mod readings;
