//! Why a run cannot be judged.

use crate::window::MIN_WINDOWS;
use core::fmt;
use isotherm_recording::{IntervalFault, unit_factor};
use isotherm_shared::wire::AXES;
/// Why the stability cannot be computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StabilityError {
    /// Too few windows.
    #[error(
        "{} of {window_s} s; at least {MIN_WINDOWS} are needed: {}", count_of(*.windows, "window"), 
        wrong_times(*.ratio).unwrap_or_else(|| "record longer, or take a shorter --window".to_owned())
    )]
    TooShort {
        /// Complete windows.
        windows: usize,
        /// Length of a window \[s\].
        window_s: f64,
        /// Length of the output over gravity.
        ratio: f64,
    },
    /// The output of an axis is not a number in any window.
    #[error(
        "the output of {axis} is not a number: its temperature is, or the table rejects it; look at a{index}_head and a{index}_board"
    )]
    NotANumber {
        /// A1, A2 or A3.
        axis: &'static str,
        /// 1, 2 or 3.
        index: usize,
    },
    /// Samples of another device than the table's.
    #[error(
        "{samples} samples are of another device than the table's, which has the serial number {serial:?}; use the \
         table of that device, or give --other-device"
    )]
    OtherDevice {
        /// How many.
        samples: u64,
        /// Serial number of the table.
        serial: String,
    },
    /// The intervals are not the time from sample to sample.
    #[error("{0}")]
    Interval(IntervalFault),
    /// Too few windows are at the attitude.
    #[error(
        "only {counted} of {windows} windows are {} specific force {force}: the output is {output}, {:.4} g0 long; {}",
        if *.stated { format!("still and within {OTHER_ATTITUDE} g0 of the stated") } else { "still at the median".to_owned() },
        output.0.iter().map(|f| f * f).sum::<f64>().sqrt(),
        if *.stated {
            "this is another attitude than the one stated (--attitude, --angles), the table of another IMU, cables that are exchanged, or the IMU was not at rest"
        } else {
            "hold the IMU still"
        }
    )]
    OffAttitude {
        /// Windows at the attitude.
        counted: usize,
        /// All windows.
        windows: usize,
        /// The specific force of the attitude.
        force: Force,
        /// The median of the output.
        output: Force,
        /// Whether the attitude was stated.
        stated: bool,
    },
}

/// A specific force \[g0\], displayed with its unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Force(pub [f64; AXES]);

impl fmt::Display for Force {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [a1, a2, a3] = self.0;
        write!(f, "({a1:.4}, {a2:.4}, {a3:.4}) g0")
    }
}

/// At another attitude than the one stated, an axis is over this off \[g0\]: 6 degrees. With its own table no IMU is.
pub(super) const OTHER_ATTITUDE: f64 = 0.1;

/// `1 window`, `3 windows`.
pub(super) fn count_of(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// What an output that is `ratio` times as long as gravity says about the times of the samples, if it is the factor of
/// a unit.
pub(super) fn wrong_times(ratio: f64) -> Option<String> {
    let factor = unit_factor(ratio).filter(|factor| *factor > 1.0)?;
    Some(format!(
        "all times look {factor} times too short; give timestamp_ns and interval_ns in nanoseconds (multiply both by {factor})"
    ))
}
