//! How far the sweeps of ramps disagree at the same telemetry: the honest error of a bias curve that they give.
//!
//! Each sweep is fitted alone: a polynomial of order 3 through its means in 12 bins of the range, so that each
//! temperature weighs alike. What the fits have at mid range is the constant of a recording, and is taken off.

use crate::hysteresis::BINS;
use crate::least_squares::least_squares;
use nalgebra::{DMatrix, DVector};

/// Highest order of the fit of a sweep.
const ORDER: usize = 3;
/// Fits that differ by more than this many of their errors disagree.
const DISAGREE: f64 = 4.0;

/// What one sweep shows.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepValues {
    /// Number of its recording: all sweeps of a recording have one unknown constant.
    pub recording: usize,
    /// Whether the telemetry rises.
    pub heating: bool,
    /// Telemetry and value. Values less a curve that is common to all sweeps tell the same, with less error within
    /// bins.
    pub values: Vec<(f64, f64)>,
}

/// How far sweeps are apart, in the unit of their values.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepBand {
    /// Half of the largest difference of two sweeps' means in a bin: the error of the curve, not negative.
    pub half_width: f64,
    /// Telemetry in the middle of that bin.
    pub at: f64,
    /// Bins with two sweeps, of 12.
    pub bins: usize,
    /// Bins with heating and cooling of one recording, of 12.
    pub both_directions: usize,
    /// The two sweeps whose fits differ most, of those that differ by over 4 jackknife errors.
    pub disagreement: Option<Disagreement>,
}

/// Two sweeps that differ by more than their errors.
#[derive(Clone, Debug, PartialEq)]
pub struct Disagreement {
    /// Difference of their fits.
    pub difference: f64,
    /// The same in standard errors.
    pub errors: f64,
    /// Telemetry there.
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
        there.iter().any(|a| there.iter().any(|b| a.recording == b.recording && a.heating != b.heating))
    };
    Some(SweepBand {
        half_width: widest / 2.0,
        at: at(bin),
        bins: widths.len(),
        both_directions: (0..BINS).filter(both).count(),
        disagreement: disagreement(&alone, at),
    })
}

/// The pair of sweeps that differs most, of those that disagree.
fn disagreement(alone: &[(usize, Alone)], at: impl Fn(usize) -> f64) -> Option<Disagreement> {
    // The jackknife error of one fit in one bin is uncertain itself: it counts at least as the usual one.
    let errors: Vec<f64> = alone.iter().flat_map(|(_, sweep)| sweep.fits).flatten().map(|(_, error)| error).collect();
    let usual = (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt();
    let pairs = (0..alone.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
    let all = pairs.flat_map(|pair| (0..BINS).map(move |bin| (pair, bin))).filter_map(|((a, b), bin)| {
        let [(first, one), (second, other)] = [&alone[a], &alone[b]];
        let ((value, error), (against, its_error)) = (one.fits[bin]?, other.fits[bin]?);
        let (difference, error) = ((value - against).abs(), error.max(usual).hypot(its_error.max(usual)));
        (difference > DISAGREE * error).then(|| Disagreement {
            difference,
            errors: difference / error,
            at: at(bin),
            sweeps: [*first, *second],
        })
    });
    all.max_by(|a, b| a.difference.total_cmp(&b.difference))
}

/// One sweep, fitted alone.
struct Alone {
    /// Mean place in the range (-1 to 1) and mean value of each bin.
    means: [Option<(f64, f64)>; BINS],
    /// Value of the fit in the middle of each bin that has a mean, and its jackknife error.
    fits: [Option<(f64, f64)>; BINS],
    /// Value of the fit at mid range, if the sweep reaches it.
    middle: Option<f64>,
}

impl Alone {
    /// `None` if it has too few bins for a fit.
    fn of(sweep: &SweepValues, range: [f64; 2]) -> Option<Self> {
        let means = bin_means(&sweep.values, range);
        let points: Vec<(f64, f64)> = means.iter().flatten().copied().collect();
        let ends = [means.iter().position(Option::is_some)?, means.iter().rposition(Option::is_some)?];
        if points.len() < ORDER + 2 {
            return None;
        }
        let reaches_middle = ends[0] < BINS / 2 && ends[1] >= BINS / 2;
        let places: Vec<f64> = (0..BINS).map(centre).chain([0.0]).collect();
        let whole = fitted(&points, &places)?;
        let mut squares = vec![0.0; places.len()];
        for left_out in 0..points.len() {
            let others: Vec<_> =
                points.iter().enumerate().filter(|(i, _)| *i != left_out).map(|(_, point)| *point).collect();
            let values = fitted(&others, &places)?;
            squares.iter_mut().zip(values.iter().zip(&whole)).for_each(|(sum, (a, b))| *sum += (a - b).powi(2));
        }
        let n = points.len() as f64;
        let error = |bin: usize| ((n - 1.0) / n * squares[bin]).sqrt();
        let fits = core::array::from_fn(|bin| means[bin].map(|_| (whole[bin], error(bin))));
        Some(Self { means, fits, middle: reaches_middle.then_some(whole[BINS]) })
    }

    /// The sweep without the constant of its recording.
    fn less(mut self, constant: f64) -> Self {
        self.means.iter_mut().flatten().for_each(|(_, mean)| *mean -= constant);
        self.fits.iter_mut().flatten().for_each(|(value, _)| *value -= constant);
        self
    }
}

/// Middle of a bin, from -1 to 1.
fn centre(bin: usize) -> f64 {
    (2.0 * bin as f64 + 1.0) / BINS as f64 - 1.0
}

fn bin_means(values: &[(f64, f64)], [low, high]: [f64; 2]) -> [Option<(f64, f64)>; BINS] {
    let mut sums = [(0.0, 0.0, 0_usize); BINS];
    for (telemetry, value) in values {
        let part = (telemetry - low) / (high - low);
        let (places, sum, count) = &mut sums[((part * BINS as f64) as usize).min(BINS - 1)];
        *places += 2.0 * part - 1.0;
        *sum += value;
        *count += 1;
    }
    sums.map(|(places, sum, count)| (count > 0).then(|| (places / count as f64, sum / count as f64)))
}

/// The polynomial through the points, at the places; `None` if they do not determine it.
fn fitted(points: &[(f64, f64)], places: &[f64]) -> Option<Vec<f64>> {
    let power = |x: f64, k: usize| x.powi(k as i32);
    let jacobian = DMatrix::from_fn(points.len(), ORDER + 1, |i, k| power(points[i].0, k));
    let residual = DVector::from_fn(points.len(), |i, _| -points[i].1);
    let change = least_squares(&jacobian, &residual)?.change;
    Some(places.iter().map(|x| (0..=ORDER).map(|k| change[k] * power(*x, k)).sum()).collect())
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
            let hash = (u * 60.0 + 1e4 * seed as f64).sin() * 43_758.545_3;
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
        // Of another recording its constant is not known.
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
