//! The choice of the order, and of one scale factor or two; and what is refused.

use super::attitudes::Attitudes;
use super::covariance::MOVED;
use super::dilution::{Dilution, MOST, WARNED};
use super::error::TumbleError;
use super::groups::{Groups, STEPS};
use super::model::{GravityFit, GravityModel, Unknowns};
use super::noise::{LEAST_NOISE, errors_of_means};
use super::options::{ScaleFactorChoice, TumbleOptions};
use super::reading::Reading;
use super::weighted::WeightedFit;
use crate::effects::{BIAS_EFFECT, SCALE_FACTOR_EFFECT};
use isotherm_campaign::joint_range;
use isotherm_shared::polynomial::MAX_ORDER;
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use isotherm_support::finding::{Finding, name};
use nalgebra::{DMatrix, DVector};
use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

/// Highest order that is considered if none is requested.
const MAX_AUTO_ORDER: usize = 3;
/// Probability of choosing what has no effect.
const SIGNIFICANCE: f64 = 0.01;
/// Probability of choosing a K- of its own that is not there: it costs more than an order, as it makes the attitudes
/// distinguish the parameters far worse.
const SPLIT_SIGNIFICANCE: f64 = 0.001;
/// A split of the scale factor needs readings beyond this share of gravity with both signs, and one within it.
const SIGNED: f64 = 0.3;
/// Scale factors of the static poses, relative to the start's, that differ by more are no IMU's.
const SCALE_FACTORS: f64 = 1.5;
/// A bias beyond this is no accelerometer's \[g0\].
const LARGEST_BIAS: f64 = 0.7;
/// Pulses of a static pose beyond this are no accelerometer's, in local gravity.
const LARGEST_LOAD: f64 = 3.0;
/// Parts of the temperature's range that are counted where one group allows an order.
const PARTS: f64 = 10.0;

/// The fit that was chosen.
pub(super) struct Choice<'a> {
    pub fitted: TumbleFit<'a>,
    /// Of the order, and of the scale factors.
    pub reasons: [String; 2],
    pub warnings: Vec<Finding>,
}

/// A fit with its model.
#[derive(Clone)]
pub(super) struct TumbleFit<'a> {
    pub model: GravityModel<'a>,
    /// With equal weights.
    pub fit: GravityFit,
    pub dilution: Dilution,
    /// With the weights of its covariance; `None` without degrees of freedom.
    pub weighted: Option<Rc<WeightedFit<'a>>>,
}

impl TumbleFit<'_> {
    /// The unknowns, by the weights if there are any.
    pub(super) fn unknown(&self) -> &DVector<f64> {
        self.weighted.as_ref().map_or(&self.fit.unknown, |weighted| &weighted.unknown)
    }
}

/// Readings with what every fit of them needs.
#[derive(Clone, Copy)]
pub(super) struct Data<'a> {
    pub readings: &'a [Reading],
    pub groups: &'a Groups,
    pub gravity: f64,
    pub misalignment: bool,
}

impl<'a> Data<'a> {
    fn unknowns(self, order: usize, split: bool) -> Unknowns {
        Unknowns { order, split, misalignment: self.misalignment }
    }

    /// The attitudes that there are, at the end of a message.
    fn attitudes(self) -> String {
        format!("; {}", Attitudes::of(self.readings, self.gravity))
    }

    /// The fit with equal weights; `None` if there are too few static poses, or if they do not determine it.
    pub(super) fn fit(self, order: usize, split: bool) -> Option<(GravityModel<'a>, GravityFit)> {
        let unknowns = self.unknowns(order, split);
        if self.readings.len() < unknowns.count() {
            return None;
        }
        let (model, start) = GravityModel::new(self.readings, unknowns, self.gravity);
        let fit = model.fit(start)?;
        fit.inverse.is_some().then_some((model, fit))
    }

