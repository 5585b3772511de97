//! Means over the windows of a recording at rest: what stability and verdict are computed from.

use crate::occupancy::Bins;
use isotherm_shared::wire::AXES;
use serde::{Deserialize, Serialize};

/// Fewest windows for a standard deviation.
pub(crate) const MIN_WINDOWS: usize = 3;

/// Means over one window, of the accelerometers \[g0\] or of the gyroscopes \[deg/h\].
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct Window {
    /// Middle of the window, since the begin of the recording \[s\].
    pub time_s: f64,
    /// Sum of its intervals \[s\].
    pub seconds: f64,
    /// Output with the coefficients frozen at mid temperature.
    pub before: [f64; AXES],
    /// Output of the full model; NaN where the table rejects.
    pub after: [f64; AXES],
    /// Mean temperature of the heads.
    pub head: [f64; AXES],
    /// Mean temperature of the boards.
    pub board: [f64; AXES],
    /// Lowest and highest temperature of a row: head and board, by axis.
    pub temperature: [[[f64; 2]; 2]; AXES],
    /// Which bins of the table's ranges the rows touch: of that of the bias, and of that of K+ and K-, by axis.
    pub touched: [[Bins; 2]; AXES],
    /// Whether a sample had any flag of the triad other than stale temperature and another unit.
    pub flagged: bool,
    /// Whether the window counts for the stability: it is at the attitude.
    pub counts: bool,
    /// Whether the IMU was still, at any attitude.
    pub still: bool,
}

impl Window {
    /// Length of the output of the full model \[g0\].
    #[must_use]
    pub fn length(&self) -> f64 {
        self.after.iter().map(|a| a * a).sum::<f64>().sqrt()
    }
}
