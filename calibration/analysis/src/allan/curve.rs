//! The overlapping Allan deviation of a rate, with intervals.

use crate::allan::deviations::{Curve, octaves};
use crate::allan::filter::filtered;
use crate::allan::model::ModelFit;
use crate::allan::moments::Moments;
use crate::allan::step::{Step, take_out};
use isotherm_statistics::{CONFIDENCE, chi_square_limit, mean};

/// Fewest rates that are analysed.
pub const MIN_ROWS: usize = 1000;

/// A slope is significant over this many standard errors under the model of the rates, which takes contamination for
/// noise (two-sided 10 %), and over this many under the model of what is left, which is too small where the line takes
/// off a random walk.
const SIGNIFICANT_SLOPE: [f64; 2] = [1.645, 6.0];

/// One point of the Allan deviation, in the unit of the rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AllanPoint {
    /// Averaging factor m: tau over the interval of the rows.
    pub factor: usize,
    /// Averaging time \[s\].
    pub tau_s: f64,
    /// Allan deviation.
    pub adev: f64,
    /// Ends of its 95 % interval; `None` without a model, and where the model begins later.
    pub interval: Option<[f64; 2]>,
    /// Degrees of freedom of the estimate under the fitted model.
    pub freedom: Option<f64>,
}

/// The Allan deviation of a rate, and the model of it.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_analysis::Allan;
/// use isotherm_simulation::RandomGenerator;
///
/// // White noise of 1 unit in each row of 10 ms: it falls with the root of the averaging time.
/// let mut random = RandomGenerator::new(1, 0);
/// let rates: Vec<_> = (0..20_000).map(|_| random.normal()).collect();
/// let allan = Allan::of(&rates, 0.01).ok_or("too few rates")?;
/// assert!((allan.points[0].adev - 1.0).abs() < 0.05);
/// let point = allan.points.iter().find(|point| point.tau_s > 1.0).ok_or("too short")?;
/// assert!((point.adev * (point.tau_s / 0.01).sqrt() - 1.0).abs() < 0.2);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Allan {
    /// The points, by rising averaging time.
    pub points: Vec<AllanPoint>,
    /// The model; `None` if the points allow none, see [`ModelFit::of`].
    pub model: Option<ModelFit>,
    /// Steps that were taken out of the rates, in turn: K is not given.
    pub steps: Vec<Step>,
    /// Where rows correlate by more than the noise of the model, as those of a filter: by how many errors. The model is
    /// then that of longer tau, if one holds there, and Q is not given.
    pub filtered_errors: Option<f64>,
}

/// A rate against temperature.
#[derive(Clone, Debug, PartialEq)]
pub struct TemperatureLine {
    /// Slope \[unit of the rate per unit of the temperature\].
    pub slope: f64,
    /// Standard error of the slope, the larger of those under the model of the rates and of what is left; `None`
    /// without a model.
    pub slope_error: Option<f64>,
    /// Averaging time of the first point that leaves its interval when the line is removed \[s\]; `None` if no point
    /// does, or if the slope is not significant: a line takes off a part of every slow noise. In simulated records
    /// whose temperature has no influence, at most 4 % have one.
    pub contaminated_from_s: Option<f64>,
    /// What is left when the line is removed.
    pub without: Allan,
}

impl Allan {
    /// The Allan deviation of `rates` that are `interval_s` apart. `None` if the rate never changes, or if there are
    /// fewer than [`MIN_ROWS`] rates. All rates must be finite.
    #[must_use]
    pub fn of(rates: &[f64], interval_s: f64) -> Option<Self> {
        Self::without_steps(&mut rates.to_vec(), interval_s)
    }

    /// The same; the steps are taken out of the rates.
    pub(super) fn without_steps(rates: &mut [f64], interval_s: f64) -> Option<Self> {
        if rates.len() < MIN_ROWS || rates.iter().all(|rate| *rate == rates[0]) {
            return None;
        }
        let (steps, Curve { variances, mut model }) = take_out(rates, interval_s);
        let filtered = model.as_ref().and_then(|model| filtered(rates, &octaves(&variances), model, interval_s));
        let filtered_errors = filtered.as_ref().map(|filtered| filtered.errors);
        model = filtered.and_then(|filtered| filtered.model).or(model);
        let point = |(factor, variance): &(usize, f64)| {
            let freedom = model.as_ref().map(|model| model.freedom(*factor, &Moments::of([*factor; 2], rates.len())));
            let (tau_s, adev) = (*factor as f64 * interval_s, variance.sqrt());
            // The fit leaves long tau out that have few degrees of freedom; short ones only where rows correlate.
            let modelled = model.as_ref().is_some_and(|model| tau_s > 0.999 * model.fitted_s[0]);
            let ends = freedom.filter(|_| modelled).and_then(chi_square_interval);
            AllanPoint {
                factor: *factor,
                tau_s,
                adev,
                interval: ends.map(|ends| ends.map(|ratio| adev * ratio)),
                freedom,
            }
        };
        let points = variances.iter().map(point).collect();
        Some(Self { points, model, steps, filtered_errors })
    }

