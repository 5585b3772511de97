//! A log-linear histogram of latencies. One thread writes it and others read it, without locks.

use isotherm_client::sync::AtomicU64;
use isotherm_shared::status::{LATENCY_BOUNDS_NS, LatencyDistribution, LatencySummary};
use std::sync::atomic::Ordering::Relaxed;

/// Buckets in an octave: the relative resolution is 1/32.
const SUB: u32 = 32;
const SUB_BITS: u32 = SUB.trailing_zeros();
const BUCKETS: usize = ((32 - SUB_BITS + 1) * SUB) as usize;

/// Counts of 32-bit values \[ns\], by bucket.
#[derive(Debug)]
pub struct Histogram(Box<[AtomicU64; BUCKETS]>);

impl Default for Histogram {
    fn default() -> Self {
        Self(Box::new([const { AtomicU64::new(0) }; BUCKETS]))
    }
}

impl Histogram {
    /// Adds one value. Only the one writer of [`CounterWriter`](super::counters::CounterWriter) calls it.
    #[inline]
    pub(super) fn record(&self, value: u32) {
        let bucket = &self.0[bucket_of(value)];
        bucket.store(bucket.load(Relaxed).saturating_add(1), Relaxed);
    }

    /// The counts since the start.
    pub fn counts(&self) -> BucketCounts {
        BucketCounts(self.0.iter().map(|count| count.load(Relaxed)).collect())
    }
}

/// Counts of a histogram, by bucket.
#[derive(Clone, Debug, Default)]
pub struct BucketCounts(Vec<u64>);

impl BucketCounts {
    /// What the same histogram has counted since `before`.
    pub fn since(&self, before: &Self) -> Growth {
        let then = before.0.iter().copied().chain(std::iter::repeat(0));
        let grown = self.0.iter().zip(then).map(|(now, then)| now.saturating_sub(then)).enumerate();
        Growth(grown.filter(|(_, count)| *count > 0).collect())
    }

    /// The sum of what was counted in several intervals.
    pub fn sum<'a>(intervals: impl IntoIterator<Item = &'a Growth>) -> Self {
        let mut sum = vec![0; BUCKETS];
        for (bucket, count) in intervals.into_iter().flat_map(|interval| &interval.0) {
            sum[*bucket] += count;
        }
        Self(sum)
    }

    /// Percentiles and maximum; `None` if nothing was counted.
    ///
    /// Each is the upper end of its bucket: never less than the value itself, and at most 1/32 more.
    pub fn summary(&self) -> Option<LatencySummary> {
        let total: u64 = self.0.iter().sum();
        let percentile = |part: f64| {
            let rank = ((total as f64 * part).ceil() as u64).clamp(1, total);
            let mut below = 0;
            let bucket = self.0.iter().position(|count| {
                below += count;
                below >= rank
            });
            bucket.map_or(0, upper_end)
        };
        (total > 0).then(|| LatencySummary {
            count: total,
            p50: percentile(0.5),
            p99: percentile(0.99),
            p999: percentile(0.999),
            max: percentile(1.0),
        })
    }

    /// The same counts in fewer buckets. A fine bucket that extends over a bound counts above the bound: no value is
    /// reported too small.
    pub fn distribution(&self) -> LatencyDistribution {
        let mut coarse = vec![0; LATENCY_BOUNDS_NS.len() + 1];
        let mut sum_ns = 0.0;
        for (bucket, count) in self.0.iter().enumerate().filter(|(_, count)| **count > 0) {
            let upper = upper_end(bucket);
            coarse[LATENCY_BOUNDS_NS.partition_point(|bound| *bound < upper)] += count;
            let lower = bucket.checked_sub(1).map_or(0, |below| upper_end(below) + 1);
            sum_ns += (lower + upper) as f64 / 2.0 * *count as f64;
        }
        LatencyDistribution { counts: coarse, sum_s: sum_ns * 1e-9 }
    }
}

/// What a histogram has counted in an interval of time.
#[derive(Clone, Debug, Default)]
pub struct Growth(
    /// Bucket and count, where the count is not 0.
    Vec<(usize, u64)>,
);

/// The bucket of a value. Below 32 each value has its own bucket; above, each octave has 32 buckets.
const fn bucket_of(value: u32) -> usize {
    let shift = (u32::BITS - value.leading_zeros()).saturating_sub(SUB_BITS + 1);
    (shift * SUB + (value >> shift)) as usize
}

/// The largest value of a bucket.
const fn upper_end(bucket: usize) -> u64 {
    let bucket = bucket as u64;
    let shift = (bucket / SUB as u64).saturating_sub(1);
    let first = (bucket - shift * SUB as u64) << shift;
    first + (1 << shift) - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_falls_into_a_bucket_that_holds_it() {
        let powers = (12..32).flat_map(|bit| [(1u32 << bit) - 1, 1 << bit, (1 << bit) + 1]);
        for value in (0..=4096).chain(powers).chain([u32::MAX]) {
            let bucket = bucket_of(value);
            let upper = upper_end(bucket);
            assert!(upper >= value.into() && upper - u64::from(value) <= u64::from(value) / 32, "{value}: {upper}");
            // No bucket is skipped: the next value is in the same bucket or the next one.
            let next = bucket_of(value.saturating_add(1));
            assert!(next == bucket || next == bucket + 1, "{value}: {bucket}, {next}");
        }
        assert_eq!(bucket_of(u32::MAX), BUCKETS - 1);
    }

    #[test]
    fn percentiles_of_known_values() {
        let histogram = Histogram::default();
        assert_eq!(histogram.counts().summary(), None);
        for value in 1..=1000 {
            histogram.record(value * 100);
        }
        let summary = histogram.counts().summary().unwrap();
        assert_eq!(summary.count, 1000);
        let exact = [50_000, 99_000, 99_900, 100_000];
        for (found, exact) in [summary.p50, summary.p99, summary.p999, summary.max].into_iter().zip(exact) {
            assert!(found >= exact && found <= exact + exact / 32, "{found} for {exact}");
        }
    }

    #[test]
    fn the_coarse_buckets_hold_every_value_and_none_that_is_over_their_end() {
        let histogram = Histogram::default();
        let values = [0, 190, 200, 201, 400, 49_000, 50_000, 1_000_000_000, u32::MAX];
        values.iter().for_each(|value| histogram.record(*value));
        let distribution = histogram.counts().distribution();
        let filled: Vec<_> = distribution.counts.iter().enumerate().filter(|(_, count)| **count > 0).collect();
        // 200 and 50000 are bounds, but each shares a fine bucket with larger values and therefore counts above its
        // bound.
        assert_eq!(filled, [(0, &2), (1, &3), (7, &1), (8, &1), (21, &2)]);
        let exact: f64 = values.iter().map(|value| f64::from(*value) * 1e-9).sum();
        assert!((distribution.sum_s / exact - 1.0).abs() < 1.0 / 63.0);
    }

    #[test]
    fn the_maximum_of_an_interval_covers_what_is_counted_in_it() {
        let (histogram, mut before) = (Histogram::default(), BucketCounts::default());
        for value in [70_000, 900, 65_000, 800, 80_000, 100] {
            histogram.record(value);
            let counts = histogram.counts();
            let summary = BucketCounts::sum([&counts.since(&before)]).summary().unwrap();
            let value = u64::from(value);
            assert_eq!(summary.count, 1);
            assert!(summary.max >= value && summary.max <= value + value / 32, "{value}: {}", summary.max);
            before = counts;
        }
        assert_eq!(BucketCounts::sum([&histogram.counts().since(&before)]).summary(), None);
    }
}
