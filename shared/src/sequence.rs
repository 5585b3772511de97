//! The order and the times of the samples of a session: one rule for what an acquisition sends and for what a recording
//! has.

use crate::wire::{CompensatedIncrement, RawSample};

/// Whether a sample with this `sequence` may follow the sample `last` of its session; with `None` it is the session's
/// first.
///
/// The first sample may have any sequence, each later one a higher one. Every number of 64 bits is a sequence, the
/// highest too; after the highest a new session must begin, since sequences do not wrap.
#[inline]
#[must_use]
pub const fn rises(last: Option<u64>, sequence: u64) -> bool {
    match last {
        Some(last) => sequence > last,
        None => true,
    }
}

/// Place and time of a control period: what [`time_step`] compares. Any values are valid.
#[derive(Clone, Copy, Debug, Default, Eq, Hash, PartialEq)]
pub struct Period {
    /// Session of the acquisition.
    pub session: u64,
    /// Sequence in the session.
    pub sequence: u64,
    /// End of the period on the acquisition's clock \[ns\]; 0 = not given.
    pub timestamp_ns: u64,
    /// Length of the period \[ns\].
    pub interval_ns: u64,
}

impl From<&RawSample> for Period {
    #[inline]
    fn from(raw: &RawSample) -> Self {
        let &RawSample { session, sequence, timestamp_ns, interval_ns, .. } = raw;
        Self { session, sequence, timestamp_ns, interval_ns }
    }
}

impl From<&CompensatedIncrement> for Period {
    #[inline]
    fn from(increment: &CompensatedIncrement) -> Self {
        let &CompensatedIncrement { session, sequence, timestamp_ns, interval_ns, .. } = increment;
        Self { session, sequence, timestamp_ns, interval_ns }
    }
}

/// The step of the timestamps from `earlier` to `later` less the interval of `later` \[ns\]: 0 where time is neither
/// lost nor counted twice. `None` unless `later` is the next sample of the session and both timestamps are given.
#[inline]
#[must_use]
pub const fn excess_ns(earlier: Period, later: Period) -> Option<i128> {
    let is_next = earlier.session == later.session && later.sequence.wrapping_sub(earlier.sequence) == 1;
    if !is_next || later.sequence == 0 || earlier.timestamp_ns == 0 || later.timestamp_ns == 0 {
        return None;
    }
    // 128 bits hold every difference of three numbers of 64 bits.
    Some(later.timestamp_ns as i128 - earlier.timestamp_ns as i128 - later.interval_ns as i128)
}

