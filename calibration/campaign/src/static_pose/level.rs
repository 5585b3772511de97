//! The quietest lasting level of a recording, at which averaging helps.

use super::windows::{Counts, Windows};
use isotherm_shared::wire::AXES;
use isotherm_statistics::median;

/// Share of the windows that are at rest at least.
const LEAST_SHARE: f64 = 0.05;
/// A window whose ln of variance is this far below a mode is at another level.
const FAR: f64 = 1.5;
/// Quantile of the distances below the mode: one standard deviation.
const SPREAD_QUANTILE: f64 = 0.68;
/// A level holds the windows this near at least.
const LEAST_WIDTH: f64 = 0.1;
/// At rest up to twice the variance: noise differs by temperature and attitude.
const LEAST_MARGIN: f64 = core::f64::consts::LN_2;
/// Or up to so many times the spread of the level.
const MARGIN: f64 = 3.0;

/// How the windows at a level scatter.
pub(super) struct Level {
    /// Whether each window is at it.
    pub windows: Vec<bool>,
    /// Allan variance of the means of neighbouring windows, of each axis, at least that of white noise.
    pub allan: Counts,
    /// Mean variance within them.
    pub variance: Counts,
    /// Ratio of the two, R.
    pub wander: f64,
}

impl Level {
    /// The lowest level at which averaging helps: R is under `most`. Otherwise, the lowest level that was seen, none if
    /// no two windows follow each other.
    pub(super) fn quietest(windows: &Windows, live_alone: bool, most: f64) -> Result<Self, Option<Self>> {
        let whole = (0..windows.len()).filter(|window| windows.whole[*window]);
        let total = whole.clone().count() as f64;
        let left = whole.filter(|window| !live_alone || windows.live[*window]);
        let mut left: Vec<f64> = left.map(|window| windows.levels[window]).collect();
        left.sort_unstable_by(f64::total_cmp);
        let mut lowest = None;
        while left.len() as f64 >= (LEAST_SHARE * total).max(1.0) {
            let mode = mode(&left);
            let spread = spread(&left, mode);
            let width = (2.0 * spread).max(LEAST_WIDTH);
            if let Some(level) = Self::of(windows, |level| (level - mode).abs() <= width) {
                if level.wander < most && windows.share_below(mode - FAR) < LEAST_SHARE {
                    return Ok(level);
                }
                lowest = Some(level);
            }
            let next = mode - spread.min(FAR);
            left.truncate(left.partition_point(|level| *level < next).min(left.len() - 1));
        }
        Err(lowest)
    }

    /// The scatter of the windows whose ln of variance is `within`; `None` if no two follow each other.
    fn of(windows: &Windows, within: impl Fn(f64) -> bool) -> Option<Self> {
        let chosen = |window: usize| windows.whole[window] && within(windows.levels[window]);
        let chosen: Vec<bool> = (0..windows.len()).map(chosen).collect();
        let next = |window: usize| window + windows.window_rows;
        let mut pairs = 0.0;
        let (mut allan, mut variance) = ([0.0; AXES], [0.0; AXES]);
        for one in (0..windows.len()).filter(|one| chosen[*one] && windows.paired[*one] && chosen[next(*one)]) {
            let other = next(one);
            pairs += 1.0;
            for axis in 0..AXES {
                allan[axis] += (windows.means[other][axis] - windows.means[one][axis]).powi(2) / 2.0;
                variance[axis] += (windows.variances[one][axis] + windows.variances[other][axis]) / 2.0;
            }
        }
        if pairs == 0.0 {
            return None;
        }
        let (allan, variance) = (allan.map(|sum| sum / pairs), variance.map(|sum| sum / pairs));
        let wander = (0..AXES).map(|axis| allan[axis] / variance[axis]).sum::<f64>() / AXES as f64;
        let of_white_noise = |axis: usize| variance[axis] / windows.window_rows as f64;
        let allan = [0, 1, 2].map(|axis| f64::max(allan[axis], of_white_noise(axis)));
        Some(Self { windows: chosen, allan, variance, wander })
    }

