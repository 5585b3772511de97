//! A dwell or a turn, as the fit needs it.

use super::runs::TurnBlock;
use isotherm_shared::wire::AXES;
use nalgebra::Vector3;

/// One dwell or turn, as the fit needs it.
#[derive(Clone, Debug)]
pub(super) struct GyroscopeRun<'a> {
    /// Index of the set point.
    pub set_point: usize,
    /// T: sum of the intervals \[s\].
    pub seconds: f64,
    /// Pulses of the positive and of the negative channel, by gyroscope.
    pub pulses: [[f64; 2]; AXES],
    pub head: [f64; AXES],
    pub board: [f64; AXES],
    /// Specific force at the start \[g0\].
    pub force: Vector3<f64>,
    /// The part of Earth's rate at the start that is known \[deg/h\].
    pub earth: Vector3<f64>,
    /// Derivatives of Earth's rate at the start by its horizontal components in the base; 0 without angles.
    pub by_horizontal: [Vector3<f64>; 2],
    /// Without angles: components of Earth's rate that nobody knows, each with a number and its direction at the start.
    /// They are eliminated.
    pub horizontal: Vec<(usize, Vector3<f64>)>,
    /// The runs that have such components in common.
    pub group: Option<usize>,
    pub turn: Option<TurnMotion<'a>>,
}

/// What a turn has in addition to what a dwell has.
#[derive(Clone, Copy, Debug)]
pub(super) struct TurnMotion<'a> {
    /// k.
    pub axis: Vector3<f64>,
    /// theta \[arcsec\].
    pub angle: f64,
    /// -1 if the IMU coordinates are left-handed, which turns the sign of a cross product; otherwise 1.
    pub hand: f64,
    pub blocks: &'a [TurnBlock],
}
