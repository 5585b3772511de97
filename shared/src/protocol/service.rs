//! The service's part of the protocol: whether the samples of a session come in order, and what the increment says about it.
//! Every session number and sequence number is valid.

use crate::wire::Flags;

/// The session of the last sample, and the highest sequence number of that session.
#[derive(Clone, Copy, Debug, Default, Eq, Hash, PartialEq)]
pub struct SequenceTracker {
    last: Option<(u64, u64)>,
}

/// What session and sequence number say about a sample.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct Arrival {
    /// Samples of its session that are missing before it.
    pub missing: u64,
    /// Its sequence number is not above the highest of its session: a resend.
    pub repeated: bool,
    /// It is the first of its session.
    pub begins: bool,
}

impl SequenceTracker {
    /// Notes session and sequence number of the next sample.
    #[inline]
    pub fn note(&mut self, session: u64, sequence: u64) -> Arrival {
        let (arrival, highest) = match self.last {
            Some((known, highest)) if known == session => {
                let missing = sequence.saturating_sub(highest).saturating_sub(1);
                (Arrival { missing, repeated: sequence <= highest, begins: false }, highest.max(sequence))
            }
            _ => (Arrival { begins: true, ..Arrival::default() }, sequence),
        };
        self.last = Some((session, highest));
        arrival
    }
}

impl Arrival {
    /// The [delivery flags](Flags::DELIVERY) of the increment, which is published this long after its sample was sent.
    #[inline]
    #[must_use]
    pub const fn flags(self, latency_ns: u64, budget_ns: u64) -> Flags {
        let gap = if self.missing > 0 { Flags::GAP.0 } else { 0 };
        let late = if latency_ns > budget_ns { Flags::LATE.0 } else { 0 };
        Flags(gap | late)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_of_gaps_and_late_answers() {
        let gap = Arrival { missing: 1, ..Arrival::default() };
        let repeat = Arrival { repeated: true, ..Arrival::default() };
        assert_eq!([gap.flags(10, 10), gap.flags(11, 10)], [Flags::GAP, Flags::DELIVERY]);
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
            begins,
            Arrival { missing: u64::MAX - 1, ..plain },
            repeated,
        ];
        assert_eq!(arrivals.map(|(session, sequence)| tracker.note(session, sequence)), expected);
    }
}
