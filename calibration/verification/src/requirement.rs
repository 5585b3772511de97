//! What is required of a table, and whether a recording at rest shows it.
//!
//! At one attitude the errors of bias, scale factor and misalignment cannot be distinguished; so the bound `bias`
//! judges the whole error of an axis, and `scale` the error of the length relative to gravity. `rate` judges the whole
//! error of a gyroscope at rest. A bound is met only if the whole interval is within it.

use crate::evidence::OWN_RECORDING;
use crate::stability::{Coverage, Stability};
use crate::verdict::{Estimate, arcsec};
use isotherm_shared::bounds;
use isotherm_shared::table::AXIS_NAMES;
use serde::Serialize;
use std::fmt;
use std::str::FromStr;

/// What a table must reach: a factor of stability, absolute bounds, or both. All bounds are for the upper end of the
/// interval.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_verification::Requirement;
///
/// let requirement: Requirement = "bias=2e-5g0,scale=50ppm,rate=0.02deg/h".parse()?;
/// assert_eq!((requirement.bias, requirement.factor), (Some(2e-5), None)); // g0
/// assert!("bias=20ppm".parse::<Requirement>().is_err());
/// // What one side leaves open, the other may state.
/// let required = requirement.or("10,bias=5ug0".parse()?);
/// assert_eq!((required.bias, required.factor), (Some(2e-5), Some(10.0)));
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Requirement {
    /// Least factor of stability of every accelerometer. In windows of 10 s the factor of a gyroscope is that of its
    /// noise; `rate` judges it.
    pub factor: Option<f64>,
    /// Largest error of every axis \[g0\].
    pub bias: Option<f64>,
    /// Largest error of the length, relative to gravity.
    pub scale: Option<f64>,
    /// Largest error of the level \[rad\].
    pub level: Option<f64>,
    /// Largest error of every gyroscope \[deg/h\].
    pub rate: Option<f64>,
}

/// The rule, for messages.
const REQUIREMENT_RULE: &str =
    "give a factor, or bounds such as bias=20ug0,scale=50ppm,level=5arcsec,rate=0.02deg/h; factor=10 may be among them";

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
        return Err(format!("a bound next to a comma is empty; {REQUIREMENT_RULE}"));
    }
    let (name, value) = part.split_once('=').map_or(("factor", part), |(name, value)| (name.trim(), value.trim()));
    let mut found = Requirement::default();
    let (place, kind) = match name {
        "factor" => (&mut found.factor, bounds::FACTOR),
        "bias" => (&mut found.bias, bounds::BIAS),
        "scale" => (&mut found.scale, bounds::SCALE),
        "level" => (&mut found.level, bounds::LEVEL),
        "rate" => (&mut found.rate, bounds::RATE),
        _ => return Err(format!("{name:?} is not a bound; {REQUIREMENT_RULE}")),
    };
    *place = Some(kind.parse(value, REQUIREMENT_RULE)?);
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
            self.rate.map(|rate| format!("rate={rate:.6}deg/h")),
        ];
        f.write_str(&parts.into_iter().flatten().collect::<Vec<_>>().join(","))
    }
}

/// One bound of a requirement, judged.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Judgement {
    /// The bound: factor, bias, scale, level or rate; or why no bound is judged: `own recording`, if the table was made
    /// from it, `at rest`, if the output is not as long as gravity, `whole run`, if too many windows are left out,
    /// `length of the run`, if it is too short.
    pub bound: &'static str,
    /// Whether the data show that it is met.
    pub met: bool,
    /// The judgement in words, with value, interval and bound.
    pub message: String,
    /// What to do if it is not met.
    pub remedy: Option<&'static str>,
}

