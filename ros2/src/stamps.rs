//! Where on Unix time a stamp lies that was taken on another clock.
//!
//! A stamp of `CLOCK_MONOTONIC` is moved by the offset that the client measures. For another clock, it is only known
//! when what it stamped has come. What comes is late, and never early, so the smallest delay between stamp and arrival
//! of the last half to whole minute is taken for none:
//! ```text
//! time = stamp + offset,   offset -> min(arrival - stamp)
//! ```
//! The first messages often come together and late, and show a delay that is too large. So the offset moves towards the
//! smallest delay by a tenth of the time that passes on the stamps, and by no more: stamps never go back, and their
//! distances are right to a tenth at once, and right when the smallest delay is reached. All are then late by the
//! smallest true delay, which nothing shows. A clock that runs off by 100 ppm is followed within 6 ms.

use isotherm_client::UnixOffset;

/// A stamp of `CLOCK_MONOTONIC` is within this time of its arrival, and another clock is set by more than this \[ns\].
const NEAR_NS: i64 = 1_000_000_000;
/// The smallest delay is that of one to two of these times \[ns\].
const WINDOW_NS: u64 = 30_000_000_000;
/// The offset moves by this part of the time that passes, its inverse.
const SLOWER: u64 = 10;
/// How fast the scatter of the delays follows.
const FOLLOWED: f64 = 0.01;

/// The smallest delay between stamp and arrival, and where it places stamps.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SmallestDelay {
    /// Of the present window and of the one before \[ns\].
    least: [i64; 2],
    /// What is added to stamps now, and the stamp that it was added to last \[ns\].
    offset_ns: i64,
    stamp_ns: u64,
    /// The last delay \[ns\].
    delay_ns: i64,
    /// When the present window began \[ns\].
    since_ns: u64,
    /// By how much delays are over the smallest, in the mean \[ns\].
    scatter_ns: f64,
}

impl SmallestDelay {
    /// Of the first stamp.
    pub(crate) fn new(stamp_ns: u64, arrived_ns: u64) -> Self {
        let delay_ns = delay_ns(stamp_ns, arrived_ns);
        let (least, since_ns) = ([delay_ns, i64::MAX], arrived_ns);
        Self { least, offset_ns: delay_ns, stamp_ns, delay_ns, since_ns, scatter_ns: 0.0 }
    }

    /// Where a stamp lies on the clock of the arrivals \[ns\].
    pub(crate) fn place(&mut self, stamp_ns: u64, arrived_ns: u64) -> i128 {
        let delay_ns = delay_ns(stamp_ns, arrived_ns);
        if core::mem::replace(&mut self.delay_ns, delay_ns).saturating_sub(delay_ns) > NEAR_NS {
            // The clock was set forward.
            *self = Self::new(stamp_ns, arrived_ns);
        }
        if arrived_ns.saturating_sub(self.since_ns) > WINDOW_NS {
            (self.least, self.since_ns) = ([delay_ns, self.least[0]], arrived_ns);
        }
        self.least[0] = self.least[0].min(delay_ns);
        let least = self.least();
        self.scatter_ns += FOLLOWED * (delay_ns.saturating_sub(least) as f64 - self.scatter_ns);
        let most = i64::try_from(stamp_ns.saturating_sub(self.stamp_ns) / SLOWER).unwrap_or(i64::MAX);
        let change = least.saturating_sub(self.offset_ns).clamp(-most, most);
        self.offset_ns = self.offset_ns.saturating_add(change);
        self.stamp_ns = self.stamp_ns.max(stamp_ns);
        i128::from(stamp_ns) + i128::from(self.offset_ns)
    }

    /// The smallest delay \[ns\].
    pub(crate) fn least(&self) -> i64 {
        self.least[0].min(self.least[1])
    }

    /// By how much delays are over the smallest, in the mean \[ns\].
    pub(crate) const fn scatter_ns(&self) -> u64 {
        self.scatter_ns as u64
    }
}

/// The time from a stamp to an arrival \[ns\].
pub(crate) fn delay_ns(stamp_ns: u64, arrived_ns: u64) -> i64 {
    i64::try_from(i128::from(arrived_ns) - i128::from(stamp_ns)).unwrap_or(if arrived_ns < stamp_ns {
        i64::MIN
    } else {
        i64::MAX
    })
}

