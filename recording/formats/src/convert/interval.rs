//! The nominal interval, and how far apart the rows are.

use isotherm_shared::wire::MAX_INTERVAL_NS;

/// A step of the time over this number of nominal intervals is a gap, or a late row.
pub(super) const GAP: f64 = 1.5;
/// Relative difference that counts: 100 ppm.
const COUNTS: f64 = 1e-4;
/// Most that a rounded interval may differ from the mean step, relative, however much the time jitters.
const MOST: f64 = 5e-3;
/// Standard errors that jitter explains.
const ERRORS: f64 = 3.0;
/// Fewest steps that are judged.
const FEWEST: u64 = 3;
/// A usual step is within this part of the median.
const USUAL: f64 = 0.2;
/// Steps of more medians show no interval.
const MOST_MEDIANS: u64 = 10;
/// A step over this many times the 99 % quantile is a gap, where stamps jitter.
const LATE: u64 = 3;

/// The steps of the time between rows without a gap, as deviations from one interval.
pub(super) struct Steps {
    interval_ns: f64,
    count: u64,
    sum: f64,
    squares: f64,
    /// Of each deviation and the one before.
    products: f64,
    last: f64,
}

impl Steps {
    /// No steps.
    pub(super) fn new(interval_ns: u64) -> Self {
        Self { interval_ns: interval_ns as f64, count: 0, sum: 0.0, squares: 0.0, products: 0.0, last: 0.0 }
    }

    /// Takes a step in \[ns\]. One over [`GAP`] intervals does not count.
    pub(super) fn take(&mut self, step_ns: u64) {
        let step = step_ns as f64;
        if step <= GAP * self.interval_ns {
            let deviation = step - self.interval_ns;
            self.count += 1;
            self.sum += deviation;
            self.squares += deviation * deviation;
            self.products += deviation * self.last;
            self.last = deviation;
        }
    }

    /// The mean step \[ns\].
    fn mean(&self) -> f64 {
        self.interval_ns + self.sum / self.count as f64
    }

    /// The variance of the steps \[ns2\].
    fn variance(&self) -> f64 {
        let (count, mean) = (self.count as f64, self.sum / self.count as f64);
        (self.squares / count - mean * mean).max(0.0)
    }

    /// The mean step \[ns\], if it differs from the interval by over 100 ppm and what the jitter explains.
    ///
    /// The variance of the mean is that of steps that are correlated with the step before: where only the stamps
    /// jitter, a step that is too long is followed by one that is too short.
    pub(super) fn other_mean(&self) -> Option<f64> {
        if self.count < FEWEST {
            return None;
        }
        let (count, off) = (self.count as f64, self.sum / self.count as f64);
        let covariance = (self.products - (count - 1.0) * off * off) / count;
        let variance = (self.variance() + 2.0 * covariance).max(self.variance() / count);
        let explained = ERRORS * (variance / count).sqrt();
        (off.abs() > COUNTS * self.interval_ns + explained).then(|| self.mean())
    }
}

/// The nominal interval, and how the stamps keep it.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) struct Nominal {
    pub interval_ns: u64,
    /// Whether half of the time lies in steps within 20 % of the median step. Else the stamps jitter, or come in
    /// bursts.
    pub is_regular: bool,
    /// A stamp of those that is further off is after a gap: 3 times the 99 % quantile of the steps \[ns\].
    pub gap_ns: u64,
}

