//! The order of the curves: the one that best predicts sweeps that it was not fitted to. Neighbouring rows are the same
//! point, so that no F test holds, and a higher order always fits better.
//!
//! All biases have one order: what is left out is one or two sweeps more, so that the figure of a single axis is
//! chance.

use super::curves::{Part, Series, Shape, Weight, spread};

/// Highest order that is tried with two sweeps or more.
const HIGHEST: usize = 6;
/// With one sweep: nothing there tells a curve from hysteresis.
const HIGHEST_OF_ONE: usize = 3;
/// Blocks of time that take the place of sweeps where there is one.
const BLOCKS: usize = 4;
/// A higher order has to predict better by this part.
const BETTER: f64 = 0.02;
/// Errors below are as good as 0 \[g0 or deg/h\].
const NONE: f64 = 1e-12;

/// What was left out of the fits, one at a time.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum LeftOut {
    /// Sweeps: this many.
    Sweeps(usize),
    /// Blocks of time, since there is one sweep.
    Blocks(usize),
}

/// An order that was tried.
#[derive(Clone, Debug, PartialEq)]
pub struct TriedOrder {
    /// The order.
    pub order: usize,
    /// Standard deviation of what it leaves of what was left out, by bias \[g0 or deg/h\].
    pub errors: Vec<f64>,
}

/// How the order was found.
#[derive(Clone, Debug, PartialEq)]
pub struct OrderChoice {
    /// The order of all curves.
    pub order: usize,
    /// Whether the user gave it.
    pub given: bool,
    /// What was left out.
    pub left_out: LeftOut,
    /// The orders that could be tried.
    pub tried: Vec<TriedOrder>,
}

/// Chooses the order, at most `highest`. `sweeps` are those of all recordings.
pub(super) fn choose(series: &[Series], sweeps: &[Part], given: Option<usize>, highest: Option<usize>) -> OrderChoice {
    let (groups, left_out, most) = match sweeps {
        [one] => (blocks(one), LeftOut::Blocks(BLOCKS), HIGHEST_OF_ONE),
        _ => (sweeps.to_vec(), LeftOut::Sweeps(sweeps.len()), HIGHEST),
    };
    let most = most.min(highest.unwrap_or(most));
    let tried: Vec<TriedOrder> = (0..=most)
        .map_while(|order| {
            let errors: Option<Vec<f64>> = series.iter().map(|bias| error(bias, &groups, order)).collect();
            Some(TriedOrder { order, errors: errors? })
        })
        .collect();
    let score = |it: &TriedOrder| {
        it.errors.iter().map(|error| error.max(NONE).ln()).sum::<f64>() / it.errors.len().max(1) as f64
    };
    let best = tried.iter().map(score).fold(f64::INFINITY, f64::min);
    let chosen = tried.iter().find(|it| score(it) <= best + BETTER).map_or(0, |it| it.order);
    OrderChoice { order: given.unwrap_or(chosen), given: given.is_some(), left_out, tried }
}

/// Blocks of equal time.
fn blocks(sweep: &Part) -> Vec<Part> {
    let Part { recording, bins } = sweep;
    let at = |block: usize| bins.start + bins.len() * block / BLOCKS;
    (0..BLOCKS).map(|block| Part { recording: *recording, bins: at(block)..at(block + 1) }).collect()
}

/// What curves of this order leave of each group when it is left out, about its own mean, rms over the groups.
fn error(bias: &Series, groups: &[Part], order: usize) -> Option<f64> {
    let mut squares = 0.0;
    for (number, group) in groups.iter().enumerate() {
        let others: Vec<Part> =
            groups.iter().enumerate().filter(|(other, _)| *other != number).map(|(_, part)| part.clone()).collect();
        let shape = bias.fit(&others, order, Weight::Alike(bias.narrow()))?;
        squares += left(bias, group, &shape).powi(2);
    }
    Some((squares / groups.len() as f64).sqrt())
}

/// What a curve leaves of a group: standard deviation of the means of narrow bins.
fn left(bias: &Series, group: &Part, shape: &Shape) -> f64 {
    let means = bias.means(core::slice::from_ref(group), bias.narrow());
    let residuals: Vec<f64> = means.iter().map(|(_, mean)| mean.value - shape.at(mean.telemetry)).collect();
    spread(&residuals)[0]
}
