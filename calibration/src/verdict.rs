//! What a recording at rest allows to be claimed of a coefficient table, and whether this meets a requirement.
//!
//! # Definition
//! The windows of [`crate::stability`] are divided, in order of time, into groups of at least [`MIN_GROUP`] neighbours. A group's mean
//! has little noise left, and it does not average over the run: it shows what temperature, its direction and the time do. Of the errors of
//! the groups' means (output minus specific force) there are, for each accelerometer:
//!
//! - **constant**: their mean. Its 95 % interval is Student's t of the means of ten equal parts of the run (fewer for a short run), so that
//!   slow changes count.
//! - **variation**: the largest distance of a group from the constant error.
//! - **worst**: the largest error of a group, constant error and variation together. Where the constant error is not judged, it is the
//!   variation.
//! - **noise**: the standard deviation of a window about its neighbours, from the differences of successive windows.
//!
//! The constant error of an axis is judged if both the attitude and local gravity are known: without one of them a part of the error is
//! subtracted with the output's own median. The level needs only the attitude.
//!
//! The intervals of variation and worst hold for all groups at once (Bonferroni): the noise of a window over the square root of the group's
//! length, times the quantile of Student's t with the degrees of freedom of n - 1 successive differences, 2 (n - 1)^2 / (3 n - 4). A bound is
//! met only if the whole interval is within it.
//!
//! **Correlated noise.** The interval of the constant error holds for noise that a tenth of the run averages out: with a correlation time of
//! 1/130 of the run (4.5 of 600 windows) 94.5 % of the intervals contain the truth, with 1/30 of the run 90 %, with 1/6 only 66 %. Noise that
//! is slower than a group is no noise here: it is part of variation and worst, as an error that the run has shown.
//!
//! **Length** is the same for |output| minus local gravity, over the windows in which the IMU was still. **Level** is the length of the error's
//! part across the specific force, over gravity: the angle by which a levelled IMU is tilted.
//!
//! At one attitude the errors of bias, scale factor and misalignment cannot be told apart; so the bound `bias` judges the whole error of an
//! axis, and `scale` the error of the length relative to gravity.
//!
//! Over 400 lines: the errors and the bounds that judge them are one definition.

use crate::curve::{CONFIDENCE, student_quantile, student_quantile_of};
use crate::stability::{MIN_WINDOWS, Stability, Window};
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use serde::Serialize;
use std::fmt;
use std::str::FromStr;

/// Fewest windows of a group, if there are as many.
pub const MIN_GROUP: usize = 6;
/// Most groups.
const MAX_GROUPS: usize = 64;
/// Parts of the run whose means give the constant error's interval.
const PARTS: usize = 10;
/// Radius of the Earth \[m\]: a level error times this is the amplitude of the position error (Schuler).
const EARTH_RADIUS: f64 = 6.371e6;

/// A value with the half width of its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
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
        (self.value.abs() - self.interval).max(0.0)
    }

    fn times(self, factor: f64) -> Self {
        Self { value: self.value * factor, interval: self.interval * factor }
    }
}

/// The errors of one accelerometer, of the length or of the level.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
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
#[derive(Clone, Debug, PartialEq, Serialize)]
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
    /// The verdict of a run with these windows and this specific force \[g0\], which is `stated` or the median of the output. `gravity` is
    /// local gravity \[g0\], if it is known. At least [`MIN_WINDOWS`] windows must count.
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

    /// The largest error that is judged: its name, and its value in g0. That of the level is larger than that of an axis where two axes have a part
    /// of it.
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
fn group_size(count: usize) -> usize {
    count.div_ceil(MAX_GROUPS).max(MIN_GROUP).min(count / 3).max(1)
}

pub(crate) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
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
    let (count, n) = ((windows / size) as f64, windows as f64);
    // Successive differences overlap: their mean square scatters as a variance with so many degrees of freedom.
    let freedom = 2.0 * (n - 1.0).powi(2) / (3.0 * n - 4.0);
    noise / (size as f64).sqrt() * student_quantile_of(1.0 - (1.0 - CONFIDENCE) / count, freedom)
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