    /// A fit that may become a table: its attitudes distinguish the unknowns, and it is that of an accelerometer.
    fn candidate(self, order: usize, split: bool) -> Option<TumbleFit<'a>> {
        let (model, fit) = self.fit(order, split)?;
        let dilution = Dilution::of(&model, &fit, self.readings, self.gravity);
        if dilution.times_root_n > MOST || !self.is_sane(&model, &fit) {
            return None;
        }
        let weighted = WeightedFit::of(&model, &fit, self.groups, noise_of_magnitudes(&model, &fit), None).map(Rc::new);
        Some(TumbleFit { model, fit, dilution, weighted })
    }

    /// Not the trivial solution: a K without end, and a bias as long as gravity, leave no residual.
    pub(super) fn is_sane(self, model: &GravityModel<'_>, fit: &GravityFit) -> bool {
        let all: Vec<[f64; 2]> = model.relative(&fit.unknown).flatten().collect();
        let [least, most] = joint_range(all.iter().map(|[scale_factor, _]| [*scale_factor; 2]));
        let bias = all.iter().map(|[_, bias]| bias.abs()).fold(0.0, f64::max);
        let load = fit.load.row_iter().map(|row| row.norm()).fold(0.0, f64::max);
        least > 0.0 && most < SCALE_FACTORS * least && bias < LARGEST_BIAS && load < LARGEST_LOAD * self.gravity
    }

    /// Judges the attitudes at the fit, or at its start if there is none.
    fn dilution(self, order: usize, split: bool) -> Dilution {
        match self.fit(order, split) {
            Some((model, fit)) => Dilution::of(&model, &fit, self.readings, self.gravity),
            None => {
                let (model, start) = GravityModel::new(self.readings, self.unknowns(order, split), self.gravity);
                let fit = model.at(start);
                Dilution::of(&model, &fit, self.readings, self.gravity)
            }
        }
    }
}

/// Mean variance of a length by the noise of its static pose's mean \[g0^2\].
fn noise_of_magnitudes(model: &GravityModel<'_>, fit: &GravityFit) -> f64 {
    let errors = errors_of_means(model.readings());
    let of = |(i, errors): (usize, [f64; AXES])| {
        let part = |axis: usize| fit.by_force[(i, axis)] * errors[axis] / model.scale_factor(&fit.unknown, axis);
        (0..AXES).map(|axis| part(axis).powi(2)).sum::<f64>()
    };
    let all = errors.into_iter().enumerate().map(of).sum::<f64>() / model.readings().len() as f64;
    all.max(LEAST_NOISE * LEAST_NOISE)
}

/// The candidates, each fitted once.
struct Candidates<'a> {
    data: Data<'a>,
    known: BTreeMap<(usize, bool), Option<TumbleFit<'a>>>,
}

impl<'a> Candidates<'a> {
    fn get(&mut self, order: usize, split: bool) -> Option<&TumbleFit<'a>> {
        let data = self.data;
        self.known.entry((order, split)).or_insert_with(|| data.candidate(order, split)).as_ref()
    }

    fn weighted(&mut self, order: usize, split: bool) -> Option<Rc<WeightedFit<'a>>> {
        self.get(order, split)?.weighted.clone()
    }

    /// The probability by chance of a K- of its own: the larger one of that under its own variances, and of that under
    /// the ratios of those of the fit without it, because a walk is easily taken for a split. `None` if there is no
    /// such fit.
    fn p_of_split(&mut self, order: usize) -> Option<f64> {
        let [both, one] = [self.weighted(order, true)?, self.weighted(order, false)?];
        let columns = both.model.unknowns;
        let mut sums = DMatrix::zeros(AXES * (order + 1), columns.count());
        for axis in 0..AXES {
            for k in 0..=order {
                for quantity in [1, 2] {
                    sums[(axis * (order + 1) + k, columns.offset(axis, quantity) + k)] = 1.0;
                }
            }
        }
        let TumbleFit { model, fit, .. } = self.get(order, true)?.clone();
        let given = WeightedFit::of(&model, &fit, self.data.groups, both.floor, Some(&one.variances.values))?;
        Some(both.p_at_own_size(&sums, 1.0)?.max(given.p_at_own_size(&sums, 0.0)?))
    }

    /// The probability by chance of the highest coefficients of all curves, and whether one is large enough to matter.
    fn p_of_order(&mut self, order: usize, split: bool) -> Option<(f64, bool)> {
        let weighted = self.weighted(order, split)?;
        let unknowns = weighted.model.unknowns;
        let quantities = if split { 3 } else { 2 };
        let all = (0..AXES).flat_map(|axis| (0..quantities).map(move |quantity| (axis, quantity)));
        let mut highest = DMatrix::zeros(AXES * quantities, unknowns.count());
        let mut matters = false;
        for (row, (axis, quantity)) in all.enumerate() {
            let column = unknowns.offset(axis, quantity) + order;
            highest[(row, column)] = 1.0;
            let effect = if quantity == 0 { BIAS_EFFECT } else { SCALE_FACTOR_EFFECT };
            matters |= weighted.unknown[column].abs() > effect;
        }
        Some((weighted.p(&highest)?, matters))
    }
}

