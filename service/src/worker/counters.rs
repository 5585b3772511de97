//! What the worker counts and the control thread tells. One writer each, so plain relaxed loads and stores will do.

use isotherm_shared::wire::Flags;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Adds one to a counter that only the calling thread writes.
#[inline]
pub fn bump(counter: &AtomicU64) {
    add(counter, 1);
}

/// Adds to a counter that only the calling thread writes.
#[inline]
pub fn add(counter: &AtomicU64, by: u64) {
    counter.store(counter.load(Relaxed).saturating_add(by), Relaxed);
}

/// The counters of one IMU since the start of the service.
#[derive(Debug, Default)]
pub struct Counters {
    /// Raw samples received.
    pub received: AtomicU64,
    /// Increments published.
    pub compensated: AtomicU64,
    /// Samples before which others of their session were missing.
    pub gaps: AtomicU64,
    /// How many were missing in all.
    pub missing: AtomicU64,
    /// Samples whose sequence did not rise: resends.
    pub repeats: AtomicU64,
    /// Sessions begun.
    pub sessions: AtomicU64,
    /// Receiving or publishing failed in the transport.
    pub transport_errors: AtomicU64,
    /// Increments that carried each flag, by bit.
    pub flagged: [AtomicU64; 26],
    /// The table in force: [`CoefficientTable::id`](isotherm_shared::table::CoefficientTable::id), 0 for none.
    pub table: AtomicU64,
    /// Latency of every increment.
    pub latency: Histogram,
}

impl Counters {
    /// Counts an increment's flags.
    #[inline]
    pub fn count_flags(&self, flags: Flags) {
        let mut rest = flags.0;
        while rest != 0 {
            let bit = rest.trailing_zeros();
            if let Some(counter) = self.flagged.get(bit as usize) {
                bump(counter);
            }
            rest &= rest - 1;
        }
    }
}

/// Buckets an octave: values are kept to within 1/32 of themselves.
const SUB: u32 = 32;
const SUB_BITS: u32 = SUB.trailing_zeros();
const BUCKETS: usize = ((32 - SUB_BITS + 1) * SUB) as usize;

/// A log-linear histogram of 32-bit nanoseconds that one thread fills and another reads, without locks.
#[derive(Debug)]
pub struct Histogram {
    buckets: Box<[AtomicU64; BUCKETS]>,
    max: AtomicU64,
    /// Since it was last taken.
    recent_max: AtomicU64,
}

impl Default for Histogram {
    fn default() -> Self {
        let buckets = Box::new([const { AtomicU64::new(0) }; BUCKETS]);
        Self { buckets, max: AtomicU64::new(0), recent_max: AtomicU64::new(0) }
    }
}

impl Histogram {
    /// Adds one value.
    #[inline]
    pub fn record(&self, value: u32) {
        bump(&self.buckets[Self::bucket(value)]);
        for max in [&self.max, &self.recent_max] {
            if u64::from(value) > max.load(Relaxed) {
                max.store(value.into(), Relaxed);
            }
        }
    }

    /// The largest value since this was asked last. One that comes just now may count for the next time.
    pub fn take_recent_max(&self) -> u64 {
        self.recent_max.swap(0, Relaxed)
    }

    /// The count of each bucket.
    pub fn counts(&self) -> Vec<u64> {
        self.buckets.iter().map(|count| count.load(Relaxed)).collect()
    }

    /// Below 32 a value is its own bucket; above, each octave has 32.
    const fn bucket(value: u32) -> usize {
        let shift = (u32::BITS - value.leading_zeros()).saturating_sub(SUB_BITS + 1);
        (shift * SUB + (value >> shift)) as usize
    }

    /// The largest value of a bucket.
    const fn upper(bucket: usize) -> u64 {
        let bucket = bucket as u64;
        let shift = (bucket / SUB as u64).saturating_sub(1);
        let first = (bucket - shift * SUB as u64) << shift;
        first + (1 << shift) - 1
    }

    /// The percentiles of all values so far; `None` before the first.
    pub fn summary(&self) -> Option<Summary> {
        Self::summarize(&self.counts(), self.max.load(Relaxed))
    }

    /// The percentiles of `counts`, given by bucket; `None` if there are none.
    pub fn summarize(counts: &[u64], max: u64) -> Option<Summary> {
        let total: u64 = counts.iter().sum();
        let percentile = |part: f64| {
            let rank = ((total as f64 * part).ceil() as u64).max(1);
            let mut below = 0;
            let bucket = counts.iter().position(|count| {
                below += count;
                below >= rank
            });
            bucket.map_or(max, |bucket| Self::upper(bucket).min(max))
        };
        (total > 0).then(|| Summary {
            count: total,
            p50: percentile(0.5),
            p99: percentile(0.99),
            p999: percentile(0.999),
            max,
        })
    }
}

/// Percentiles in nanoseconds.
#[derive(Clone, Copy, Debug, Eq, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct Summary {
    /// Number of values.
    pub count: u64,
    /// Median.
    pub p50: u64,
    /// 99th percentile.
    pub p99: u64,
    /// 99.9th percentile.
    pub p999: u64,
    /// Largest value.
    pub max: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_falls_into_a_bucket_that_holds_it() {
        let powers = (12..32).flat_map(|bit| [(1u32 << bit) - 1, 1 << bit, (1 << bit) + 1]);
        for value in (0..=4096).chain(powers).chain([u32::MAX]) {
            let bucket = Histogram::bucket(value);
            let upper = Histogram::upper(bucket);
            assert!(upper >= value.into() && upper - u64::from(value) <= u64::from(value) / 32, "{value}: {upper}");
            // No bucket is left out: the next value is in the same one or the next one.
            let next = Histogram::bucket(value.saturating_add(1));
            assert!(next == bucket || next == bucket + 1, "{value}: {bucket}, {next}");
        }
        assert_eq!(Histogram::bucket(u32::MAX), BUCKETS - 1);
    }

    #[test]
    fn percentiles_of_known_values() {
        let histogram = Histogram::default();
        assert_eq!(histogram.summary(), None);
        for value in 1..=1000 {
            histogram.record(value * 100);
        }
        let summary = histogram.summary().unwrap();
        assert_eq!((summary.count, summary.max), (1000, 100_000));
        for (found, exact) in [(summary.p50, 50_000), (summary.p99, 99_000), (summary.p999, 99_900)] {
            assert!(found >= exact && found <= exact + exact / 32, "{found} for {exact}");
        }
    }

    #[test]
    fn flags_are_counted_by_bit() {
        let counters = Counters::default();
        counters.count_flags(Flags::GAP | Flags::head_below(0));
        counters.count_flags(Flags::GAP);
        counters.count_flags(Flags(1 << 31));
        let counts: Vec<_> = counters.flagged.iter().map(|count| count.load(Relaxed)).collect();
        assert_eq!((counts[24], counts[0], counts.iter().sum::<u64>()), (2, 1, 3));
    }
}