fn errors(values: &[f64], with_constant: bool) -> Errors {
    let noise = noise(values);
    let middle = constant(values);
    let groups = groups(values, mean);
    let interval = group_interval(noise, values.len());
    let largest = |about: f64| groups.iter().map(|group| (group - about).abs()).fold(0.0, f64::max);
    let about = if with_constant { 0.0 } else { middle.value };
    Errors {
        constant: with_constant.then_some(middle),
        variation: Estimate { value: largest(middle.value), interval },
        worst: Estimate { value: largest(about), interval },
        noise,
        largest_window: values.iter().map(|value| (value - about).abs()).fold(0.0, f64::max),
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
    let largest =
        |of: &dyn Fn(&[f64; AXES]) -> f64| groups(counted, |group| of(&mean_of(group))).into_iter().fold(0.0, f64::max);
    // The noise of the two directions across, taken as that of the noisiest axis in both.
    let noise = axes.iter().map(|axis| noise(axis)).fold(0.0, f64::max) * 2.0_f64.sqrt() / gravity;
    let interval = group_interval(noise, counted.len());
    let from_zero = |error: &[f64; AXES]| angle(*error);
    let about: &dyn Fn(&[f64; AXES]) -> f64 = if stated { &from_zero } else { &from_middle };
    let constants = axes.iter().map(|axis| constant(axis).interval);
    Errors {
        constant: stated.then(|| Estimate {
            value: angle(middle),
            interval: constants.map(|interval| interval * interval).sum::<f64>().sqrt() / gravity,
        }),
        variation: Estimate { value: largest(&from_middle), interval },
        worst: Estimate { value: largest(about), interval },
        noise,
        largest_window: counted.iter().map(about).fold(0.0, f64::max),
    }
}

/// What an error costs in navigation, as the tilt \[rad\] of a level: the angle, and the amplitude of the position error on the ground
/// (Schuler).
fn cost(tilt: f64) -> String {
    format!("{:.2} arcsec of level, {:.0} m of position", arcsec(tilt), tilt * EARTH_RADIUS)
}

/// An angle \[rad\] in arc seconds.
#[must_use]
pub fn arcsec(angle: f64) -> f64 {
    angle.to_degrees() * 3600.0
}

/// What a table must reach: a factor of stability, absolute bounds, or both. All bounds are for the upper end of the interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Requirement {
    /// Least factor of stability of every axis.
    pub factor: Option<f64>,
    /// Largest error of every axis \[g0\].
    pub bias: Option<f64>,
    /// Largest error of the length, relative to gravity.
    pub scale: Option<f64>,
    /// Largest error of the level \[rad\].
    pub level: Option<f64>,
}

/// Units of each bound, with their size in the bound's own unit.
type Units = &'static [(&'static str, f64)];
const BIAS_UNITS: Units = &[("ug0", 1e-6), ("mg0", 1e-3), ("g0", 1.0)];
const SCALE_UNITS: Units = &[("ppm", 1e-6), ("%", 1e-2)];
const LEVEL_UNITS: Units = &[
    ("arcsec", std::f64::consts::PI / 648_000.0),
    ("arcmin", std::f64::consts::PI / 10_800.0),
    ("deg", std::f64::consts::PI / 180.0),
    ("urad", 1e-6),
    ("mrad", 1e-3),
    ("rad", 1.0),
];
/// The rule, for messages.
const REQUIREMENT_RULE: &str =
    "give a factor, or bounds such as bias=20ug0,scale=50ppm,level=5arcsec; factor=10 may be among them";

/// Smallest and largest value of a bound that makes sense, in its own unit and in words. No smaller one has digits where it is printed.
const FACTORS: ([f64; 2], &str) = ([1e-9, 1e9], "1e-9 to 1e9");
const BIASES: ([f64; 2], &str) = ([1e-9, 1.0], "0.001 ug0 to 1 g0");
const SCALES: ([f64; 2], &str) = ([1e-9, 1.0], "0.001 ppm to 100 %");
const LEVELS: ([f64; 2], &str) = ([0.001 * LEVEL_UNITS[0].1, 90.0 * LEVEL_UNITS[2].1], "0.001 arcsec to 90 deg");

impl FromStr for Requirement {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.trim().is_empty() {
            return Err(format!("it is empty; {REQUIREMENT_RULE}"));
        }
        text.split(',').try_fold(Self::default(), |found, part| found.and(bound(part.trim())?))
    }
}

