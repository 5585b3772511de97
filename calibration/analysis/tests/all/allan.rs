//! The Allan deviation and the model of it, on simulated noise with a known truth.

mod coverage;
mod lost;
mod misled;
mod recording;
mod simulated;
