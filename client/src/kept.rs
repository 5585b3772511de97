//! The waiting line of an acquisition: control periods that could not be sent yet, in private memory. They are summed
//! as far as a sum stays one that the service computes like its periods; then another sum begins.

use crate::pace::Pace;
use isotherm_shared::nominal::MAX_MULTIPLE;
use isotherm_shared::protocol::{AcquisitionState, Refusal};
use isotherm_shared::sequence::{Period, rises, time_step};
use isotherm_shared::wire::{RawSample, Triad};

/// Most sums that wait: 30 s at 546 Hz even where no two periods fit into one. They take 4.1 MiB.
pub const MOST_KEPT: usize = 16_384;

/// How far a sum may go, beyond what its fields hold.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) struct Ceiling {
    pub periods: u64,
    pub interval_ns: u64,
}

impl Ceiling {
    /// For a table whose scale factors hold at any interval: as far as a sum fits.
    pub(crate) const COUNTS: Self = Self { periods: u64::MAX, interval_ns: u64::MAX };
    /// For a table that is not known: right for readings of one nominal interval each.
    pub(crate) const UNKNOWN: Self = Self { periods: MAX_MULTIPLE, ..Self::COUNTS };

    /// For a table of this nominal interval \[ns\]: as long as a sum is not flagged `interval-not-nominal`, which has
    /// a tolerance of 1 %.
    pub(crate) const fn readings(nominal_ns: u64) -> Self {
        Self { interval_ns: (MAX_MULTIPLE * 101).saturating_mul(nominal_ns) / 100, ..Self::UNKNOWN }
    }
}

/// A sample that waits: a control period, or the sum of several.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Sum {
    /// Within the line its sequence has no [shift](Kept::shift).
    pub raw: RawSample,
    /// The control periods in it.
    pub periods: u64,
}

/// Why a control period was not kept.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) struct SequenceRefusal;

/// The line: a ring, oldest first. It never allocates after construction.
#[derive(Debug)]
pub(crate) struct Kept {
    sums: Box<[Sum]>,
    /// Place of the oldest.
    first: usize,
    len: usize,
    /// Control periods in all sums.
    periods: u64,
    /// What is added to each sequence: the numbers that were left out for sums that were dropped, since they had fewer
    /// than periods.
    shift: u64,
    /// Control periods that were dropped since the line was last empty.
    dropped: u64,
    pub pace: Pace,
}

impl Kept {
    /// An empty line for this many sums, at least 1. All its pages are touched, so that keeping needs no new one.
    pub(crate) fn new(most: usize) -> Self {
        let sums = vec![Sum::default(); most.max(1)].into();
        Self { sums, first: 0, len: 0, periods: 0, shift: 0, dropped: 0, pace: Pace::default() }
    }

    #[inline]
    pub(crate) const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Sums that wait.
    pub(crate) const fn sums(&self) -> usize {
        self.len
    }

    /// Control periods that wait.
    pub(crate) const fn periods(&self) -> u64 {
        self.periods
    }

    /// Control periods that wait and have no number of their own.
    pub(crate) const fn unnumbered(&self) -> u64 {
        self.periods - self.len as u64
    }

    /// Control periods that were dropped since the line was last empty.
    pub(crate) const fn dropped(&self) -> u64 {
        self.dropped
    }

    fn place(&self, index: usize) -> usize {
        (self.first + index) % self.sums.len()
    }

    fn newest(&mut self) -> Option<&mut Sum> {
        let place = self.place(self.len.checked_sub(1)?);
        self.sums.get_mut(place)
    }