/// One bound, or a bare factor.
fn bound(part: &str) -> Result<Requirement, String> {
    if part.is_empty() {
        return Err(format!("a bound beside a comma is empty; {REQUIREMENT_RULE}"));
    }
    let (name, value) = part.split_once('=').map_or(("factor", part), |(name, value)| (name.trim(), value.trim()));
    let mut found = Requirement::default();
    let (place, units, ([least, most], range)): (&mut Option<f64>, Units, _) = match name {
        "factor" => (&mut found.factor, &[], FACTORS),
        "bias" => (&mut found.bias, BIAS_UNITS, BIASES),
        "scale" => (&mut found.scale, SCALE_UNITS, SCALES),
        "level" => (&mut found.level, LEVEL_UNITS, LEVELS),
        _ => return Err(format!("{name:?} is no bound; {REQUIREMENT_RULE}")),
    };
    // Both characters for micro: the sign, and the Greek letter.
    let ascii = value.replace(['\u{b5}', '\u{3bc}'], "u");
    // The unit "ug0" ends with a digit, and "g0" ends it too.
    let with_unit = units.iter().find_map(|(unit, size)| {
        let number = ascii.strip_suffix(unit)?.trim().parse::<f64>().ok()?;
        Some(number * size)
    });
    let number = if units.is_empty() { ascii.parse::<f64>().ok() } else { with_unit };
    let Some(number) = number else {
        if units.is_empty() {
            return Err(format!("{value:?} is no number; {REQUIREMENT_RULE}"));
        }
        let names: Vec<_> = units.iter().map(|(unit, _)| *unit).collect();
        return Err(format!("{name} is {value:?}; give a number with a unit: {}", names.join(", ")));
    };
    // 1e-9: 90 deg is 90 deg, whatever rounding makes of it. NaN is in no range.
    if number <= 0.0 {
        return Err(format!("{name} must be over 0"));
    }
    if !(least * (1.0 - 1e-9)..=most * (1.0 + 1e-9)).contains(&number) {
        return Err(format!("{name} must be from {range}"));
    }
    *place = Some(number);
    Ok(found)
}

/// As it is written on the command line.
impl fmt::Display for Requirement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parts = [
            self.factor.map(|factor| format!("factor={factor}")),
            self.bias.map(|bias| format!("bias={:.4}ug0", bias * 1e6)),
            self.scale.map(|scale| format!("scale={:.4}ppm", scale * 1e6)),
            self.level.map(|level| format!("level={:.4}arcsec", arcsec(level))),
        ];
        f.write_str(&parts.into_iter().flatten().collect::<Vec<_>>().join(","))
    }
}

/// One bound of a requirement, judged.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Judgement {
    /// The bound: factor, bias, scale or level; or why no bound is judged: `at rest`, if the output is not as long as gravity, `whole run`, if
    /// too many windows are left out, `length of the run`, if it is too short.
    pub bound: &'static str,
    /// Whether the data show that it is met.
    pub met: bool,
    /// The judgement in words, with value, interval and bound.
    pub message: String,
    /// What to do if it is not met.
    pub remedy: Option<&'static str>,
}

const ANEW: &str = "calibrate anew, or look at the report";
const LONGER: &str = "record longer";

impl Requirement {
    /// The bounds of both.
    ///
    /// # Errors
    /// If both have the same bound.
    pub fn and(self, other: Self) -> Result<Self, String> {
        let pairs = [
            ("factor", self.factor, other.factor),
            ("bias", self.bias, other.bias),
            ("scale", self.scale, other.scale),
            ("level", self.level, other.level),
        ];
        match pairs.into_iter().find(|(_, a, b)| a.is_some() && b.is_some()) {
            Some((name, ..)) => Err(format!("{name} is given twice")),
            None => Ok(self.or(other)),
        }
    }

    /// These bounds, and those of `defaults` where there is none.
    #[must_use]
    pub fn or(self, defaults: Self) -> Self {
        Self {
            factor: self.factor.or(defaults.factor),
            bias: self.bias.or(defaults.bias),
            scale: self.scale.or(defaults.scale),
            level: self.level.or(defaults.level),
        }
    }

