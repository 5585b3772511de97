//! Leave one sweep out: what a model predicts of a sweep that it was not fitted to.
//!
//! With a time constant that was given, one sweep each way is enough for the transient: then a quarter of a sweep is
//! left out at a time.

use super::blocks::{Column, Ramps};
use super::equations::NormalEquations;
use super::options::SOAK;
use super::result::Prediction;
use super::search::{Grid, LeftOut, total};

const STATIC: [Column; 2] = [Column::Constant, Column::Curve];
const HYSTERESIS: [Column; 3] = [Column::Constant, Column::Curve, Column::Plays];
/// With the plays.
const LAG_AND_HYSTERESIS: [Column; 5] =
    [Column::Constant, Column::Curve, Column::Transient, Column::Start, Column::Plays];
/// With a time constant that was given.
const LAG: [Column; 3] = [Column::Constant, Column::Curve, Column::Transient];

/// Groups of what is left out, at most.
const GROUPS: usize = 100;

/// Sums of squares of the four models.
#[derive(Clone, Default)]
struct Squares {
    sums: [f64; 4],
    count: usize,
}

/// The prediction errors of each bias; `None` if no sweep can be left out.
pub(super) fn predictions(ramps: &Ramps, grid: &Grid<'_>, given_s: Option<f64>) -> Vec<Option<Prediction>> {
    let with_plays = given_s.is_none();
    let lag = ramps.columns_of(if with_plays { &LAG_AND_HYSTERESIS } else { &LAG });
    let plays = ramps.columns(Column::Plays);
    let mut squares = vec![Squares::default(); ramps.biases.len()];
    for parts in left_out(ramps, given_s.is_some()) {
        let tau_s = given_s.unwrap_or_else(|| grid.minimum(&lag, &parts).tau_s);
        for (bias, squares) in ramps.biases.iter().zip(&mut squares) {
            let rows = ramps.rows(bias, tau_s);
            let equations = ramps.equations(&rows);
            let pieces = parts.iter().flat_map(|part| &equations[part.sweep][part.pieces.clone()]);
            let training = pieces.fold(total(ramps, &equations), NormalEquations::minus);
            let models =
                [&ramps.columns_of(&STATIC), &ramps.columns_of(&HYSTERESIS), &lag].map(|used| training.solve(used));
            let judged =
                parts.iter().flat_map(|part| &ramps.sweeps[part.sweep].pieces[part.pieces.clone()]).cloned().flatten();
            let soaked = |block: &usize| ramps.blocks[*block].age_s > SOAK * tau_s && ramps.blocks[*block].is_fitted();
            for block in judged.filter(soaked) {
                let row = &rows[block];
                let value = bias.values[block];
                let [static_curve, hysteresis, whole] = models.each_ref().map(|model| value - model.of(row));
                let of_plays: f64 = plays.clone().map(|column| models[2].values[column] * row[column]).sum();
                let residuals = [static_curve, hysteresis, whole, whole + of_plays];
                squares.sums.iter_mut().zip(residuals).for_each(|(sum, residual)| *sum += residual * residual);
                squares.count += 1;
            }
        }
    }
    let rms = |squares: &Squares| {
        let [static_curve, hysteresis, lag_and_hysteresis, written] =
            squares.sums.map(|sum| (sum / squares.count as f64).sqrt());
        (squares.count > 0).then_some(Prediction { static_curve, hysteresis, lag_and_hysteresis, written })
    };
    squares.iter().map(rms).collect()
}

/// The sweeps to leave out: those of recordings with another sweep, which gives the constant, and of these those
/// without which one recording still has both directions. If there are none: with a time constant that was `given`
/// every piece, otherwise all sweeps. One
/// at a time, if there are more of them in [`GROUPS`] groups.
fn left_out(ramps: &Ramps, given: bool) -> Vec<Vec<LeftOut>> {
    let others = |sweep: usize| {
        ramps.sweeps.iter().enumerate().filter(move |(other, _)| *other != sweep).map(|(_, other)| other)
    };
    let recording = |sweep: usize| ramps.sweeps[sweep].recording;
    let possible =
        (0..ramps.sweeps.len()).filter(|sweep| others(*sweep).any(|other| other.recording == recording(*sweep)));
    let possible: Vec<_> = possible.collect();
    let both = |sweep: &usize| {
        let has = |recording: usize, heating: bool| {
            others(*sweep).any(|other| other.recording == recording && other.heating == heating)
        };
        (0..ramps.recordings).any(|recording| has(recording, true) && has(recording, false))
    };
    let remain: Vec<_> = possible.iter().copied().filter(both).collect();
    let pieces = |sweep: usize| ramps.sweeps[sweep].pieces.len();
    let parts: Vec<LeftOut> = if remain.is_empty() && given {
        let every = possible.iter().flat_map(|&sweep| (0..pieces(sweep)).map(move |piece| (sweep, piece)));
        every.map(|(sweep, piece)| LeftOut { sweep, pieces: piece..piece + 1 }).collect()
    } else {
        let sweeps = if remain.is_empty() { possible } else { remain };
        sweeps.into_iter().map(|sweep| LeftOut { sweep, pieces: 0..pieces(sweep) }).collect()
    };
    // The sweeps of a recording are neighbours: they come into different groups.
    let groups = parts.len().min(GROUPS);
    (0..groups).map(|group| parts.iter().skip(group).step_by(groups).cloned().collect()).collect()
}
