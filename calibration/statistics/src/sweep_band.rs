//! How far the sweeps of ramps disagree at the same temperature: the honest error of a bias curve that they give.
//!
//! Sweeps are compared by their means in 12 bins of the range, so that each temperature weighs alike. A recording has a
//! constant of its own, which is taken off: what polynomials of order 3, one for each sweep, have at mid range.
//!
//! Two sweeps disagree if a parabola through the differences of their means is more than noise makes of it. The noise
//! is that of neighbouring values, or what the differences scatter about the parabola by, whichever is larger.

use crate::diagnostics::median;
use crate::hysteresis::BINS;
use crate::least_squares::least_squares;
use nalgebra::{DMatrix, DVector};

/// Highest order of the fit of a sweep.
const ORDER: usize = 3;
/// Coefficients of the parabola through the differences of two sweeps.
const PARABOLA: usize = 3;
/// A parabola that is more than this many times as large as noise makes it (root mean square) is a disagreement. 13 is
/// the quantile of Fisher's distribution that noise exceeds once in a thousand, with 3 and 9 degrees of freedom.
const DISAGREE: f64 = 3.6;
/// Parts of the largest value that rounding may make.
const ROUNDING: f64 = 1e-9;

/// What one sweep shows.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepValues {
    /// Number of its recording: all sweeps of a recording have one unknown constant.
    pub recording: usize,
    /// Whether the temperature rises.
    pub heating: bool,
    /// Temperature and value. Values less a curve that is common to all sweeps show the same, with less error within
    /// bins.
    pub values: Vec<(f64, f64)>,
}

/// How far sweeps are apart, in the unit of their values.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepBand {
    /// Half of the largest difference of two sweeps' means in a bin: the error of the curve, not negative.
    pub half_width: f64,
    /// Temperature in the middle of that bin.
    pub at: f64,
    /// Bins with two sweeps, of 12.
    pub bins: usize,
    /// Bins with heating and cooling, of 12.
    pub both_directions: usize,
    /// The two sweeps whose means differ most, of those that differ by more than their noise.
    pub disagreement: Option<Disagreement>,
}

/// Two sweeps that differ by more than their errors.
#[derive(Clone, Debug, PartialEq)]
pub struct Disagreement {
    /// Largest difference of their means in a bin.
    pub difference: f64,
    /// How many times as large as noise makes it the difference is over the whole range, root mean square.
    pub errors: f64,
    /// Temperature there.
    pub at: f64,
    /// Indices of the sweeps.
    pub sweeps: [usize; 2],
}

/// The band between sweeps over `range`; `None` where no two sweeps share a bin. A sweep that does not reach the middle
/// of the range has the constant of the others of its recording. A recording none of whose sweeps reaches it has no
/// constant, and does not count.
///
/// ```
/// use isotherm_statistics::{SweepValues, sweep_band};
///
/// // Heating reads 1.5 ug0 more than cooling; the attitude adds 900 to the second recording.
/// let sweep = |recording, heating, apart| {
///     let values = (0..=240).map(|i| f64::from(i) / 60.0).map(|u| (u, 3.0 * u * u + apart)).collect();
///     SweepValues { recording, heating, values }
/// };
/// let sweeps = [sweep(0, true, 1.5), sweep(0, false, 0.0), sweep(1, true, 901.5), sweep(1, false, 900.0)];
/// let found = sweep_band(&sweeps, [0.0, 4.0]);
/// assert!(found.is_some_and(|band| (band.half_width - 0.75).abs() < 1e-9 && band.both_directions == 12));
/// assert_eq!(sweep_band(&sweeps[..1], [0.0, 4.0]), None);
/// ```
#[must_use]
pub fn sweep_band(sweeps: &[SweepValues], range: [f64; 2]) -> Option<SweepBand> {
    let alone: Vec<(usize, Alone)> =
        sweeps.iter().enumerate().filter_map(|(index, sweep)| Some((index, Alone::of(sweep, range)?))).collect();
    let constants: Vec<Option<f64>> = alone
        .iter()
        .map(|(index, _)| {
            let own = |other: &&(usize, Alone)| sweeps[other.0].recording == sweeps[*index].recording;
            let middles: Vec<f64> = alone.iter().filter(own).filter_map(|(_, other)| other.middle).collect();
            (!middles.is_empty()).then(|| middles.iter().sum::<f64>() / middles.len() as f64)
        })
        .collect();
    let with_constant =
        |((index, sweep), constant): ((usize, Alone), Option<f64>)| Some((index, sweep.less(constant?)));
    let alone: Vec<(usize, Alone)> = alone.into_iter().zip(constants).filter_map(with_constant).collect();
    let [low, high] = range;
    let at = |bin: usize| low + (high - low) * (bin as f64 + 0.5) / BINS as f64;
    let width = |bin: usize| {
        let means: Vec<f64> = alone.iter().filter_map(|(_, sweep)| sweep.means[bin]).map(|(_, mean)| mean).collect();
        let extreme = |pick: fn(f64, f64) -> f64, start| means.iter().copied().fold(start, pick);
        (means.len() > 1).then(|| extreme(f64::max, f64::NEG_INFINITY) - extreme(f64::min, f64::INFINITY))
    };
    let widths: Vec<(usize, f64)> = (0..BINS).filter_map(|bin| Some((bin, width(bin)?))).collect();
    let (bin, widest) = widths.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let both = |bin: &usize| {
        let has = |(index, sweep): &(usize, Alone)| sweep.means[*bin].map(|_| &sweeps[*index]);
        let there: Vec<&SweepValues> = alone.iter().filter_map(has).collect();
        there.iter().any(|a| there.iter().any(|b| a.heating != b.heating))
    };
    Some(SweepBand {
        half_width: widest / 2.0,
        at: at(bin),
        bins: widths.len(),
        both_directions: (0..BINS).filter(both).count(),
        disagreement: disagreement(sweeps, &alone, at),
    })
}

