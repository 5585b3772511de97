//! How the pieces of a recording go on from each other.

use isotherm_shared::sequence::{Period, rises};
use isotherm_shared::wire::RawSample;

/// A piece goes on where its first row is at most so many intervals after the last row of the piece before. A step by
/// more is a fault of time within a recording, too, and a logger that is started again takes longer.
pub const MOST_PERIODS: u64 = 10;
/// Intervals that differ by more than a part of so many are those of two rates.
const SAME_RATE: u64 = 4;

/// Rule for the raw samples of a recording, in every format and over all its pieces: within a session the sequence
/// [`rises`], as an acquisition sends it. A piece without sessions that begins its sequences anew goes on where its
/// time does; otherwise it is a session of its own, if its rows may be.
#[derive(Clone, Copy, Debug, Default)]
pub struct SequenceRule {
    /// The last sample.
    last: Option<Period>,
    /// The session of samples that name none, and the first of them.
    unnamed: u64,
    first: Option<RawSample>,
    /// The number of a piece whose first sample has not come.
    piece: Option<u64>,
    /// What is added to the sequences of the piece, which goes on with the session of the piece before; otherwise 0.
    added: u64,
    /// The highest session so far.
    highest: u64,
}

impl SequenceRule {
    /// Begins a piece. If its samples name no session, and their sequences begin anew, they go on with the session of
    /// the piece before where the time does ([`goes_on`]), and otherwise are the session with this number. A piece that
    /// overlaps another one does neither, nor does its copy.
    pub const fn begin_piece(&mut self, number: u64) {
        self.piece = Some(number);
        self.added = 0;
    }

    /// Begins another session of samples that name none: their clock and their sequences begin anew.
    pub fn begin_session(&mut self) {
        (self.unnamed, self.first, self.piece, self.added) = (self.highest + 1, None, None, 0);
    }

    /// Gives the next sample a session where its piece has one of its own, and a sequence where its piece goes on with
    /// the one before, and checks it.
    ///
    /// # Errors
    /// As [`check`](Self::check).
    pub fn take(&mut self, sample: &mut RawSample) -> Result<(), String> {
        let piece = self.piece.take();
        if sample.session == 0 {
            let before = self.last.filter(|last| last.session == self.unnamed);
            let begins_anew = |sample: &RawSample| before.is_some_and(|last| sample.sequence <= last.sequence);
            if piece.is_some() && begins_anew(sample) {
                let goes_on = before.and_then(|last| last.sequence.checked_add(goes_on(last, &*sample)?));
                self.added = goes_on.map_or(0, |sequence| sequence - sample.sequence);
            }
            sample.sequence = sample.sequence.saturating_add(self.added);
            let is_anew = |first: RawSample| sample.sequence <= first.sequence && *sample != first;
            let own = piece.map(|number| if self.highest > 0 { number.max(self.highest + 1) } else { number });
            let own = own.filter(|_| begins_anew(sample) && self.first.is_some_and(is_anew));
            if own.is_some() || self.first.is_none() {
                self.first = Some(*sample);
            }
            self.unnamed = own.unwrap_or(self.unnamed);
            sample.session = self.unnamed;
        }
        self.check(sample)
    }

    /// Checks the next sample.
    ///
    /// # Errors
    /// If its sequence is not above that of the previous sample of the session.
    pub fn check(&mut self, sample: &RawSample) -> Result<(), String> {
        self.highest = self.highest.max(sample.session);
        let previous = self.last.replace(sample.into());
        let last = previous.filter(|last| last.session == sample.session).map(|last| last.sequence);
        match last {
            Some(last) if !rises(Some(last), sample.sequence) => {
                let remedy = if sample.sequence == last {
                    "remove the row that is there twice, or give both their own sequence"
                } else {
                    "put the rows in order of time; if the acquisition was started again, give its rows another session"
                };
                Err(format!("sequence {} after {last}; it must rise from row to row: {remedy}", sample.sequence))
            }
            _ => Ok(()),
        }
    }
}

