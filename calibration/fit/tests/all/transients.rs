//! Transients: ramps with a known truth, from their rows to the decision.

mod campaign;
pub(crate) mod consumer;
mod data;
mod rates;
mod simulated;
mod sweeps;
mod traps;
