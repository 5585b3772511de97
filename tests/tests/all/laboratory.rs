//! The laboratory: drivers and automatic campaigns, with the processes of a simulated station.

mod batch;
mod campaign;
mod gate;
mod instruments;
mod ramps;
mod turns;