/// Why a bound is not judged, and what to do.
type Unjudged = (String, &'static str);

fn unjudged([why, remedy]: [&'static str; 2]) -> Unjudged {
    (why.to_owned(), remedy)
}

/// The largest error of a gyroscope, with its name.
fn worst_rate(stability: &Stability) -> Result<(&'static str, Estimate), Unjudged> {
    const WHOLE: &str = "take a table and a recording of a whole IMU";
    match &stability.gyroscopes {
        None => Err(unjudged(["neither the table nor the recording has gyroscopes", WHOLE])),
        Some(Err(reason)) => Err((reason.clone(), WHOLE)),
        Some(Ok(found)) => match (found.unjudged(), found.missing()) {
            (Some(reason), _) => Err((reason, "hold the IMU still, within the table's range")),
            (None, Some(missing)) => Err(unjudged(missing)),
            (None, None) => Ok(found.largest()),
        },
    }
}

/// Why no bound is judged: another IMU's table, or an IMU that was not at rest, makes every figure meaningless.
fn conditions(stability: &Stability) -> Vec<Judgement> {
    let failed = |bound, message, remedy| Judgement { bound, met: false, message, remedy: Some(remedy) };
    let conditions = [
        ("at rest", stability.gravity_mismatch(), "hold the IMU still, and take its own table"),
        ("whole run", stability.unjudged(), "hold the IMU still at the stated attitude, within the table's range"),
    ];
    let nothing = |message| format!("Nothing can be claimed: {message}.");
    let conditions = conditions.into_iter();
    let found = conditions.filter_map(|(bound, message, remedy)| Some(failed(bound, nothing(message?), remedy)));
    let mut all: Vec<_> = no_evidence(stability.made_the_table).into_iter().chain(found).collect();
    let short = stability.too_short().filter(|_| all.is_empty());
    all.extend(short.map(|message| failed("length of the run", message, LONGER)));
    all
}

/// That no bound is judged by the recording that the table was made from.
pub(crate) fn no_evidence(made_the_table: bool) -> Option<Judgement> {
    let message = format!("Nothing can be claimed: {OWN_RECORDING}.");
    let remedy = Some("verify with a recording that the table was not made from");
    made_the_table.then_some(Judgement { bound: "own recording", met: false, message, remedy })
}

/// An error that a requirement bounds.
#[derive(Clone, Copy)]
enum Bound {
    Bias,
    Scale,
    Level,
    Rate,
}

impl Bound {
    const fn name(self) -> &'static str {
        match self {
            Self::Bias => "bias",
            Self::Scale => "scale",
            Self::Level => "level",
            Self::Rate => "rate",
        }
    }

    /// The unit that it is shown in, how many of them one of the estimate's is, and the decimals: a good gyroscope
    /// needs more than 3.
    fn shown(self) -> (&'static str, f64, usize) {
        match self {
            Self::Bias => ("ug0", 1e6, 3),
            Self::Scale => ("ppm", 1e6, 3),
            Self::Level => ("arcsec", arcsec(1.0), 3),
            Self::Rate => ("deg/h", 1.0, 4),
        }
    }

    /// The largest error of the run with its name, or why it is not judged.
    fn error(self, stability: &Stability) -> (&'static str, Result<Estimate, Unjudged>) {
        let verdict = &stability.verdict;
        let missing = || unjudged(verdict.missing().unwrap_or_default());
        match self {
            Self::Bias => {
                let axes = AXIS_NAMES.iter().zip(&verdict.axes);
                let worst = axes.max_by(|(_, a), (_, b)| a.worst.most().total_cmp(&b.worst.most()));
                let (name, worst) = worst.map_or(("", None), |(name, errors)| (*name, Some(errors.worst)));
                (name, worst.filter(|_| verdict.judges_axes()).ok_or_else(missing))
            }
            Self::Scale => {
                let why = if verdict.gravity_known {
                    ["the IMU was never still", "hold the IMU still"]
                } else {
                    const STATE: &str = "state --gravity-local, or take a table whose provenance has gravity_local";
                    ["local gravity is unknown", STATE]
                };
                let length = verdict.length.as_ref().map(|errors| errors.worst.times(1.0 / stability.gravity));
                ("the length", length.ok_or_else(|| unjudged(why)))
            }
            Self::Level => ("the level", Some(verdict.level.worst).filter(|_| verdict.stated).ok_or_else(missing)),
            Self::Rate => match worst_rate(stability) {
                Ok((name, worst)) => (name, Ok(worst)),
                Err(why) => ("", Err(why)),
            },
        }
    }
}

/// A bound as the run shows it, before it is asked whether anything can be claimed of the run.
struct BoundJudgement {
    bound: &'static str,
    message: String,
    word: String,
    remedy: Option<&'static str>,
}

impl BoundJudgement {
    fn factor(stability: &Stability, required: f64) -> Self {
        let all = AXIS_NAMES.iter().zip(&stability.axes);
        let least = all.map(|(name, axis)| (*name, axis.factor()));
        // An axis whose factor is not a number is the worst one.
        let least = least.map(|(name, factor)| (name, if factor.is_nan() { f64::NEG_INFINITY } else { factor }));
        let (name, least) = least.min_by(|(_, a), (_, b)| a.total_cmp(b)).unwrap_or(("", f64::NAN));
        let message = format!("factor of stability: {name} {least:.2}, at least {required} is required");
        let (word, remedy) = if least >= required { ("met", None) } else { ("missed", Some(ANEW)) };
        Self { bound: "factor", message, word: word.to_owned(), remedy }
    }

    fn error(bound: Bound, name: &str, error: Result<Estimate, Unjudged>, most: f64) -> Self {
        let (unit, factor, places) = bound.shown();
        let bound = bound.name();
        let limit = format!("at most {:.places$} {unit} is required", most * factor);
        let error = match error {
            Ok(error) => error,
            Err((why, remedy)) => {
                let (message, word) = (format!("{bound}: {limit}"), format!("not judged, {why}"));
                return Self { bound, message, word, remedy: Some(remedy) };
            }
        };
        let Estimate { value, interval } = error.times(factor);
        let message = format!("{bound}: {name} {value:.places$} +- {interval:.places$} {unit}, {limit}");
        let (word, remedy) = match (error.most() <= most, error.value.abs() <= most) {
            (true, _) => ("met", None),
            (false, true) => ("the interval reaches over it", Some(LONGER)),
            (false, false) => ("missed", Some(ANEW)),
        };
        Self { bound, message, word: word.to_owned(), remedy }
    }

    /// With what is said of a hole in the temperatures: no bound is met over it, unless that is accepted.
    fn over(self, hole: Option<String>, is_accepted: bool) -> Self {
        match hole.filter(|_| self.remedy.is_none()) {
            Some(hole) if is_accepted => Self { word: format!("{}; not shown over {hole}", self.word), ..self },
            Some(hole) => Self { word: format!("not shown over {hole}"), remedy: Some(COVER), ..self },
            None => self,
        }
    }

    fn judgement(self, is_void: bool) -> Judgement {
        let Self { bound, message, word, remedy } = self;
        let word = if is_void { "not judged, see below" } else { &word };
        Judgement {
            bound,
            met: !is_void && remedy.is_none(),
            message: format!("{message}: {word}"),
            remedy: remedy.filter(|_| !is_void),
        }
    }
}

const ANEW: &str = "calibrate again, or look at the report";
const LONGER: &str = "record longer";
const COVER: &str =
    "record over the whole range of the table, or accept that a part of it is not judged: --accept not-covered";

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
            ("rate", self.rate, other.rate),
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
            rate: self.rate.or(defaults.rate),
        }
    }

    /// Judges every bound that is given. If nothing can be claimed of the run, or if it is too short, no bound is
    /// judged; the last judgements say why.
    #[must_use]
    pub fn judge(&self, stability: &Stability) -> Vec<Judgement> {
        let conditions = conditions(stability);
        let is_void = !conditions.is_empty();
        let factor = self.factor.map(|least| BoundJudgement::factor(stability, least));
        let errors = [Bound::Bias, Bound::Scale, Bound::Level, Bound::Rate].into_iter().filter_map(|bound| {
            let most = self.most(bound)?;
            let (name, error) = bound.error(stability);
            let mut judged = BoundJudgement::error(bound, name, error, most);
            // One attitude drives half of the channels.
            let undriven = stability.covered.undriven();
            if matches!(bound, Bound::Scale) && judged.remedy.is_none() && !undriven.is_empty() {
                judged.word += &format!("; not shown: {}", undriven.join(", "));
            }
            let of_gyroscopes = || stability.judged_gyroscopes().map(|it| &it.covered);
            let covered = if matches!(bound, Bound::Rate) { of_gyroscopes() } else { Some(&stability.covered) };
            Some(judged.over(covered.and_then(Coverage::hole), stability.accepts_holes))
        });
        let factor = factor.map(|judged| judged.over(stability.covered.hole(), stability.accepts_holes));
        factor.into_iter().chain(errors).map(|judged| judged.judgement(is_void)).chain(conditions).collect()
    }

    const fn most(&self, bound: Bound) -> Option<f64> {
        match bound {
            Bound::Bias => self.bias,
            Bound::Scale => self.scale,
            Bound::Level => self.level,
            Bound::Rate => self.rate,
        }
    }

    /// Checks that every bound is met.
    ///
    /// # Errors
    /// The bounds that are not, in words, a line each; then the remedies. If no bound is judged, only why.
    pub fn check(&self, stability: &Stability) -> Result<(), String> {
        all_met(&self.judge(stability))
    }
}

/// Checks that every judgement is that its bound is met.
///
/// # Errors
/// As [`Requirement::check`].
pub(crate) fn all_met(judgements: &[Judgement]) -> Result<(), String> {
    let missed: Vec<_> = judgements.iter().filter(|judgement| !judgement.met).collect();
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

#[cfg(test)]
mod tests;
