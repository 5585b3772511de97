//! What the scripts of autopilots make of the same rows: a cubic for each bias, without a constant for each recording,
//! a lag, or an error. Their running means and medians are left out: on a real warm-up of 160 mm/s2 the curves differ by
//! up to 0.8 mm/s2 from those of the scripts, at the ends, where one script pads its median with zeros.

use super::curves::{Series, Shape, Weight};
use crate::transients::BinValue;

/// Width of the bins of temperature that PX4's script weighs alike \[degC\].
const PX4_BIN: f64 = 0.1;

/// An autopilot that calibrates IMUs over temperature.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Autopilot {
    /// PX4: temperatures weigh alike.
    Px4,
    /// ArduPilot: rows weigh alike.
    ArduPilot,
}

impl Autopilot {
    /// Every autopilot with its name in options.
    pub const NAMES: [(Self, &'static str); 2] = [(Self::Px4, "px4"), (Self::ArduPilot, "ardupilot")];

    /// Its own name.
    #[must_use]
    pub const fn title(self) -> &'static str {
        match self {
            Self::Px4 => "PX4",
            Self::ArduPilot => "ArduPilot",
        }
    }
}

/// The cubic of an autopilot through the values that `raw` gives for bins; `None` if the rows do not determine it.
pub(super) fn cubic(autopilot: Autopilot, bias: &Series, raw: &impl Fn(&BinValue) -> f64) -> Option<Shape> {
    let mut series = bias.clone();
    series.recordings.iter_mut().flatten().for_each(|bin| bin.value = raw(bin));
    let weight = match autopilot {
        Autopilot::Px4 => Weight::Alike(PX4_BIN),
        Autopilot::ArduPilot => Weight::Rows,
    };
    series.fit(&series.whole(), 3, weight)
}
