//! A reader's part of the protocol: it remembers which samples or increments have been returned to the caller already.

use std::collections::VecDeque;

/// Length of the range of sequences within which a repeat is recognised; more than can ever be in flight.
const WINDOW: u64 = 1024;
const WORDS: usize = (WINDOW / 64) as usize;
/// Number of remembered sessions: the running acquisition's, and its predecessors', whose last samples may still
/// arrive.
const SESSIONS: usize = 4;

/// Remembers (session, sequence) pairs, in bounded memory and without allocation after construction.
#[derive(Clone, Debug, Eq, Hash, PartialEq)]
pub struct ReaderState {
    sessions: VecDeque<Session>,
    repeats: u64,
}

impl Default for ReaderState {
    fn default() -> Self {
        Self::new()
    }
}

#[derive(Clone, Debug, Eq, Hash, PartialEq)]
struct Session {
    id: u64,
    highest: u64,
    /// Bit `sequence % WINDOW` for each received sequence in (highest - WINDOW, highest].
    received: [u64; WORDS],
}

impl ReaderState {
    /// A reader that has seen nothing.
    #[must_use]
    pub fn new() -> Self {
        Self { sessions: VecDeque::with_capacity(SESSIONS), repeats: 0 }
    }

    /// Whether this is the first time that the pair comes. A sequence that is older than the window counts as known.
    pub fn first_time(&mut self, session: u64, sequence: u64) -> bool {
        let first = self.remember(session, sequence);
        self.repeats += u64::from(!first);
        first
    }

    /// Samples or increments that came again.
    #[must_use]
    pub const fn repeats(&self) -> u64 {
        self.repeats
    }

    fn remember(&mut self, session: u64, sequence: u64) -> bool {
        if let Some(known) = self.sessions.iter_mut().find(|known| known.id == session) {
            return known.first_time(sequence);
        }
        if self.sessions.len() == SESSIONS {
            self.sessions.pop_front();
        }
        let mut new = Session { id: session, highest: sequence, received: [0; WORDS] };
        new.mark(sequence);
        self.sessions.push_back(new);
        true
    }
}

impl Session {
    fn first_time(&mut self, sequence: u64) -> bool {
        if sequence > self.highest {
            // The window moves: clear the bits of its new sequences, which still stand for old ones.
            let moved = (sequence - self.highest).min(WINDOW);
            for step in 0..moved {
                let bit = sequence.wrapping_sub(step) % WINDOW;
                self.received[(bit / 64) as usize] &= !(1 << (bit % 64));
            }
            self.highest = sequence;
        } else if self.highest - sequence >= WINDOW || self.is_marked(sequence) {
            return false;
        }
        self.mark(sequence);
        true
    }

    fn mark(&mut self, sequence: u64) {
        let bit = sequence % WINDOW;
        self.received[(bit / 64) as usize] |= 1 << (bit % 64);
    }

    fn is_marked(&self, sequence: u64) -> bool {
        let bit = sequence % WINDOW;
        self.received[(bit / 64) as usize] & (1 << (bit % 64)) != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    #[test]
    fn sessions_are_independent_and_the_oldest_is_forgotten() {
        let mut once = ReaderState::new();
        for session in 0..5 {
            assert!(once.first_time(session, 1));
            assert!(!once.first_time(session, 1));
        }
        assert!(!once.first_time(1, 1));
        assert!(once.first_time(0, 1), "session 0 was pushed out by the fifth");
    }

    #[test]
    fn far_back_counts_as_known() {
        let mut once = ReaderState::new();
        assert!(once.first_time(1, 5000));
        assert!(once.first_time(1, 5000 - 1023));
        assert!(!once.first_time(1, 5000 - 1024));
        assert!(once.first_time(1, u64::MAX));
        assert!(once.first_time(1, u64::MAX - 1));
        assert!(!once.first_time(1, u64::MAX));
    }

    proptest! {
        #[test]
        fn within_the_window_it_is_a_set(sequences in prop::collection::vec(0u64..1024, 0..500)) {
            let (mut once, mut seen) = (ReaderState::new(), BTreeSet::new());
            for sequence in sequences {
                prop_assert_eq!(once.first_time(9, sequence), seen.insert(sequence));
            }
        }

        #[test]
        fn in_rising_order_all_are_new(steps in prop::collection::vec(1u64..3000, 1..300)) {
            let (mut once, mut sequence) = (ReaderState::new(), 0);
            for step in steps {
                sequence += step;
                prop_assert!(once.first_time(9, sequence));
                prop_assert!(!once.first_time(9, sequence));
            }
        }
    }
}
