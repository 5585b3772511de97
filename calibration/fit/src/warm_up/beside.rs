//! What the scripts of autopilots make of the same rows: a cubic for each bias, without a constant for each recording,
//! a lag, or an error. Their running means and medians are left out: on a real warm-up of 160 mm/s2 the curves differ
//! by up to 0.8 mm/s2 from those of the scripts, at the ends, where one script pads its median with zeros.

use super::curves::{Series, Shape, Weight};
use super::options::OnBoard;
use crate::sensor::TriadUnits;
use crate::transients::BinValue;
use isotherm_autopilot::{Autopilot, HIGHEST_ORDER};

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

/// What parameters on board subtract from a bias at a temperature, by the firmware's formula \[g0 or deg/h\]; `None` if
/// they are only of accelerometers and this is a gyroscope. `gravity` is the value of 1 g0 \[m/s2\].
pub(super) fn of_parameters(on_board: &OnBoard, bias: &Series, gravity: f64) -> Option<impl Fn(f64) -> f64> {
    let (kind, axis, parameters) = (bias.kind, bias.axis, on_board.parameters);
    parameters.offset(kind, 0.0)?;
    let (unit, _) = TriadUnits::of(kind).si(1.0, gravity);
    Some(move |temperature: f64| {
        let offset = parameters.offset(kind, temperature as f32);
        offset.map_or(f64::NAN, |offset| f64::from(offset[axis]) / unit)
    })
}
