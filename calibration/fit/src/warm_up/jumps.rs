//! Values that are off for a moment by much of what a bias does over temperature: a broken value in rows that nobody
//! screened. Levels that stay are found where the [rest](crate::rest) is, smaller ones by the ramps.

use super::curves::Series;
use crate::sensor::TriadUnits;
use crate::transients::{BinValue, RampRecording, clock};
use isotherm_statistics::{median, robust_sd};
use isotherm_support::finding::{Finding, Severity, name};

/// Jumps that are nearer, in half the bins, are one.
const SIDE: usize = 4;
/// A jump is over this part of what the bias usually does …
const PART: f64 = 0.2;
/// … over this many of the robust standard deviations of what is no jump …
const ERRORS: f64 = 12.0;
/// … and over this many times the jump after the largest ones: coarse values jump by a step wherever they change.
const LARGER: f64 = 2.0;
/// The largest ones: this many bumps are reported.
const RARE: usize = 5;
/// What the bias usually does is between these parts of its sorted values.
const USUAL: [f64; 2] = [0.05, 0.95];

/// A value that is off.
struct Jump {
    size: f64,
    age_s: f64,
}

/// The largest jump of each bias and recording, as faults. `gravity` is 1 g0 \[m/s2\].
pub(super) fn jumps(series: &[Series], recordings: &[RampRecording], gravity: f64) -> Vec<Finding> {
    let usual = |bias: &Series| bias.recordings.iter().filter_map(|bins| usual(bins)).reduce(f64::max);
    let usual: Vec<Option<f64>> = series.iter().map(usual).collect();
    let of_recording = |(number, recording): (usize, &RampRecording)| {
        let of_bias = |(bias, usual): (_, &Option<f64>)| Some((bias, jump(bias, (*usual)?, number)?));
        let found: Vec<(&Series, Jump)> = series.iter().zip(&usual).filter_map(of_bias).collect();
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
        Some(Finding::whole(
            Severity::Fault,
            name::RAMP_STEP,
            format!("{name}: is off for a moment {at}: {}; a broken value: leave its rows out", sizes.join(", ")),
        ))
    };
    recordings.iter().enumerate().filter_map(of_recording).collect()
}

/// The largest jump of a bias in a recording, of a bias that usually does `usual`.
fn jump(bias: &Series, usual: f64, recording: usize) -> Option<Jump> {
    let bins = &bias.recordings[recording];
    let values: Vec<f64> = bins.iter().map(|bin| bin.value).collect();
    let middle = |range: core::ops::Range<usize>| median(values[range].iter().copied());
    let usual_s = median(bins.windows(2).map(|pair| pair[1].age_s - pair[0].age_s));
    // What comes after a gap has another temperature.
    let is_whole =
        |begin: usize, end: usize| bins[end - 1].age_s - bins[begin].age_s < 1.5 * usual_s * (end - begin) as f64;
    let last = values.len().saturating_sub(2);
    let spike = |i: usize| if is_whole(i - 2, i + 3) { values[i] - middle(i - 2..i + 3) } else { 0.0 };
    let spikes: Vec<f64> = (2..last).map(spike).collect();
    // The slope of the temperature is taken off: that of the bins next to it.
    let (i, size, others) = largest_of(&spikes)?;
    let limit = (PART * usual).max(ERRORS * robust_sd(&spikes)).max(LARGER * others);
    (size.abs() > limit).then(|| Jump { size, age_s: bins[i + 2].age_s })
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
