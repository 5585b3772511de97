//! Campaigns: what a campaign file says, where positions and turns point the IMU in its laboratory, rows summed to
//! dwells, static poses of a tumble, gravity and Earth's rate.
//!
//! This crate opens no file: a caller gives texts and rows.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_campaign::Campaign;
//!
//! let campaign = Campaign::from_toml(include_str!("../../../examples/campaign/campaign.toml"))?;
//! assert_eq!((campaign.imu.as_str(), campaign.positions.len()), ("imu-paper", 12));
//! // In the first position A3 points up and measures the local gravity, here as large as g0.
//! let (force, _) = campaign.force(&campaign.positions[0], None);
//! assert_eq!(force, [0.0, 0.0, 1.0]);
//! # Ok(())
//! # }
//! ```

mod counts;
mod direction;
mod dwell;
mod file;
mod geometry;
mod gravity;
mod magnitude;
mod members;
mod model;
mod mount;
mod net;
mod position;
mod positions;
mod ramp;
mod rate;
mod rows;
mod samples;
mod static_pose;
mod turn;

pub use counts::faults;
pub use dwell::{Block, Dwell, joint_range};
pub use geometry::{
    EARTH_RATE, base_axes, horizontal_rate, laboratory_axes, outer_axis, specific_force, vertical_rate,
};
pub use gravity::{GravitySource, NORMAL_GRAVITY_HALF_WIDTH, Place, normal_gravity};
pub use magnitude::{MAGNITUDE_ROWS, magnitude_at_rest};
pub use members::{MOST_IMUS, Member, members, select_imu};
pub use model::Campaign;
pub use mount::{mount, mounting, nearest_rotation, other_zero};
pub use position::{Position, SAME_DIRECTION};
pub use positions::{MAX_CONDITION, Observability, PARAMETERS, Scheme};
pub use ramp::Ramp;
pub use rate::rate_at_rest;
pub use rows::{implausible, implausible_time, read_dwells};
pub use samples::{FilePattern, IMU, POSITION, SET_POINT, SampleLayout};
pub use static_pose::{
    Begins, STATIC_POSE_WINDOW_S, StaticPose, StaticPoseError, StaticPoses, begins_ns, find_static_poses, stretches,
};
pub use turn::{LEAST_TURN, TableAxis, Turn, turns, vector_words};
