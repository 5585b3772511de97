//! What a recording at rest allows to be claimed of a coefficient table. Whether this meets a requirement:
//! [`crate::requirement`].
//!
//! # Definition
//! The windows of [`crate::stability`] are divided, in order of time, into groups of at least [`MIN_GROUP`] neighbours.
//! A group's mean has little noise left, and it does not average over the run: it shows what temperature, its direction
//! and the time do. The errors of the groups' means (output minus specific force) there are, for each accelerometer:
//!
//! - **constant**: their mean. Its 95 % interval is Student's t of the means of ten equal parts of the run (fewer for a
//!   short run), so that slow changes count.
//! - **variation**: the largest distance of a group from the constant error.
//! - **worst**: the largest error of a group, constant error and variation together. Where the constant error is not
//!   judged, it is the variation.
//! - **noise**: the standard deviation of a window about its neighbours, from the differences of successive windows.
//!
//! The constant error of an axis is judged if both the attitude and local gravity are known: without one of them a part
//! of the error is subtracted with the output's own median. The level needs only the attitude.
//!
//! The intervals of variation and worst hold for all groups at once (Bonferroni): the noise of a window over the square
//! root of the group's length, times the quantile of Student's t with the degrees of freedom of n - 1 successive
//! differences, 2 (n - 1)^2 / (3 n - 4).
//!
//! **Correlated noise.** The interval of the constant error holds for noise that a tenth of the run averages out: with
//! a correlation time of 1/130 of the run (4.5 of 600 windows) 94.5 % of the intervals contain the truth, with 1/30 of
//! the run 90 %, with 1/6 only 66 %. Noise that is slower than a group is no noise here: it is part of variation and
//! worst, as an error that the run has shown.
//!
//! **Length** is the same for |output| minus local gravity, over the windows in which the IMU was still. **Level** is
//! the length of the error's part across the specific force, over gravity: the angle by which a levelled IMU is tilted.

use crate::window::{MIN_WINDOWS, Window};
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{CONFIDENCE, largest, mean, student_quantile, student_quantile_of};
use serde::{Deserialize, Serialize};

/// Fewest windows of a group, if there are as many.
pub(crate) const MIN_GROUP: usize = 6;
/// Most groups.
const MAX_GROUPS: usize = 64;
/// Parts of the run whose means give the constant error's interval.
const PARTS: usize = 10;
/// Radius of the Earth \[m\]: a level error times this is the amplitude of the position error (Schuler).
const EARTH_RADIUS: f64 = 6.371e6;

/// A value with the half width of its 95 % interval.
///
/// ```
/// use isotherm_verification::Estimate;
///
/// let error = Estimate { value: -3.0, interval: 1.0 }; // ug0
/// assert_eq!((error.most(), error.least()), (4.0, 2.0));
/// assert_eq!(error.times(1e-6).most(), 4e-6); // g0
/// ```
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Half width of its interval.
    pub interval: f64,
}

impl Estimate {
    /// Upper end of the interval of the absolute value.
    #[must_use]
    pub fn most(&self) -> f64 {
        self.value.abs() + self.interval
    }

    /// Lower end of the interval of the absolute value, at least 0.
    #[must_use]
    pub fn least(&self) -> f64 {
        largest([self.value.abs() - self.interval])
    }

    /// In a unit that is `1 / factor` as large.
    pub fn times(self, factor: f64) -> Self {
        Self { value: self.value * factor, interval: self.interval * factor }
    }
}

/// The errors of one sensor, of the length or of the level.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct Errors {
    /// Mean error; `None` where it cannot be judged.
    pub constant: Option<Estimate>,
    /// Largest distance of a group from the mean.
    pub variation: Estimate,
    /// Largest error of a group: constant error and variation, as far as they can be judged.
    pub worst: Estimate,
    /// Standard deviation of a window about its neighbours.
    pub noise: f64,
    /// Largest absolute value of a single window, noise included.
    pub largest_window: f64,
}

/// What the recording allows to be claimed.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Verdict {
    /// By accelerometer \[g0\].
    pub axes: [Errors; AXES],
    /// Of the length of the output \[g0\]; `None` if the IMU was never still, or local gravity is unknown.
    pub length: Option<Errors>,
    /// Of the level \[rad\].
    pub level: Errors,
    /// Number of groups of the axes.
    pub groups: usize,
    /// Number of windows in a group.
    pub windows: usize,
    /// Whether the attitude was stated; otherwise no constant error is judged, except that of the length.
    pub stated: bool,
    /// Whether local gravity is known; otherwise no constant error is judged, except that of the level.
    pub gravity_known: bool,
    /// Length of the specific force \[g0\].
    pub gravity: f64,
}