    /// Takes the next control period, whose sequence is set. `is_own`: its loan has that number, and it may be given to
    /// the next loan.
    pub(crate) fn take<A: Copy + Default>(
        &mut self,
        state: &mut AcquisitionState<RawSample, A>,
        mut raw: RawSample,
        is_own: bool,
        ceiling: Ceiling,
    ) -> Result<(), SequenceRefusal> {
        let shift = self.shift;
        let newest = self.newest().map(|newest| (newest.raw.sequence.wrapping_add(shift), newest));
        let last = newest.as_ref().map(|(sequence, _)| *sequence).or_else(|| state.last_sequence());
        if !rises(last, raw.sequence) {
            return Err(SequenceRefusal);
        }
        if let Some((sequence, newest)) = newest
            && is_own
            && raw.sequence - sequence == 1
            && state.is_newest(raw.sequence)
            && newest.add(&raw, ceiling)
        {
            state.cancel(raw.sequence);
            self.periods += 1;
            return Ok(());
        }
        if self.len == self.sums.len() {
            let lost = self.pop().map_or(0, |lost| lost.periods);
            self.dropped += lost;
            self.leave_out(state, lost - 1);
            raw.sequence = raw.sequence.saturating_add(lost - 1);
        }
        state.keep(raw.sequence, self.len > 0);
        raw.sequence = raw.sequence.wrapping_sub(self.shift);
        let place = self.place(self.len);
        self.sums[place] = Sum { raw, periods: 1 };
        (self.len, self.periods) = (self.len + 1, self.periods + 1);
        Ok(())
    }

    /// Leaves numbers out before all that waits, for control periods that are lost.
    fn leave_out<A: Copy + Default>(&mut self, state: &mut AcquisitionState<RawSample, A>, periods: u64) {
        state.leave_out(periods);
        self.shift = self.shift.wrapping_add(periods);
    }

    /// Takes the oldest out, if it may be sent. Then it must be: [`failed`](Self::failed) is for one that could not.
    pub(crate) fn next<A: Copy + Default>(&mut self, state: &mut AcquisitionState<RawSample, A>) -> Option<Sum> {
        loop {
            let oldest = self.sums.get(self.first).filter(|_| self.len > 0)?;
            match state.may_send(oldest.raw.sequence.wrapping_add(self.shift)) {
                Ok(()) => return self.pop(),
                Err(Refusal::Full) => return None,
                // Numbers have come to their end, 2^64-1.
                Err(Refusal::Sequence) => state.lose(self.pop()?.periods),
            }
        }
    }

    /// The transport has failed, and the number of this sum was counted as lost: so are its other periods.
    pub(crate) fn failed<A: Copy + Default>(&mut self, state: &mut AcquisitionState<RawSample, A>, lost: &Sum) {
        self.leave_out(state, lost.periods - 1);
    }

    fn pop(&mut self) -> Option<Sum> {
        let mut oldest = *self.sums.get(self.first).filter(|_| self.len > 0)?;
        oldest.raw.sequence = oldest.raw.sequence.wrapping_add(self.shift);
        (self.first, self.len) = (self.place(1), self.len - 1);
        self.periods -= oldest.periods;
        if self.len == 0 {
            // The next one begins at the same memory.
            (self.first, self.shift, self.dropped) = (0, 0, 0);
        }
        Some(oldest)
    }
}

impl Sum {
    /// Adds the next control period if the sum stays one that the service computes like its periods.
    fn add(&mut self, later: &RawSample, ceiling: Ceiling) -> bool {
        let interval_ns = self.raw.interval_ns.saturating_add(later.interval_ns);
        let fits = self.periods < ceiling.periods && interval_ns <= ceiling.interval_ns && are_alike(&self.raw, later);
        let added = fits && self.raw.merge(later).is_ok();
        self.periods += u64::from(added);
        added
    }
}

/// Whether nothing about a control period would vanish, or spoil the others, in a sum with the one before it: both have
/// an interval and are of the same unit, the same sensors have temperature, and no time is missing between them.
fn are_alike(before: &RawSample, later: &RawSample) -> bool {
    let finite = |triad: &Triad| {
        [triad.head_temperature, triad.board_temperature].map(|temperature| temperature.map(f64::is_finite))
    };
    let step = time_step(
        Period { session: later.session, sequence: later.sequence.wrapping_sub(1), ..Period::from(before) },
        Period::from(later),
    );
    before.device == later.device
        && before.interval_ns != 0
        && later.interval_ns != 0
        && finite(&before.accelerometers) == finite(&later.accelerometers)
        && finite(&before.gyroscopes) == finite(&later.gyroscopes)
        && before.gyroscopes.is_absent() == later.gyroscopes.is_absent()
        && !step
}

#[cfg(test)]
#[path = "kept/tests.rs"]
mod tests;