/// What is known of the clock of an acquisition.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum StampState {
    /// Nothing has come yet.
    Unknown,
    /// Its stamps are of `CLOCK_MONOTONIC`.
    Monotonic,
    /// Its stamps are of another clock, as described.
    Other,
    /// It should be `CLOCK_MONOTONIC`, and cannot be: stamps are off by so much \[ns\].
    Refused(i64),
}

/// Puts the timestamps of increments on Unix time.
///
/// ```
/// use isotherm_client::UnixOffset;
/// use isotherm_ros2::{StampClock, StampState};
///
/// let offset = UnixOffset { offset_ns: 1_000, uncertainty_ns: 1 };
/// let mut clock = StampClock::new(false);
/// assert_eq!(clock.unix_ns(7, 5_000_000, 5_100_000, false, offset), Some(5_001_000));
/// // The next session began with another clock.
/// assert_eq!(clock.unix_ns(8, 77, 5_000_000_000, false, offset), None);
/// assert_eq!(clock.state(), StampState::Refused(4_999_999_923));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct StampClock {
    has_other_clock: bool,
    session: u64,
    state: StampState,
    delay: Option<SmallestDelay>,
    refused: u64,
}

impl StampClock {
    /// For timestamps of `CLOCK_MONOTONIC`, or of another clock.
    #[must_use]
    pub const fn new(has_other_clock: bool) -> Self {
        Self { has_other_clock, session: 0, state: StampState::Unknown, delay: None, refused: 0 }
    }

    /// The Unix time of a timestamp \[ns\] that arrived at this time of `CLOCK_MONOTONIC` \[ns\]. `steps`: its clock
    /// has stepped before it.
    ///
    /// `None` if it cannot be of `CLOCK_MONOTONIC` and should be: no stamp of its session was within a second of its
    /// arrival. What comes later than that after such a one was kept for a service that was away.
    pub fn unix_ns(
        &mut self,
        session: u64,
        timestamp_ns: u64,
        arrived_ns: u64,
        steps: bool,
        offset: UnixOffset,
    ) -> Option<i64> {
        if session != self.session || steps {
            (self.session, self.state, self.delay) = (session, StampState::Unknown, None);
        }
        let delay_ns = delay_ns(timestamp_ns, arrived_ns);
        if self.has_other_clock {
            self.state = StampState::Other;
            let delay = self.delay.get_or_insert_with(|| SmallestDelay::new(timestamp_ns, arrived_ns));
            return i64::try_from(delay.place(timestamp_ns, arrived_ns) + i128::from(offset.offset_ns)).ok();
        }
        let is_near = delay_ns.unsigned_abs() <= NEAR_NS.unsigned_abs();
        let is_late = self.state == StampState::Monotonic && delay_ns > 0;
        if is_near || is_late {
            self.state = StampState::Monotonic;
            return Some(offset.unix_ns(timestamp_ns));
        }
        self.state = StampState::Refused(delay_ns);
        self.refused += 1;
        None
    }

    /// What is known of the clock.
    #[must_use]
    pub const fn state(&self) -> StampState {
        self.state
    }

    /// Timestamps that were refused.
    #[must_use]
    pub const fn refused(&self) -> u64 {
        self.refused
    }