impl Verdict {
    /// The verdict of a run with these windows and this specific force \[g0\], which is `stated` or the median of the
    /// output. `gravity` is local gravity \[g0\], if it is known. At least [`MIN_WINDOWS`] windows must count.
    #[must_use]
    pub fn of(windows: &[Window], force: [f64; AXES], stated: bool, gravity: Option<f64>) -> Self {
        let counted: Vec<[f64; AXES]> = (windows.iter().filter(|window| window.counts))
            .map(|window| [0, 1, 2].map(|axis| window.after[axis] - force[axis]))
            .collect();
        let size = group_size(counted.len());
        let groups = counted.len() / size;
        let judged = stated && gravity.is_some();
        let axes = [0, 1, 2].map(|axis| errors(&counted.iter().map(|error| error[axis]).collect::<Vec<_>>(), judged));
        let lengths = gravity.map(|gravity| {
            windows.iter().filter(|window| window.still).map(|window| window.length() - gravity).collect::<Vec<_>>()
        });
        let length = lengths.filter(|values| values.len() >= MIN_WINDOWS).map(|values| errors(&values, true));
        let level = level(&counted, force, stated);
        let gravity_known = gravity.is_some();
        let gravity = force.iter().map(|f| f * f).sum::<f64>().sqrt();
        Self { axes, length, level, groups, windows: size, stated, gravity_known, gravity }
    }

    /// Whether the constant errors of the axes are judged.
    #[must_use]
    pub const fn judges_axes(&self) -> bool {
        self.stated && self.gravity_known
    }

    /// What cannot be judged because something is not stated, and how to state it; `None` if all is judged.
    #[must_use]
    pub const fn missing(&self) -> Option<[&'static str; 2]> {
        match (self.stated, self.gravity_known) {
            (true, true) => None,
            (false, true) => Some([
                "without a stated attitude only variation and length can be judged: a constant error across the specific force does not show",
                "state --attitude",
            ]),
            (true, false) => Some([
                "without local gravity only variation and level can be judged: a constant error along the specific force does not show",
                "state --gravity-local, or take a table whose provenance has gravity_local",
            ]),
            (false, false) => Some([
                "without a stated attitude and local gravity only variation can be judged: no constant error shows",
                "state --attitude, and --gravity-local or a table whose provenance has gravity_local",
            ]),
        }
    }

    /// The largest error that is judged: its name, and its value in g0. That of the level is larger than that of an
    /// axis where two axes have a part of it.
    #[must_use]
    pub fn largest(&self) -> (&'static str, Estimate) {
        let axes = AXIS_NAMES.iter().zip(&self.axes).map(|(name, errors)| (*name, errors.worst));
        let length = self.length.iter().map(|errors| ("the length", errors.worst));
        let level = ("the level", self.level.worst.times(self.gravity));
        let most = axes.chain(length).chain([level]).max_by(|(_, a), (_, b)| a.most().total_cmp(&b.most()));
        most.unwrap_or(("nothing", Estimate { value: f64::NAN, interval: f64::NAN }))
    }

    /// The largest error and what it costs, as a sentence.
    #[must_use]
    pub fn conclusion(&self) -> String {
        let (name, worst) = self.largest();
        format!(
            "The largest error{} is that of {name}, {:.3} +- {:.3}e-6 g0: up to {}.",
            if self.missing().is_none() { "" } else { " that could be judged" },
            worst.value * 1e6,
            worst.interval * 1e6,
            cost(worst.most() / self.gravity)
        )
    }
}

/// Windows in a group, of `count` windows.
pub(crate) fn group_size(count: usize) -> usize {
    count.div_ceil(MAX_GROUPS).max(MIN_GROUP).min(count / 3).max(1)
}

/// The means of groups of neighbours; the last group takes what is left over.
pub(crate) fn groups<T>(values: &[T], of: impl Fn(&[T]) -> f64) -> Vec<f64> {
    let size = group_size(values.len());
    let count = values.len() / size;
    (0..count)
        .map(|group| of(&values[group * size..if group + 1 == count { values.len() } else { (group + 1) * size }]))
        .collect()
}

/// Standard deviation of a value about its neighbours.
pub(crate) fn noise(values: &[f64]) -> f64 {
    let differences: Vec<f64> = values.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let squares = differences.iter().map(|difference| difference * difference).sum::<f64>() / differences.len() as f64;
    (0.5 * squares).sqrt()
}