/// Chooses order and scale factors, and fits.
pub(super) fn choose<'a>(data: Data<'a>, options: &TumbleOptions) -> Result<Choice<'a>, TumbleError> {
    let Data { readings, groups, .. } = data;
    let levels = groups.levels;
    let mut warnings = Vec::new();
    if let Some(order) = options.order {
        asked_order(order, readings, groups)?;
    }
    if options.scale_factor == ScaleFactorChoice::Split {
        signs(readings, data)?;
    }
    let mut candidates = Candidates { data, known: BTreeMap::new() };
    let (order, why_order, split, why_split) = order_and_split(&mut candidates, levels, options);
    if levels == 2 && options.order.is_none() && line_is_better(&mut candidates, split) {
        let message =
            "the two temperatures differ significantly, and the table has their mean: two temperatures show no curvature, so a line must be asked \
             for, --order 1; better is a third temperature"
                .to_owned();
        warnings.push(Finding::warning(name::TEMPERATURES, message));
    }
    let unknowns = data.unknowns(order, split);
    let (n, needed) = (readings.len(), unknowns.count());
    if n < needed {
        let Dilution { weakest, help, .. } = data.dilution(order, split);
        return Err(TumbleError::Attitudes {
            message: format!("{n} {} for {needed} unknowns, which leaves undetermined", poses(n)),
            parameters: weakest,
            attitude: help,
            remedy: data.attitudes()
                + if options.misalignment && n + AXES >= needed {
                    "; or leave the misalignments out: --no-misalignment"
                } else {
                    ""
                },
        });
    }
    let Some(fitted) = candidates.get(order, split).cloned() else { return Err(no_fit(data, order, split)) };
    let Dilution { times_root_n, weakest, help } = &fitted.dilution;
    if *times_root_n > WARNED {
        let message = format!(
            "the attitudes distinguish the parameters badly: D sqrt(n) is {}, over {WARNED}; worst: {}; what helps most: put the IMU down {help}",
            shown(*times_root_n),
            weakest.join(", "),
        );
        warnings.push(Finding::warning(name::ATTITUDES, message));
    }
    Ok(Choice { fitted, reasons: [why_order, why_split], warnings })
}

/// Why the static poses give no table.
fn no_fit(data: Data<'_>, order: usize, split: bool) -> TumbleError {
    let dilution = data.dilution(order, split);
    if dilution.times_root_n <= MOST {
        return TumbleError::Refused(format!(
            "no accelerometer explains the static poses: scale factors would differ by over {SCALE_FACTORS} times between static poses, or a \
             bias would be over {LARGEST_BIAS} g0; look at the columns, signs and units of the counts, file by file"
        ));
    }
    TumbleError::Attitudes {
        message: format!(
            "the attitudes do not distinguish the parameters, D sqrt(n) is {}, over {MOST}; worst",
            shown(dilution.times_root_n)
        ),
        parameters: dilution.weakest,
        attitude: dilution.help,
        remedy: data.attitudes()
            + if order > 0 && data.dilution(0, split).times_root_n <= MOST {
                "; or take one value for all temperatures: --order 0"
            } else {
                ""
            },
    }
}

/// Refuses an order that the temperatures do not show.
fn asked_order(order: usize, readings: &[Reading], groups: &Groups) -> Result<(), TumbleError> {
    let levels = groups.levels;
    let of_levels = levels.saturating_sub(1);
    let in_motion = if groups.count == 1 { parts_of_range(readings, groups).saturating_sub(2) } else { 0 };
    let most = of_levels.max(in_motion).min(MAX_ORDER);
    if order <= most {
        return Ok(());
    }
    let allow = if levels == 1 { "temperature allows" } else { "temperatures allow" };
    Err(TumbleError::Options(format!(
        "--order {order}: {levels} {allow} order {most} at most; measure at more temperatures, or give a lower order"
    )))
}

/// Tenths of the temperature's range with a static pose, where temperature moves within one group.
fn parts_of_range(readings: &[Reading], groups: &Groups) -> usize {
    let temperature: Vec<f64> = readings.iter().map(Reading::temperature).collect();
    let [low, high] = joint_range(temperature.iter().map(|temperature| [*temperature; 2]));
    let step = readings.iter().map(|reading| reading.temperature_step).fold(0.0, f64::max);
    if high - low <= MOVED * groups.row_noise || high - low <= STEPS * step {
        return 0;
    }
    let part = |temperature: &f64| ((temperature - low) / (high - low) * PARTS).min(PARTS - 1.0) as usize;
    temperature.iter().map(part).collect::<BTreeSet<_>>().len()
}