    /// Scatter of the means over the specific force \[rad\].
    pub(super) fn scatter_rad(&self, windows: &Windows) -> f64 {
        let at_level = (0..windows.len()).filter(|window| self.windows[*window]);
        let force = median(at_level.map(|window| norm(windows.means[window])));
        self.allan.iter().sum::<f64>().sqrt() / force
    }

    /// Half the mean squared change from row to row in the windows at the level, over the variance within: 1 for white
    /// noise, less where neighbouring rows are alike.
    pub(super) fn roughness(&self, windows: &Windows) -> f64 {
        let change =
            |row: usize, axis: usize| (windows.counts[row + 1][axis] - windows.counts[row][axis]).powi(2) / 2.0;
        let at_level: Vec<usize> = (0..windows.len()).filter(|window| self.windows[*window]).collect();
        let of = |axis: usize| {
            at_level.iter().map(|row| change(*row, axis)).sum::<f64>() / at_level.len() as f64 / self.variance[axis]
        };
        (0..AXES).map(of).sum::<f64>() / AXES as f64
    }

    /// Whether each window is at rest: no louder than the level, and no frozen one far below it.
    pub(super) fn at_rest(&self, windows: &Windows) -> Vec<bool> {
        let over_noise =
            |variances: &Counts| (0..AXES).map(|axis| variances[axis] / self.variance[axis]).sum::<f64>() / AXES as f64;
        let levels: Vec<f64> = windows.variances.iter().map(|variances| libm::log(over_noise(variances))).collect();
        let of_level = || levels.iter().zip(&self.windows).filter(|(_, at_it)| **at_it).map(|(level, _)| *level);
        let usual = median(of_level());
        let below: Vec<f64> = of_level().map(|level| usual - level).filter(|below| *below > 0.0).collect();
        let spread = (below.iter().map(|below| below * below).sum::<f64>() / below.len().max(1) as f64).sqrt();
        let lowest = usual - (2.0 * MARGIN * spread).max(FAR);
        let highest = usual + (MARGIN * spread).max(LEAST_MARGIN);
        let rests = |(level, whole): (&f64, &bool)| *whole && lowest < *level && *level < highest;
        levels.iter().zip(&windows.whole).map(rests).collect()
    }
}

impl Windows {
    /// Share of the whole windows whose ln of variance is below `limit`.
    fn share_below(&self, limit: f64) -> f64 {
        let whole = || self.levels.iter().zip(&self.whole).filter(|(_, whole)| **whole);
        whole().filter(|(level, _)| **level < limit).count() as f64 / whole().count().max(1) as f64
    }
}

/// Length of a vector.
pub(super) fn norm(vector: Counts) -> f64 {
    vector.iter().map(|part| part * part).sum::<f64>().sqrt()
}

/// The quantile of the distances of the values below the mode; `sorted` is in order.
fn spread(sorted: &[f64], mode: f64) -> f64 {
    let below = sorted.partition_point(|value| *value < mode);
    let Some(last) = below.checked_sub(1) else { return 0.0 };
    let distance = |index: usize| mode - sorted[last - index.min(last)];
    let at = SPREAD_QUANTILE * last as f64;
    let index = at as usize;
    distance(index) + (distance(index + 1) - distance(index)) * at.fract()
}

/// The half-sample mode of values in order, at least one: the half that lies closest together, again and again (Bickel
/// and Fruehwirth 2006).
fn mode(sorted: &[f64]) -> f64 {
    let mut part = sorted;
    while part.len() > 3 {
        let half = part.len().div_ceil(2);
        let width = |start: usize| part[start + half - 1] - part[start];
        let closest = (0..=part.len() - half).min_by(|a, b| width(*a).total_cmp(&width(*b))).unwrap_or(0);
        part = &part[closest..closest + half];
    }
    part.iter().sum::<f64>() / part.len() as f64
}
