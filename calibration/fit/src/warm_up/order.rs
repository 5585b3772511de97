//! The order of the curves.
//!
//! The cubic of the autopilots is the order to beat. A higher one is taken if it predicts sweeps that it was not fitted
//! to clearly better: neighbouring rows are the same point, so that no test of the fit itself shows it, and a higher
//! order always fits better. One sweep does not distinguish a curve from hysteresis: there the cubic is the highest.
//!
//! A lower order is never chosen. Terms that are not there cost little: the error of a line fitted by a cubic is that
//! of the cubic, which the interval states. A term that is there and not seen costs as much as it is large: over
//! hundreds of simulated devices any rule that drops terms within 1.5 to 2 standard errors doubled the error of one now
//! and then. Blocks of time show nothing: in a warm-up that slows down they are blocks of temperature, and leaving one
//! out asks for an extrapolation over tens of degrees, which punishes every order.
//!
//! All biases have one order: a figure of a single axis is chance.

use super::curves::{Part, Scatter, Series, Shape, Weight, spread};

/// The order to beat.
const CUBIC: usize = 3;
/// Highest order that is tried with two sweeps or more.
const HIGHEST: usize = 6;
/// What an order above the cubic leaves of sweeps left out is below this part of what the cubic leaves: 0.8 of the
/// square.
const BETTER: f64 = 0.9;
/// Errors below are as good as 0 \[g0 or deg/h\].
const NONE: f64 = 1e-12;

/// An order that was tried.
#[derive(Clone, Debug, PartialEq)]
pub struct TriedOrder {
    /// The order.
    pub order: usize,
    /// The highest term of each bias in standard errors.
    pub terms: Vec<f64>,
    /// Standard deviation of what it leaves of sweeps that are left out, by bias \[g0 or deg/h\]; empty if there is one
    /// sweep.
    pub errors: Vec<f64>,
}

/// How the order was found.
#[derive(Clone, Debug, PartialEq)]
pub struct OrderChoice {
    /// The order of all curves.
    pub order: usize,
    /// Whether the user gave it.
    pub given: bool,
    /// Sweeps that were left out, one at a time; 0 if there is one sweep.
    pub sweeps_left_out: usize,
    /// The orders that could be tried.
    pub tried: Vec<TriedOrder>,
}

/// Chooses the order, at most `highest`. `scatters` are those of the series, and `sweeps` those of all recordings.
pub(super) fn choose(
    series: &[Series],
    scatters: &[Scatter],
    sweeps: &[Part],
    given: Option<usize>,
    highest: Option<usize>,
) -> OrderChoice {
    let most = if sweeps.len() > 1 { HIGHEST } else { CUBIC };
    let most = most.min(highest.unwrap_or(most));
    let tried: Vec<TriedOrder> = (0..=most).map_while(|order| tried(series, scatters, sweeps, order)).collect();
    let sweeps_left_out = if sweeps.len() > 1 { sweeps.len() } else { 0 };
    let order = given.unwrap_or_else(|| chosen(&tried));
    OrderChoice { order, given: given.is_some(), sweeps_left_out, tried }
}

/// `None` if the temperature does not determine the order.
fn tried(series: &[Series], scatters: &[Scatter], sweeps: &[Part], order: usize) -> Option<TriedOrder> {
    let of_bias = |(bias, scatter): (&Series, &Scatter)| {
        let cubic = bias.fit(&bias.whole(), order.max(CUBIC), Weight::Scatter(*scatter));
        let shape = bias.fit(&bias.whole(), order, Weight::Scatter(*scatter))?;
        let together = cubic.as_ref().unwrap_or(&shape).together(bias, *scatter);
        Some(shape.significance(together))
    };
    let terms: Option<Vec<f64>> = series.iter().zip(scatters).map(of_bias).collect();
    let errors = |(bias, scatter): (&Series, &Scatter)| error(bias, *scatter, sweeps, order);
    let errors: Option<Vec<f64>> = series.iter().zip(scatters).map(errors).collect();
    Some(TriedOrder { order, terms: terms?, errors: errors.unwrap_or_default() })
}

/// The cubic, or the highest order below it that the temperature determines, unless a higher one predicts better.
fn chosen(tried: &[TriedOrder]) -> usize {
    let Some(cubic) = tried.get(CUBIC).or(tried.last()) else { return 0 };
    let better = tried[cubic.order..].iter().filter(|it| is_better(&it.errors, &cubic.errors));
    let best = better.min_by(|a, b| mean_log(&a.errors).total_cmp(&mean_log(&b.errors)));
    best.unwrap_or(cubic).order
}

/// Whether errors are clearly below those of the cubic on the whole, and above them for no bias.
fn is_better(errors: &[f64], cubic: &[f64]) -> bool {
    let is_whole = !errors.is_empty() && errors.len() == cubic.len();
    is_whole
        && mean_log(errors) < mean_log(cubic) + libm::log(BETTER)
        && errors.iter().zip(cubic).all(|(error, cubic)| error <= cubic)
}

fn mean_log(errors: &[f64]) -> f64 {
    errors.iter().map(|error| libm::log(error.max(NONE))).sum::<f64>() / errors.len().max(1) as f64
}

/// What curves of this order leave of each sweep when it is left out, about its own mean, rms over the sweeps; `None`
/// if no sweep can be left out.
fn error(bias: &Series, scatter: Scatter, sweeps: &[Part], order: usize) -> Option<f64> {
    if sweeps.len() < 2 {
        return None;
    }
    let mut squares = 0.0;
    for (number, sweep) in sweeps.iter().enumerate() {
        let others: Vec<Part> =
            sweeps.iter().enumerate().filter(|(other, _)| *other != number).map(|(_, part)| part.clone()).collect();
        let shape = bias.fit(&others, order, Weight::Scatter(scatter))?;
        squares += left(bias, sweep, &others, &shape).powi(2);
    }
    Some((squares / sweeps.len() as f64).sqrt())
}

/// What a curve leaves of a sweep within the temperature of the others that it was fitted to: standard deviation of the
/// means of narrow bins.
fn left(bias: &Series, sweep: &Part, others: &[Part], shape: &Shape) -> f64 {
    let temperature = others.iter().flat_map(|part| bias.bins(part)).map(|bin| bin.temperature);
    let [low, high] =
        temperature.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], it| [low.min(it), high.max(it)]);
    let means = bias.means(core::slice::from_ref(sweep), bias.narrow());
    let within = means.iter().map(|(_, mean)| mean).filter(|mean| (low..=high).contains(&mean.temperature));
    let residuals: Vec<f64> = within.map(|mean| mean.value - shape.at(mean.temperature)).collect();
    spread(&residuals)[0]
}
