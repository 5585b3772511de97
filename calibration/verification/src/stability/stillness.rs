//! In which windows an IMU stood still at one attitude, judged from its own output. An error of the table must not
//! decide it: a bias that drifts with the temperature moves the output slowly and counts; an IMU that is moved changes
//! it within a window, or from one to the next.
//!
//! # Rules
//! A window is **calm** if its output is a number and if the means of its tenths lie closer together than a limit, or
//! if its own mean is that of the recording: vibration does not move the IMU away. Calm windows that follow one another
//! with a step below a limit are one **stay**; over n windows that are not calm the step may be n + 1 times as large.
//! The windows of the largest stay that can be at the attitude count, and those of the stays that go on from it or lead
//! to it.
//!
//! Each limit is 10 times what is usual in this recording, which is its median, but no less than a bound that no noise
//! of a good sensor reaches and no more than one that no sensor at rest reaches.

use crate::stability::figures::MAX_UNJUDGED;
use crate::window::Window;
use core::fmt;
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use isotherm_statistics::median;
use serde::{Deserialize, Serialize};

/// Parts of a window whose means are compared.
pub(super) const PARTS: f64 = 10.0;
/// A limit is this many times what is usual in the recording.
const TIMES_USUAL: f64 = 10.0;

/// Smallest and largest limits of a triad \[g0 or deg/h\].
pub(super) struct Bounds {
    kind: SensorKind,
    /// For the parts of a window, and for the step from a window to the next of its stay.
    attitude: [f64; 2],
    /// For the step to both neighbours of a window that is called still.
    still: [f64; 2],
}

/// Accelerometers: 0.05 g0 are 3 degrees.
pub(super) const ACCELEROMETERS: Bounds =
    Bounds { kind: SensorKind::Accelerometer, attitude: [5e-3, 0.05], still: [1e-3, 0.05] };
/// Gyroscopes: 0.02 deg/s and 1 deg/s.
pub(super) const GYROSCOPES: Bounds =
    Bounds { kind: SensorKind::Gyroscope, attitude: [72.0, 3600.0], still: [72.0, 3600.0] };

/// The windows of a triad that do not count, by cause.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct LeftOut {
    /// The triad.
    pub kind: SensorKind,
    /// All windows of the recording.
    pub windows: usize,
    /// An output is not a number.
    pub not_a_number: usize,
    /// The IMU moved.
    pub moved: usize,
    /// The IMU was at another attitude, or turned.
    pub elsewhere: usize,
    /// Of gyroscopes: the window of the accelerometers does not count.
    pub by_accelerometers: usize,
}

impl LeftOut {
    /// Their number.
    #[must_use]
    pub const fn count(&self) -> usize {
        self.not_a_number + self.moved + self.elsewhere + self.by_accelerometers
    }

    /// Whether fewer than half of the windows are judged.
    #[must_use]
    pub const fn over_half(&self) -> bool {
        2 * self.count() > self.windows
    }

    /// The causes in words; empty if no window is left out.
    #[must_use]
    pub fn causes(&self) -> String {
        let elsewhere = match self.kind {
            SensorKind::Accelerometer => "the IMU was at another attitude",
            SensorKind::Gyroscope => "the rate was another, as if the IMU turned",
        };
        let causes = [
            (self.not_a_number, "an output is not a number"),
            (self.moved, "the IMU was not still"),
            (self.elsewhere, elsewhere),
            (self.by_accelerometers, "the accelerometers are not judged"),
        ];
        let some = causes.into_iter().filter(|(count, _)| *count > 0);
        some.map(|(count, cause)| format!("in {count} {cause}")).collect::<Vec<_>>().join(", ")
    }
}

impl LeftOut {
    fn of(bounds: &Bounds, causes: &[Option<Cause>]) -> Self {
        let count = |of: Cause| causes.iter().filter(|cause| **cause == Some(of)).count();
        Self {
            kind: bounds.kind,
            windows: causes.len(),
            not_a_number: count(Cause::NotANumber),
            moved: count(Cause::Moved),
            elsewhere: count(Cause::Elsewhere),
            by_accelerometers: count(Cause::Accelerometers),
        }
    }
}

/// The number of windows that are left out, with the causes; or that all are judged.
impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.count() {
            0 => write!(f, "all {} windows are judged", self.windows),
            count => write!(f, "{count} of {} windows left out: {}", self.windows, self.causes()),
        }
    }
}

/// Why a window does not count.
#[derive(Clone, Copy, PartialEq)]
enum Cause {
    NotANumber,
    Moved,
    Elsewhere,
    Accelerometers,
}

