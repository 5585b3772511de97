//! Bumps: where the level of a sensor steps, and stays. Time and a parabola of the temperature go through the bins on
//! both sides; the step next to it is compared with its error, and with the steps that the recording has everywhere.

use super::bins::Bins;
use core::ops::Range;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{median, robust_sd};

/// Bins on each side of a step: where the noise is large, usually, and where two bumps are near each other.
const SIDES: [usize; 3] = [128, 32, 8];
/// Fewest bins on a side.
const FEWEST: usize = 6;
/// A bump has a sum of squared ratios of steps and errors over this, by triad.
const LIMIT: f64 = 64.0;
/// One of its steps is over this many errors.
const ERRORS: f64 = 4.0;
/// A step of a gyroscope that matters is over this part of what its bias usually does …
const PART: f64 = 0.5;
/// … one of an accelerometer over this \[rad\]; the ramps find smaller ones …
const ANGLE: f64 = 4e-3;
/// … and over this many steps of the values.
const STEPS: f64 = 3.0;
/// A step is like another estimate of it to this part.
const LIKE: f64 = 0.35;
/// Bumps of a recording, at most.
const MOST: usize = 64;
/// A bin that is off its neighbours by so many deviations is no level.
const SPIKE: f64 = 8.0;
/// What a bias usually does is between these parts of its sorted values.
const USUAL: [f64; 2] = [0.05, 0.95];

/// A bump.
pub(super) struct Bump {
    /// The first bin after it, in the list of bins at rest.
    pub place: usize,
    /// Its size in the accelerometers, over the specific force \[rad\].
    pub size_rad: f64,
}

/// The bumps between the bins at rest, in order of time.
pub(super) fn bumps(bins: &Bins, rest: &[usize]) -> Vec<Bump> {
    let rates: Vec<Vec<f64>> = bins.rates.iter().map(|rates| without_spikes(rates, rest)).collect();
    let force = rates[..AXES].iter().map(|rates| median(rates.iter().copied()).powi(2)).sum::<f64>().sqrt();
    let least = |(sensor, rates): (usize, &Vec<f64>)| {
        let mut sorted = rates.clone();
        sorted.sort_by(f64::total_cmp);
        let at = |part: f64| sorted.get((sorted.len() as f64 * part) as usize).copied().unwrap_or_default();
        let usual = PART * (at(USUAL[1]) - at(USUAL[0]));
        f64::max(if sensor < AXES { ANGLE * force } else { usual }, STEPS * bins.steps[sensor])
    };
    let least = rates.iter().enumerate().map(least).collect();
    let levels = Levels { bins, rest, rates, least, force };
    let mut found: Vec<Bump> = Vec::new();
    let mut parts = Vec::from([(0, rest.len())]);
    while let Some((start, end)) = parts.pop() {
        if found.len() == MOST {
            break;
        }
        if let Some(bump) = levels.largest(start..end) {
            parts.extend([(start, bump.place), (bump.place, end)]);
            found.push(bump);
        }
    }
    found.sort_by_key(|bump| bump.place);
    found
}

/// The levels of all sensors at rest.
struct Levels<'a> {
    bins: &'a Bins,
    rest: &'a [usize],
    rates: Vec<Vec<f64>>,
    /// The least step that matters, by sensor \[pulse/s\].
    least: Vec<f64>,
    /// The specific force \[pulse/s\].
    force: f64,
}

impl Levels<'_> {
    /// The largest bump in a part.
    fn largest(&self, part: Range<usize>) -> Option<Bump> {
        let rest = &self.rest[part.clone()];
        let rates: Vec<&[f64]> = self.rates.iter().map(|rates| &rates[part.clone()]).collect();
        let widths = SIDES.map(|side| Steps::all(self.bins, rest, &rates, &self.least, side));
        let mut best: Option<(f64, Bump)> = None;
        for (triad, first) in (0..rates.len()).step_by(AXES).enumerate() {
            let force = (triad == 0).then_some(self.force);
            let widths = widths.each_ref().map(|steps| &steps[first..first + AXES]);
            for place in 0..part.len() {
                for (width, all) in widths.iter().enumerate() {
                    let ratio: f64 = all.iter().map(|steps| steps.ratios[place].powi(2)).sum();
                    // A fast change is no step where one looks closer.
                    let is_like =
                        |axis: usize| widths[width + 1..].iter().all(|near| near[axis].is_like(place, &all[axis]));
                    let matters = |axis: usize| all[axis].matters(place) && is_like(axis);
                    let is_best = best.as_ref().is_none_or(|(most, _)| ratio > *most);
                    if ratio > LIMIT && is_best && (0..all.len()).any(matters) {
                        let size = all.iter().map(|steps| steps.sizes[place].powi(2)).sum::<f64>().sqrt();
                        let size_rad = force.map_or(0.0, |force| size / force);
                        best = Some((ratio, Bump { place: part.start + place, size_rad }));
                    }
                }
            }
        }
        best.map(|(_, bump)| bump)
    }
}

/// The rates at rest; a bin that leaves its neighbours by far is their median.
fn without_spikes(rates: &[f64], rest: &[usize]) -> Vec<f64> {
    let values: Vec<f64> = rest.iter().map(|bin| rates[*bin]).collect();
    let middle = |place: usize| {
        let near = place.saturating_sub(2)..(place + 3).min(values.len());
        median(values[near].iter().copied())
    };
    let middles: Vec<f64> = (0..values.len()).map(middle).collect();
    let off: Vec<f64> = values.iter().zip(&middles).map(|(value, middle)| value - middle).collect();
    let limit = SPIKE * robust_sd(&off);
    let of_bin = |((value, middle), off): ((&f64, &f64), &f64)| if off.abs() > limit { *middle } else { *value };
    values.iter().zip(&middles).zip(&off).map(of_bin).collect()
}

