//! Samples that an acquisition has sent and whose answers its user has not received yet. Bounded; never allocates after
//! construction.

use isotherm_shared::wire::{CompensatedIncrement, RawSample};
use std::collections::VecDeque;

/// Samples in the order of their sequence, each with its answer if that has come.
#[derive(Debug)]
pub(crate) struct Pending {
    entries: VecDeque<(RawSample, Option<CompensatedIncrement>)>,
    depth: usize,
}

impl Pending {
    pub(crate) fn new(depth: usize) -> Self {
        Self { entries: VecDeque::with_capacity(depth), depth }
    }

    #[inline]
    pub(crate) fn len(&self) -> usize {
        self.entries.len()
    }

    pub(crate) fn depth(&self) -> usize {
        self.depth
    }

    #[inline]
    pub(crate) fn is_full(&self) -> bool {
        self.entries.len() >= self.depth
    }

    /// Keeps a copy of a sample. Its sequence must be above all that are kept, and the caller must have checked
    /// [`is_full`](Self::is_full).
    #[inline]
    pub(crate) fn push(&mut self, sample: RawSample) {
        self.entries.push_back((sample, None));
    }

    /// Takes an answer; repeated and unknown ones are ignored. If it answers the oldest sample, removes that sample and
    /// returns true: the caller may return the answer to its user at once.
    #[inline]
    pub(crate) fn accept(&mut self, answer: &CompensatedIncrement) -> bool {
        if let Some((oldest, None)) = self.entries.front()
            && oldest.sequence == answer.sequence
        {
            self.entries.pop_front();
            return true;
        }
        self.keep(answer);
        false
    }

    /// Keeps an answer until the answers to all earlier samples have come.
    fn keep(&mut self, answer: &CompensatedIncrement) {
        let index = self.entries.binary_search_by_key(&answer.sequence, |(sample, _)| sample.sequence);
        if let Some((_, kept)) = index.ok().and_then(|index| self.entries.get_mut(index))
            && kept.is_none()
        {
            *kept = Some(*answer);
        }
    }

    /// Removes the oldest sample if its answer has come, and returns that answer. So answers leave in the order in which their
    /// samples were sent.
    #[inline]
    pub(crate) fn pop_answered(&mut self) -> Option<CompensatedIncrement> {
        let answer = self.entries.front()?.1?;
        self.entries.pop_front();
        Some(answer)
    }

    /// The samples without an answer, oldest first. With `answered` also those whose answers wait for an earlier answer.
    pub(crate) fn samples(&self, answered: bool) -> impl Iterator<Item = &RawSample> {
        self.entries.iter().filter(move |(_, answer)| answered || answer.is_none()).map(|(sample, _)| sample)
    }

    /// Number of unanswered samples that were sent before an answered one.
    pub(crate) fn overtaken(&self) -> usize {
        let last = self.entries.iter().rposition(|(_, answer)| answer.is_some()).unwrap_or(0);
        self.entries.iter().take(last).filter(|(_, answer)| answer.is_none()).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(sequence: u64) -> RawSample {
        RawSample { sequence, ..RawSample::default() }
    }

    fn answer(sequence: u64) -> CompensatedIncrement {
        CompensatedIncrement { sequence, ..CompensatedIncrement::default() }
    }

    #[test]
    fn answers_leave_once_and_in_order() {
        let mut pending = Pending::new(3);
        for sequence in [10, 11, 20] {
            assert!(!pending.is_full());
            pending.push(sample(sequence));
        }
        assert!(pending.is_full());
        for sequence in [20, 11, 11, 15, 9] {
            assert!(!pending.accept(&answer(sequence)));
            assert!(pending.pop_answered().is_none());
        }
        let samples = |answered| pending.samples(answered).map(|sample| sample.sequence).collect::<Vec<_>>();
        assert_eq!((samples(false), samples(true), pending.overtaken()), (vec![10], vec![10, 11, 20], 1));
        assert!(pending.accept(&answer(10)));
        let order: Vec<_> = std::iter::from_fn(|| pending.pop_answered()).map(|a| a.sequence).collect();
        assert_eq!(order, [11, 20]);
        assert_eq!(pending.len(), 0);
    }
}
