//! Whether `interval_ns` is the time from row to row, in any recording.
//!
//! Two figures of interval over step, over the steps without a gap: the median of the single steps, and the median over
//! blocks of 1050 steps of sum over sum. Stamps that jitter, or that come in bursts, change the first; rows that were
//! lost and renumbered change the second. Only a wrong interval changes both.

use core::fmt;
use isotherm_support::finding::{Finding, name};

/// Relative difference of interval and step from which one of them is wrong.
pub const CLOCK_TOLERANCE: f64 = 0.01;
/// Factors by which times are wrong if their unit is.
const UNIT_FACTORS: [f64; 4] = [60.0, 1e3, 1e6, 1e9];
/// A ratio is a factor if it differs from it by less than this part.
const UNIT_TOLERANCE: f64 = 0.01;
/// Steps of a block: whole bursts of 5, 6, 7, 10, 14, 15, 21, 25, 30.
const BLOCK: u32 = 1050;
/// With fewer blocks the two figures must agree within a factor of two.
const MANY_BLOCKS: usize = 10;
/// Where the middle half of the steps lies within this part of their median, only pauses are in the second number.
const REGULAR: f64 = 0.1;
/// Fewest steps that are judged.
const LEAST_STEPS: u32 = 9;
/// Most values that a median is taken of.
const MOST: usize = 4096;

/// An interval that is not the time from row to row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IntervalFault {
    /// Interval \[s\], the mean.
    pub interval_s: f64,
    /// Interval over the time from row to row.
    pub ratio: f64,
}

/// The steps of the rows so far.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Intervals {
    single: ThinSteps,
    blocks: ThinSteps,
    open: Sums,
    all: Sums,
    /// Of all rows, also of those after a gap \[ns\].
    lengths: ThinSteps,
}

/// Sums over steps \[ns\].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Sums {
    count: u32,
    interval: f64,
    step: f64,
}

impl Sums {
    fn add(&mut self, interval: f64, step: f64) {
        self.count = self.count.saturating_add(1);
        self.interval += interval;
        self.step += step;
    }

    fn ratio(self) -> f64 {
        if self.step > 0.0 { self.interval / self.step } else { f64::INFINITY }
    }
}

/// Every n-th value of a series, so that there are at most [`MOST`]: n doubles as they come.
#[derive(Clone, Debug, Default, PartialEq)]
struct ThinSteps {
    values: Vec<f64>,
    /// log2 of n.
    doublings: u32,
    count: u64,
}

impl ThinSteps {
    fn add(&mut self, value: f64) {
        if self.count.trailing_zeros() >= self.doublings {
            self.values.push(value);
        }
        self.count += 1;
        if self.values.len() >= MOST {
            let mut index = 0;
            self.values.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.doublings += 1;
        }
    }

    /// The value below which a part of them lies.
    fn quantile(&self, part: f64) -> f64 {
        let mut values = self.values.clone();
        let place = (values.len() as f64 * part) as usize;
        if values.is_empty() { f64::NAN } else { *values.select_nth_unstable_by(place, f64::total_cmp).1 }
    }
}

impl Intervals {
    /// Takes the step of the time to a row, and the interval of the row \[ns\].
    pub(crate) fn add(&mut self, step_ns: i128, interval_ns: u64) {
        let (step, interval) = (step_ns as f64, interval_ns as f64);
        self.single.add(if step > 0.0 { interval / step } else { f64::INFINITY });
        self.open.add(interval, step);
        self.all.add(interval, step);
        if self.open.count == BLOCK {
            self.blocks.add(core::mem::take(&mut self.open).ratio());
        }
    }

    /// Takes the interval of a row \[ns\], whatever came before.
    pub(crate) fn note(&mut self, interval_ns: u64) {
        self.lengths.add(interval_ns as f64);
    }

    /// The usual interval \[ns\], the median; where it is not the time from row to row, that time. `None` without rows.
    pub(crate) fn usual_ns(&self) -> Option<u64> {
        let interval = self.lengths.quantile(0.5);
        let usual = self.fault().map_or(interval, |fault| interval / fault.ratio);
        usual.is_finite().then(|| usual.round() as u64)
    }

    /// The interval over the step, if it is not 1.
    pub(crate) fn fault(&self) -> Option<IntervalFault> {
        let is_off = |ratio: f64| (ratio - 1.0).abs() > CLOCK_TOLERANCE;
        if self.all.count < LEAST_STEPS {
            return None;
        }
        let [low, single, high] = [0.25, 0.5, 0.75].map(|part| self.single.quantile(part));
        // The steps within a burst are regular too, and far shorter.
        let regular = (high - low).abs() < REGULAR * single && single < 2.0;
        let many = self.blocks.values.len() >= MANY_BLOCKS;
        let whole = if many { self.blocks.quantile(0.5) } else { self.all.ratio() };
        let agree = (single > 1.0) == (whole > 1.0) && (many || (0.5..2.0).contains(&(single / whole)));
        // Bursts are in the first figure; pauses, and what is lost and renumbered, are in the second.
        let ratio = if regular || libm::log(single).abs() < libm::log(whole).abs() { single } else { whole };
        let found = is_off(single) && is_off(whole) && (regular || agree) && ratio.is_finite();
        found.then(|| IntervalFault { interval_s: self.all.interval / f64::from(self.all.count) / 1e9, ratio })
    }
}

