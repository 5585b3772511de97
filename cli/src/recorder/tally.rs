//! Counts of what has been recorded of an IMU's streams, and of what is missing.

use isotherm_client::transport::stream::RAW_DEPTH;
use isotherm_recording::Continuity;
use isotherm_shared::names::StreamKind;
use isotherm_shared::sequence::Period;
use std::collections::VecDeque;

/// Most sessions whose first and last sequences are kept for [`StreamCounts::settle`].
const SESSIONS: usize = 64;

/// Counts of one stream, by sequence, session by session.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Tally {
    /// Rows written.
    pub rows: u64,
    /// Sessions of the acquisition.
    pub sessions: u64,
    /// Sequences within a session that never came.
    pub missing: u64,
    /// Rows that came after a later one of their session.
    pub late: u64,
    last: Option<(u64, u64)>,
}

/// Counts of an IMU.
#[derive(Clone, Debug, Default)]
pub(super) struct StreamCounts {
    tallies: [Tally; 2],
    continuity: [Continuity; 2],
    ends: VecDeque<(u64, Ends)>,
    /// Sequences that have not come and may still come, the first and the last of each hole.
    open: [VecDeque<(u64, u64)>; 2],
}

/// The first and last sequence of a session in each stream.
type Ends = [Option<(u64, u64)>; 2];

impl StreamCounts {
    /// Counts a row that comes for the first time. Returns whether it is to be written. A raw sample that comes after a
    /// later one is not written, because `feed` needs rising sequences. An increment that comes after a later one is
    /// written.
    pub(super) fn take(&mut self, stream: StreamKind, row: Period, recorded_ns: u64) -> bool {
        let Period { session, sequence, .. } = row;
        self.extend(stream, session, sequence);
        self.note_holes(stream, session, sequence);
        let tally = &mut self.tallies[stream as usize];
        match tally.last {
            Some((known, last)) if known == session => {
                if sequence <= last {
                    tally.late += 1;
                    if stream == StreamKind::Raw {
                        return false;
                    }
                    tally.rows += 1;
                    tally.missing = tally.missing.saturating_sub(1);
                    return true;
                }
                tally.missing = tally.missing.saturating_add(sequence - last - 1);
            }
            _ => tally.sessions += 1,
        }
        tally.last = Some((session, sequence));
        self.continuity[stream as usize].add_recorded(row, Some(recorded_ns));
        tally.rows += 1;
        true
    }

    /// Keeps the holes that may still be filled: after a restart of the service the samples that were in flight are
    /// answered behind later ones.
    fn note_holes(&mut self, stream: StreamKind, session: u64, sequence: u64) {
        let open = &mut self.open[stream as usize];
        let Some((known, last)) = self.tallies[stream as usize].last else { return };
        if known != session {
            open.clear();
            return;
        }
        if sequence > last {
            if sequence - last > 1 {
                open.push_back((last + 1, sequence - 1));
            }
            let oldest = sequence.saturating_sub(RAW_DEPTH as u64);
            open.retain(|(_, end)| *end >= oldest);
            open.iter_mut().for_each(|(begin, _)| *begin = oldest.max(*begin));
        } else if let Some(place) = open.iter().position(|(begin, end)| (begin..=end).contains(&&sequence))
            && let Some((begin, end)) = open.remove(place)
        {
            let parts = [(begin, sequence.wrapping_sub(1)), (sequence + 1, end)];
            let parts = [(begin < sequence).then_some(parts[0]), (sequence < end).then_some(parts[1])];
            parts.into_iter().flatten().rev().for_each(|part| open.insert(place, part));
        }
    }

    /// Rows of a stream that are missing so far, without those that may still come.
    pub(super) fn lost(&self, stream: StreamKind) -> u64 {
        let open: u64 = self.open[stream as usize].iter().map(|(begin, end)| end - begin + 1).sum();
        self.tallies[stream as usize].missing.saturating_sub(open)
    }