/// Half width of the interval of a group's mean, for all groups at once.
pub(crate) fn group_interval(noise: f64, windows: usize) -> f64 {
    let size = group_size(windows);
    let count = (windows / size) as f64;
    noise / (size as f64).sqrt() * student_quantile_of(1.0 - (1.0 - CONFIDENCE) / count, noise_freedom(windows))
}

/// Degrees of freedom of the square of [`noise`]. Successive differences overlap: their mean square scatters as a
/// variance with so many.
pub(crate) fn noise_freedom(windows: usize) -> f64 {
    let n = windows as f64;
    2.0 * (n - 1.0).powi(2) / (3.0 * n - 4.0)
}

/// The mean with its interval, from the means of parts of the run.
fn constant(values: &[f64]) -> Estimate {
    let parts = PARTS.min(values.len());
    let means: Vec<f64> =
        (0..parts).map(|part| mean(&values[part * values.len() / parts..(part + 1) * values.len() / parts])).collect();
    let middle = mean(&means);
    let variance = means.iter().map(|m| (m - middle).powi(2)).sum::<f64>() / (parts - 1) as f64;
    let error = (variance / parts as f64).sqrt();
    Estimate { value: mean(values), interval: error * student_quantile(CONFIDENCE, parts - 1) }
}

/// The errors of one sensor with these values, in order of time; without `with_constant` about their mean.
pub(crate) fn errors(values: &[f64], with_constant: bool) -> Errors {
    let noise = noise(values);
    let middle = constant(values);
    let groups = groups(values, mean);
    let interval = group_interval(noise, values.len());
    let most = |about: f64| largest(groups.iter().map(|group| (group - about).abs()));
    let about = if with_constant { 0.0 } else { middle.value };
    Errors {
        constant: with_constant.then_some(middle),
        variation: Estimate { value: most(middle.value), interval },
        worst: Estimate { value: most(about), interval },
        noise,
        largest_window: largest(values.iter().map(|value| (value - about).abs())),
    }
}

/// The error across the specific force, over gravity \[rad\].
fn level(counted: &[[f64; AXES]], force: [f64; AXES], stated: bool) -> Errors {
    let axes = [0, 1, 2].map(|axis| counted.iter().map(|error| error[axis]).collect::<Vec<_>>());
    let square = |v: &[f64; AXES]| v.iter().map(|x| x * x).sum::<f64>();
    let gravity = square(&force).sqrt();
    let across = |error: [f64; AXES]| {
        let along = (0..AXES).map(|axis| error[axis] * force[axis]).sum::<f64>() / (gravity * gravity);
        [0, 1, 2].map(|axis| error[axis] - along * force[axis])
    };
    let mean_of = |errors: &[[f64; AXES]]| {
        [0, 1, 2].map(|axis| mean(&errors.iter().map(|error| error[axis]).collect::<Vec<_>>()))
    };
    let middle = mean_of(counted);
    let angle = |error: [f64; AXES]| square(&across(error)).sqrt() / gravity;
    let from_middle = |error: &[f64; AXES]| angle([0, 1, 2].map(|axis| error[axis] - middle[axis]));
    let most = |of: &dyn Fn(&[f64; AXES]) -> f64| largest(groups(counted, |group| of(&mean_of(group))));
    // The noise of the two directions across, taken as that of the noisiest axis in both.
    let noise = largest(axes.iter().map(|axis| noise(axis))) * 2.0_f64.sqrt() / gravity;
    let interval = group_interval(noise, counted.len());
    let from_zero = |error: &[f64; AXES]| angle(*error);
    let about: &dyn Fn(&[f64; AXES]) -> f64 = if stated { &from_zero } else { &from_middle };
    let constants = axes.iter().map(|axis| constant(axis).interval);
    Errors {
        constant: stated.then(|| Estimate {
            value: angle(middle),
            interval: constants.map(|interval| interval * interval).sum::<f64>().sqrt() / gravity,
        }),
        variation: Estimate { value: most(&from_middle), interval },
        worst: Estimate { value: most(about), interval },
        noise,
        largest_window: largest(counted.iter().map(about)),
    }
}

/// What an error costs in navigation, as the tilt \[rad\] of a level: the angle, and the amplitude of the position
/// error on the ground (Schuler).
fn cost(tilt: f64) -> String {
    format!("{:.2} arcsec of level, {:.0} m of position", arcsec(tilt), tilt * EARTH_RADIUS)
}

/// An angle \[rad\] in arc seconds.
#[must_use]
pub fn arcsec(angle: f64) -> f64 {
    angle.to_degrees() * 3600.0
}

#[cfg(test)]
pub(crate) mod tests;