/// The pair of sweeps that differs most, of those that disagree.
fn disagreement(sweeps: &[SweepValues], alone: &[(usize, Alone)], at: impl Fn(usize) -> f64) -> Option<Disagreement> {
    let pairs = (0..alone.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
    let all = pairs.filter_map(|(a, b)| {
        let [(first, one), (second, other)] = [&alone[a], &alone[b]];
        let errors = one.against(other, sweeps[*first].recording == sweeps[*second].recording)?;
        let difference = |bin: usize| Some((bin, (one.means[bin]?.1 - other.means[bin]?.1).abs()));
        let (bin, difference) = (0..BINS).filter_map(difference).max_by(|a, b| a.1.total_cmp(&b.1))?;
        (errors > DISAGREE).then(|| Disagreement { difference, errors, at: at(bin), sweeps: [*first, *second] })
    });
    all.max_by(|a, b| a.difference.total_cmp(&b.difference))
}

/// One sweep, fitted separately.
struct Alone {
    /// Mean place in the range (-1 to 1) and mean value of each bin.
    means: [Option<(f64, f64)>; BINS],
    /// Number of values of each bin.
    counts: [usize; BINS],
    /// Variance of a value, as neighbours show it.
    noise: f64,
    /// Value of the fit at mid range, if the sweep reaches it.
    middle: Option<f64>,
}

impl Alone {
    /// `None` if it has too few bins for a fit.
    fn of(sweep: &SweepValues, range: [f64; 2]) -> Option<Self> {
        let (means, counts) = bin_means(&sweep.values, range);
        let points: Vec<(f64, f64)> = means.iter().flatten().copied().collect();
        let ends = [means.iter().position(Option::is_some)?, means.iter().rposition(Option::is_some)?];
        if points.len() < ORDER + 2 {
            return None;
        }
        let reaches_middle = ends[0] < BINS / 2 && ends[1] >= BINS / 2;
        let middle = fitted(&points)?;
        let noise = noise(&sweep.values);
        Some(Self { means, counts, noise, middle: reaches_middle.then_some(middle) })
    }

    /// How many times as large as noise makes it the parabola through the differences to another sweep is, root mean
    /// square; `None` if they share too few bins. Sweeps of two recordings have two constants, which show nothing.
    fn against(&self, other: &Self, of_one_recording: bool) -> Option<f64> {
        let difference = |bin: usize| {
            let ((place, value), (_, against)) = (self.means[bin]?, other.means[bin]?);
            let variance = self.noise / self.counts[bin] as f64 + other.noise / other.counts[bin] as f64;
            Some((place, value - against, variance.sqrt().recip()))
        };
        let all: Vec<(f64, f64, f64)> = (0..BINS).filter_map(difference).collect();
        let freedom = all.len().checked_sub(PARABOLA).filter(|freedom| *freedom > 0)?;
        let jacobian = |columns: usize| DMatrix::from_fn(all.len(), columns, |i, k| all[i].0.powi(k as i32) * all[i].2);
        let residual = DVector::from_fn(all.len(), |i, _| -all[i].1 * all[i].2);
        let left = |columns: usize| {
            let jacobian = jacobian(columns);
            Some((&jacobian * least_squares(&jacobian, &residual)?.change + &residual).norm_squared())
        };
        let without = if of_one_recording { residual.norm_squared() } else { left(1)? };
        let told = PARABOLA - usize::from(!of_one_recording);
        let left = left(PARABOLA)?;
        let scale = (left / freedom as f64).max(1.0);
        Some(((without - left) / told as f64 / scale).sqrt())
    }

    /// The sweep without the constant of its recording.
    fn less(mut self, constant: f64) -> Self {
        self.means.iter_mut().flatten().for_each(|(_, mean)| *mean -= constant);
        self
    }
}

/// Means of place and value of each bin, and the number of its values.
fn bin_means(values: &[(f64, f64)], [low, high]: [f64; 2]) -> ([Option<(f64, f64)>; BINS], [usize; BINS]) {
    let mut sums = [(0.0, 0.0, 0_usize); BINS];
    for (temperature, value) in values {
        let part = (temperature - low) / (high - low);
        let (places, sum, count) = &mut sums[((part * BINS as f64) as usize).min(BINS - 1)];
        *places += 2.0 * part - 1.0;
        *sum += value;
        *count += 1;
    }
    let means = sums.map(|(places, sum, count)| (count > 0).then(|| (places / count as f64, sum / count as f64)));
    (means, sums.map(|(_, _, count)| count))
}

/// Variance of the noise of a value: second differences have neither level nor slope.
fn noise(values: &[(f64, f64)]) -> f64 {
    /// Variance of a second difference, and median size, of values of variance 1.
    const OF_DIFFERENCE: (f64, f64) = (6.0, 0.6745);
    let size = median(values.windows(3).map(|of| (of[2].1 - 2.0 * of[1].1 + of[0].1).abs())) / OF_DIFFERENCE.1;
    let rounding = ROUNDING * values.iter().map(|(_, value)| value.abs()).fold(f64::MIN_POSITIVE.sqrt(), f64::max);
    // Too few values have no noise that is known.
    if size.is_nan() { f64::INFINITY } else { (size * size / OF_DIFFERENCE.0).max(rounding * rounding) }
}

/// What the polynomial through the points has at mid range; `None` if they do not determine it.
fn fitted(points: &[(f64, f64)]) -> Option<f64> {
    let jacobian = DMatrix::from_fn(points.len(), ORDER + 1, |i, k| points[i].0.powi(k as i32));
    let residual = DVector::from_fn(points.len(), |i, _| -points[i].1);
    Some(least_squares(&jacobian, &residual)?.change[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sweep(recording: usize, heating: bool, value: impl Fn(f64) -> f64) -> SweepValues {
        let values = (0..480).map(|i| f64::from(i) / 60.0 - 4.0).map(|u| (u, value(u)));
        SweepValues { recording, heating, values: values.collect() }
    }

    #[test]
    fn sweeps_that_differ_by_their_noise_agree() {
        let noise = |u: f64, seed: usize| {
            let hash = libm::sin(u * 60.0 + 1e4 * seed as f64) * 43_758.545_3;
            hash - hash.floor() - 0.5
        };
        let drawn = |seed: usize| {
            let all: Vec<_> = (0..4).map(|k| sweep(k / 2, k % 2 == 0, |u| noise(u, 4 * seed + k))).collect();
            sweep_band(&all, [-4.0, 4.0]).unwrap()
        };
        let bands: Vec<_> = (1..=200).map(drawn).collect();
        assert!(bands.iter().all(|band| band.half_width < 0.2));
        let all: Vec<_> = (0..4).map(|k| sweep(k / 2, k % 2 == 0, |u| noise(u, k))).collect();
        let alarms = bands.iter().filter(|band| band.disagreement.is_some()).count();
        println!("{alarms} of 200");
        assert!(alarms <= 4, "{alarms}");
        let other = [all[0].clone(), all[1].clone(), sweep(1, true, |u| 0.2 * u * u + noise(u, 7))];
        let band = sweep_band(&other, [-4.0, 4.0]).unwrap();
        let found = band.disagreement.unwrap();
        assert!((2.0..4.0).contains(&found.difference) && found.sweeps.contains(&2), "{found:?}");
    }

    #[test]
    fn a_sweep_beside_the_middle_counts_with_the_constant_of_its_recording() {
        let upper = |recording: usize| SweepValues {
            values: sweep(recording, false, |u| u * u + 2.0).values[280..].to_vec(),
            ..sweep(recording, false, |u| u)
        };
        let both = [sweep(0, true, |u| u * u), sweep(0, false, |u| u * u + 0.2)];
        let width = |sweeps: &[SweepValues]| sweep_band(sweeps, [-4.0, 4.0]).unwrap().half_width;
        assert!((width(&both) - 0.1).abs() < 1e-9);
        assert!((width(&[&both[..], &[upper(0)]].concat()) - 1.0).abs() < 1e-9);
        // The constant of another recording is not known.
        assert!((width(&[&both[..], &[upper(1)]].concat()) - 0.1).abs() < 1e-9);
    }

    #[test]
    fn what_shares_no_bin_has_no_band() {
        let low = SweepValues { values: sweep(0, true, |u| u).values[..300].to_vec(), ..sweep(0, true, |u| u) };
        let high = SweepValues { values: sweep(1, false, |u| u).values[470..].to_vec(), ..sweep(1, false, |u| u) };
        assert_eq!(sweep_band(&[low.clone(), high], [-4.0, 4.0]), None);
        let band = sweep_band(&[low, sweep(0, false, |u| u)], [-4.0, 4.0]).unwrap();
        assert_eq!((band.bins, band.both_directions), (8, 8));
        assert_eq!(sweep_band(&[], [0.0, 1.0]), None);
        let broken = sweep(0, true, |_| f64::NAN);
        assert_eq!(sweep_band(&[broken.clone(), broken], [-4.0, 4.0]), None);
    }
}