    /// What the times of a stream's rows say, of those that came in order.
    pub(super) const fn continuity(&self, stream: StreamKind) -> &Continuity {
        &self.continuity[stream as usize]
    }

    /// The counts of a stream so far.
    pub(super) const fn tally(&self, stream: StreamKind) -> &Tally {
        &self.tallies[stream as usize]
    }

    /// Also counts what is missing at the beginnings and ends of sessions, by comparing the two streams. To be called
    /// once, at the end, if both were recorded.
    pub(super) fn count_missing_at_ends(&mut self) {
        // Up to RAW_DEPTH samples may have been in flight when the recording began or ended. They are not missing.
        let mut before = RAW_DEPTH as u64;
        while let Some((_, ends)) = self.ends.pop_front() {
            self.compare(ends, before, if self.ends.is_empty() { RAW_DEPTH as u64 } else { 0 });
            before = 0;
        }
    }

    fn compare(&mut self, ends: Ends, before: u64, behind: u64) {
        let over = |missing: u64, in_flight| if missing > in_flight { missing } else { 0 };
        for (stream, other) in [(0, 1), (1, 0)] {
            let Some((first, last)) = ends[other] else { continue };
            let missing = match ends[stream] {
                Some((own_first, own_last)) => {
                    over(own_first.saturating_sub(first), before) + over(last.saturating_sub(own_last), behind)
                }
                None => over((last - first).saturating_add(1), before.max(behind)),
            };
            self.tallies[stream].missing = self.tallies[stream].missing.saturating_add(missing);
        }
    }

    fn extend(&mut self, stream: StreamKind, session: u64, sequence: u64) {
        let place = match self.ends.iter().rposition(|(known, _)| *known == session) {
            Some(place) => place,
            None => {
                // Only a faulty acquisition has so many sessions.
                if self.ends.len() == SESSIONS {
                    self.ends.pop_front();
                }
                self.ends.push_back((session, [None; 2]));
                self.ends.len() - 1
            }
        };
        let end = &mut self.ends[place].1[stream as usize];
        let (first, last) = end.unwrap_or((sequence, sequence));
        *end = Some((first.min(sequence), last.max(sequence)));
    }
}

#[cfg(test)]
mod tests {
    use super::StreamKind::{Increment, Raw};
    use super::*;

    fn totals(counts: &StreamCounts, stream: StreamKind) -> (u64, u64, u64, u64) {
        let Tally { rows, sessions, missing, late, .. } = *counts.tally(stream);
        (rows, sessions, missing, late)
    }

    fn row(session: u64, sequence: u64) -> Period {
        Period { session, sequence, ..Period::default() }
    }

    fn take_all(counts: &mut StreamCounts, stream: StreamKind, session: u64, sequences: impl Iterator<Item = u64>) {
        for sequence in sequences {
            counts.take(stream, row(session, sequence), 0);
        }
    }

    #[test]
    fn gaps_are_counted_within_a_session() {
        let mut counts = StreamCounts::default();
        for stream in StreamKind::BOTH {
            for sequence in [5, 6, 9] {
                assert!(counts.take(stream, row(1, sequence), 0));
            }
            assert_eq!(counts.take(stream, row(1, 7), 0), stream == Increment);
            assert!(
                counts.take(stream, row(2, u64::MAX), 0)
                    && counts.take(stream, row(3, 0), 0)
                    && counts.take(stream, row(3, 1), 0)
            );
        }
        assert_eq!(totals(&counts, Raw), (6, 3, 2, 1));
        assert_eq!(totals(&counts, Increment), (7, 3, 1, 1));
        counts.count_missing_at_ends();
        assert_eq!(counts.tally(Raw).missing, 2, "both ended alike");
    }

