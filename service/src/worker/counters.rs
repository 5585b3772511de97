//! What the worker counts and the control thread tells. One writer each, so plain relaxed loads and stores will do.

use isotherm_shared::wire::{AXES, Flags, RawSample};
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
    /// Telemetry of the last sample, as bits: heads, then boards.
    pub telemetry: [AtomicU64; 2 * AXES],
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

    /// Keeps a sample's telemetry.
    #[inline]
    pub fn keep_telemetry(&self, raw: &RawSample) {
        let telemetry = raw.head_temperature.iter().chain(&raw.board_temperature);
        for (kept, value) in self.telemetry.iter().zip(telemetry) {
            kept.store(value.to_bits(), Relaxed);
        }
    }

    /// The last sample's telemetry, heads and boards; `None` where it is not finite, or there was no sample yet.
    pub fn telemetry(&self) -> [[Option<f64>; AXES]; 2] {
        let seen = self.received.load(Relaxed) > 0;
        let value = |place: usize| {
            let value = f64::from_bits(self.telemetry[place].load(Relaxed));
            (seen && value.is_finite()).then_some(value)
        };
        [0, AXES].map(|first| core::array::from_fn(|axis| value(first + axis)))
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
        self.summary_of(&self.counts())
    }

    /// As [`summary`](Self::summary), of counts that have just been taken.
    pub fn summary_of(&self, counts: &[u64]) -> Option<Summary> {
        Self::summarize(counts, self.max.load(Relaxed))
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

/// Upper ends of the coarse buckets that others are told \[ns\]; one more holds what is above.
pub const BOUNDS_NS: [u64; 21] = {
    let mut bounds = [0; 21];
    let mut index = 0;
    while index < bounds.len() {
        bounds[index] = [2, 5, 10][index % 3] * 100 * 10u64.pow((index / 3) as u32);
        index += 1;
    }
    bounds
};

/// A histogram in few buckets.
#[derive(Clone, Debug, Default, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct Distribution {
    /// Values up to each of [`BOUNDS_NS`] and over the one before, then those over the last.
    pub counts: Vec<u64>,
    /// Sum of the values \[s\], to within 1.6 %.
    pub sum_s: f64,
}

impl Distribution {
    /// Of `counts`, given by fine bucket. One that reaches over a bound counts above it: no value is told smaller than it was.
    pub fn of(counts: &[u64]) -> Self {
        let mut coarse = vec![0; BOUNDS_NS.len() + 1];
        let mut sum_ns = 0.0;
        for (bucket, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            let upper = Histogram::upper(bucket);
            coarse[BOUNDS_NS.partition_point(|bound| *bound < upper)] += count;
            let lower = bucket.checked_sub(1).map_or(0, |below| Histogram::upper(below) + 1);
            sum_ns += (lower + upper) as f64 / 2.0 * *count as f64;
        }
        Self { counts: coarse, sum_s: sum_ns * 1e-9 }
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
    fn the_coarse_buckets_hold_every_value_and_none_that_is_over_their_end() {
        assert_eq!((BOUNDS_NS[0], BOUNDS_NS[7], BOUNDS_NS[20]), (200, 50_000, 1_000_000_000));
        assert!(BOUNDS_NS.is_sorted());
        let histogram = Histogram::default();
        let values = [0, 190, 200, 201, 400, 49_000, 50_000, 1_000_000_000, u32::MAX];
        values.iter().for_each(|value| histogram.record(*value));
        let distribution = Distribution::of(&histogram.counts());
        let told: Vec<_> = distribution.counts.iter().enumerate().filter(|(_, count)| **count > 0).collect();
        // 200 and 50000 are within 3 % of a bound and share a fine bucket with what is over it.
        assert_eq!(told, [(0, &2), (1, &3), (7, &1), (8, &1), (21, &2)]);
        let exact: f64 = values.iter().map(|value| f64::from(*value) * 1e-9).sum();
        assert!((distribution.sum_s / exact - 1.0).abs() < 1.0 / 63.0);
    }

    #[test]
    fn telemetry_is_told_when_it_has_come_and_is_finite() {
        let counters = Counters::default();
        assert_eq!(counters.telemetry(), [[None; 3]; 2]);
        let (head_temperature, board_temperature) = ([1.0, f64::NAN, -3.0], [4.0, 5.0, f64::INFINITY]);
        counters.keep_telemetry(&RawSample { head_temperature, board_temperature, ..RawSample::default() });
        bump(&counters.received);
        assert_eq!(counters.telemetry(), [[Some(1.0), None, Some(-3.0)], [Some(4.0), Some(5.0), None]]);
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
