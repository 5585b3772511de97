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

use super::curves::{Mean, Part, Scatter, Series, Shape, Weight, spread};

/// The order to beat.
const CUBIC: usize = 3;
/// Highest order that is tried with two sweeps or more.
const HIGHEST: usize = 6;
/// Sweeps are left out one at a time, if there are more of them in this many groups: every one is predicted once, and
/// the time rises with their number, not with its square.
const GROUPS: usize = 100;
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
    let errors: Vec<Vec<Option<f64>>> =
        series.iter().zip(scatters).map(|(bias, scatter)| errors(bias, *scatter, sweeps, most)).collect();
    let tried = (0..=most).map_while(|order| {
        let errors: Option<Vec<f64>> = errors.iter().map(|of_bias| of_bias[order]).collect();
        Some(TriedOrder { order, terms: terms(series, scatters, order)?, errors: errors.unwrap_or_default() })
    });
    let tried: Vec<TriedOrder> = tried.collect();
    let sweeps_left_out = if sweeps.len() > 1 { sweeps.len() } else { 0 };
    let order = given.unwrap_or_else(|| chosen(&tried));
    OrderChoice { order, given: given.is_some(), sweeps_left_out, tried }
}

/// The highest term of each bias in standard errors; `None` if the temperature does not determine the order.
fn terms(series: &[Series], scatters: &[Scatter], order: usize) -> Option<Vec<f64>> {
    let of_bias = |(bias, scatter): (&Series, &Scatter)| {
        let cubic = bias.fit(&bias.whole(), order.max(CUBIC), Weight::Scatter(*scatter));
        let shape = bias.fit(&bias.whole(), order, Weight::Scatter(*scatter))?;
        let together = cubic.as_ref().unwrap_or(&shape).together(bias, *scatter);
        Some(shape.significance(together))
    };
    series.iter().zip(scatters).map(of_bias).collect()
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

/// What curves of the orders up to `most` leave of each sweep when it is left out, about its own mean, rms over the
/// sweeps; `None` for an order if no sweep can be left out.
fn errors(bias: &Series, scatter: Scatter, sweeps: &[Part], most: usize) -> Vec<Option<f64>> {
    let mut squares = vec![(sweeps.len() > 1).then_some(0.0); most + 1];
    let groups = sweeps.len().min(GROUPS);
    for group in 0..groups {
        let of_group = |number: usize| number % groups == group;
        let part = |is_in: bool| {
            let parts = sweeps.iter().enumerate().filter(move |(number, _)| of_group(*number) == is_in);
            parts.map(|(_, part)| part.clone()).collect::<Vec<_>>()
        };
        let (own, others) = (part(true), part(false));
        let temperature = others.iter().flat_map(|part| bias.bins(part)).map(|bin| bin.temperature);
        let range = temperature.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], it| [low.min(it), high.max(it)]);
        let means = bias.means(&others, bias.narrow());
        let own: Vec<Vec<(i64, Mean)>> =
            own.iter().map(|sweep| bias.means(core::slice::from_ref(sweep), bias.narrow())).collect();
        for (order, sum) in squares.iter_mut().enumerate() {
            let Some(before) = *sum else { continue };
            let shape = bias.fit_to(&means, order, Weight::Scatter(scatter));
            *sum = shape.map(|shape| own.iter().fold(before, |sum, sweep| sum + left(sweep, range, &shape).powi(2)));
        }
    }
    squares.into_iter().map(|sum| Some((sum? / sweeps.len() as f64).sqrt())).collect()
}

/// What a curve leaves of the means of a sweep within the temperature that it was fitted to: their standard deviation.
fn left(means: &[(i64, Mean)], [low, high]: [f64; 2], shape: &Shape) -> f64 {
    let within = means.iter().map(|(_, mean)| mean).filter(|mean| (low..=high).contains(&mean.temperature));
    let residuals: Vec<f64> = within.map(|mean| mean.value - shape.at(mean.temperature)).collect();
    spread(&residuals)[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transients::BinValue;
    use isotherm_shared::units::SensorKind;

    /// Sweeps of a bias of order 5, each a recording of its own.
    fn of_sweeps(count: usize) -> OrderChoice {
        let bin = |sweep: usize, number: usize| {
            let x = f64::from(number as u32) / 50.0 - 1.0;
            let value = 1e-3 * (16.0 * x.powi(5) - 20.0 * x.powi(3) + 5.0 * x) + sweep as f64;
            let value = value + 1e-5 * libm::sin((number * 11 + sweep * 5) as f64);
            BinValue { age_s: number as f64, temperature: 20.0 + 20.0 * x, value, difference: 0.0 }
        };
        let recordings: Vec<Vec<BinValue>> =
            (0..count).map(|sweep| (0..100).map(|number| bin(sweep, number)).collect()).collect();
        let series = Series { kind: SensorKind::Accelerometer, axis: 0, range: [0.0, 40.0], recordings };
        let scatters = [series.scatter().unwrap()];
        let sweeps = series.whole();
        choose(&[series], &scatters, &sweeps, None, None)
    }

    #[test]
    fn sweeps_are_left_out_in_groups_where_there_are_many() {
        for count in [2, GROUPS, GROUPS + 1, 2 * GROUPS] {
            let choice = of_sweeps(count);
            assert_eq!([choice.order, choice.sweeps_left_out], [5, count]);
            let errors: Vec<f64> = choice.tried.iter().map(|tried| tried.errors[0]).collect();
            // The noise has 1e-5, and the terms of order 5 over a hundred times as much.
            assert!(errors[3] > 5e-4 && errors[5] < 2e-5, "{count}: {errors:?}");
        }
        assert!(of_sweeps(1).tried.iter().all(|tried| tried.errors.is_empty()));
    }
}
