//! Gyroscopes: campaigns with turns, from their rows to the table.

mod by_hand;
mod coverage;
mod data;
mod gate;
mod refused;
mod simulated;
mod station;
mod traps;
mod verification;
