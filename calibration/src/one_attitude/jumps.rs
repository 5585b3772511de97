//! Values that jump by much of what a bias does over temperature, wherever they are: a bump, or a broken value. Smaller
//! steps are found by the ramps, in the middle of long sweeps alone.

use super::curves::Series;
use crate::sensor::TriadUnits;
use crate::transients::{BinValue, RampRecording, clock};
use isotherm_finding::{Finding, Severity, name};
use isotherm_statistics::{median, robust_sd};

/// Bins on each side of a jump.
const SIDE: usize = 4;
/// A jump is over this part of what the bias usually does ..
const PART: f64 = 0.2;
/// .. over this many of the robust standard deviations of what is no jump ..
const ERRORS: f64 = 12.0;
/// .. and over this many times the jump after the largest ones: coarse values jump by a step wherever they change.
const LARGER: f64 = 2.0;
/// The largest ones: so many bumps are told.
const RARE: usize = 5;
/// What the bias usually does is between these parts of its sorted values.
const USUAL: [f64; 2] = [0.05, 0.95];

/// A value or a level that is off.
struct Jump {
    size: f64,
    age_s: f64,
    /// Whether the values come back at once.
    is_spike: bool,
}

/// The largest jump of each bias and recording, as faults. `gravity` is 1 g0 \[m/s2\].
pub(super) fn jumps(series: &[Series], recordings: &[RampRecording], gravity: f64) -> Vec<Finding> {
    let of_recording = |(number, recording): (usize, &RampRecording)| {
        let found: Vec<(&Series, Jump)> = series.iter().filter_map(|bias| Some((bias, jump(bias, number)?))).collect();
        let (_, first) = found.first()?;
        let sizes: Vec<_> = found
            .iter()
            .map(|(bias, jump)| {
                let size = TriadUnits::of(bias.kind).si_text(jump.size, gravity);
                format!("{} by {size}", bias.kind.names()[bias.axis])
            })
            .collect();
        let at = clock(recording.begin_ns(&(0..1)) + (first.age_s * 1e9) as u64, first.age_s);
        let name = recording.name();
        let (what, remedy) = match first.is_spike {
            true => ("is off for a moment", "a broken value: leave its rows out"),
            false => ("moved", "a bump, or a sensor that jumps: record it again with the IMU held fast"),
        };
        Some(Finding::whole(
            Severity::Fault,
            name::RAMP_STEP,
            format!("{name}: {what} {at}: {}; {remedy}", sizes.join(", ")),
        ))
    };
    recordings.iter().enumerate().filter_map(of_recording).collect()
}

/// The largest jump of a bias in a recording.
fn jump(bias: &Series, recording: usize) -> Option<Jump> {
    let bins = &bias.recordings[recording];
    let values: Vec<f64> = bins.iter().map(|bin| bin.value).collect();
    let usual = bias.recordings.iter().filter_map(|bins| usual(bins)).reduce(f64::max)?;
    let middle = |range: core::ops::Range<usize>| median(values[range].iter().copied());
    let usual_s = median(bins.windows(2).map(|pair| pair[1].age_s - pair[0].age_s));
    // What comes after a gap has another temperature.
    let is_whole =
        |begin: usize, end: usize| bins[end - 1].age_s - bins[begin].age_s < 1.5 * usual_s * (end - begin) as f64;
    let last = values.len().saturating_sub(2);
    let spike = |i: usize| if is_whole(i - 2, i + 3) { values[i] - middle(i - 2..i + 3) } else { 0.0 };
    let spikes: Vec<f64> = (2..last).map(spike).collect();
    // The slope of the temperature is taken off: that of the bins beside it.
    let last = values.len().saturating_sub(2 * SIDE);
    let levels: Vec<f64> = (2 * SIDE..last)
        .map(|i| {
            if !is_whole(i - 2 * SIDE, i + 2 * SIDE) {
                return 0.0;
            }
            let step = |from: usize| middle(from..from + SIDE) - middle(from - SIDE..from);
            let beside = [step(i - SIDE), step(i + SIDE)];
            // A step is in the middle alone.
            step(i) - if beside[0].abs() < beside[1].abs() { beside[0] } else { beside[1] }
        })
        .collect();
    let largest = |all: &[f64], offset: usize, is_spike: bool| {
        let (i, size, others) = largest_of(all)?;
        let limit = (PART * usual).max(ERRORS * robust_sd(all)).max(LARGER * others);
        (size.abs() > limit).then(|| Jump { size, age_s: bins[i + offset].age_s, is_spike })
    };
    largest(&spikes, 2, true).or_else(|| largest(&levels, 2 * SIDE, false))
}

/// What a bias usually does in a recording: a stretch of one may do far less.
fn usual(bins: &[BinValue]) -> Option<f64> {
    let [low, high] = USUAL.map(|part| quantile(bins.iter().map(|bin| bin.value).collect(), part));
    Some(high? - low?)
}

/// Place and size of the largest of all, and the size of what comes after the largest ones; each is apart from the
/// others.
fn largest_of(all: &[f64]) -> Option<(usize, f64, f64)> {
    let mut by_size: Vec<usize> = (0..all.len()).collect();
    by_size.sort_by(|a, b| all[*b].abs().total_cmp(&all[*a].abs()));
    let mut apart: Vec<usize> = Vec::new();
    for i in by_size {
        if apart.iter().all(|other| i.abs_diff(*other) > 2 * SIDE) {
            apart.push(i);
        }
        if apart.len() > RARE {
            break;
        }
    }
    let first = *apart.first()?;
    Some((first, all[first], apart.get(RARE).map_or(0.0, |i| all[*i].abs())))
}

/// The value that this part of all is below.
fn quantile(mut values: Vec<f64>, part: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get((values.len() as f64 * part) as usize).copied()
}