    /// By how much times may be off \[ns\]: a bound for `CLOCK_MONOTONIC`; of another clock how much the delays
    /// scatter, to which the smallest delay comes.
    #[must_use]
    pub fn uncertainty_ns(&self, offset: UnixOffset) -> u64 {
        let scatter_ns = self.delay.filter(|_| self.has_other_clock).map_or(0, |delay| delay.scatter_ns());
        offset.uncertainty_ns.saturating_add(scatter_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OFFSET: UnixOffset = UnixOffset { offset_ns: 1_700_000_000_000_000_000, uncertainty_ns: 50 };
    const MS: u64 = 1_000_000;

    #[test]
    fn another_clock_is_placed_by_its_earliest_arrival() {
        let mut clock = StampClock::new(true);
        let delays = [5, 3, 9, 1, 4, 1, 7];
        let mut placed = Vec::new();
        for (period, delay) in (0..).zip(delays) {
            let (stamp, arrived) = (period * 10 * MS, 500_000 * MS + (period * 10 + delay) * MS);
            placed.push(clock.unix_ns(1, stamp, arrived, false, OFFSET).unwrap() - OFFSET.offset_ns);
        }
        let true_ns = |period: i64, late: i64| 500_000 * 1_000_000 + (period * 10 + late) * 1_000_000;
        assert_eq!(placed[0], true_ns(0, 5));
        // A tenth of the time that passes.
        assert!(placed.windows(2).all(|pair| (9_000_000..=10_000_000).contains(&(pair[1] - pair[0]))), "{placed:?}");
        assert_eq!(placed[5..], [true_ns(5, 1), true_ns(6, 1)]);
        assert!(clock.uncertainty_ns(OFFSET) > 50);
        // Another session may have another clock.
        assert_eq!(clock.unix_ns(2, 7, 9 * MS, false, OFFSET), Some(OFFSET.offset_ns + 9_000_000));
        assert_eq!(clock.unix_ns(2, 8, 20 * MS, true, OFFSET), Some(OFFSET.offset_ns + 20_000_000));
    }

    #[test]
    fn the_smallest_delay_is_forgotten_after_a_while() {
        let mut delay = SmallestDelay::new(0, 5);
        let mut least = |delay_ns: u64, arrived_ns: u64| {
            delay.place(arrived_ns - delay_ns, arrived_ns);
            delay.least()
        };
        assert_eq!(least(9, WINDOW_NS), 5);
        assert_eq!(least(8, WINDOW_NS + 6), 5);
        assert_eq!(least(9, 2 * WINDOW_NS + 7), 8);
        assert_eq!(least(9, 4 * WINDOW_NS), 9);
    }

    #[test]
    fn what_has_waited_and_comes_together_keeps_its_distances() {
        // 100 messages of a quarter of a second at once, and then each at its time.
        let mut delay = SmallestDelay::new(0, 250 * MS);
        let placed: Vec<i128> = (0..4_000_u64)
            .map(|period| {
                let stamp = period * 5 * MS / 2;
                delay.place(stamp, if period < 100 { 250 * MS + period } else { stamp + MS })
            })
            .collect();
        let distances: Vec<i128> = placed.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(distances.iter().all(|ns| (2_250_000..=2_500_000).contains(ns)));
        assert_eq!(distances.last(), Some(&2_500_000));
        assert_eq!(placed.last(), Some(&i128::from(3_999 * 5 * MS / 2 + MS)));
    }

    #[test]
    fn a_clock_that_is_set_forward_goes_on() {
        let mut delay = SmallestDelay::new(0, MS);
        assert_eq!(delay.place(10 * MS, 11 * MS), i128::from(11 * MS));
        let set = 3_600_000 * MS;
        assert_eq!(delay.place(set + 20 * MS, 21 * MS), i128::from(21 * MS));
        assert_eq!(delay.place(set + 30 * MS, 33 * MS), i128::from(31 * MS));
    }

    #[test]
    fn a_clock_that_cannot_be_the_monotonic_one_is_found_out_and_late_data_are_not() {
        let now = 5_000_000 * MS;
        for (stamp, is_right) in [
            (now, true),
            (now - 900 * MS, true),
            (now + 900 * MS, true),
            (0, false),
            (now - 1001 * MS, false),
            (now + 1001 * MS, false),
            (u64::MAX, false),
        ] {
            let mut clock = StampClock::new(false);
            assert_eq!(clock.unix_ns(1, stamp, now, false, OFFSET).is_some(), is_right, "{stamp}");
            assert_eq!(clock.refused(), u64::from(!is_right));
        }
        let mut clock = StampClock::new(false);
        clock.unix_ns(1, now, now + MS, false, OFFSET).unwrap();
        // Kept while the service was away.
        assert_eq!(
            clock.unix_ns(1, now + 10 * MS, now + 30_000 * MS, false, OFFSET),
            Some(OFFSET.unix_ns(now + 10 * MS))
        );
        assert_eq!(clock.unix_ns(1, now + 90_000 * MS, now + 30_000 * MS, false, OFFSET), None);
        assert!(matches!(clock.state(), StampState::Refused(-60_000_000_000)));
    }
}