    /// Whether the coefficient of this index in [`COEFFICIENTS`](crate::COEFFICIENTS) is one of the noise: not K where
    /// a step was taken out, which may be one of many; not Q where rows correlate.
    #[must_use]
    pub fn gives(&self, index: usize) -> bool {
        match index {
            0 => self.filtered_errors.is_none(),
            3 => self.steps.is_empty(),
            _ => true,
        }
    }

    /// The first tau that the model holds for \[s\]; `None` if it does not hold.
    #[must_use]
    pub fn holds_from_s(&self) -> Option<f64> {
        self.model.as_ref().filter(|model| model.holds()).map(|model| model.fitted_s[0])
    }

    /// The lowest point.
    #[must_use]
    pub fn minimum(&self) -> Option<&AllanPoint> {
        self.points.iter().min_by(|a, b| a.adev.total_cmp(&b.adev))
    }

    /// Whether the lowest point is the last, so that a longer recording may show a lower one.
    #[must_use]
    pub fn falls_to_the_end(&self) -> bool {
        self.minimum() == self.points.last()
    }
}

impl TemperatureLine {
    /// The straight line of `rates` in `temperature`, by least squares, and what is left of `raw`, their Allan
    /// deviation, without it; both without the steps of `raw`. `None` if the temperature never changes or is not
    /// finite, or if nothing is left.
    #[must_use]
    pub fn of(rates: &[f64], temperature: &[f64], interval_s: f64, raw: &Allan) -> Option<Self> {
        let mut rates = rates.to_vec();
        raw.steps.iter().for_each(|step| step.take_out(&mut rates));
        Self::taken_off(&mut rates, temperature, interval_s, raw)
    }

    /// The same of rates without steps, of which the line is taken off.
    pub(super) fn taken_off(rates: &mut [f64], temperature: &[f64], interval_s: f64, raw: &Allan) -> Option<Self> {
        let (rate, middle) = (mean(rates), mean(temperature));
        let (mut squares, mut products) = (0.0, 0.0);
        for (r, u) in rates.iter().zip(temperature) {
            squares += (u - middle) * (u - middle);
            products += (u - middle) * (r - rate);
        }
        let constant = temperature.iter().all(|u| *u == temperature[0]);
        if constant || !(squares > 0.0 && squares.is_finite()) {
            return None;
        }
        let slope = products / squares;
        rates.iter_mut().zip(temperature).for_each(|(r, u)| *r -= slope * (u - middle));
        let mut without = Allan::without_steps(rates, interval_s)?;
        without.steps.extend_from_slice(&raw.steps);
        without.steps.sort_by_key(|step| step.row);
        let mut pairs = raw.points.iter().zip(&without.points);
        let leaves = |(raw, without): &(&AllanPoint, &AllanPoint)| {
            raw.interval.is_some_and(|[low, high]| !(low..=high).contains(&without.adev))
        };
        let weight = |row: usize| (temperature[row] - middle) / squares;
        let error = |allan: &Allan| allan.model.as_ref().map(|model| model.standard_error(temperature.len(), weight));
        let errors = error(raw).zip(error(&without));
        let [of_raw, of_left] = SIGNIFICANT_SLOPE;
        let is_significant = errors.is_some_and(|(a, b)| slope.abs() > of_raw * a && slope.abs() > of_left * b);
        let contaminated_from_s = pairs.find(leaves).filter(|_| is_significant).map(|(raw, _)| raw.tau_s);
        let slope_error = errors.map(|(a, b)| a.max(b));
        Some(Self { slope, slope_error, contaminated_from_s, without })
    }
}

/// The ends of the 95 % interval of a deviation over its estimate, with these degrees of freedom; `None` if they are
/// not over 0.
fn chi_square_interval(freedom: f64) -> Option<[f64; 2]> {
    let tail = 0.5 * (1.0 - CONFIDENCE);
    (freedom > 0.0).then(|| [tail, 1.0 - tail].map(|part| (freedom / chi_square_limit(part, freedom)).sqrt()))
}
