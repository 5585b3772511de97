//! Recordings at one attitude: a real warm-up against both autopilots, and what must be named.

mod autopilots;
mod orders;
mod real;
mod traps;
mod warm_ups;
