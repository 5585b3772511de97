//! The noise of one sensor, and what is to be known before its figures are used.

use super::counts::CountChanges;
use super::curve::{Allan, TemperatureLine};
use super::rate::RateKind;
use isotherm_shared::units::SensorKind;
use isotherm_support::finding::{Finding, name};

/// White noise of fewer steps of the counts a row gives a warning: the counts then repeat a pattern.
const LEAST_WHITE_STEPS: f64 = 0.3;

/// The noise of one sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorNoise {
    /// A1 to A3, G1 to G3.
    pub name: &'static str,
    /// Which triad it is of.
    pub sensor: SensorKind,
    /// What its rate is.
    pub kind: RateKind,
    /// Its mean rate, in the unit of the rate.
    pub mean: f64,
    /// The Allan deviation; `None` if the rate never changes.
    pub allan: Option<Allan>,
    /// The rate against head temperature; `None` if the temperature never changes or is not finite.
    pub line: Option<TemperatureLine>,
    /// Standard deviation of the white noise of a row \[pulse\].
    pub white_counts: Option<f64>,
    /// How its counts change from row to row; `None` if they never do.
    pub changes: Option<CountChanges>,
    /// Mean time from one new value to the next, if its values repeat \[s\].
    pub new_every_s: Option<f64>,
}

impl SensorNoise {
    /// The line, if the rate without it differs from the raw one by more than the intervals allow.
    #[must_use]
    pub fn contamination(&self) -> Option<(&TemperatureLine, f64)> {
        self.line.as_ref().and_then(|line| Some((line, line.contaminated_from_s?)))
    }

    /// White noise of a row in steps of the counts, if it is so small that the counts repeat a pattern: they change by
    /// single steps.
    #[must_use]
    pub fn limit_cycle(&self) -> Option<f64> {
        let changes = self.changes.filter(CountChanges::are_single)?;
        let steps = self.white_counts? / changes.step;
        (steps < LEAST_WHITE_STEPS).then_some(steps)
    }

    /// What is to be known before its figures are used; each message begins with its name.
    #[must_use]
    pub fn findings(&self) -> Vec<Finding> {
        let mut found = Vec::new();
        let mut add = |name, message: String| found.push(Finding::warning(name, format!("{}: {message}", self.name)));
        let Some(allan) = &self.allan else {
            add(name::RATE_CONSTANT, "its counts never change; look at the sensor and its cable".to_owned());
            return found;
        };
        for step in &allan.steps {
            let message = format!(
                "a step of {:.3e} {} at {:.1} s; the curve is without it, and K is not given; record again without knocks, or leave it out with \
                 --from and --to",
                step.size,
                self.kind.units().rate,
                step.at_s
            );
            add(name::NOISE_STEP, message);
        }
        if let Some(steps) = self.limit_cycle() {
            let message = format!(
                "its noise is smaller than a step of its counts, {steps:.2} steps a row: the counts repeat a pattern (limit cycle), so Q and N are not \
                 those of the sensor; record with a longer interval"
            );
            add(name::LIMIT_CYCLE, message);
        } else if let Some(errors) = allan.filtered_errors.filter(|_| self.new_every_s.is_none()) {
            let message = format!(
                "its rows correlate from one to the next, by {errors:.0} errors more than noise of the model: a filter, or vibration; {}",
                above(allan.holds_from_s())
            );
            add(name::NOISE_FILTERED, message);
        }
        match &allan.model {
            None => add(name::NOISE_MODEL, "the model cannot be fitted: the counts repeat a pattern".to_owned()),
            Some(model) if !model.holds() => {
                let message = format!(
                    "the model does not hold: chi-square {:.1} for {} degrees of freedom, at most {} allowed; no ranges are given, and the intervals \
                     of the points are approximate",
                    model.chi_square,
                    model.freedom,
                    2 * model.freedom
                );
                add(name::NOISE_MODEL, message);
            }
            Some(_) => {}
        }
        if let Some((_, from_s)) = self.contamination() {
            let message = format!(
                "contaminated by the temperature from tau = {from_s:.4} s; what is left without a straight line in head temperature is shown, too"
            );
            add(name::NOISE_TEMPERATURE, message);
        }
        found
    }
}

/// From which tau on N holds.
pub(super) fn above(from_s: Option<f64>) -> String {
    from_s.map_or_else(|| "no model holds".to_owned(), |from_s| format!("N holds above tau = {from_s:.4} s"))
}
