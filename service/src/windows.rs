//! Latency in the last second and in the last minute, from the growth of the histogram in each second; and the samples
//! of the last second.

use crate::worker::histogram::{BucketCounts, Growth};
use isotherm_shared::status::LatencySummary;
use std::collections::VecDeque;

const MINUTE_S: usize = 60;

/// How much one histogram has grown in each of the last seconds.
#[derive(Debug, Default)]
pub(crate) struct LatencyWindows {
    /// The counts at the end of the last second.
    previous: BucketCounts,
    /// Growth in each second, the newest last.
    seconds: VecDeque<Growth>,
    /// Samples received up to the end of the last second, and in it.
    received: (u64, u64),
    /// The end of the last second in which a sample came \[s since 1970\].
    last_sample_unix_s: Option<f64>,
}

impl LatencyWindows {
    /// Ends a second with the current counts, and the samples received so far.
    pub(crate) fn end_second(&mut self, counts: BucketCounts, received: u64, unix_s: f64) {
        let new = received.saturating_sub(self.received.0);
        self.received = (received, new);
        if new > 0 {
            self.last_sample_unix_s = Some(unix_s);
        }
        self.seconds.push_back(counts.since(&self.previous));
        if self.seconds.len() > MINUTE_S {
            self.seconds.pop_front();
        }
        self.previous = counts;
    }

    /// Samples received in the last complete second.
    pub(crate) const fn samples(&self) -> u64 {
        self.received.1
    }

    /// When a sample came last, within a second \[s since 1970\].
    pub(crate) const fn last_sample_unix_s(&self) -> Option<f64> {
        self.last_sample_unix_s
    }

    /// Latency in the last complete second; `None` if no sample came in it.
    pub(crate) fn second(&self) -> Option<LatencySummary> {
        BucketCounts::sum(self.seconds.back()).summary()
    }

    /// Latency in the last 60 complete seconds; `None` if no sample came in them.
    pub(crate) fn minute(&self) -> Option<LatencySummary> {
        BucketCounts::sum(&self.seconds).summary()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::worker::counters::counters;
    use isotherm_shared::protocol::Arrival;
    use isotherm_shared::wire::{Flags, RawSample};

    #[test]
    fn each_window_covers_its_own_time_only() {
        let ((mut writer, reader), mut windows) = (counters(), LatencyWindows::default());
        let mut record = |latency_ns| {
            writer.answered(&RawSample::default(), Arrival::default(), Flags(0), latency_ns, true);
        };
        assert_eq!((windows.second(), windows.minute()), (None, None));
        for second in 0..=60 {
            // Smaller than 64: each is the upper end of its bucket.
            record(second);
            record(0);
            windows.end_second(reader.latency(), 2 * (second + 1), second as f64);
            assert_eq!((windows.samples(), windows.last_sample_unix_s()), (2, Some(second as f64)));
            let last = windows.second().unwrap();
            assert_eq!((last.count, last.max), (2, second));
        }
        let minute = windows.minute().unwrap();
        assert_eq!((minute.count, minute.p50, minute.max), (120, 0, 60));
        assert_eq!(reader.latency().summary().unwrap().count, 122);
        windows.end_second(reader.latency(), 122, 99.0);
        assert_eq!((windows.samples(), windows.last_sample_unix_s()), (0, Some(60.0)));
        assert_eq!(windows.second(), None);
        assert_eq!(windows.minute().unwrap().count, 118);
    }
}
