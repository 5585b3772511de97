//! How far heating and cooling are apart: the sweeps of a recording and the hysteresis band of a residual.
//!
//! A sweep is what lies between two turns of the temperature, with the hold after it. The band is the residual of
//! heating sweeps less that of cooling sweeps, by bins of temperature. Lag and hysteresis both open it; nothing here
//! distinguishes them (see transients).

use core::ops::Range;
use serde::{Deserialize, Serialize};

/// A turn counts if the temperature goes back by more than this part of its range.
const LEAST_TURN: f64 = 0.15;
/// What is nearer to the end of a sweep than this part of the range is the hold after it.
const HOLD: f64 = 0.02;
/// Bins of temperature that heating and cooling are compared in.
pub const BINS: usize = 12;

/// What the temperature did between two turns, with the hold after it.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Sweep {
    /// The values that belong to it.
    pub values: Range<usize>,
    /// Whether the temperature rose.
    pub heating: bool,
}

/// The sweeps of temperature in the order of time. A series that turns nowhere is one sweep; one that does not change,
/// or an empty one, has none.
///
/// ```
/// use isotherm_statistics::{Sweep, sweeps};
///
/// let up_and_down = [0.0, 1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 1.0, 0.0];
/// let expected = [Sweep { values: 0..5, heating: true }, Sweep { values: 5..9, heating: false }];
/// assert_eq!(sweeps(&up_and_down), expected);
/// ```
#[must_use]
pub fn sweeps(temperature: &[f64]) -> Vec<Sweep> {
    let low = temperature.iter().copied().fold(f64::INFINITY, f64::min);
    let high = temperature.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let range = high - low;
    if !(range > 0.0 && range.is_finite()) {
        return Vec::new();
    }
    // The turning points: index of the extremum, and whether the temperature rose to it.
    let mut turns: Vec<(usize, bool)> = Vec::new();
    let (mut lowest, mut highest) = (0, 0);
    let mut rising = None;
    for (i, &value) in temperature.iter().enumerate() {
        if value < temperature[lowest] {
            lowest = i;
        }
        if value > temperature[highest] {
            highest = i;
        }
        if rising != Some(true) && value - temperature[lowest] > LEAST_TURN * range {
            if rising == Some(false) {
                turns.push((lowest, false));
            }
            rising = Some(true);
            highest = i;
        } else if rising != Some(false) && temperature[highest] - value > LEAST_TURN * range {
            if rising == Some(true) {
                turns.push((highest, true));
            }
            rising = Some(false);
            lowest = i;
        }
    }
    let mut sweeps = Vec::new();
    let mut begin = 0;
    for &(turn, heating) in &turns {
        // The hold ends where the temperature leaves the neighbourhood of the turn.
        let near = |value: &f64| (value - temperature[turn]).abs() <= HOLD * range;
        let end = turn + temperature[turn..].iter().take_while(|value| near(value)).count();
        sweeps.push(Sweep { values: begin..end, heating });
        begin = end;
    }
    let last =
        turns.last().map_or_else(|| temperature[temperature.len() - 1] > temperature[0], |(_, heating)| !heating);
    let last = if turns.is_empty() { rising.unwrap_or(last) } else { last };
    if begin < temperature.len() {
        sweeps.push(Sweep { values: begin..temperature.len(), heating: last });
    }
    sweeps
}

/// Mean residual over a short time at rest.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct LoopPoint {
    /// Mean head temperature.
    pub temperature: f64,
    /// Mean residual, in the bias's unit.
    pub residual: f64,
    /// Whether it is of a heating sweep.
    pub heating: bool,
}

/// The hysteresis band: the residual of heating less that of cooling in 12 bins of temperature, rms over the bins that
/// have both. `None` where heating and cooling share no bin.
///
/// ```
/// use isotherm_statistics::{LoopPoint, band, shared_bins};
///
/// // Heating reads 1.5 ug0 more than cooling over the whole range of 1 to 4 V.
/// let at = |temperature, residual, heating| LoopPoint { temperature, residual, heating };
/// let temperature = (0..=30).map(|i| 1.0 + 0.1 * f64::from(i));
/// let points: Vec<_> = temperature.flat_map(|x| [at(x, 1.5, true), at(x, 0.0, false)]).collect();
/// assert_eq!(band(&points), Some(1.5));
/// assert_eq!(shared_bins(&points), 12);
/// assert_eq!(band(&points[..1]), None);
/// ```
#[must_use]
pub fn band(points: &[LoopPoint]) -> Option<f64> {
    let (sum, count) =
        differences(points).fold((0.0, 0), |(sum, count), difference| (sum + difference * difference, count + 1));
    (count > 0).then(|| (sum / f64::from(count)).sqrt())
}

