//! What of a recording at one attitude can be used: the stretches in which the IMU was at rest and its thermometer
//! worked. A table never rests on rows that moved.
//!
//! # Rules
//! 1. The vehicle was not armed and did not fly, where its log says so.
//! 2. `motion`: a part is at rest if it is as quiet as the quietest lasting part of the recording; and at that level
//!    averaging has to help, as in the static poses of [`isotherm_campaign`].
//! 3. `bumps`: where the level steps, the attitude is another one from there on.
//! 4. `thermometer`: a thermometer that stands still while the biases go on has no rows there.
//! 5. The stretch that covers the largest span of temperature is used. Others of the same recording are used in
//!    addition to it if they are as long as a recording has to be and cover a tenth of the span of all: each has a
//!    constant of its own, so that its attitude does not matter.

mod account;
mod bins;
mod bumps;
mod motion;
mod thermometer;

pub use account::{LeftOutCause, LeftOutPart, RowAccount};

use crate::transients::RampRecording;
use bins::{Bins, Stretch};
use core::ops::Range;
use isotherm_support::finding::{Finding, name};

/// Fewest means of a stretch, of a second or of a row: twice those of a recording, as gaps leave some out.
const LEAST_MEANS: usize = 48;
/// A stretch next to the longest one covers this part of the span of all.
const LEAST_PART: f64 = 0.1;
/// After so long a motion the attitude may be another one \[s\].
const LONG_S: f64 = 10.0;
/// So many spikes within so many rows are no bad rows: the IMU moved.
const DENSE: (usize, u64) = (21, 40);
/// Rows that are bad, at most, as a part of all.
const MOST_BAD: f64 = 0.05;

/// The stretches at rest of all recordings, and what was left out.
pub(crate) struct AtRest {
    pub(crate) recordings: Vec<RampRecording>,
    pub(crate) accounts: Vec<RowAccount>,
    pub(crate) findings: Vec<Finding>,
}

/// Finds what can be used of each recording.
pub(crate) fn at_rest(recordings: &[RampRecording]) -> AtRest {
    let mut all = AtRest { recordings: Vec::new(), accounts: Vec::new(), findings: Vec::new() };
    for recording in recordings {
        let (stretches, account, findings) = of_recording(recording);
        all.recordings.extend(stretches);
        all.accounts.push(account);
        all.findings.extend(findings);
    }
    all
}

fn of_recording(recording: &RampRecording) -> (Vec<RampRecording>, RowAccount, Vec<Finding>) {
    let bins = Bins::of(recording);
    let mut causes: Vec<Option<LeftOutCause>> = vec![None; bins.len()];
    let dense = recording.bad_rows().dense(DENSE.0, DENSE.1 * recording.usual_row_ns());
    for (bin, cause) in causes.iter_mut().enumerate().filter(|_| !dense.is_empty()) {
        let times = recording.times_of(&(bin..bin + 1));
        let after = dense.partition_point(|time| time.end <= times.start);
        if dense.get(after).is_some_and(|time| time.start < times.end) {
            *cause = Some(LeftOutCause::Motion);
        }
    }
    if bins.temperature.len() == bins.len() && bins.len() > 0 {
        mark(recording, &bins, &mut causes);
    }
    let stretches = stretches(recording, &bins, &causes, &dense);
    let longest = stretches.iter().map(|stretch| stretch.span(&bins)).fold(0.0, f64::max);
    let whole = Stretch { bins: (0..bins.len()).collect(), bump_rad: None };
    let least = LEAST_PART * whole.span(&bins);
    let is_used = |stretch: &Stretch| {
        let is_longest = stretch.span(&bins) == longest;
        (is_longest || stretch.span(&bins) >= least) && stretch.bins.len() >= LEAST_MEANS
    };
    let is_whole = matches!(stretches.as_slice(), [one] if one.bins.len() == bins.len());
    let is_untouched = is_whole || bins.len() == 0;
    let used: Vec<&Stretch> = match is_untouched {
        true => stretches.iter().collect(),
        false => stretches.iter().filter(|stretch| is_used(stretch)).collect(),
    };
    let account = RowAccount::of(recording, &bins, &causes, &stretches, &used, &dense);
    let mut findings: Vec<Finding> = account.findings(MOST_BAD);
    if used.is_empty() && !is_untouched {
        findings.insert(0, Finding::fault(name::MOTION, account.refusal(LEAST_MEANS)));
    }
    let cut: Vec<RampRecording> = match is_untouched {
        true => vec![recording.clone()],
        false => {
            let cut = |(number, stretch): (usize, &&Stretch)| {
                let name = if used.len() == 1 { recording.name().to_owned() } else { account.name_of(number) };
                recording.stretch(name, &stretch.ranges(), number == 0)
            };
            used.iter().enumerate().map(cut).collect()
        }
    };
    (cut, account, findings)
}

/// Marks the bins that cannot be used.
fn mark(recording: &RampRecording, bins: &Bins, causes: &mut [Option<LeftOutCause>]) {
    for (bin, cause) in causes.iter_mut().enumerate() {
        let times = recording.times_of(&(bin..bin + 1));
        let in_use = recording.in_use();
        let after = in_use.partition_point(|time| time.end <= times.start);
        if in_use.get(after).is_some_and(|time| time.start < times.end) {
            *cause = Some(LeftOutCause::InUse);
        }
    }
    let is_moving = motion::moving(bins, causes);
    for (cause, _) in causes.iter_mut().zip(is_moving).filter(|(cause, moving)| *moving && cause.is_none()) {
        *cause = Some(LeftOutCause::Motion);
    }
    for stuck in thermometer::stuck(recording, bins, causes) {
        let of_stuck = causes[stuck].iter_mut().filter(|cause| cause.is_none());
        of_stuck.for_each(|cause| *cause = Some(LeftOutCause::Thermometer));
    }
}

/// The stretches without a bump, or a motion after which the attitude may be another one.
fn stretches(
    recording: &RampRecording,
    bins: &Bins,
    causes: &[Option<LeftOutCause>],
    dense: &[Range<u64>],
) -> Vec<Stretch> {
    let rest: Vec<usize> = (0..bins.len()).filter(|bin| causes[*bin].is_none()).collect();
    let bumps = bumps::bumps(bins, &rest);
    let mut stretches: Vec<Stretch> = Vec::new();
    let mut previous: Option<usize> = None;
    for (place, &bin) in rest.iter().enumerate() {
        let moved = previous.is_some_and(|previous| {
            let between = &causes[previous + 1..bin];
            let has_moved =
                between.iter().any(|cause| matches!(cause, Some(LeftOutCause::Motion | LeftOutCause::InUse)));
            let times = recording.times_of(&(previous..previous + 1)).end..recording.times_of(&(bin..bin + 1)).start;
            let after = dense.partition_point(|time| time.end <= times.start);
            let has_moved = has_moved || dense.get(after).is_some_and(|time| time.start < times.end);
            has_moved && bins.ages[bin] - bins.ages[previous] > LONG_S
        });
        let bump_rad = bumps.iter().find(|bump| bump.place == place).map(|bump| bump.size_rad);
        match stretches.last_mut() {
            Some(stretch) if !moved && bump_rad.is_none() => stretch.bins.push(bin),
            _ => stretches.push(Stretch { bins: vec![bin], bump_rad: bump_rad.filter(|_| !moved) }),
        }
        previous = Some(bin);
    }
    stretches
}
