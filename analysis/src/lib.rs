//! What is seen in a recording or between tables: the Allan deviation of an IMU at rest, the comparison of two tables, and the statistics of
//! a batch of units.
//!
//! This crate opens no file: a caller gives rows and tables.

pub mod allan;
pub mod batch;
pub mod compare;
