//! Motion: what is far less quiet than the quietest lasting part of a recording, or wanders where it is quietest.

use super::account::LeftOutCause;
use super::bins::Bins;
use isotherm_shared::wire::AXES;
use isotherm_statistics::median;

/// The quietest lasting part is the lowest tenth of the windows.
const QUIETEST: f64 = 0.1;
/// At rest, the noise of an axis varies by up to this factor in variance: temperature, and chance.
const FACTOR: f64 = 25.0;
/// Bins on each side of a window, of the changes from bin to bin.
const SIDE: usize = 6;
/// Bins next to a motion that may belong to it.
const MARGIN: usize = 2;
/// A shorter rest between two motions is none, in bins.
const SHORTEST: usize = 8;
/// Bins of a mean …
const MEAN: usize = 10;
/// … which at rest differs from the next one by less \[rad\] …
const HAND: f64 = 5e-3;
/// … or by less than so many times what the noise of the bins explains.
const NOISE: f64 = 3.0;

/// Whether the IMU moved, by bin.
pub(super) fn moving(bins: &Bins, causes: &[Option<LeftOutCause>]) -> Vec<bool> {
    let mut is_moving = vec![false; bins.len()];
    let is_known: Vec<bool> = causes.iter().map(Option::is_some).collect();
    for triad in bins.rates.chunks(AXES).zip(bins.variances.chunks(AXES)).zip(bins.steps.chunks(AXES)) {
        let ((rates, variances), steps) = triad;
        let of_rows: Vec<_> = variances.iter().zip(steps).map(|(all, step)| logs(all, *step)).collect();
        let of_bins: Vec<_> = rates.iter().zip(steps).map(|(all, step)| logs(&changes(all), *step)).collect();
        for logs in [of_rows, of_bins] {
            for (bin, excess) in excesses(&logs, &is_known).into_iter().enumerate() {
                is_moving[bin] |= excess > libm::log(FACTOR);
            }
        }
    }
    let mut is_moving = widened(&is_moving);
    let rest: Vec<usize> = (0..bins.len()).filter(|bin| !is_moving[*bin] && !is_known[*bin]).collect();
    if wanders(bins, &rest) {
        is_moving.fill(true);
    }
    is_moving
}

/// Logarithms of variances; under a step a variance says nothing.
fn logs(variances: &[Option<f64>], step: f64) -> Vec<Option<f64>> {
    // A value that changes between two steps has a quarter of a squared step.
    let floor = step * step / 4.0;
    variances
        .iter()
        .map(|variance| variance.map(|variance| libm::log(variance.max(floor).max(f64::MIN_POSITIVE))))
        .collect()
}

/// Variance of a bin of white noise, by the median of the squared second differences nearby.
fn changes(rates: &[f64]) -> Vec<Option<f64>> {
    // Median of chi-square with a degree of freedom.
    const MEDIAN: f64 = 0.4549;
    let second: Vec<f64> =
        rates.windows(3).map(|three| (three[0] - 2.0 * three[1] + three[2]).powi(2) / 6.0 / MEDIAN).collect();
    let of_bin = |bin: usize| {
        let near = bin.saturating_sub(SIDE + 1)..(bin + SIDE).min(second.len());
        (near.len() > SIDE).then(|| median(second[near].iter().copied()))
    };
    (0..rates.len()).map(of_bin).collect()
}

/// How far each bin is over the quietest lasting part, mean over the axes.
fn excesses(logs: &[Vec<Option<f64>>], is_known: &[bool]) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); is_known.len()];
    for axis in logs {
        let rest = axis.iter().zip(is_known).filter(|(_, known)| !**known);
        let mut all: Vec<f64> = rest.filter_map(|(log, _)| *log).collect();
        if all.is_empty() {
            continue;
        }
        let place = (all.len() as f64 * QUIETEST) as usize;
        let quietest = *all.select_nth_unstable_by(place, f64::total_cmp).1;
        // An axis that is dead, or coarse, for a tenth of the recording says nothing.
        if quietest <= libm::log(f64::MIN_POSITIVE) + 1.0 {
            continue;
        }
        for (sum, log) in sums.iter_mut().zip(axis) {
            if let Some(log) = log {
                sum.0 += log - quietest;
                sum.1 += 1.0;
            }
        }
    }
    sums.into_iter().map(|(sum, count)| if count > 0.0 { sum / count } else { 0.0 }).collect()
}

/// Motions with what is near, and with short rests between them.
fn widened(is_moving: &[bool]) -> Vec<bool> {
    let n = is_moving.len();
    let mut wide = vec![false; n];
    for bin in (0..n).filter(|bin| is_moving[*bin]) {
        wide[bin.saturating_sub(MARGIN)..(bin + MARGIN + 1).min(n)].fill(true);
    }
    let mut last: Option<usize> = None;
    for bin in 0..n {
        if wide[bin] {
            if let Some(last) = last.filter(|last| bin - last <= SHORTEST) {
                wide[last..bin].fill(true);
            }
            last = Some(bin);
        }
    }
    wide
}

/// Whether the means of the accelerometers wander where they are quietest: a hand, or a vehicle.
fn wanders(bins: &Bins, rest: &[usize]) -> bool {
    let blocks: Vec<&[usize]> = rest.chunks_exact(MEAN).filter(|bins| bins[MEAN - 1] - bins[0] == MEAN - 1).collect();
    let (mut of_means, mut of_noise, mut length) = (0.0, 0.0, 0.0);
    for rates in &bins.rates[..AXES] {
        let mean = |bins: &[usize]| bins.iter().map(|bin| rates[*bin]).sum::<f64>() / MEAN as f64;
        let near = |pair: &&[&[usize]]| pair[1][0] - pair[0][0] == MEAN;
        let differences = blocks.windows(2).filter(near).map(|pair| (mean(pair[1]) - mean(pair[0])).powi(2));
        of_means += median(differences);
        let noise = changes(rates);
        of_noise += 2.0 * median(rest.iter().filter_map(|bin| noise[*bin])) / MEAN as f64 * 0.4549;
        length += median(rest.iter().map(|bin| rates[*bin])).powi(2);
    }
    // NaN without two blocks.
    of_means > HAND.powi(2) * length && of_means > NOISE.powi(2) * of_noise
}