/// How the bins around a place give the step there.
struct Weights {
    first: usize,
    weights: Vec<f64>,
    /// Error of the step for a bin's noise of 1.
    error: f64,
}

impl Weights {
    fn of(bins: &Bins, rest: &[usize], place: usize, side: usize) -> Option<Self> {
        let rows = place.saturating_sub(side)..(place + side).min(rest.len());
        if place - rows.start < FEWEST || rows.end - place < FEWEST {
            return None;
        }
        let of = |all: &[f64]| rest[rows.clone()].iter().map(|bin| all[*bin]).collect::<Vec<f64>>();
        let mut left: Vec<f64> = rows.clone().map(|row| if row < place { -0.5 } else { 0.5 }).collect();
        let whole: f64 = left.iter().map(|step| step * step).sum();
        // What a constant, time, temperature and its square do not explain of the step's column.
        let mut known: Vec<Vec<f64>> = Vec::new();
        let temperature = of(&bins.temperature);
        let middle = temperature.iter().sum::<f64>() / temperature.len() as f64;
        let squares = temperature.iter().map(|value| (value - middle).powi(2)).collect();
        for column in [vec![1.0; left.len()], of(&bins.ages), temperature, squares] {
            let size: f64 = column.iter().map(|value| value * value).sum();
            let column = without(column, &known);
            let rest: f64 = column.iter().map(|value| value * value).sum();
            if rest > 1e-12 * size {
                known.push(column.iter().map(|value| value / rest.sqrt()).collect());
            }
        }
        left = without(left, &known);
        let squares: f64 = left.iter().map(|value| value * value).sum();
        // Temperature that steps there explains it as well.
        if squares < 0.02 * whole {
            return None;
        }
        left.iter_mut().for_each(|value| *value /= squares);
        Some(Self { first: rows.start, weights: left, error: squares.sqrt().recip() })
    }

    /// The step of these rates.
    fn step(&self, rates: &[f64]) -> f64 {
        self.weights.iter().zip(&rates[self.first..]).map(|(weight, value)| weight * value).sum()
    }
}

/// A column without what others explain of it, which are orthonormal.
fn without(mut column: Vec<f64>, known: &[Vec<f64>]) -> Vec<f64> {
    for other in known {
        let part: f64 = column.iter().zip(other).map(|(a, b)| a * b).sum();
        column.iter_mut().zip(other).for_each(|(a, b)| *a -= part * b);
    }
    column
}

/// The steps of a sensor at every place.
struct Steps {
    sizes: Vec<f64>,
    ratios: Vec<f64>,
    errors: Vec<f64>,
    least: f64,
}

impl Steps {
    /// The steps of all sensors between so many bins on each side. Those of a place are found while its weights are
    /// there: all weights of a day would be hundreds of megabytes.
    fn all(bins: &Bins, rest: &[usize], rates: &[&[f64]], least: &[f64], side: usize) -> Vec<Self> {
        let mut sizes = vec![vec![0.0; rest.len()]; rates.len()];
        let mut of_noise: Vec<Option<f64>> = Vec::with_capacity(rest.len());
        for place in 0..rest.len() {
            let weights = Weights::of(bins, rest, place, side);
            for (sizes, rates) in sizes.iter_mut().zip(rates) {
                sizes[place] = weights.as_ref().map_or(0.0, |weights| weights.step(rates));
            }
            of_noise.push(weights.map(|weights| weights.error));
        }
        let steps = |((sizes, rates), least): ((_, &&[f64]), &f64)| Self::of(sizes, rates, &of_noise, *least);
        sizes.into_iter().zip(rates).zip(least).map(steps).collect()
    }

    /// `of_noise` is the error of a step for a bin's noise of 1, where there is one.
    fn of(sizes: Vec<f64>, rates: &[f64], of_noise: &[Option<f64>], least: f64) -> Self {
        let there: Vec<f64> =
            of_noise.iter().zip(&sizes).filter(|(it, _)| it.is_some()).map(|(_, size)| *size).collect();
        let second: Vec<f64> = rates.windows(3).map(|three| three[0] - 2.0 * three[1] + three[2]).collect();
        let noise = robust_sd(&second) / 6.0_f64.sqrt();
        let everywhere = robust_sd(&there);
        let error = |of_noise: &Option<f64>| {
            let white = of_noise.map_or(0.0, |error| noise * error);
            white.max(everywhere).max(f64::MIN_POSITIVE)
        };
        let errors: Vec<f64> = of_noise.iter().map(error).collect();
        let ratios = sizes.iter().zip(&errors).map(|(size, error)| size / error).collect();
        Self { sizes, ratios, errors, least }
    }

    /// Whether the step is as large as another estimate of it says.
    fn is_like(&self, place: usize, other: &Self) -> bool {
        let size = other.sizes[place];
        (self.sizes[place] - size).abs() < LIKE * size.abs() + 3.0 * self.errors[place]
    }

    fn matters(&self, place: usize) -> bool {
        self.sizes[place].abs() > self.least && self.ratios[place].abs() > ERRORS
    }
}
