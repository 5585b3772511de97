//! A thermometer that stands still while the biases go on.
//!
//! It stands legally at the end of a warm-up, where the biases stand too, and as long as the temperature is within a
//! step of coarse temperature. It is stuck if it catches up with a jump afterwards, or if a bias changes by more, while
//! it stands, than some steps of the temperature explain.

use super::account::LeftOutCause;
use super::bins::Bins;
use crate::transients::RampRecording;
use core::ops::Range;
use isotherm_statistics::median;

/// Shorter times are no standing thermometer \[s\] …
const SHORTEST_S: f64 = 20.0;
/// … without a jump afterwards.
const SHORTEST_BY_BIAS_S: f64 = 60.0;
/// It stands for over this many of the usual times from change to change …
const TIMES: f64 = 5.0;
/// … and the jump afterwards is over this many of the usual changes.
const JUMP: f64 = 4.0;
/// … and over this many steps of a coarse thermometer.
const STEPS: f64 = 2.5;
/// Rows cover this part of the time in which it stands.
const COVERED: f64 = 0.8;
/// Parts of this time that show the change of a bias.
const PARTS: usize = 8;
/// A bias changes by over what so many changes of the temperature give …
const CHANGES: f64 = 3.0;
/// … and over so many of its errors …
const ERRORS: f64 = 8.0;
/// … and over this part of what it usually does.
const PART: f64 = 0.1;

/// A time in which the temperature has one value.
struct ConstantTemperature {
    bins: Range<usize>,
    /// Change to the value after it; `None` at the end.
    jump: Option<f64>,
}

/// The ranges of bins in which the thermometer of A1 is stuck.
pub(super) fn stuck(recording: &RampRecording, bins: &Bins, causes: &[Option<LeftOutCause>]) -> Vec<Range<usize>> {
    let all = standings(recording, bins);
    if all.len() < 2 {
        return Vec::new();
    }
    let seconds = |standing: &ConstantTemperature| bins.ages[standing.bins.end - 1] - bins.ages[standing.bins.start];
    let (step, interval_s) = (recording.step_of_temperature(), recording.usual_interval_s());
    let usual_change = median(all.iter().filter_map(|standing| standing.jump));
    let least_jump = (JUMP * usual_change).max(STEPS * step);
    let biases = RankedBins::of(bins, causes);
    let is_stuck = |(number, standing): (usize, &ConstantTemperature)| {
        let near = number.saturating_sub(10)..(number + 11).min(all.len());
        let others = all[near.clone()].iter().enumerate().filter(|(other, _)| near.start + other != number);
        let usual_s = median(others.map(|(_, other)| seconds(other)));
        let stands_s = seconds(standing);
        let covered = standing.bins.len() as f64 * interval_s / stands_s.max(f64::MIN_POSITIVE);
        if stands_s < SHORTEST_S || stands_s < TIMES * usual_s || covered < COVERED {
            return false;
        }
        let jumps = standing.jump.is_some_and(|jump| jump > least_jump);
        jumps || stands_s >= SHORTEST_BY_BIAS_S && biases.go_on(&standing.bins, usual_change.max(step))
    };
    let found = all.iter().enumerate().filter(|(number, standing)| is_stuck((*number, standing)));
    // The first bin of each was measured.
    found.map(|(_, standing)| standing.bins.start + 1..standing.bins.end).collect()
}

/// The times in which the temperature has one value.
fn standings(recording: &RampRecording, bins: &Bins) -> Vec<ConstantTemperature> {
    let times: Vec<u64> = recording.bins().iter().map(crate::transients::Bin::middle_ns).collect();
    let mut changes: Vec<(usize, f64)> = Vec::new();
    for reading in recording.heads(0) {
        if changes.last().is_none_or(|(_, value)| *value != reading.temperature) {
            let bin = times.partition_point(|time| *time < reading.time_ns).min(bins.len() - 1);
            changes.push((bin, reading.temperature));
        }
    }
    let ends = changes.iter().skip(1).map(|(bin, value)| (*bin, Some(*value))).chain([(bins.len(), None)]);
    let standing = |((start, value), (end, next)): (&(usize, f64), (usize, Option<f64>))| ConstantTemperature {
        bins: *start..end.max(start + 1),
        jump: next.map(|next| (next - value).abs()),
    };
    changes.iter().zip(ends).map(standing).collect()
}

/// The bins that count, by the size of each rate and of the temperature: a span of all of them but some is then found
/// without sorting all again.
struct RankedBins<'a> {
    bins: &'a Bins,
    /// The bins that count, ascending.
    counted: Vec<usize>,
    /// Of each rate and of the temperature.
    rates: Vec<Ranks<'a>>,
    temperature: Ranks<'a>,
}

