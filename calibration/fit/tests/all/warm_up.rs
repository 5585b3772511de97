//! Recordings at one attitude: a real warm-up against both autopilots, and what must be named.

mod autopilots;
mod bad_rows;
mod curves;
mod orders;
mod real;
mod rest;
mod traps;
mod units;
