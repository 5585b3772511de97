//! The laboratory: drivers and automatic campaigns, with the processes of a simulated station.
//!
//! One program for all of them: these tests wait for the station's clock far longer than they compute, so they run
//! beside each other.
#![allow(clippy::unwrap_used, reason = "in a test the panic is the report")]

mod batch;
mod campaign;
#[path = "../feed/mod.rs"]
mod feed;
mod gate;
mod instruments;
mod ramps;
mod turns;
