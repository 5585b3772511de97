//! The waiting line of an acquisition: control periods that could not be sent yet, in private memory.

use crate::pace::Pace;
use crate::transport::stream::RAW_DEPTH;
use core::ops::RangeInclusive;
use isotherm_shared::wire::RawSample;

/// Control periods that wait at most, unless [`Options::kept`](crate::Options::kept) says otherwise: 30 s at 546 Hz.
/// They take 4.1 MiB.
pub const MOST_KEPT: usize = 16_384;
/// The numbers that [`Options::kept`](crate::Options::kept) may have: up to 256 MiB.
pub const KEPT_RANGE: RangeInclusive<usize> = 1..=1 << 20;

/// The line: a ring, oldest first. It never allocates after construction.
#[derive(Debug)]
pub(crate) struct Kept {
    samples: Box<[RawSample]>,
    /// Samples that may wait. The ring has more places: for those that a smaller depth puts back.
    most: usize,
    /// Place of the oldest.
    first: usize,
    len: usize,
    pub pace: Pace,
}

impl Kept {
    /// An empty line for this many samples. All its pages are touched, so that keeping needs no new one.
    pub(crate) fn new(most: usize) -> Self {
        let most = most.clamp(*KEPT_RANGE.start(), *KEPT_RANGE.end());
        // Not zero, so that the pages are written.
        let samples = vec![RawSample { interval_ns: 1, ..RawSample::default() }; most + RAW_DEPTH].into();
        Self { samples, most, first: 0, len: 0, pace: Pace::default() }
    }

    #[inline]
    pub(crate) const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Samples that wait.
    pub(crate) const fn len(&self) -> usize {
        self.len
    }

    const fn place(&self, index: usize) -> usize {
        (self.first + index) % self.samples.len()
    }

    /// Adds the newest. If the line is full, the oldest is dropped for it; returns whether that is so.
    pub(crate) fn push(&mut self, sample: &RawSample) -> bool {
        let is_full = self.len >= self.most;
        if is_full {
            self.pop();
        }
        let place = self.place(self.len);
        self.samples[place] = *sample;
        self.len += 1;
        is_full
    }

    /// Puts samples back that were sent, at most [`RAW_DEPTH`] of them: they are the oldest again.
    pub(crate) fn put_back(&mut self, samples: &[RawSample]) {
        for sample in samples.iter().rev() {
            self.first = self.place(self.samples.len() - 1);
            self.samples[self.first] = *sample;
            self.len += 1;
        }
    }

    /// The places of the samples that wait, and of others.
    pub(crate) fn places_mut(&mut self) -> impl Iterator<Item = &mut RawSample> {
        self.samples.iter_mut()
    }

    /// Takes the oldest out.
    pub(crate) fn pop(&mut self) -> Option<RawSample> {
        let oldest = *self.samples.get(self.first).filter(|_| self.len > 0)?;
        self.len -= 1;
        // An empty line begins at the same memory again.
        self.first = if self.len == 0 { 0 } else { self.place(1) };
        Some(oldest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(sequence: u64) -> RawSample {
        RawSample { sequence, ..RawSample::default() }
    }

    fn all(kept: &mut Kept) -> Vec<u64> {
        std::iter::from_fn(|| kept.pop()).map(|sample| sample.sequence).collect()
    }

    #[test]
    fn the_oldest_makes_room_for_the_newest() {
        let mut kept = Kept::new(3);
        let dropped: Vec<_> = (0..5).filter(|sequence| kept.push(&sample(*sequence))).collect();
        assert_eq!((dropped, kept.len()), (vec![3, 4], 3));
        assert_eq!(all(&mut kept), [2, 3, 4]);
        assert_eq!((kept.first, kept.len(), kept.pop().is_none()), (0, 0, true));
    }

    #[test]
    fn what_is_put_back_comes_first_and_drops_nothing() {
        let mut kept = Kept::new(RAW_DEPTH);
        (0..2 * RAW_DEPTH as u64).for_each(|sequence| _ = kept.push(&sample(100 + sequence)));
        let back: Vec<_> = (0..RAW_DEPTH as u64).map(sample).collect();
        kept.put_back(&back);
        assert_eq!(kept.len(), 2 * RAW_DEPTH);
        let expected = (0..RAW_DEPTH as u64).chain(100 + RAW_DEPTH as u64..100 + 2 * RAW_DEPTH as u64);
        assert_eq!(all(&mut kept), expected.collect::<Vec<_>>());
    }

    #[test]
    fn a_line_has_one_place_at_least() {
        let mut kept = Kept::new(0);
        assert_eq!([kept.push(&sample(1)), kept.push(&sample(2))], [false, true]);
        assert_eq!(all(&mut kept), [2]);
    }
}
