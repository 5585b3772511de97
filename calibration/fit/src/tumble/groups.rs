//! Groups of static poses: what a file, a power-up or a temperature shares is no scatter of its static poses.
//!
//! A group ends with a file, a session, a gap of over 600 s, or where temperature jumps by a tenth of its range and ten
//! of its usual steps.

use super::reading::Reading;
use isotherm_campaign::joint_range;
use isotherm_statistics::{mean, median};

/// Time between the starts of two static poses that ends a group \[s\].
const GAP_S: f64 = 600.0;
/// Share of the temperature's range that a step of a new group has, and that two temperatures differ by.
const LEVEL: f64 = 0.1;
/// Usual steps of the temperature that a step of a new group has.
pub(super) const STEPS: f64 = 10.0;

/// Relative rounding of a mean of many rows.
const ROUNDING: f64 = 1e-9;

/// The groups of some readings.
#[derive(Clone, Debug, PartialEq)]
pub struct Groups {
    /// Index of the group of each reading.
    pub of: Vec<usize>,
    /// Their number.
    pub count: usize,
    /// Number of temperatures: groups whose means are further apart than a tenth of their range, and than temperature
    /// moves in a group. One group is one.
    pub levels: usize,
    /// Noise of a row of the temperature, at least that of its digits.
    pub row_noise: f64,
}

impl Groups {
    /// The groups of `readings`, which are in the order of the recordings and of time.
    #[must_use]
    pub fn of(readings: &[Reading]) -> Self {
        let temperature: Vec<f64> = readings.iter().map(Reading::temperature).collect();
        let row_noise = median(readings.iter().map(|reading| reading.temperature_noise)).max(resolution(&temperature));
        let steps: Vec<f64> = temperature.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
        let usual = if steps.is_empty() { row_noise } else { median(steps.iter().copied()).max(row_noise) };
        let [low, high] = joint_range(temperature.iter().map(|temperature| [*temperature; 2]));
        let jump = (LEVEL * (high - low)).max(STEPS * usual);
        let starts = |(pair, step): (&[Reading], &f64)| {
            let [before, after] = [&pair[0], &pair[1]];
            let other = before.recording != after.recording || before.session != after.session;
            other || after.start_s - before.start_s > GAP_S || *step > jump
        };
        let mut of = vec![0; readings.len()];
        let mut group = 0;
        for (index, starts) in readings.windows(2).zip(&steps).map(starts).enumerate() {
            group += usize::from(starts);
            of[index + 1] = group;
        }
        let count = if readings.is_empty() { 0 } else { group + 1 };
        let mut groups = Self { of, count, levels: count, row_noise };
        groups.levels = groups.temperatures(&temperature);
        groups
    }

    /// The indices of a group's readings.
    pub fn members(&self, group: usize) -> Vec<usize> {
        (0..self.of.len()).filter(|index| self.of[*index] == group).collect()
    }

    /// The indices of every group's readings.
    pub(super) fn all(&self) -> Vec<Vec<usize>> {
        let mut all = vec![Vec::new(); self.count];
        self.of.iter().enumerate().for_each(|(index, group)| all[*group].push(index));
        all
    }

    /// The values, by static pose, of each group.
    fn split(&self, values: &[f64]) -> Vec<Vec<f64>> {
        self.all().into_iter().map(|members| members.into_iter().map(|index| values[index]).collect()).collect()
    }

    fn temperatures(&self, temperature: &[f64]) -> usize {
        let groups = self.split(temperature);
        let moved = groups.iter().map(|values| spread(values));
        let mut means: Vec<f64> = groups.iter().map(|values| mean(values)).collect();
        means.sort_by(f64::total_cmp);
        let Some(first) = means.first() else { return 0 };
        let width = (LEVEL * spread(&means)).max(median(moved)).max(resolution(temperature));
        let (mut levels, mut at) = (1, *first);
        for mean in means {
            if mean - at > width {
                (levels, at) = (levels + 1, mean);
            }
        }
        levels
    }

    /// The values less the mean of their group.
    pub fn centred(&self, values: &[f64]) -> Vec<f64> {
        let means: Vec<f64> = self.split(values).iter().map(|values| mean(values)).collect();
        values.iter().zip(&self.of).map(|(value, group)| value - means[*group]).collect()
    }

    /// The largest difference of two values of one group.
    pub fn moved(&self, values: &[f64]) -> f64 {
        self.split(values).iter().map(|values| spread(values)).fold(0.0, f64::max)
    }
}

/// What numbers of this size may differ by without a difference in the data: means of a constant differ in their last
/// bits.
pub(super) fn resolution(values: &[f64]) -> f64 {
    let size = values.iter().map(|value| value.abs()).fold(0.0, f64::max);
    (ROUNDING * size).max(f64::MIN_POSITIVE)
}

pub(super) fn spread(values: &[f64]) -> f64 {
    let [low, high] = joint_range(values.iter().map(|value| [*value; 2]));
    high - low
}
