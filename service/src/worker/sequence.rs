//! Whether the samples of a session come in order: gaps, repeats, new sessions. Every session number and sequence number is
//! valid.

/// The session of the last sample, and the highest sequence number of that session.
#[derive(Clone, Copy, Debug, Default)]
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

#[cfg(test)]
mod tests {
    use super::*;

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
