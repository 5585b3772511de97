//! The automatic campaign: chamber and table are led through a plan while the IMU's samples are taken.

pub mod limits;
pub mod plan;
