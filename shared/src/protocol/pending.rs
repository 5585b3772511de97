//! Samples that an acquisition has sent and whose answers its user has not received yet. Bounded; allocates only when
//! it is made or gets another size.

/// Samples of type `S` in the order of their sequence, each with its answer of type `A` if that has come.
///
/// A ring. The keys are adjacent, apart from the copies, so that a search touches few cache lines. When the ring gets
/// empty it begins again at its first slot, so that an acquisition with one sample in flight always uses the same
/// memory.
#[derive(Clone, Debug)]
pub(super) struct Pending<S, A> {
    keys: Box<[Key]>,
    samples: Box<[S]>,
    answers: Box<[A]>,
    /// Slot of the oldest sample.
    first: usize,
    len: usize,
}

#[derive(Clone, Copy, Debug, Default)]
struct Key {
    sequence: u64,
    /// What the caller gave with the sample.
    mark: u64,
    /// Whether the slot has an answer, which waits for an earlier answer.
    answered: bool,
}

impl<S: Copy + Default, A: Copy + Default> Pending<S, A> {
    pub(super) fn new(depth: usize) -> Self {
        Self {
            keys: vec![Key::default(); depth].into(),
            samples: vec![S::default(); depth].into(),
            answers: vec![A::default(); depth].into(),
            first: 0,
            len: 0,
        }
    }

    #[inline]
    pub(super) const fn len(&self) -> usize {
        self.len
    }

    pub(super) const fn depth(&self) -> usize {
        self.keys.len()
    }

    #[inline]
    pub(super) const fn is_full(&self) -> bool {
        self.len >= self.keys.len()
    }

    /// Slot of the sample with this index, 0 for the oldest.
    #[inline]
    const fn slot(&self, index: usize) -> usize {
        let slot = self.first + index;
        if slot < self.keys.len() { slot } else { slot - self.keys.len() }
    }

    /// Keeps a copy of a sample, and a mark that comes back with its answer; returns the copy. Its sequence must be
    /// above all that are kept, and the caller must have checked [`is_full`](Self::is_full).
    #[inline]
    pub(super) fn push(&mut self, sequence: u64, mark: u64, sample: &S) -> &mut S {
        let slot = self.slot(self.len);
        self.keys[slot] = Key { sequence, mark, answered: false };
        self.len += 1;
        let kept = &mut self.samples[slot];
        *kept = *sample;
        kept
    }

    /// Makes place for `depth` samples in all. The oldest stay, with their answers; returns the others, oldest first.
    pub(super) fn resize(&mut self, depth: usize) -> Vec<S> {
        let old = core::mem::replace(self, Self::new(depth));
        for (index, slot) in old.slots(0).enumerate().take(depth) {
            (self.keys[index], self.samples[index], self.answers[index]) =
                (old.keys[slot], old.samples[slot], old.answers[slot]);
        }
        self.len = old.len.min(depth);
        old.samples(self.len).copied().collect()
    }

    /// Removes the newest sample.
    pub(super) const fn pop_newest(&mut self) {
        self.len = self.len.saturating_sub(1);
    }

    #[inline]
    const fn pop_oldest(&mut self) {
        self.len -= 1;
        self.first = if self.len == 0 { 0 } else { self.slot(1) };
    }

    /// Takes an answer; repeated and unknown ones are ignored. If it answers the oldest sample, removes that sample and
    /// returns true: the caller may return the answer to its user at once. Also returns the sample's mark, 0 if it is
    /// unknown.
    #[inline]
    pub(super) fn accept(&mut self, sequence: u64, answer: &A) -> (bool, u64) {
        let oldest = self.keys[self.first];
        if self.len > 0 && oldest.sequence == sequence && !oldest.answered {
            self.pop_oldest();
            return (true, oldest.mark);
        }
        (false, self.keep(sequence, answer))
    }

