//! The order and the times of the samples of a session: one rule for what an acquisition sends and for what a recording
//! has.

use crate::wire::{CompensatedIncrement, MAX_INTERVAL_NS, RawSample};

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

/// A period and when it was seen: what [`periods_between`] compares.
#[derive(Clone, Copy, Debug, Default, Eq, Hash, PartialEq)]
pub struct Seen {
    /// The period.
    pub period: Period,
    /// When it was seen, by any one clock of this machine \[ns\].
    pub at_ns: u64,
}

/// Two clocks agree if their steps differ by less than this \[ns\], and by 0.1 % of the step.
const SAME_CLOCK_NS: u128 = 250_000_000;

/// The control periods between the last sample of a session and the first of the next one, which is no sample of the
/// same session. `None` if that is not known: the sessions need timestamps of the same clock. They have it if the step
/// of the timestamps agrees with the time from seeing the one to seeing the other, within 0.25 s and 0.1 % of it, and
/// does not go back.
///
/// The time that is missing is the step less the interval of `later`, which may be a sum of periods; the shorter of
/// both intervals is taken for one period.
///
/// ```
/// use isotherm_shared::sequence::{Period, Seen, periods_between};
///
/// let last = Period { session: 1, sequence: 8, timestamp_ns: 5_000_000_000, interval_ns: 2_500_000 };
/// let first = Period { session: 2, sequence: 0, timestamp_ns: 6_500_000_000, interval_ns: 2_500_000 };
/// let [last, first] = [(last, 100), (first, 1_500_200_100)].map(|(period, at_ns)| Seen { period, at_ns });
/// assert_eq!(periods_between(last, first), Some(599)); // 1.5 s are 600 periods, and `first` has one of them
/// // A device whose clock begins anew tells nothing.
/// let anew = Seen { period: Period { timestamp_ns: 2_500_000, ..first.period }, ..first };
/// assert_eq!(periods_between(last, anew), None);
/// ```
#[must_use]
pub fn periods_between(earlier: Seen, later: Seen) -> Option<u64> {
    let (last, first) = (earlier.period, later.period);
    let interval_ns = last.interval_ns.min(first.interval_ns);
    let has_times = [last, first]
        .iter()
        .all(|period| period.timestamp_ns != 0 && (1..=MAX_INTERVAL_NS).contains(&period.interval_ns));
    // 128 bits hold every difference of numbers of 64 bits.
    let step = |from: u64, to: u64| i128::from(to) - i128::from(from);
    let (by_timestamps, by_clock) = (step(last.timestamp_ns, first.timestamp_ns), step(earlier.at_ns, later.at_ns));
    let limit_ns = SAME_CLOCK_NS + by_clock.unsigned_abs() / 1000;
    if !has_times || by_timestamps <= 0 || (by_timestamps - by_clock).unsigned_abs() > limit_ns {
        return None;
    }
    let missing_ns = u128::try_from(by_timestamps - i128::from(first.interval_ns)).unwrap_or(0);
    let interval_ns = u128::from(interval_ns);
    u64::try_from((missing_ns + interval_ns / 2) / interval_ns).ok()
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

    fn seen(timestamp_ns: u64, interval_ns: u64, at_ns: u64) -> Seen {
        Seen { period: period(1, 0, timestamp_ns, interval_ns), at_ns }
    }

    #[test]
    fn periods_between_sessions_of_one_clock_are_counted() {
        let last = seen(1000 * MS, 2 * MS, 70 * MS);
        let after = |ms: u64, late: i64| seen((1000 + ms) * MS, 2 * MS, (70 + ms).saturating_add_signed(late) * MS);
        for (ms, late, expected) in [
            (2, 0, Some(0)),
            (3, 0, Some(1)),
            (4, 0, Some(1)),
            (1500, 0, Some(749)),
            (1500, 250, Some(749)),
            (1500, 252, None),
            (1500, -251, Some(749)),
            (1500, -252, None),
            // 0.1 % of 1000 s.
            (1_000_000, 1250, Some(499_999)),
            (1_000_000, 1252, None),
            (1, 200, Some(0)),
            // A clock that began anew a short time ago.
            (0, 200, None),
        ] {
            assert_eq!(periods_between(last, after(ms, late)), expected, "{ms} ms, {late} ms late");
        }
        assert_eq!(periods_between(last, seen(900 * MS, 2 * MS, 71 * MS)), None);
    }

    #[test]
    fn the_first_sample_may_be_a_sum_of_periods() {
        let last = seen(1000 * MS, 2 * MS, 0);
        assert_eq!(periods_between(last, seen(1100 * MS, 20 * MS, 100 * MS)), Some(40));
        assert_eq!(periods_between(seen(1000 * MS, 20 * MS, 0), seen(1100 * MS, 2 * MS, 100 * MS)), Some(49));
    }

    #[test]
    fn without_times_or_of_another_clock_the_periods_are_unknown() {
        let last = seen(1000 * MS, 2 * MS, 0);
        for first in [
            seen(0, 2 * MS, 0),
            seen(1100 * MS, 0, 100 * MS),
            seen(1100 * MS, MAX_INTERVAL_NS + 1, 100 * MS),
            seen(2 * MS, 2 * MS, 100 * MS),
            seen(u64::MAX, 1, 0),
            seen(1, 1, u64::MAX),
        ] {
            assert_eq!([periods_between(last, first), periods_between(first, last)], [None; 2], "{first:?}");
        }
        assert_eq!(periods_between(seen(1, 1, 1), seen(u64::MAX, 1, u64::MAX)), Some(u64::MAX - 2));
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
