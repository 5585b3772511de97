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

/// The nominal interval \[ns\] of rows with these times \[ns\]: their mean step without gaps; or the interval of a
/// whole number of Hz, of s, or the median step, the first that is within 100 ppm of it and what the jitter of the
/// first and the last stamp explains.
pub(super) fn nominal(times: &[u64]) -> Option<u64> {
    let steps = || times.windows(2).filter_map(|pair| pair[1].checked_sub(pair[0])).filter(|step| *step > 0);
    let mut sorted: Vec<_> = steps().collect();
    sorted.sort_unstable();
    let median = *sorted.get(sorted.len() / 2)?;
    let mut all = Steps::new(median);
    steps().for_each(|step| all.take(step));
    let mean = all.mean();
    let jitter = ERRORS * all.variance().sqrt() / all.count as f64;
    let near = (COUNTS * mean + jitter).min(MOST * mean);
    let hertz = 1e9 / (1e9 / mean).round();
    let seconds = (mean / 1e9).round() * 1e9;
    let round = [hertz, seconds, median as f64].into_iter().find(|round| (round - mean).abs() <= near);
    let found = round.unwrap_or(mean).round() as u64;
    (1..=MAX_INTERVAL_NS).contains(&found).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stamps of rows at this rate, each rounded down to `unit`, from 5 s on.
    fn stamps(hertz: f64, unit: u64, rows: u64) -> Vec<u64> {
        (0..rows).map(|row| (5e9 + row as f64 * 1e9 / hertz) as u64 / unit * unit).collect()
    }

    fn other_mean(times: &[u64], interval_ns: u64) -> Option<f64> {
        let mut steps = Steps::new(interval_ns);
        times.windows(2).for_each(|pair| steps.take(pair[1] - pair[0]));
        steps.other_mean()
    }

    #[test]
    fn only_a_rate_that_is_a_whole_number_of_hertz_is_rounded() {
        for unit in [1, 1000, 100_000] {
            assert_eq!(nominal(&stamps(416.0, unit, 1000)), Some(2_403_846), "{unit}");
            let found = nominal(&stamps(416.4, unit, 1000)).unwrap() as f64 * 416.4 / 1e9;
            assert!((found - 1.0).abs() < 1e-4, "{unit}: {found}");
        }
        assert_eq!(nominal(&stamps(200.01, 1, 1000)), Some(5_000_000));
        assert_eq!(nominal(&stamps(300.0, 1_000_000, 1000)), Some(3_333_333));
        assert_eq!(nominal(&[0, 1_000_000_000]), Some(1_000_000_000));
        assert_eq!((nominal(&[]), nominal(&[7, 7]), nominal(&[0, u64::MAX])), (None, None, None));
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
