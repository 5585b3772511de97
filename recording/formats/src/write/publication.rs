//! When a sample was taken, as the publish time of MCAP says it.

use isotherm_recording::rows::RecordedRow;

/// A timestamp of `CLOCK_MONOTONIC` is within this time of its recording \[ns\].
const NEAR_NS: u64 = 1_000_000_000;

/// Puts the timestamps of a stream on Unix time, session by session, where they are of `CLOCK_MONOTONIC`.
///
/// They are if one of the session was within a second of its recording: later ones may be late, since a sample waits
/// for a service that is away. Nothing is known of any other clock, and its timestamps stay as they are.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PublicationClock {
    /// The session whose timestamps are of `CLOCK_MONOTONIC`.
    monotonic: Option<u64>,
}

impl PublicationClock {
    /// The publish time for a time of the acquisition's clock in a row \[ns\].
    pub(super) fn time_ns(&mut self, row: &RecordedRow, acquired_ns: u64) -> u64 {
        let Some(offset) = row.unix_offset else { return acquired_ns };
        let session = row.period().session;
        if offset.unix_ns(row.timestamp_ns()).abs_diff(row.recorded_ns) <= NEAR_NS {
            self.monotonic = Some(session);
        }
        if self.monotonic == Some(session) { offset.unix_ns(acquired_ns) } else { acquired_ns }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_recording::rows::RecordedOffset;
    use isotherm_shared::wire::{RawSample, StreamSample};

    const OFFSET_NS: u64 = 1_700_000_000_000_000_000;
    const S: u64 = 1_000_000_000;

    #[test]
    fn only_timestamps_of_the_monotonic_clock_are_put_on_unix_time() {
        let offset = RecordedOffset::new(OFFSET_NS as i64, 50);
        let row = |session, timestamp_ns, received_ns| {
            let raw = RawSample { session, timestamp_ns, ..RawSample::default() };
            RecordedRow { unix_offset: offset, ..RecordedRow::new(0, OFFSET_NS + received_ns, StreamSample::Raw(raw)) }
        };
        let mut clock = PublicationClock::default();
        let mut of = |row: &RecordedRow| clock.time_ns(row, row.timestamp_ns());
        // A file that is fed has its own times.
        assert_eq!(of(&row(1, 7, 500 * S)), 7);
        assert_eq!(of(&row(2, 500 * S, 500 * S + S / 2)), OFFSET_NS + 500 * S);
        // It waited while the service was away.
        assert_eq!(of(&row(2, 501 * S, 540 * S)), OFFSET_NS + 501 * S);
        assert_eq!(of(&row(3, 501 * S, 541 * S)), 501 * S);
        assert_eq!(of(&RecordedRow { unix_offset: None, ..row(3, 541 * S, 541 * S) }), 541 * S);
        assert_eq!(RecordedOffset::new(-1, 50), None);
    }
}