/// The nominal interval of rows with these times \[ns\]; `None` if they do not show one.
///
/// Where the steps are regular it is their sum over the number of median steps in each, of steps up to 10 medians. Else
/// it is the mean step of the longest stretch without a gap. The interval of a whole number of Hz, of s, or the median
/// step takes its place, the first that is within 100 ppm of it and what the jitter of the stamps explains.
pub(super) fn nominal(times: &[u64]) -> Option<Nominal> {
    let steps: Vec<u64> = times.windows(2).filter_map(|pair| pair[1].checked_sub(pair[0])).collect();
    let mut sorted = steps.clone();
    sorted.sort_unstable();
    let median = *sorted.get(sorted.len() / 2)?;
    let gap_ns = sorted[(sorted.len() - 1) * 99 / 100].saturating_mul(LATE);
    let total: f64 = sorted.iter().map(|step| *step as f64).sum();
    let usual = |step: &&u64| (**step as f64 - median as f64).abs() <= USUAL * median as f64;
    let in_usual: f64 = sorted.iter().filter(usual).map(|step| *step as f64).sum();
    // A pause is no step of the rows.
    let is_regular = median > 0 && in_usual >= 0.5 * (total - pauses(&sorted, median));
    let (mean, error) = if is_regular { regular(&steps, median) } else { of_stretch(&steps, gap_ns)? };
    let near = (COUNTS * mean + error).min(MOST * mean);
    let hertz = 1e9 / (1e9 / mean).round();
    let seconds = (mean / 1e9).round() * 1e9;
    let middle = if is_regular { median as f64 } else { mean };
    let round = [hertz, seconds, middle].into_iter().find(|round| (round - mean).abs() <= near);
    let found = round.unwrap_or(mean).round() as u64;
    (1..=MAX_INTERVAL_NS).contains(&found).then_some(Nominal { interval_ns: found, is_regular, gap_ns })
}

/// Time in few steps that are far beyond all others: under 1 % of the steps, over 100 medians each.
fn pauses(sorted: &[u64], median: u64) -> f64 {
    let long = sorted.iter().rev().take(sorted.len() / 100).filter(|step| **step > median.saturating_mul(100));
    long.map(|step| *step as f64).sum()
}

/// The mean step of regular stamps, and what their jitter explains \[ns\].
fn regular(steps: &[u64], median: u64) -> (f64, f64) {
    let (mut sum, mut count) = (0.0, 0.0);
    let mut all = Steps::new(median);
    for step in steps.iter().filter(|step| **step > 0) {
        all.take(*step);
        if *step <= median.saturating_mul(MOST_MEDIANS) {
            sum += *step as f64;
            count += (*step as f64 / median as f64).round();
        }
    }
    (sum / count, ERRORS * all.variance().sqrt() / all.count as f64)
}