    /// Keeps an answer until the answers to all earlier samples have come.
    fn keep(&mut self, sequence: u64, answer: &A) -> u64 {
        let Some(slot) = self.slots(0).find(|slot| self.keys[*slot].sequence == sequence) else { return 0 };
        let key = &mut self.keys[slot];
        if !key.answered {
            key.answered = true;
            self.answers[slot] = *answer;
        }
        key.mark
    }

    /// Removes the oldest sample if its answer has come, and returns that answer. So answers leave in the order in
    /// which their samples were sent.
    #[inline]
    pub(super) fn pop_answered(&mut self) -> Option<A> {
        if self.len == 0 || !self.keys[self.first].answered {
            return None;
        }
        let answer = self.answers[self.first];
        self.pop_oldest();
        Some(answer)
    }

    fn slots(&self, from: usize) -> impl Iterator<Item = usize> + '_ {
        (from..self.len).map(|index| self.slot(index))
    }

    /// The samples from this index on, oldest first; also those whose answers wait for an earlier answer.
    pub(super) fn samples(&self, from: usize) -> impl Iterator<Item = &S> {
        self.slots(from).map(|slot| &self.samples[slot])
    }

    /// The places of the samples, and of others.
    pub(super) fn places_mut(&mut self) -> impl Iterator<Item = &mut S> {
        self.samples.iter_mut()
    }

    /// Sequence of each sample, oldest first, and whether its answer has come.
    pub(super) fn keys(&self) -> impl Iterator<Item = (u64, bool)> {
        self.slots(0).map(|slot| (self.keys[slot].sequence, self.keys[slot].answered))
    }

    /// For the search: the mark of each sample.
    #[cfg(test)]
    pub(super) fn marks(&self) -> impl Iterator<Item = u64> {
        self.slots(0).map(|slot| self.keys[slot].mark)
    }

    /// Whether an unanswered sample was sent before an answered one.
    pub(super) fn is_overtaken(&self) -> bool {
        self.keys().skip_while(|(_, answered)| *answered).any(|(_, answered)| answered)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_leave_once_and_in_order_wherever_the_ring_begins() {
        let mut pending = Pending::new(3);
        for before in 0..5 {
            // Moves the first slot without letting the ring get empty.
            pending.push(0, 0, &0);
            for sequence in 1..=before {
                pending.push(sequence, 10 * sequence, &sequence);
                assert_eq!(pending.accept(sequence - 1, &0), (true, 10 * (sequence - 1)));
            }
            for sequence in [10, 20] {
                assert!(!pending.is_full());
                pending.push(sequence, 10 * sequence, &sequence);
            }
            assert!(pending.is_full());
            for (sequence, mark) in [(20, 200), (10, 100), (10, 100), (15, 0), (9, 0)] {
                assert_eq!(pending.accept(sequence, &sequence), (false, mark));
                assert!(pending.pop_answered().is_none());
            }
            assert!(pending.is_overtaken());
            assert_eq!(pending.keys().collect::<Vec<_>>(), [(before, false), (10, true), (20, true)]);
            assert_eq!(pending.samples(1).collect::<Vec<_>>(), [&10, &20]);
            assert_eq!(pending.accept(before, &before), (true, 10 * before));
            assert!(!pending.is_overtaken());
            let order: Vec<_> = std::iter::from_fn(|| pending.pop_answered()).collect();
            assert_eq!(order, [10, 20]);
            assert_eq!((pending.len(), pending.first), (0, 0), "an empty ring begins at its first slot again");
        }
    }

    #[test]
    fn the_newest_can_be_taken_back() {
        let mut pending = Pending::new(2);
        pending.push(1, 7, &());
        pending.push(2, 8, &());
        pending.pop_newest();
        assert_eq!(pending.keys().collect::<Vec<_>>(), [(1, false)]);
        assert_eq!([1, 2].map(|sequence| pending.accept(sequence, &())), [(true, 7), (false, 0)]);
    }
}
