//! Latency over the last second and the last minute, from a histogram that only grows.

use crate::worker::counters::{Histogram, Summary};
use std::collections::VecDeque;

/// Seconds in a minute.
const MINUTE: usize = 60;

/// What one histogram has taken in, second by second.
#[derive(Debug, Default)]
pub struct Windows {
    /// All counts when the last second ended.
    seen: Vec<u64>,
    /// The newest last.
    seconds: VecDeque<Second>,
}

#[derive(Debug)]
struct Second {
    /// Bucket and count, of those that are not 0.
    counts: Vec<(usize, u64)>,
    max: u64,
}

impl Windows {
    /// Ends a second.
    pub fn turn(&mut self, histogram: &Histogram) {
        let counts = histogram.counts();
        self.seen.resize(counts.len(), 0);
        let grown = counts.iter().zip(&self.seen).map(|(now, before)| now - before).enumerate();
        let grown = grown.filter(|(_, count)| *count > 0).collect();
        self.seconds.push_back(Second { counts: grown, max: histogram.take_recent_max() });
        if self.seconds.len() > MINUTE {
            self.seconds.pop_front();
        }
        self.seen = counts;
    }

    /// The last second that has ended; `None` if nothing came in it.
    pub fn second(&self) -> Option<Summary> {
        self.last(1)
    }

    /// The last sixty of them; `None` if nothing came in them.
    pub fn minute(&self) -> Option<Summary> {
        self.last(MINUTE)
    }

    fn last(&self, seconds: usize) -> Option<Summary> {
        let mut counts = vec![0; self.seen.len()];
        let mut max = 0;
        for second in self.seconds.iter().rev().take(seconds) {
            for (bucket, count) in &second.counts {
                counts[*bucket] += count;
            }
            max = max.max(second.max);
        }
        Histogram::summarize(&counts, max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_window_knows_its_own_time_only() {
        let (histogram, mut windows) = (Histogram::default(), Windows::default());
        assert_eq!((windows.second(), windows.minute()), (None, None));
        for second in 0..=60 {
            histogram.record(1000 + second);
            histogram.record(10);
            windows.turn(&histogram);
            let last = windows.second().unwrap();
            assert_eq!((last.count, last.max), (2, u64::from(1000 + second)));
        }
        let minute = windows.minute().unwrap();
        assert_eq!((minute.count, minute.p50, minute.max), (120, 10, 1060));
        assert_eq!(histogram.summary().unwrap().count, 122);
        windows.turn(&histogram);
        assert_eq!(windows.second(), None);
        assert_eq!(windows.minute().unwrap().count, 118);
    }
}