/// The mean step of the longest stretch without a step over `gap_ns`, and what the jitter of its ends explains.
fn of_stretch(steps: &[u64], gap_ns: u64) -> Option<(f64, f64)> {
    let stretch = steps.split(|step| *step > gap_ns).max_by_key(|stretch| stretch.len())?;
    let (sum, count) = (stretch.iter().map(|step| *step as f64).sum::<f64>(), stretch.len() as f64);
    (sum > 0.0).then(|| (sum / count, gap_ns as f64 / LATE as f64 / count))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stamps of rows at this rate, each rounded down to `unit`, from 5 s on.
    fn stamps(hertz: f64, unit: u64, rows: u64) -> Vec<u64> {
        (0..rows).map(|row| (5e9 + row as f64 * 1e9 / hertz) as u64 / unit * unit).collect()
    }

    fn interval(times: &[u64]) -> Option<u64> {
        nominal(times).map(|nominal| nominal.interval_ns)
    }

    #[test]
    fn jitter_bursts_losses_and_pauses_change_it_by_little() {
        let off = |times: &[u64]| interval(times).unwrap() as f64 / 1e7 - 1.0;
        let row = |row: u64| 5_000_000_000 + row * 10_000_000;
        let random = |row: u64| (row.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as f64 / (1_u64 << 24) as f64;
        let jitter: Vec<_> = (0..20_000).map(|k| row(k) + (random(k) * 9e6) as u64).collect();
        assert!(off(&jitter).abs() < 1.3e-3 && !nominal(&jitter).unwrap().is_regular, "{}", off(&jitter));
        for size in [10, 25, 64] {
            let bursts: Vec<_> = (0..20_000).map(|k| row(k / size * size + size) + k % size * 50_000).collect();
            assert!(off(&bursts).abs() < 1.3e-3 && !nominal(&bursts).unwrap().is_regular, "{size} {}", off(&bursts));
        }
        for share in [0.05, 0.2] {
            let lost: Vec<_> = (0..2000).filter(|k| random(*k) > share).map(row).collect();
            assert!(off(&lost).abs() < 1e-9 && nominal(&lost).unwrap().is_regular, "{share} {}", off(&lost));
        }
        let pause: Vec<_> = (0..1000).map(|k| row(k) + if k > 500 { 3_600_000_000_000 } else { 0 }).collect();
        assert!(off(&pause).abs() < 1e-9 && nominal(&pause).unwrap().is_regular, "{}", off(&pause));
        // Whole milliseconds of 2 kHz: half of the stamps are those before.
        let times: Vec<_> = (0..20_000_u64).map(|k| k / 2 * 1_000_000).collect();
        assert_eq!(nominal(&times).map(|it| (it.interval_ns, it.is_regular)), Some((500_000, false)));
    }

    fn other_mean(times: &[u64], interval_ns: u64) -> Option<f64> {
        let mut steps = Steps::new(interval_ns);
        times.windows(2).for_each(|pair| steps.take(pair[1] - pair[0]));
        steps.other_mean()
    }

    #[test]
    fn only_a_rate_that_is_a_whole_number_of_hertz_is_rounded() {
        for unit in [1, 1000, 100_000] {
            assert_eq!(interval(&stamps(416.0, unit, 1000)), Some(2_403_846), "{unit}");
            let found = interval(&stamps(416.4, unit, 1000)).unwrap() as f64 * 416.4 / 1e9;
            assert!((found - 1.0).abs() < 1e-4, "{unit}: {found}");
        }
        assert_eq!(interval(&stamps(200.01, 1, 1000)), Some(5_000_000));
        assert_eq!(interval(&stamps(300.0, 1_000_000, 1000)), Some(3_333_333));
        assert_eq!(interval(&[0, 1_000_000_000]), Some(1_000_000_000));
        assert_eq!((interval(&[]), interval(&[7, 7]), interval(&[0, u64::MAX])), (None, None, None));
    }

    #[test]
    fn a_wrong_interval_is_told_from_jitter() {
        // Twice as long, and as the rounding of a rate that is no whole number makes it.
        assert_eq!(other_mean(&stamps(200.0, 1, 10), 10_000_000), Some(5e6));
        for unit in [1, 1000, 1_000_000] {
            let mean = other_mean(&stamps(416.4, unit, 20_000), 2_403_846).unwrap();
            assert!((mean * 416.4 / 1e9 - 1.0).abs() < 1e-4, "{unit}: {mean}");
            assert_eq!(other_mean(&stamps(416.0, unit, 20_000), 2_403_846), None, "{unit}");
        }
        // 50 ppm do not count; nor do 2 steps, nor gaps.
        assert_eq!(other_mean(&stamps(200.01, 1, 1000), 5_000_000), None);
        assert_eq!(other_mean(&[0, 5, 10], 10), None);
        assert_eq!(other_mean(&[0, 10, 20, 60, 70, 110], 10), None);
        // Rows whose sampling jitters by up to 20 %, so that the mean of 20 steps differs by chance.
        let mut time = 0;
        let times: Vec<_> = (0..20_u64)
            .map(|row| {
                time += 9_000_000 + row * 7_919_000 % 2_100_000;
                time
            })
            .collect();
        let mean = (times[19] - times[0]) as f64 / 19.0;
        assert!((mean / 1e7 - 1.0).abs() > 1e-4 && other_mean(&times, 10_000_000).is_none(), "{mean}");
    }
}
