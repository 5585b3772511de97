//! The service's part of the protocol: whether the samples of a session come in order, and what the increment says
//! about it. Every session number and sequence number is valid.

use crate::sequence::{Period, rises, time_step};
use crate::wire::Flags;

/// Number of remembered sessions, as many as a reader remembers: the running acquisition's, and its predecessors',
/// whose last samples may still arrive or come again.
const SESSIONS: usize = 4;

/// Of each of the last sessions, the sample with the highest sequence number.
#[derive(Clone, Copy, Debug, Default, Eq, Hash, PartialEq)]
pub struct SequenceTracker {
    /// The session of the last sample first, then that of the last sample of another session, and so on.
    highest: [Option<Period>; SESSIONS],
}

/// What session, sequence number and times say about a sample.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct Arrival {
    /// Samples of its session that are missing before it.
    pub missing: u64,
    /// Its sequence number is not above the highest of its session: a resend.
    pub repeated: bool,
    /// It is the first of its session.
    pub begins: bool,
    /// None is missing before it, but its time is not one interval after that of the sample before: [`time_step`].
    pub time_step: bool,
}

impl SequenceTracker {
    /// Notes the next sample.
    #[inline]
    pub fn note(&mut self, sample: Period) -> Arrival {
        let [last, ..] = self.highest;
        let Some(last) = last.filter(|last| last.session == sample.session).or_else(|| self.turn_to(sample.session))
        else {
            self.highest[0] = Some(sample);
            return Arrival { begins: true, ..Arrival::default() };
        };
        if !rises(Some(last.sequence), sample.sequence) {
            return Arrival { repeated: true, ..Arrival::default() };
        }
        self.highest[0] = Some(sample);
        let missing = sample.sequence - last.sequence - 1;
        Arrival { missing, time_step: time_step(last, sample), ..Arrival::default() }
    }

    /// Puts a session first. Returns its highest sample; `None` if it is new, or was forgotten.
    #[cold]
    #[inline(never)]
    fn turn_to(&mut self, session: u64) -> Option<Period> {
        let is_known = |known: &Option<Period>| known.is_some_and(|known| known.session == session);
        let place = self.highest.iter().position(is_known);
        self.highest[..=place.unwrap_or(SESSIONS - 1)].rotate_right(1);
        self.highest[0].filter(|_| place.is_some())
    }
}

impl Arrival {
    /// The [delivery flags](Flags::DELIVERY) of the increment, which is published this long after its sample was sent.
    #[inline]
    #[must_use]
    pub const fn flags(self, latency_ns: u64, budget_ns: u64) -> Flags {
        let gap = if self.missing > 0 { Flags::GAP.0 } else { 0 };
        let late = if latency_ns > budget_ns { Flags::LATE.0 } else { 0 };
        let time_step = if self.time_step { Flags::TIME_STEP.0 } else { 0 };
        Flags(gap | late | time_step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_of_gaps_and_late_answers() {
        let gap = Arrival { missing: 1, ..Arrival::default() };
        let repeat = Arrival { repeated: true, ..Arrival::default() };
        let step = Arrival { time_step: true, ..Arrival::default() };
        assert_eq!([step.flags(10, 10), step.flags(11, 10)], [Flags::TIME_STEP, Flags::TIME_STEP | Flags::LATE]);
        assert_eq!([gap.flags(10, 10), gap.flags(11, 10)], [Flags::GAP, Flags::GAP | Flags::LATE]);
        assert_eq!([repeat.flags(10, 10), repeat.flags(11, 10)], [Flags(0), Flags::LATE]);
    }

    #[test]
    fn gaps_repeats_and_sessions() {
        let mut tracker = SequenceTracker::default();
        let (plain, begins) = (Arrival::default(), Arrival { begins: true, ..Arrival::default() });
        let repeated = Arrival { repeated: true, ..plain };
        let arrivals = [(1, 5), (1, 6), (1, 9), (1, 7), (1, 9), (2, 9), (1, 0), (1, u64::MAX), (1, u64::MAX)];
        let expected = [
            begins,
            plain,
            Arrival { missing: 2, ..plain },
            repeated,
            repeated,
            begins,
            repeated,
            Arrival { missing: u64::MAX - 10, ..plain },
            repeated,
        ];
        assert_eq!(arrivals.map(|(session, sequence)| tracker.note(at(session, sequence, 0))), expected);
    }

    /// Samples of an earlier session that come again make no session, and hide no gap of the newer one.
    #[test]
    fn the_last_four_sessions_are_remembered() {
        let mut tracker = SequenceTracker::default();
        let mut note = |session, sequence| tracker.note(at(session, sequence, 0));
        let (repeated, begins) =
            (Arrival { repeated: true, ..Arrival::default() }, Arrival { begins: true, ..Arrival::default() });
        for session in 1..=4 {
            assert_eq!(note(session, 9), begins);
        }
        assert_eq!([note(1, 8), note(4, 9), note(2, 9), note(3, 1)], [repeated; 4]);
        assert_eq!(note(4, 12), Arrival { missing: 2, ..Arrival::default() });
        assert_eq!(note(1, 10), Arrival::default());
        // The session whose last sample is the longest ago is forgotten.
        assert_eq!(note(5, 0), begins);
        assert_eq!([note(1, 10), note(3, 9), note(4, 12), note(5, 0)], [repeated; 4]);
        assert_eq!(note(2, 9), begins);
    }

    fn at(session: u64, sequence: u64, timestamp_ns: u64) -> Period {
        Period { session, sequence, timestamp_ns, interval_ns: 10 }
    }

    #[test]
    fn a_time_step_is_one_against_the_highest_sequence_of_the_session() {
        let mut tracker = SequenceTracker::default();
        let mut steps = |session, sequence, timestamp_ns| tracker.note(at(session, sequence, timestamp_ns)).time_step;
        assert!(!steps(1, 5, 100) && !steps(1, 6, 110) && steps(1, 7, 140), "30 ns for a period of 10 ns");
        // A repeat has none, and is not what the next sample is compared with.
        assert!(!steps(1, 7, 170) && !steps(1, 6, 110) && !steps(1, 8, 150));
        // Nor has a sample after a gap, the first of a session, or one without a timestamp on either side.
        assert!(!steps(1, 10, 900) && !steps(2, 11, 5) && !steps(2, 12, 0) && !steps(2, 13, 900) && steps(2, 14, 900));
    }
}