    /// Judges every bound that is given. If nothing can be claimed of the run, or if it is too short, no bound is judged; the last judgements
    /// say why.
    #[must_use]
    pub fn judge(&self, stability: &Stability) -> Vec<Judgement> {
        let verdict = &stability.verdict;
        // Another IMU's table, or an IMU that was not at rest, makes every figure meaningless.
        let conditions = [
            ("at rest", stability.gravity_mismatch(), "hold the IMU still, and take its own table"),
            ("whole run", stability.unjudged(), "hold the IMU still at the stated attitude, within the table's range"),
        ];
        let nothing = |message| format!("Nothing can be claimed: {message}.");
        let mut conditions: Vec<_> = (conditions.into_iter())
            .filter_map(|(bound, message, remedy)| Some((bound, nothing(message?), remedy)))
            .collect();
        let short = stability.too_short().filter(|_| conditions.is_empty());
        conditions.extend(short.map(|message| ("length of the run", message, LONGER)));
        let void = (!conditions.is_empty()).then_some("not judged, see below");
        let mut found = Vec::new();
        let mut push = |bound: &'static str, message: String, word: String, remedy: Option<&'static str>| {
            let message = format!("{message}: {}", void.unwrap_or(&word));
            found.push(Judgement {
                bound,
                met: void.is_none() && remedy.is_none(),
                message,
                remedy: remedy.filter(|_| void.is_none()),
            });
        };
        if let Some(factor) = self.factor {
            let least = AXIS_NAMES.iter().zip(&stability.axes).map(|(name, axis)| (*name, axis.factor()));
            // An axis whose factor is not a number is the worst one.
            let least = least.map(|(name, factor)| (name, if factor.is_nan() { f64::NEG_INFINITY } else { factor }));
            let (name, least) = least.min_by(|(_, a), (_, b)| a.total_cmp(b)).unwrap_or(("", f64::NAN));
            let message = format!("factor of stability: {name} {least:.2}, at least {factor} is required");
            let (word, remedy) = if least >= factor { ("met", None) } else { ("missed", Some(ANEW)) };
            push("factor", message, word.to_owned(), remedy);
        }
        let mut judge =
            |bound, name: &str, error: Result<Estimate, [&'static str; 2]>, most: f64, unit: &str, factor: f64| {
                let limit = format!("at most {:.3} {unit} is required", most * factor);
                match error {
                    Err([why, remedy]) => {
                        push(bound, format!("{bound}: {limit}"), format!("not judged, {why}"), Some(remedy));
                    }
                    Ok(error) => {
                        let shown = error.times(factor);
                        let message =
                            format!("{bound}: {name} {:.3} +- {:.3} {unit}, {limit}", shown.value, shown.interval);
                        let (word, remedy) = match (error.most() <= most, error.value.abs() <= most) {
                            (true, _) => ("met", None),
                            (false, true) => ("the interval reaches over it", Some(LONGER)),
                            (false, false) => ("missed", Some(ANEW)),
                        };
                        push(bound, message, word.to_owned(), remedy);
                    }
                }
            };
        let missing = verdict.missing().unwrap_or_default();
        let axis =
            AXIS_NAMES.iter().zip(&verdict.axes).max_by(|(_, a), (_, b)| a.worst.most().total_cmp(&b.worst.most()));
        let (axis, errors) = axis.map_or(("", None), |(name, errors)| (*name, Some(errors.worst)));
        if let Some(bias) = self.bias {
            let errors = errors.filter(|_| verdict.judges_axes()).ok_or(missing);
            judge("bias", axis, errors, bias, "ug0", 1e6);
        }
        if let Some(scale) = self.scale {
            let why = if verdict.gravity_known {
                ["the IMU was never still", "hold the IMU still"]
            } else {
                [
                    "local gravity is unknown",
                    "state --gravity-local, or take a table whose provenance has gravity_local",
                ]
            };
            let length = verdict.length.as_ref().map(|errors| errors.worst.times(1.0 / stability.gravity));
            judge("scale", "the length", length.ok_or(why), scale, "ppm", 1e6);
        }
        if let Some(level) = self.level {
            let worst = Some(verdict.level.worst).filter(|_| verdict.stated);
            judge("level", "the level", worst.ok_or(missing), level, "arcsec", arcsec(1.0));
        }
        found.extend(conditions.into_iter().map(|(bound, message, remedy)| Judgement {
            bound,
            met: false,
            message,
            remedy: Some(remedy),
        }));
        found
    }

    /// Checks that every bound is met.
    ///
    /// # Errors
    /// The bounds that are not, in words, a line each; then the remedies. If no bound is judged, only why.
    pub fn check(&self, stability: &Stability) -> Result<(), String> {
        let missed: Vec<_> = self.judge(stability).into_iter().filter(|judgement| !judgement.met).collect();
        if missed.is_empty() {
            return Ok(());
        }
        // Those without a remedy are not judged.
        let mut lines = vec!["the requirement is not met:".to_owned()];
        let mut remedies = Vec::new();
        for judgement in &missed {
            let Some(remedy) = judgement.remedy else { continue };
            lines.push(format!("  {}", judgement.message));
            if !remedies.contains(&remedy) {
                remedies.push(remedy);
            }
        }
        lines.push(format!("remedy: {}", remedies.join("; ")));
        Err(lines.join("\n"))
    }
}

#[cfg(test)]
mod tests;
