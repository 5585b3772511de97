//! The choice of the order, and of one scale factor or two; and what is refused.

use super::dilution::{Dilution, MOST, WARNED};
use super::error::GravityOnlyError;
use super::model::{GravityFit, GravityModel, Unknowns};
use super::options::{GravityOnlyOptions, ScaleFactorChoice};
use super::reading::Reading;
use crate::effects::{BIAS_EFFECT, SCALE_FACTOR_EFFECT};
use isotherm_finding::{Finding, name};
use isotherm_shared::polynomial::MAX_ORDER;
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use isotherm_statistics::f_tail;

/// Highest order that is considered if none is requested.
const MAX_AUTO_ORDER: usize = 3;
/// Probability of choosing what has no effect.
const SIGNIFICANCE: f64 = 0.01;
/// A split of the scale factor needs readings beyond this share of gravity with both signs, and one within it.
const SIGNED: f64 = 0.3;

/// The fit that was chosen.
pub(super) struct Chosen<'a> {
    pub model: GravityModel<'a>,
    pub fit: GravityFit,
    pub dilution: Dilution,
    /// Of the order, and of the scale factors.
    pub reasons: [String; 2],
    pub warnings: Vec<Finding>,
}

/// A fit with its model.
struct Fitted<'a>(GravityModel<'a>, GravityFit);

/// Readings with what every fit of them needs.
#[derive(Clone, Copy)]
struct Data<'a> {
    readings: &'a [Reading],
    gravity: f64,
    misalignment: bool,
}

impl<'a> Data<'a> {
    fn unknowns(self, order: usize, split: bool) -> Unknowns {
        Unknowns { order, split, misalignment: self.misalignment }
    }

    /// The fit; `None` if there are too few standstills, or if they do not determine it.
    fn fit(self, order: usize, split: bool) -> Option<Fitted<'a>> {
        let unknowns = self.unknowns(order, split);
        if self.readings.len() < unknowns.count() {
            return None;
        }
        let (model, start) = GravityModel::new(self.readings, unknowns, self.gravity);
        let fit = model.fit(start)?;
        fit.inverse.is_some().then_some(Fitted(model, fit))
    }

    /// Judges the attitudes at the fit, or at its start if there is none.
    fn dilution(self, order: usize, split: bool) -> Dilution {
        match self.fit(order, split) {
            Some(Fitted(model, fit)) => Dilution::of(&model, &fit, self.readings, self.gravity),
            None => {
                let (model, start) = GravityModel::new(self.readings, self.unknowns(order, split), self.gravity);
                let fit = GravityFit { inverse: None, ..model.at(start) };
                Dilution::of(&model, &fit, self.readings, self.gravity)
            }
        }
    }
}

impl Fitted<'_> {
    /// The probability of an F at least as large as that of this fit against `less`, by chance; `None` without degrees
    /// of freedom.
    fn p(&self, less: &Self) -> Option<f64> {
        let Fitted(model, fit) = self;
        let freedom = fit.residual.len().checked_sub(model.unknowns.count()).filter(|freedom| *freedom > 0)? as f64;
        let more = (model.unknowns.count() - less.0.unknowns.count()) as f64;
        let f = (less.1.squares() - fit.squares()) / more / (fit.squares() / freedom);
        Some(if f.is_nan() { 1.0 } else { f_tail(f.max(0.0), more, freedom) })
    }

    /// Whether a curve differs from that of `less` by what matters.
    fn matters(&self, less: &Self) -> bool {
        let curve =
            |fitted: &Self, axis, quantity| fitted.0.curve(&fitted.1.unknown, None, [axis, quantity], 0, [0.0, 1.0]);
        (0..AXES).any(|axis| {
            (0..3).any(|quantity| {
                let [ours, others] = [self, less].map(|fitted| curve(fitted, axis, quantity));
                let [center, scale] = ours.basis();
                let size = if quantity == 0 { BIAS_EFFECT } else { SCALE_FACTOR_EFFECT * others.at(center).abs() };
                (0..=8).any(|point| {
                    let telemetry = center + scale * (f64::from(point) / 4.0 - 1.0);
                    (ours.at(telemetry) - others.at(telemetry)).abs() >= size
                })
            })
        })
    }
}

