//! Calibration without a turntable: recorded and simulated static poses, what attitudes allow, and what is refused.

mod accuracy;
mod afternoons;
mod attitudes;
mod common;
mod local_gravity;
mod plain;
mod poses;
mod recorded;
mod traps;
mod tumbles;
