//! How fast a backlog is sent.

use crate::transport::stream::RECORDER_DEPTH;

/// Samples that are sent at once, and then in a millisecond: a recorder or a reader whose thread waits for its turn
/// must not lose what the service takes.
const BURST: u64 = RECORDER_DEPTH as u64 / 2;
const PER_MS: u64 = 16;
const MS: u64 = 1_000_000;

/// How many samples of a backlog may be sent now: 256 at once, and then 16 in a millisecond.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pace {
    left: u64,
    /// Up to when `left` is counted \[ns\].
    at_ns: u64,
}

impl Pace {
    /// Whether another one may be sent, which is then counted. `now` is `CLOCK_MONOTONIC` \[ns\].
    pub(crate) fn allows(&mut self, now: u64) -> bool {
        let passed_ms = now.saturating_sub(self.at_ns) / MS;
        if passed_ms >= BURST / PER_MS {
            (self.left, self.at_ns) = (BURST, now);
        } else {
            self.left = BURST.min(self.left + passed_ms * PER_MS);
            self.at_ns += passed_ms * MS;
        }
        let allows = self.left > 0;
        self.left = self.left.saturating_sub(1);
        allows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_backlog_is_sent_no_faster_than_a_reader_takes_it() {
        let mut pace = Pace::default();
        let mut sent = |us: u64| (0..10_000).take_while(|_| pace.allows(1_000_000_000 + us * 1000)).count() as u64;
        assert_eq!([0, 900].map(&mut sent), [BURST, 0]);
        // Looks at any distance allow as much in all.
        let all: u64 = (1..=100).map(|look| sent(look * 1700)).sum();
        assert_eq!(all, 170 * PER_MS);
        assert_eq!(sent(10_000_000), BURST);
    }
}
