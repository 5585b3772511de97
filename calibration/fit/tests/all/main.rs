//! Fits of campaigns, turns, ramps and static poses, and the mistakes that they must refuse.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

mod campaign;
mod gyroscopes;
mod mistakes;
mod transients;
mod tumble;
mod warm_up;
