//! What a plan specifies.

use crate::limits::Limits;
use isotherm_campaign::{Campaign, Member, Position};
use isotherm_instruments::{ChamberConfig, TurntableConfig};
use isotherm_shared::names::ImuId;
use std::path::PathBuf;

/// A checked plan. Times are laboratory time \[s\].
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The IMU to calibrate; the first one of a batch.
    pub imu: ImuId,
    /// The folder for everything that the campaign writes.
    pub output: PathBuf,
    /// Chamber temperatures, in order \[degC\].
    pub set_points_c: Vec<f64>,
    /// Positions of the turntable at each set point, in order; all have angles. The directions of a batch are along the
    /// axes of an IMU without mounting, those of one of its IMUs along its own.
    pub positions: Vec<Position>,
    /// When a set point counts as reached and settled.
    pub soak: SoakPlan,
    /// The samples to take in a position.
    pub dwell: DwellPlan,
    /// Turns of the turntable at each set point, after the positions, in order; none if the gyroscopes are not
    /// calibrated.
    pub turns: Vec<PlannedTurn>,
    /// How a turn is taken.
    pub turn: TurnPlan,
    /// The ramps, after the last set point, in order; none if no transients are estimated.
    pub ramps: Vec<RampPlan>,
    /// Ramp of the chamber's set point \[degC/s\].
    pub ramp_c_per_s: f64,
    /// How the turntable moves, and when it counts as arrived.
    pub motion: MotionPlan,
    /// Limits of commands and readings.
    pub limits: Limits,
    /// Time-outs, and the number of attempts.
    pub patience: Patience,
    /// The set point that the chamber holds in the safe state \[degC\]; `None` for standby.
    pub ambient_c: Option<f64>,
    /// Verification runs; `None` for none.
    pub verify: Option<VerificationPlan>,
    /// The file that the coefficient table is installed as if the verification holds; each IMU of a batch has its own.
    pub install: Option<PathBuf>,
    /// The chamber's driver and line.
    pub chamber: ChamberConfig,
    /// The turntable's driver and line.
    pub turntable: TurntableConfig,
    /// Text of the campaign file that is written next to the samples.
    pub campaign_toml: String,
    /// The same campaign file, parsed; of a batch the part of the first IMU.
    pub campaign: Campaign,
    /// The IMU's place in a batch; `None` if it is the only one.
    pub member: Option<Member>,
    /// The plan of each IMU, in order, for a plan with `imus`; otherwise empty. See [`each`](Self::each).
    pub batch: Vec<Self>,
}

/// When a set point counts as reached and settled. Times are laboratory time \[s\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SoakPlan {
    /// Shortest time at the set point before the first position.
    pub time_s: f64,
    /// Shortest time at the set point in all.
    pub stay_s: f64,
    /// Largest difference between the air and the set point \[degC\].
    pub tolerance_c: f64,
    /// Window over which rates of change are measured.
    pub window_s: f64,
    /// Largest rate of change of the air \[degC/h\].
    pub chamber_c_per_h: f64,
    /// Largest rate of change of each of the IMU's temperatures \[unit/h\]; `None` for no limit.
    pub temperature_per_h: Option<f64>,
}

/// The samples to take in a position. Times are laboratory time \[s\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DwellPlan {
    /// Counted time: the sum of the samples' intervals.
    pub time_s: f64,
    /// Samples are summed into rows of this length; 0 writes every sample.
    pub row_s: f64,
}

/// A turn from rest to rest about one axis of the turntable. The same of a campaign file may begin at another angle, by
/// whole turns: the limits and the turn before decide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedTurn {
    /// Its number in the samples.
    pub number: u32,
    /// The axis that turns: 0 is the outer one, 1 the inner.
    pub axis: usize,
    /// Outer and inner angle where it begins \[deg\].
    pub from_deg: [f64; 2],
    /// Outer and inner angle where it ends \[deg\].
    pub to_deg: [f64; 2],
}

impl PlannedTurn {
    /// Its angle, right-handed about the axis of the turntable \[deg\].
    #[must_use]
    pub const fn angle_deg(&self) -> f64 {
        self.to_deg[self.axis] - self.from_deg[self.axis]
    }
}

/// How a turn is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurnPlan {
    /// Shortest rest before and after, in which samples are taken \[s\].
    pub rest_s: f64,
    /// Commanded rate of the axis \[deg/s\].
    pub rate_deg_s: f64,
    /// Commanded acceleration of the axis \[deg/s2\].
    pub acceleration_deg_s2: f64,
    /// Samples are summed into rows of this length \[s\].
    pub row_s: f64,
}

/// How the turntable moves, and when it counts as arrived.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionPlan {
    /// Commanded rate of each axis \[deg/s\].
    pub rate_deg_s: f64,
    /// Commanded acceleration of each axis \[deg/s2\].
    pub acceleration_deg_s2: f64,
    /// Largest angle error of an axis that has arrived \[deg\].
    pub tolerance_deg: f64,
    /// Largest rate of an axis at rest \[deg/s\].
    pub still_deg_s: f64,
    /// How long both must hold \[s\].
    pub settle_s: f64,
}

/// Time-outs after which the campaign pauses or gives up, and the number of attempts. Times are laboratory time \[s\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patience {
    /// Longest pause because an instrument or the IMU's stream is missing.
    pub pause_s: f64,
    /// Longest time without a usable sample.
    pub stream_s: f64,
    /// Longest time to the set point after the end of the ramp.
    pub approach_s: f64,
    /// Longest time until the rates of change are within their limits, after the soak and one window.
    pub stable_s: f64,
    /// Longest time until the turntable has settled, after the longest motion.
    pub settle_s: f64,
    /// After a longer interruption the soak begins anew.
    pub resoak_s: f64,
    /// Most attempts at one unit, and most interruptions without a complete unit between them.
    pub attempts: u32,
}

/// The chamber's way there and back in a ramp or a verification run: it holds, ramps to the other end, holds, ramps
/// back, and holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThereAndBack {
    /// Set point of the chamber at the beginning, and at the end \[degC\].
    pub from_c: f64,
    /// Set point of the chamber at the other end \[degC\].
    pub to_c: f64,
    /// The ramp of both ways \[degC/s\].
    pub ramp_c_per_s: f64,
    /// Hold time at the beginning, at the other end, and at the end \[s\].
    pub hold_s: f64,
}

impl ThereAndBack {
    /// Duration of the whole way \[s\].
    #[must_use]
    pub fn time_s(&self) -> f64 {
        2.0 * (self.to_c - self.from_c).abs() / self.ramp_c_per_s + 3.0 * self.hold_s
    }
}

/// A ramp: the IMU is at rest at one attitude while the chamber goes there and back.
#[derive(Clone, Debug, PartialEq)]
pub struct RampPlan {
    /// The chamber's way.
    pub way: ThereAndBack,
    /// The attitude; it has angles.
    pub attitude: Position,
}

/// The verification runs: the IMU is at rest while the chamber goes there and back.
#[derive(Clone, Debug, PartialEq)]
pub struct VerificationPlan {
    /// Number of runs.
    pub runs: u32,
    /// The chamber's way.
    pub way: ThereAndBack,
    /// The attitudes of the runs, which alternate over them: at least one, all have angles.
    pub attitudes: Vec<Position>,
}

impl VerificationPlan {
    /// The attitude of a run, counted from 0.
    pub fn attitude(&self, run: usize) -> &Position {
        &self.attitudes[run % self.attitudes.len()]
    }
}