/// Whether no sequence is missing between two samples, but time is, or the interval is wrong: the step of the
/// timestamps differs from the interval of `later` by more than half of it. This is
/// [`Flags::TIME_STEP`](crate::wire::Flags::TIME_STEP).
///
/// ```
/// use isotherm_shared::sequence::{Period, time_step};
///
/// let first = Period { session: 1, sequence: 8, timestamp_ns: 1_000_000, interval_ns: 2_500_000 };
/// let next = Period { sequence: 9, timestamp_ns: 3_500_000, ..first };
/// assert!(!time_step(first, next));
/// assert!(time_step(first, Period { timestamp_ns: 6_000_000, ..next })); // one period is lost
/// ```
#[inline]
#[must_use]
pub const fn time_step(earlier: Period, later: Period) -> bool {
    match excess_ns(earlier, later) {
        Some(excess) => 2 * excess.unsigned_abs() > later.interval_ns as u128,
        None => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn any_first_sequence_then_only_higher_ones_up_to_the_highest() {
        for first in [0, 1, u64::MAX] {
            assert!(rises(None, first));
        }
        assert!(rises(Some(0), 1) && rises(Some(0), u64::MAX) && rises(Some(u64::MAX - 1), u64::MAX));
        for (last, sequence) in [(0, 0), (5, 4), (u64::MAX, 0), (u64::MAX, u64::MAX)] {
            assert!(!rises(Some(last), sequence), "{sequence} after {last}");
        }
    }

    const MS: u64 = 1_000_000;

    fn period(session: u64, sequence: u64, timestamp_ns: u64, interval_ns: u64) -> Period {
        Period { session, sequence, timestamp_ns, interval_ns }
    }

    #[test]
    fn a_step_may_differ_from_the_later_interval_by_half_of_it() {
        let earlier = period(7, 5, 100 * MS, 99);
        let step = |timestamp_ns, interval_ns| time_step(earlier, period(7, 6, timestamp_ns, interval_ns));
        for (timestamp_ns, steps) in
            [(102 * MS, false), (101 * MS, false), (103 * MS, false), (101 * MS - 1, true), (103 * MS + 1, true)]
        {
            assert_eq!(step(timestamp_ns, 2 * MS), steps, "{timestamp_ns}");
        }
        // A clock that goes back or stands still, and an interval that is 1000 times too short or 0.
        assert!(step(99 * MS, 2 * MS) && step(100 * MS, 2 * MS) && step(102 * MS, 2 * MS / 1000));
        assert!(step(102 * MS, 0) && !step(100 * MS, 0) && step(u64::MAX, 1) && step(1, u64::MAX));
        // Odd intervals: half of 3 is 1.5.
        assert!(!step(100 * MS + 2, 3) && !step(100 * MS + 4, 3) && step(100 * MS + 1, 3) && step(100 * MS + 5, 3));
        // The sum of two periods has an interval of both.
        assert!(!step(104 * MS, 4 * MS));
    }

    #[test]
    fn only_the_next_sample_of_a_session_can_have_a_step() {
        let (earlier, far) = (period(7, 5, 100 * MS, 2 * MS), 900 * MS);
        assert!(time_step(earlier, period(7, 6, far, 2 * MS)));
        for (session, sequence, timestamp_ns) in
            [(8, 6, far), (7, 7, far), (7, 5, far), (7, 4, far), (7, 6, 0), (7, 0, far), (7, u64::MAX, far)]
        {
            assert!(!time_step(earlier, period(session, sequence, timestamp_ns, 2 * MS)));
        }
        assert!(!time_step(period(7, 5, 0, 2 * MS), period(7, 6, far, 2 * MS)));
        assert!(!time_step(period(7, u64::MAX, MS, 2 * MS), period(7, 0, far, 2 * MS)), "sequences do not wrap");
        assert!(time_step(period(7, u64::MAX - 1, MS, 2 * MS), period(7, u64::MAX, far, 2 * MS)));
    }

    #[test]
    fn samples_and_increments_are_the_same_periods() {
        let raw = RawSample { session: 1, sequence: 2, timestamp_ns: 3, interval_ns: 4, ..RawSample::default() };
        let increment = CompensatedIncrement {
            session: 1,
            sequence: 2,
            timestamp_ns: 3,
            interval_ns: 4,
            ..CompensatedIncrement::default()
        };
        assert_eq!([Period::from(&raw), Period::from(&increment)], [period(1, 2, 3, 4); 2]);
    }

    /// Small numbers, so that samples often follow each other, and any.
    fn any_number() -> impl Strategy<Value = u64> {
        prop_oneof![0..4_u64, any::<u64>(), (u64::MAX - 3)..=u64::MAX]
    }

    proptest! {
        #[test]
        fn the_rule_is_that_of_wide_numbers(
            earlier in (0..2_u64, any_number(), any_number(), any_number()),
            later in (0..2_u64, any_number(), any_number(), any_number()),
            follows in any::<bool>(),
        ) {
            let earlier = period(earlier.0, earlier.1, earlier.2, earlier.3);
            let mut later = period(later.0, later.1, later.2, later.3);
            if follows {
                (later.session, later.sequence) = (earlier.session, earlier.sequence.wrapping_add(1));
            }
            let [t1, t2, interval] = [earlier.timestamp_ns, later.timestamp_ns, later.interval_ns].map(i128::from);
            let is_next = earlier.session == later.session
                && i128::from(later.sequence) == i128::from(earlier.sequence) + 1;
            // The step lies outside of 1/2 to 3/2 of the interval.
            let outside = 2 * (t2 - t1) < interval || 2 * (t2 - t1) > 3 * interval;
            prop_assert_eq!(time_step(earlier, later), is_next && t1 != 0 && t2 != 0 && outside);
        }
    }
}