/// Order and split with their reasons. Each is chosen under the other, until both stay: a split that is missed looks
/// like an effect of temperature, and an effect of temperature hides a split.
fn order_and_split(
    candidates: &mut Candidates<'_>,
    levels: usize,
    options: &TumbleOptions,
) -> (usize, String, bool, String) {
    let by_order = |candidates: &mut Candidates<'_>, split| match options.order {
        Some(order) => (order, "asked for".to_owned()),
        None => by_the_data(candidates, levels, split),
    };
    let asked = "asked for".to_owned();
    if options.scale_factor != ScaleFactorChoice::Auto {
        let split = options.scale_factor == ScaleFactorChoice::Split;
        let (order, why) = by_order(candidates, split);
        return (order, why, split, asked);
    }
    let highest = options.order.unwrap_or_else(|| auto_order(levels));
    // A split that is significant at any order, as far as the order that follows from it agrees.
    for at in options.order.unwrap_or(0)..=highest {
        if is_split(candidates, at).0 {
            let (order, why_order) = by_order(candidates, true);
            let (split, why_split) = is_split(candidates, order);
            if split {
                return (order, why_order, true, why_split);
            }
        }
    }
    let (order, why_order) = by_order(candidates, false);
    (order, why_order, false, is_split(candidates, order).1)
}

/// Whether a K- of its own is significant at `order` and the attitudes allow it, with the reason.
fn is_split(candidates: &mut Candidates<'_>, order: usize) -> (bool, String) {
    let data = candidates.data;
    match candidates.p_of_split(order) {
        Some(p) if p < SPLIT_SIGNIFICANCE => (true, format!("a K- of its own is significant (p {p:.1e})")),
        Some(p) => (false, format!("a K- of its own is not significant (p {p:.3})")),
        None if data.readings.len() < data.unknowns(order, true).count() => {
            (false, "the static poses do not determine a K- of its own".to_owned())
        }
        None => match data.dilution(order, true).times_root_n {
            large if large > MOST => {
                (false, format!("the attitudes do not show a K- of its own, D sqrt(n) would be {}", shown(large)))
            }
            _ => (false, "the static poses leave nothing to judge a K- of its own by".to_owned()),
        },
    }
}

/// The highest order that is considered for this number of temperatures: one is left over to judge it by.
fn auto_order(levels: usize) -> usize {
    levels.saturating_sub(2).min(MAX_AUTO_ORDER)
}

/// The order by F under the fit's own covariance, and by what matters, from the highest down.
fn by_the_data(candidates: &mut Candidates<'_>, levels: usize, split: bool) -> (usize, String) {
    let highest = auto_order(levels);
    if highest == 0 {
        let why = match levels {
            1 => "one temperature",
            _ => "two temperatures show no curvature",
        };
        return (0, why.to_owned());
    }
    let limit = SIGNIFICANCE / highest as f64;
    for order in (1..=highest).rev() {
        if let Some((p, true)) = candidates.p_of_order(order, split)
            && p < limit
        {
            let why = format!("order {order} is significant (p {p:.1e}, limit {limit:.1e}) and large enough to matter");
            return (order, why);
        }
    }
    (0, format!("no higher order is both significant (limit {limit:.1e}) and large enough to matter"))
}

fn line_is_better(candidates: &mut Candidates<'_>, split: bool) -> bool {
    candidates.p_of_order(1, split).is_some_and(|(p, matters)| p < SIGNIFICANCE && matters)
}

/// Refuses a split for an axis without readings of both signs, or without one near zero.
fn signs(readings: &[Reading], data: Data<'_>) -> Result<(), TumbleError> {
    let (model, start) = GravityModel::new(readings, data.unknowns(0, false), data.gravity);
    for (axis, name) in AXIS_NAMES.iter().enumerate() {
        let parts = || readings.iter().map(|reading| model.force_of(&start, reading)[axis] / data.gravity);
        let lacks = [
            (parts().any(|part| part > SIGNED), "a positive reading"),
            (parts().any(|part| part < -SIGNED), "a negative reading"),
            (parts().any(|part| part.abs() < SIGNED), "a reading near zero"),
        ];
        if let Some((_, what)) = lacks.into_iter().find(|(there, _)| !there) {
            return Err(TumbleError::Refused(format!(
                "--scale-factor split: {name} has no static pose with {what}, so its K+ and K- cannot be separated from its bias; put the IMU down with {}",
                match what {
                    "a positive reading" => format!("+{name} up"),
                    "a negative reading" => format!("-{name} up"),
                    _ => format!("{name} level"),
                }
            )));
        }
    }
    Ok(())
}

/// D sqrt(n) in words.
fn shown(times_root_n: f64) -> String {
    if times_root_n.is_finite() { format!("{times_root_n:.3}") } else { "infinite".to_owned() }
}

fn poses(n: usize) -> &'static str {
    if n == 1 { "static pose" } else { "static poses" }
}