/// The periods from `last`, the last row of a piece, to `next`, the first row of another one, if that goes on where the
/// first one ends: its stamp is later, by up to [`MOST_PERIODS`] intervals, and both have one rate. Sessions and
/// sequences do not count.
///
/// ```
/// use isotherm_recording::goes_on;
/// use isotherm_shared::sequence::Period;
///
/// let last = Period { session: 0, sequence: 799, timestamp_ns: 8_000_000_000, interval_ns: 10_000_000 };
/// let next = |timestamp_ns| Period { sequence: 0, timestamp_ns, ..last };
/// assert_eq!(goes_on(last, next(8_010_000_000)), Some(1));
/// assert_eq!(goes_on(last, next(8_030_000_000)), Some(3)); // two rows are missing
/// assert_eq!(goes_on(last, next(9_000_000_000)), None);
/// assert_eq!(goes_on(last, next(10_000_000)), None); // the clock began anew
/// ```
#[must_use]
pub fn goes_on(last: impl Into<Period>, next: impl Into<Period>) -> Option<u64> {
    let (last, next) = (last.into(), next.into());
    let step_ns = next.timestamp_ns.checked_sub(last.timestamp_ns).filter(|step_ns| *step_ns > 0)?;
    let interval_ns = next.interval_ns;
    let is_same_rate = last.interval_ns.abs_diff(interval_ns) <= interval_ns / SAME_RATE;
    let most_ns = interval_ns.checked_mul(MOST_PERIODS)?;
    let is_next = last.timestamp_ns > 0 && is_same_rate && step_ns <= most_ns;
    is_next.then(|| ((step_ns + interval_ns / 2) / interval_ns).max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(sequence: u64, timestamp_ns: u64, pulses: u32) -> RawSample {
        let mut sample = RawSample { sequence, timestamp_ns, interval_ns: 10_000_000, ..RawSample::default() };
        sample.accelerometers.positive_pulses[0] = pulses;
        sample
    }

    /// Sessions and sequences of pieces, each of three rows from a stamp on [intervals].
    fn joined(begins: &[u64]) -> Result<Vec<(u64, u64)>, String> {
        let mut rule = SequenceRule::default();
        let mut rows = Vec::new();
        for (number, begin) in (1..).zip(begins) {
            if number > 1 {
                rule.begin_piece(number);
            }
            for sequence in 0..3 {
                let mut sample = row(sequence, (begin + sequence) * 10_000_000, number as u32);
                rule.take(&mut sample)?;
                rows.push((sample.session, sample.sequence));
            }
        }
        Ok(rows)
    }

    #[test]
    fn a_piece_goes_on_where_its_time_does() {
        let session = |session: u64, begin: u64| (begin..begin + 3).map(move |sequence| (session, sequence));
        let goes_on = |begins: &[u64], expected: &[(u64, u64)]| {
            let expected: Vec<_> = expected.iter().flat_map(|(number, begin)| session(*number, *begin)).collect();
            assert_eq!(joined(begins).unwrap(), expected, "{begins:?}");
        };
        goes_on(&[100, 103, 106], &[(0, 0), (0, 3), (0, 6)]);
        // Two rows are missing, and then as many as may be.
        goes_on(&[100, 105, 117], &[(0, 0), (0, 5), (0, 17)]);
        goes_on(&[100, 113], &[(0, 0), (2, 0)]);
        // The clock begins anew, and goes on from there.
        goes_on(&[100, 1, 4], &[(0, 0), (2, 0), (2, 3)]);
        // A row at the same time is none that goes on.
        goes_on(&[100, 102], &[(0, 0), (2, 0)]);
    }

    #[test]
    fn another_rate_or_rows_without_a_time_do_not_go_on() {
        let last = row(9, 10_000_000_000, 1);
        assert_eq!(goes_on(&last, &row(0, 10_010_000_000, 1)), Some(1));
        assert_eq!(goes_on(&last, &RawSample { interval_ns: 20_000_000, ..row(0, 10_020_000_000, 1) }), None);
        assert_eq!(goes_on(&last, &RawSample { interval_ns: 0, ..row(0, 10_010_000_000, 1) }), None);
        assert_eq!(goes_on(&row(9, 0, 1), &row(0, 10_000_000, 1)), None);
        assert_eq!(goes_on(&last, &RawSample { interval_ns: u64::MAX, ..row(0, u64::MAX, 1) }), None);
    }
}