impl IntervalFault {
    /// The fault as a finding.
    #[must_use]
    pub fn finding(&self) -> Finding {
        Finding::fault(name::INTERVAL, self.to_string())
    }
}

/// Both values, their ratio, the cause and the remedy.
impl fmt::Display for IntervalFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let &Self { interval_s, ratio } = self;
        let step_s = shown(interval_s / ratio);
        let interval_s = shown(interval_s);
        let (part, cause) = (part(ratio), cause(ratio));
        write!(f, "interval_ns is {part} of the time from row to row, {interval_s} s against {step_s} s: {cause}")
    }
}

/// A number with six digits that count.
pub(crate) fn shown(value: f64) -> f64 {
    let digits = libm::pow(10_f64, 5.0 - libm::log10(value.abs()).floor());
    if digits.is_finite() { (value * digits).round() / digits } else { value }
}

/// A ratio with four digits.
#[must_use]
pub fn part(ratio: f64) -> String {
    if (0.01..100.0).contains(&ratio) { format!("{ratio:.4}") } else { format!("{ratio:.3e}") }
}

/// The factor of a unit that `ratio` is, or 1 over it.
#[must_use]
pub fn unit_factor(ratio: f64) -> Option<f64> {
    let factors = UNIT_FACTORS.into_iter().flat_map(|factor| [factor, factor.recip()]);
    factors.into_iter().find(|factor| (ratio / factor - 1.0).abs() < UNIT_TOLERANCE)
}

/// The cause of an interval that is `ratio` times the time from row to row, and the remedy.
#[must_use]
pub fn cause(ratio: f64) -> String {
    match unit_factor(ratio) {
        Some(factor) if factor < 1.0 => {
            let times = factor.recip().round();
            format!("it looks {times} times too short, in another unit or that of a single sample; multiply interval_ns by {times}")
        }
        Some(factor) => format!("it looks {factor} times too long, in another unit; divide interval_ns by {factor}"),
        None => "it is not the time in which the row's pulses were counted, and every scale factor would be wrong by as much; give the \
                 measured time of each row"
            .to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i128 = 1_000_000;

    fn fault(steps: impl Iterator<Item = i128>, interval_ns: u64) -> Option<IntervalFault> {
        let mut found = Intervals::default();
        steps.for_each(|step| found.add(step, interval_ns));
        found.fault()
    }

    #[test]
    fn a_wrong_interval_is_named_with_both_values() {
        for (interval_ns, ratio, words) in [
            (
                10_000,
                1e-3,
                "1.000e-3 of the time from row to row, 0.00001 s against 0.01 s: it looks 1000 times too short",
            ),
            (10_200_000, 1.02, "1.0200 of the time from row to row, 0.0102 s against 0.01 s: it is not the time"),
        ] {
            for count in [10, 150, 20_000] {
                let found = fault((0..count).map(|_| 10 * MS), interval_ns).expect("it is wrong");
                assert!((found.ratio / ratio - 1.0).abs() < 1e-9 && found.to_string().contains(words), "{found}");
            }
        }
    }

    #[test]
    fn jitter_bursts_and_lost_rows_are_no_wrong_interval() {
        let bursts = |n: i128| move |i: i128| if i % n == 0 { n * 10 * MS - (n - 1) } else { 1 };
        for count in [30, 400, 30_000] {
            for n in [7, 10, 25] {
                assert_eq!(fault((1..=count).map(bursts(n)), 10_000_000), None, "{n} {count}");
            }
            // Stamps in ms at 416 Hz; a fifth lost and renumbered; jitter of 6 ms.
            assert_eq!(fault((0..count).map(|i| ((i + 1) * 1000 / 416 - i * 1000 / 416) * MS), 2_403_846), None);
            assert_eq!(fault((0..count).map(|i| if i % 5 == 0 { 20 * MS } else { 10 * MS }), 10_000_000), None);
            let late = |i: i128| i * i % 1009 * 7919 % 61 * MS / 10;
            assert_eq!(fault((0..count).map(|i| 10 * MS + late(i + 1) - late(i)), 10_000_000), None);
        }
        // A clock that is set right every seven rows.
        assert_eq!(fault((0..400).map(|i| if i % 7 == 6 { 8_800_000 } else { 10_200_000 }), 10_000_000), None);
        // A wrong one is found next to pauses, and more.
        let paused = fault((0..400).map(|i| if i % 80 == 79 { 10_000 * MS } else { 10 * MS }), 12_000_000);
        assert!(paused.is_some_and(|found| (found.ratio - 1.2).abs() < 1e-9), "{paused:?}");
        // … and bursts.
        assert!(fault((1..=30_000).map(bursts(10)), 10_300_000).is_some_and(|found| (found.ratio - 1.03).abs() < 1e-3));
        assert!(fault((0..9).map(|_| 10 * MS), 1).is_some() && fault((0..8).map(|_| 10 * MS), 1).is_none());
    }
}
