//! What the scripts of autopilots make of the same rows: a cubic for each bias, without a constant for each recording,
//! a lag, or an error. Their running means and medians are left out: on a real warm-up of 160 mm/s2 the curves differ
//! by up to 0.8 mm/s2 from those of the scripts, at the ends, where one script pads its median with zeros.

use super::curves::{Series, Shape, Weight};
use crate::transients::BinValue;
use isotherm_parameters::{Autopilot, HIGHEST_ORDER};

/// Width of the bins of temperature that PX4's script weighs alike \[degC\].
const PX4_BIN: f64 = 0.1;

/// The cubic of an autopilot through the values that `raw` gives for bins; `None` if the rows do not determine it.
pub(super) fn cubic(autopilot: Autopilot, bias: &Series, raw: &impl Fn(&BinValue) -> f64) -> Option<Shape> {
    let mut series = bias.clone();
    series.recordings.iter_mut().flatten().for_each(|bin| bin.value = raw(bin));
    let weight = match autopilot {
        Autopilot::Px4 => Weight::Alike(PX4_BIN),
        Autopilot::ArduPilot => Weight::Rows,
    };
    series.fit(&series.whole(), HIGHEST_ORDER, weight)
}
