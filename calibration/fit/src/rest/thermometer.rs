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
    let step = recording.step_of_temperature();
    let usual_change = median(all.iter().filter_map(|standing| standing.jump));
    let least_jump = (JUMP * usual_change).max(STEPS * step);
    let is_stuck = |(number, standing): (usize, &ConstantTemperature)| {
        let near = number.saturating_sub(10)..(number + 11).min(all.len());
        let others = all[near.clone()].iter().enumerate().filter(|(other, _)| near.start + other != number);
        let usual_s = median(others.map(|(_, other)| seconds(other)));
        let stands_s = seconds(standing);
        let covered = standing.bins.len() as f64 * recording.usual_interval_s() / stands_s.max(f64::MIN_POSITIVE);
        if stands_s < SHORTEST_S || stands_s < TIMES * usual_s || covered < COVERED {
            return false;
        }
        let jumps = standing.jump.is_some_and(|jump| jump > least_jump);
        jumps || stands_s >= SHORTEST_BY_BIAS_S && biases_go_on(bins, &standing.bins, causes, usual_change.max(step))
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

/// Whether a bias changes within these bins by more than some changes of the temperature explain.
fn biases_go_on(bins: &Bins, within: &Range<usize>, causes: &[Option<LeftOutCause>], change: f64) -> bool {
    let rest: Vec<usize> = within.clone().filter(|bin| causes[*bin].is_none()).collect();
    let others: Vec<usize> = (0..bins.len()).filter(|bin| !within.contains(bin) && causes[*bin].is_none()).collect();
    if rest.len() < 2 * PARTS || others.len() < 2 * PARTS {
        return false;
    }
    bins.rates.iter().any(|rates| {
        let (moved, error) = change_of(rates, &rest);
        let spans = |some: &[usize]| [rates, &bins.temperature].map(|all| spread(some.iter().map(|bin| all[*bin])));
        let slope = |[value, temperature]: [f64; 2]| value / temperature.max(change);
        let before = others.partition_point(|bin| *bin < within.start);
        let near = spans(&others[before.saturating_sub(rest.len())..before]);
        let [value, temperature] = spans(&others);
        let slope = slope([value, temperature]).max(slope(near));
        moved.abs() > CHANGES * change * slope + ERRORS * error && moved.abs() > PART * value
    })
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

/// The span of values, without the outermost tenths.
fn spread(values: impl Iterator<Item = f64>) -> f64 {
    let mut all: Vec<f64> = values.collect();
    all.sort_by(f64::total_cmp);
    let at = |part: f64| all.get((all.len() as f64 * part) as usize).copied().unwrap_or_default();
    at(0.95) - at(0.05)
}