/// Chooses order and scale factors, and fits.
pub(super) fn choose<'a>(
    readings: &'a [Reading],
    levels: usize,
    gravity: f64,
    options: &GravityOnlyOptions,
) -> Result<Chosen<'a>, GravityOnlyError> {
    let data = Data { readings, gravity, misalignment: options.misalignment };
    let mut warnings = Vec::new();
    if let Some(order) = options.order {
        let most = levels.saturating_sub(1).min(MAX_ORDER);
        if order > most {
            return Err(GravityOnlyError::Options(format!(
                "--order {order}: {levels} {} order {most} at most; measure at more temperatures, or give a lower order",
                if levels == 1 { "temperature allows" } else { "temperatures allow" }
            )));
        }
    }
    if options.scale_factor == ScaleFactorChoice::Split {
        signs(readings, data)?;
    }
    let (order, why_order, split, why_split) = order_and_split(data, levels, options);
    if levels == 2 && options.order.is_none() && line_is_better(data, split) {
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
        return Err(GravityOnlyError::Attitudes {
            message: format!("{n} {} for {needed} unknowns, which leaves undetermined", standstills(n)),
            parameters: weakest,
            attitude: help,
            remedy: if options.misalignment && n + AXES >= needed {
                "; or leave the misalignments out: --no-misalignment"
            } else {
                ""
            },
        });
    }
    let dilution = data.dilution(order, split);
    let shown = shown(dilution.times_root_n);
    let fitted = data.fit(order, split).filter(|_| dilution.times_root_n <= MOST);
    let Some(Fitted(model, fit)) = fitted else {
        return Err(GravityOnlyError::Attitudes {
            message: format!(
                "the attitudes do not tell the parameters apart, D sqrt(n) is {shown}, over {MOST}; worst"
            ),
            parameters: dilution.weakest,
            attitude: dilution.help,
            remedy: if order > 0 && data.dilution(0, split).times_root_n <= MOST {
                "; or take one value for all temperatures: --order 0"
            } else {
                ""
            },
        });
    };
    if dilution.times_root_n > WARNED {
        let message = format!(
            "the attitudes tell the parameters apart badly: D sqrt(n) is {shown}, over {WARNED}; worst: {}; what helps most: put the IMU down \
             {}",
            dilution.weakest.join(", "),
            dilution.help
        );
        warnings.push(Finding::warning(name::ATTITUDES, message));
    }
    Ok(Chosen { model, fit, dilution, reasons: [why_order, why_split], warnings })
}

/// Order and split with their reasons. Each is chosen under the other, until both stay: a split that is missed looks
/// like an effect of temperature, and an effect of temperature hides a split.
fn order_and_split(data: Data<'_>, levels: usize, options: &GravityOnlyOptions) -> (usize, String, bool, String) {
    let by_order = |split| match options.order {
        Some(order) => (order, "asked for".to_owned()),
        None => by_the_data(data, levels, split),
    };
    let asked = "asked for".to_owned();
    match options.scale_factor {
        ScaleFactorChoice::Auto => {}
        choice => {
            let split = choice == ScaleFactorChoice::Split;
            let (order, why) = by_order(split);
            return (order, why, split, asked);
        }
    }
    let highest = options.order.unwrap_or_else(|| auto_order(levels));
    let lowest = options.order.unwrap_or(0);
    // A split that is significant at any order, as far as the order that follows from it agrees.
    let limit = SIGNIFICANCE / (highest + 1 - lowest) as f64;
    for at in lowest..=highest {
        if is_split(data, at, limit).0 {
            let (order, why_order) = by_order(true);
            let (split, why_split) = is_split(data, order, SIGNIFICANCE);
            if split {
                return (order, why_order, true, why_split);
            }
        }
    }
    let (order, why_order) = by_order(false);
    (order, why_order, false, is_split(data, order, SIGNIFICANCE).1)
}