/// The order of bins by size.
struct Ranks<'a> {
    values: &'a [f64],
    /// Bins by rising values.
    sorted: Vec<usize>,
    /// The place of each of these bins in `sorted`.
    places: Vec<usize>,
}

impl<'a> Ranks<'a> {
    fn of(values: &'a [f64], counted: &[usize]) -> Self {
        let mut sorted = counted.to_vec();
        sorted.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
        let mut places = vec![0; values.len()];
        sorted.iter().enumerate().for_each(|(place, bin)| places[*bin] = place);
        Self { values, sorted, places }
    }

    /// The span of the values of all bins but these, without the outermost twentieths.
    fn spread_without(&self, bins: &[usize]) -> f64 {
        let mut left_out: Vec<usize> = bins.iter().map(|bin| self.places[*bin]).collect();
        left_out.sort_unstable();
        let count = self.sorted.len() - left_out.len();
        let at = |part: f64| {
            let mut place = (count as f64 * part) as usize;
            for out in &left_out {
                place += usize::from(*out <= place);
            }
            self.sorted.get(place).map_or(0.0, |bin| self.values[*bin])
        };
        at(0.95) - at(0.05)
    }
}

impl<'a> RankedBins<'a> {
    fn of(bins: &'a Bins, causes: &[Option<LeftOutCause>]) -> Self {
        let counted: Vec<usize> = (0..bins.len()).filter(|bin| causes[*bin].is_none()).collect();
        let rates = bins.rates.iter().map(|rates| Ranks::of(rates, &counted)).collect();
        let temperature = Ranks::of(&bins.temperature, &counted);
        Self { bins, counted, rates, temperature }
    }

    /// Whether a bias changes within these bins by more than some changes of the temperature explain.
    fn go_on(&self, within: &Range<usize>, change: f64) -> bool {
        let [before, behind] = [within.start, within.end].map(|end| self.counted.partition_point(|bin| *bin < end));
        let rest = &self.counted[before..behind];
        if rest.len() < 2 * PARTS || self.counted.len() - rest.len() < 2 * PARTS {
            return false;
        }
        let near = &self.counted[before.saturating_sub(rest.len())..before];
        let slope = |[value, temperature]: [f64; 2]| value / temperature.max(change);
        let of_all = self.temperature.spread_without(rest);
        let of_near = spread(near.iter().map(|bin| self.bins.temperature[*bin]));
        self.rates.iter().any(|ranks| {
            let rates = ranks.values;
            let (moved, error) = change_of(rates, rest);
            let value = ranks.spread_without(rest);
            let slope = slope([value, of_all]).max(slope([spread(near.iter().map(|bin| rates[*bin])), of_near]));
            moved.abs() > CHANGES * change * slope + ERRORS * error && moved.abs() > PART * value
        })
    }
}

/// How much a rate changes over these bins, with its error.
fn change_of(rates: &[f64], rest: &[usize]) -> (f64, f64) {
    let part = |number: usize| &rest[rest.len() * number / PARTS..rest.len() * (number + 1) / PARTS];
    let means: Vec<f64> = (0..PARTS).map(|number| median(part(number).iter().map(|bin| rates[*bin]))).collect();
    let n = PARTS as f64;
    let places: Vec<f64> = (0..PARTS).map(|number| (number as f64 - (n - 1.0) / 2.0) / n).collect();
    let mean = means.iter().sum::<f64>() / n;
    let squares: f64 = places.iter().map(|place| place * place).sum();
    let slope = places.iter().zip(&means).map(|(place, value)| place * value).sum::<f64>() / squares;
    let left: f64 = places.iter().zip(&means).map(|(place, value)| (value - mean - slope * place).powi(2)).sum();
    (slope, (left / (n - 2.0) / squares).sqrt())
}

/// The span of values, without the outermost twentieths.
fn spread(values: impl Iterator<Item = f64>) -> f64 {
    let mut all: Vec<f64> = values.collect();
    all.sort_by(f64::total_cmp);
    let at = |part: f64| all.get((all.len() as f64 * part) as usize).copied().unwrap_or_default();
    at(0.95) - at(0.05)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_without_some_bins_is_that_of_the_others() {
        // Values that repeat, in no order.
        let values: Vec<f64> = (0..500_u32).map(|bin| f64::from(bin.wrapping_mul(2_654_435_761) >> 25)).collect();
        let counted: Vec<usize> = (0..values.len()).filter(|bin| bin % 7 != 0).collect();
        let ranks = Ranks::of(&values, &counted);
        for (begin, end) in [(0, 0), (0, 20), (13, 14), (100, 300), (400, counted.len()), (0, counted.len())] {
            let others = counted[..begin].iter().chain(&counted[end..]);
            let right = spread(others.map(|bin| values[*bin]));
            assert_eq!(ranks.spread_without(&counted[begin..end]), right, "{begin} to {end}");
        }
    }
}