/// Sets `counts` and `still` of every window to whether it counts and whether the IMU was still, if they are set
/// before. `spreads` are the largest differences of the means of the parts of each window; `can_be` says whether the
/// median of a stay can be that of the attitude.
pub(super) fn mark(
    windows: &mut [Window],
    spreads: &[[f64; AXES]],
    bounds: &Bounds,
    can_be: impl Fn([f64; AXES]) -> bool,
) -> LeftOut {
    let outputs: Vec<_> = windows.iter().map(|window| window.after).collect();
    let mut causes = moved(windows, spreads, bounds);
    let steps = |axis: usize| {
        let pairs = outputs.windows(2).map(|pair| (pair[1][axis] - pair[0][axis]).abs());
        let calm = causes.windows(2).map(|pair| pair == [None, None]);
        pairs.zip(calm).filter_map(|(step, calm)| calm.then_some(step)).collect()
    };
    let (step, still) = (limits(&steps, bounds.attitude), limits(&steps, bounds.still));
    let within = |a: usize, b: usize, limit: &dyn Fn(usize) -> f64| {
        (0..AXES).all(|axis| (outputs[a][axis] - outputs[b][axis]).abs() < limit(axis))
    };
    for (index, window) in windows.iter_mut().enumerate() {
        let neighbours = [index.checked_sub(1), Some(index + 1).filter(|next| *next < outputs.len())];
        let near = neighbours.into_iter().flatten().all(|other| within(index, other, &|axis| still[axis]));
        window.still &= near && causes[index].is_none_or(|cause| cause == Cause::Accelerometers);
    }
    let follows = |a: usize, b: usize| {
        let times = a.abs_diff(b) as f64;
        within(a, b, &|axis| (step[axis] * times).min(bounds.attitude[1]))
    };
    let stays = stays(&causes, follows);
    let middle_of = |stay: &[usize]| [0, 1, 2].map(|axis| median(stay.iter().map(|index| outputs[*index][axis])));
    // If two stays have one size, the first.
    let possible = (0..stays.len()).rev().filter(|stay| can_be(middle_of(&stays[*stay])));
    let main = possible.max_by_key(|stay| stays[*stay].len());
    for (stay, _) in stays.iter().zip(at_attitude(&stays, main, follows)).filter(|(_, at_attitude)| !at_attitude) {
        stay.iter().for_each(|index| causes[*index] = Some(Cause::Elsewhere));
    }
    for (window, cause) in windows.iter_mut().zip(&causes) {
        window.counts = cause.is_none();
    }
    LeftOut::of(bounds, &causes)
}

/// The limit of each axis: some times the usual value, within bounds.
fn limits(values: &dyn Fn(usize) -> Vec<f64>, [least, most]: [f64; 2]) -> [f64; AXES] {
    // `max` leaves NaN out, which is the median of nothing.
    [0, 1, 2].map(|axis| (TIMES_USUAL * median(values(axis))).max(least).min(most))
}

/// Why a window does not count, as far as it shows that by itself.
fn moved(windows: &[Window], spreads: &[[f64; AXES]], bounds: &Bounds) -> Vec<Option<Cause>> {
    let finite = |output: &[f64; AXES]| output.iter().all(|value| value.is_finite());
    let spread = limits(&|axis| spreads.iter().map(|spread| spread[axis]).collect(), bounds.attitude);
    let middle = [0, 1, 2].map(|axis| median(windows.iter().map(|window| window.after[axis])));
    let near_middle =
        |output: &[f64; AXES]| (0..AXES).all(|axis| (output[axis] - middle[axis]).abs() < bounds.attitude[0]);
    let cause = |(window, of_parts): (&Window, &[f64; AXES])| match window {
        _ if !window.counts => Some(Cause::Accelerometers),
        _ if !finite(&window.after) => Some(Cause::NotANumber),
        // NaN is below no limit.
        _ if !(0..AXES).all(|axis| of_parts[axis] < spread[axis]) && !near_middle(&window.after) => Some(Cause::Moved),
        _ => None,
    };
    windows.iter().zip(spreads).map(cause).collect()
}

/// The windows that count so far, in stays: each window follows the one before it.
fn stays(causes: &[Option<Cause>], follows: impl Fn(usize, usize) -> bool) -> Vec<Vec<usize>> {
    let mut stays: Vec<Vec<usize>> = Vec::new();
    for index in (0..causes.len()).filter(|index| causes[*index].is_none()) {
        match stays.last_mut() {
            Some(stay) if stay.last().is_some_and(|last| follows(*last, index)) => stay.push(index),
            _ => stays.push(vec![index]),
        }
    }
    stays
}

/// Which stays are at the attitude of the stay `main`: from there on, and back from there, each that follows the last.
fn at_attitude(stays: &[Vec<usize>], main: Option<usize>, follows: impl Fn(usize, usize) -> bool) -> Vec<bool> {
    let mut at_attitude = vec![false; stays.len()];
    let Some(main) = main else { return at_attitude };
    at_attitude[main] = true;
    let ends = |stay: usize| [stays[stay][0], stays[stay][stays[stay].len() - 1]];
    let [mut first, mut last] = ends(main);
    for (stay, at_attitude) in at_attitude.iter_mut().enumerate().skip(main + 1) {
        if follows(last, ends(stay)[0]) {
            (*at_attitude, last) = (true, ends(stay)[1]);
        }
    }
    for (stay, at_attitude) in at_attitude.iter_mut().enumerate().take(main).rev() {
        if follows(first, ends(stay)[1]) {
            (*at_attitude, first) = (true, ends(stay)[0]);
        }
    }
    at_attitude
}

/// Why a triad is not judged over the whole run, if too many windows are left out, because they are not `at` what
/// counts.
pub(super) fn unjudged(left_out: &LeftOut, at: &str) -> Option<String> {
    let (count, windows) = (left_out.count(), left_out.windows);
    (count as f64 > MAX_UNJUDGED * windows as f64).then(|| {
        let enough = if left_out.over_half() { "; under half of the run is not enough to judge by" } else { "" };
        format!("{count} of {windows} windows are not {at}, at most 1 % may be left out: {}{enough}", left_out.causes())
    })
}