/// Whether a K- of its own is significant at `order` and the attitudes allow it, with the reason.
fn is_split(data: Data<'_>, order: usize, limit: f64) -> (bool, String) {
    let (Some(one), Some(both)) = (data.fit(order, false), data.fit(order, true)) else {
        return (false, "the standstills do not determine a K- of its own".to_owned());
    };
    let Some(p) = both.p(&one) else {
        return (false, "the standstills leave nothing to judge a K- of its own by".to_owned());
    };
    if p >= limit {
        return (false, format!("a K- of its own is not significant (p {p:.2})"));
    }
    let Dilution { times_root_n, .. } = data.dilution(order, true);
    if times_root_n > MOST {
        let why = format!("a K- of its own is significant (p {p:.1e}), but D sqrt(n) would be {}", shown(times_root_n));
        return (false, why);
    }
    (true, format!("a K- of its own is significant (p {p:.1e})"))
}

/// The highest order that is considered for this number of temperatures: one is left over to judge it by.
fn auto_order(levels: usize) -> usize {
    levels.saturating_sub(2).min(MAX_AUTO_ORDER)
}

/// The order by F of the joint fit, and by what matters, from the highest down.
fn by_the_data(data: Data<'_>, levels: usize, split: bool) -> (usize, String) {
    let highest = auto_order(levels);
    if highest == 0 {
        let why = match levels {
            1 => "one temperature",
            _ => "two temperatures show no curvature",
        };
        return (0, why.to_owned());
    }
    let fits: Vec<Option<Fitted<'_>>> = (0..=highest).map(|order| data.fit(order, split)).collect();
    let limit = SIGNIFICANCE / highest as f64;
    for order in (1..=highest).rev() {
        let (Some(fit), Some(less)) = (&fits[order], &fits[order - 1]) else { continue };
        if let Some(p) = fit.p(less).filter(|p| *p < limit)
            && fit.matters(less)
        {
            return (
                order,
                format!("order {order} is significant (p {p:.1e}, limit {limit:.1e}) and large enough to matter"),
            );
        }
    }
    (0, format!("no higher order is both significant (limit {limit:.1e}) and large enough to matter"))
}

fn line_is_better(data: Data<'_>, split: bool) -> bool {
    let (Some(line), Some(constant)) = (data.fit(1, split), data.fit(0, split)) else { return false };
    line.p(&constant).is_some_and(|p| p < SIGNIFICANCE) && line.matters(&constant)
}

/// Refuses a split for an axis without readings of both signs, or without one near zero.
fn signs(readings: &[Reading], data: Data<'_>) -> Result<(), GravityOnlyError> {
    let (model, start) = GravityModel::new(readings, data.unknowns(0, false), data.gravity);
    for (axis, name) in AXIS_NAMES.iter().enumerate() {
        let parts = || readings.iter().map(|reading| model.force_of(&start, reading)[axis] / data.gravity);
        let lacks = [
            (parts().any(|part| part > SIGNED), "a positive reading"),
            (parts().any(|part| part < -SIGNED), "a negative reading"),
            (parts().any(|part| part.abs() < SIGNED), "a reading near zero"),
        ];
        if let Some((_, what)) = lacks.into_iter().find(|(there, _)| !there) {
            return Err(GravityOnlyError::Refused(format!(
                "--scale-factor split: {name} has no standstill with {what}, so its K+ and K- cannot be told from its bias; put the IMU down with {}",
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

fn standstills(n: usize) -> &'static str {
    if n == 1 { "standstill" } else { "standstills" }
}