    /// As after a restart of the service: what was in flight comes behind later samples.
    #[test]
    fn what_may_still_come_is_not_lost() {
        let mut counts = StreamCounts::default();
        take_all(&mut counts, Increment, 1, (0..10).chain([30, 31]));
        assert_eq!((counts.tally(Increment).missing, counts.lost(Increment)), (20, 0));
        take_all(&mut counts, Increment, 1, [15, 10, 29].into_iter().chain(11..15).chain(16..29));
        assert_eq!((counts.tally(Increment).missing, counts.lost(Increment)), (0, 0));
        // The beginning of a longer hole is lost at once, the rest when 64 more have come, or in the next session.
        take_all(&mut counts, Increment, 1, [132, 133].into_iter());
        assert_eq!((counts.tally(Increment).missing, counts.lost(Increment)), (100, 37));
        take_all(&mut counts, Increment, 1, 134..=195);
        assert_eq!(counts.lost(Increment), 99);
        take_all(&mut counts, Increment, 1, 196..=196);
        assert_eq!(counts.lost(Increment), 100);
        take_all(&mut counts, Raw, 1, [1, 5].into_iter());
        assert_eq!(counts.lost(Raw), 0);
        take_all(&mut counts, Raw, 2, 0..1);
        assert_eq!(counts.lost(Raw), 3);
        take_all(&mut counts, Raw, 2, [u64::MAX, 0].into_iter());
        assert!(counts.lost(Raw) > 1 << 63);
    }

    #[test]
    fn time_steps_are_those_of_rows_in_order() {
        let mut counts = StreamCounts::default();
        for (sequence, timestamp_ns) in [(1, 10), (2, 20), (3, 60), (5, 100), (4, 70), (6, 110), (7, 0), (8, 900)] {
            counts.take(Increment, Period { session: 1, sequence, timestamp_ns, interval_ns: 10 }, 0);
        }
        let losses = counts.continuity(Increment).losses();
        assert_eq!((losses.time_steps, counts.tally(Increment).missing, counts.tally(Increment).late), (1, 0, 1));
        assert!(counts.continuity(Raw).losses().is_none());
    }

    #[test]
    fn losses_at_the_ends_of_a_session_are_found_in_the_other_stream() {
        let mut counts = StreamCounts::default();
        take_all(&mut counts, Raw, 1, 0..10);
        take_all(&mut counts, Increment, 1, 5..30);
        take_all(&mut counts, Raw, 2, 8..12);
        counts.take(Raw, row(3, 0), 0);
        assert_eq!((counts.tally(Raw).missing, counts.tally(Increment).missing), (0, 0));
        counts.count_missing_at_ends();
        assert_eq!((counts.tally(Raw).missing, counts.tally(Increment).missing), (20, 4));
        // Up to 64 samples without an increment at the end count as in flight; from 65 on, all of them count as
        // missing.
        for (answered, missing) in [(36, 0), (35, 65)] {
            let mut counts = StreamCounts::default();
            take_all(&mut counts, Raw, 1, 0..=100);
            take_all(&mut counts, Increment, 1, 0..=answered);
            counts.count_missing_at_ends();
            assert_eq!(counts.tally(Increment).missing, missing);
        }
        // The same at the beginning. In a later session every increment that has not come is missing.
        for (found, missing) in [(64, 0), (65, 65)] {
            let mut counts = StreamCounts::default();
            take_all(&mut counts, Raw, 1, 0..=100);
            take_all(&mut counts, Increment, 1, found..=100);
            take_all(&mut counts, Raw, 2, 0..=100);
            take_all(&mut counts, Increment, 2, 3..=100);
            counts.count_missing_at_ends();
            assert_eq!(counts.tally(Increment).missing, missing + 3);
        }
    }

    #[test]
    fn arbitrary_sessions_and_sequences_do_not_overflow() {
        let mut counts = StreamCounts::default();
        for session in 0..1000 {
            for sequence in [0, u64::MAX] {
                assert!(counts.take(Raw, row(session, sequence), 0));
                counts.take(Increment, row(session ^ 1, sequence), 0);
            }
        }
        counts.count_missing_at_ends();
        assert_eq!(counts.tally(Raw).missing, u64::MAX);
        assert_eq!(counts.tally(Raw).sessions, 1000);
    }
}
