//! Campaigns: what a campaign file says, where positions and turns point the IMU in its laboratory, rows summed to dwells, standstills of an
//! IMU that is put down by hand, gravity and Earth's rate.
//!
//! This crate opens no file: a caller gives texts and rows.

pub mod campaign;
pub mod geometry;
pub mod gravity;
pub mod positions;
pub mod standstill;
pub mod turn;