/// The number of bins that heating and cooling share, of the 12 of [`band`].
#[must_use]
pub fn shared_bins(points: &[LoopPoint]) -> usize {
    differences(points).count()
}

/// The residual of heating less that of cooling in each bin of temperature that has both.
fn differences(points: &[LoopPoint]) -> impl Iterator<Item = f64> {
    let low = points.iter().map(|point| point.temperature).fold(f64::INFINITY, f64::min);
    let high = points.iter().map(|point| point.temperature).fold(f64::NEG_INFINITY, f64::max);
    // Sum and number of each bin, of cooling and of heating.
    let mut bins = [[(0.0, 0_usize); 2]; BINS];
    for point in points {
        let bin = ((point.temperature - low) / (high - low) * BINS as f64) as usize;
        let (sum, count) = &mut bins[bin.min(BINS - 1)][usize::from(point.heating)];
        *sum += point.residual;
        *count += 1;
    }
    let both = bins.into_iter().filter(|bin| bin.iter().all(|(_, count)| *count > 0));
    both.map(|bin| {
        let [cooling, heating] = bin.map(|(sum, count)| sum / count as f64);
        heating - cooling
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A hold, up, a hold, down, a hold, half way up again; a wiggle below 15 % of the range on the way.
    fn profile() -> Vec<f64> {
        let leg = |from: f64, to: f64| (0..100).map(move |i| from + (to - from) * f64::from(i) / 99.0);
        let hold = |at: f64| std::iter::repeat_n(at, 30);
        let up = leg(0.0, 0.5).chain(leg(0.5, 0.4)).chain(leg(0.4, 1.0));
        hold(0.0).chain(up).chain(hold(1.0)).chain(leg(1.0, 0.0)).chain(hold(0.0)).chain(leg(0.0, 0.5)).collect()
    }

    #[test]
    fn a_sweep_goes_from_turn_to_turn_with_the_hold_after_it() {
        let sweeps = sweeps(&profile());
        assert_eq!(sweeps.iter().map(|sweep| sweep.heating).collect::<Vec<_>>(), [true, false, true]);
        assert_eq!(sweeps[0].values.start, 0);
        assert!(sweeps.windows(2).all(|pair| pair[0].values.end == pair[1].values.start));
        assert_eq!(sweeps[2].values.end, profile().len());
        // The first hold and three legs, then the hold at the top: 360 values. The first values of the way down are
        // still near the top.
        assert!((360..=363).contains(&sweeps[0].values.end), "{:?}", sweeps[0]);
        let down: Vec<_> = profile().iter().map(|value| -value).collect();
        assert_eq!(
            crate::hysteresis::sweeps(&down).iter().map(|s| s.values.clone()).collect::<Vec<_>>(),
            sweeps.iter().map(|s| s.values.clone()).collect::<Vec<_>>()
        );
    }

    #[test]
    fn temperature_without_turns_is_one_sweep() {
        let of = |values: &[f64]| sweeps(values);
        assert_eq!(of(&[]), []);
        assert_eq!(of(&[1.0; 9]), []);
        assert_eq!(of(&[1.0, 2.0, 3.0]), [Sweep { values: 0..3, heating: true }]);
        assert_eq!(of(&[3.0, 2.0, 1.0]), [Sweep { values: 0..3, heating: false }]);
        assert_eq!(of(&[1.0, f64::NAN, 3.0]).len(), 1);
    }

    #[test]
    fn the_band_is_the_difference_of_the_directions() {
        let point = |i: i32, heating: bool, residual| LoopPoint { temperature: f64::from(i), residual, heating };
        let both = |apart: f64| -> Vec<LoopPoint> {
            (0..=120)
                .flat_map(move |i| [point(i, true, 1.0 + apart / 2.0), point(i, false, 1.0 - apart / 2.0)])
                .collect()
        };
        let apart = |points: Vec<LoopPoint>| band(&points);
        assert!((apart(both(3.0)).unwrap() - 3.0).abs() < 1e-12);
        assert!(apart(both(0.0)).unwrap() < 1e-12);
        // Only what both directions have is compared.
        assert_eq!(band(&[point(0, true, 5.0), point(10, false, 1.0)]), None);
        assert_eq!(band(&[]), None);
        let half =
            both(3.0).into_iter().filter(|it: &LoopPoint| it.heating || it.temperature > 60.5).collect::<Vec<_>>();
        assert_eq!((shared_bins(&both(3.0)), shared_bins(&half), shared_bins(&[])), (BINS, BINS / 2, 0));
    }
}
