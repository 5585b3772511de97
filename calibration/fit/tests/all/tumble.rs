//! Calibration without a turntable: recorded and simulated standstills, what attitudes allow, and what is refused.

mod accuracy;
mod afternoons;
mod attitudes;
mod common;
mod local_gravity;
mod plain;
mod recorded;
mod standstills;
mod traps;
mod tumbles;
