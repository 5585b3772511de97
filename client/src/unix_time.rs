//! Unix time (`CLOCK_REALTIME`) next to `CLOCK_MONOTONIC`: the offset between them, and its steps.
//!
//! # Measurement
//! The monotonic clock is read before and after the other one. With the readings m, u, M the offset u - m lies between
//! u - M and u - m, whatever happened in between:
//! ```text
//! offset = u - (m + M)/2,   within (M - m)/2
//! ```
//! The narrowest of several such triples counts: an interruption widens one, and never moves it.
//!
//! # Slews and steps
//! The kernel steers both clocks by the same rate: while chrony or a PTP daemon slews Unix time, `CLOCK_MONOTONIC` is
//! slewed alike, and the offset stays. It changes where Unix time is set, and by a leap second: these are steps. So all
//! measurements since the last step are of one number, which lies in each of their ranges; a measurement whose range
//! has nothing in common with them shows a step.

use rustix::time::{ClockId, Timespec, clock_gettime};

/// Triples of which the narrowest counts.
const TRIPLES: usize = 8;

/// How far Unix time is ahead of `CLOCK_MONOTONIC`.
///
/// ```
/// use isotherm_client::{UnixOffset, monotonic_ns, unix_s};
///
/// let offset = UnixOffset::measure();
/// let now_s = offset.unix_ns(monotonic_ns()) as f64 / 1e9;
/// assert!((now_s - unix_s()).abs() < 1.0);
/// ```
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct UnixOffset {
    /// The offset \[ns\]. The true one lies within the uncertainty.
    pub offset_ns: i64,
    /// The uncertainty, a bound \[ns\].
    pub uncertainty_ns: u64,
}

impl UnixOffset {
    /// Measures the offset now. Takes about a microsecond, and no system call.
    #[must_use]
    pub fn measure() -> Self {
        let triples = (0..TRIPLES).map(|_| {
            let before = ns(clock_gettime(ClockId::Monotonic));
            let unix = ns(clock_gettime(ClockId::Realtime));
            let after = ns(clock_gettime(ClockId::Monotonic));
            Self::of_readings(before, unix, after)
        });
        triples.min_by_key(|triple| triple.uncertainty_ns).unwrap_or(Self { offset_ns: 0, uncertainty_ns: u64::MAX })
    }

    /// The offset by a reading of Unix time between two of the monotonic clock \[ns\].
    const fn of_readings(before: i64, unix: i64, after: i64) -> Self {
        let width = after.saturating_sub(before).unsigned_abs();
        let middle = before.saturating_add((width / 2).cast_signed());
        // One more for the rounding.
        Self { offset_ns: unix.saturating_sub(middle), uncertainty_ns: width / 2 + 1 }
    }

    /// The Unix time at this time of `CLOCK_MONOTONIC` \[ns\].
    #[must_use]
    pub const fn unix_ns(self, monotonic_ns: u64) -> i64 {
        self.offset_ns.saturating_add_unsigned(monotonic_ns)
    }

    /// The time of `CLOCK_MONOTONIC` at this Unix time \[ns\]; `None` if it is before the machine was started.
    #[must_use]
    pub const fn monotonic_ns(self, unix_ns: i64) -> Option<u64> {
        match unix_ns.checked_sub(self.offset_ns) {
            Some(monotonic_ns) if monotonic_ns >= 0 => Some(monotonic_ns.cast_unsigned()),
            _ => None,
        }
    }

    /// The ends of the range that it lies in \[ns\].
    const fn ends(self) -> [i64; 2] {
        let Self { offset_ns, uncertainty_ns } = self;
        [offset_ns.saturating_sub_unsigned(uncertainty_ns), offset_ns.saturating_add_unsigned(uncertainty_ns)]
    }
}

/// Follows the offset between Unix time and `CLOCK_MONOTONIC`: call [`look`](Self::look) about once a second.
///
/// ```
/// use isotherm_client::UnixClock;
///
/// let mut clock = UnixClock::new();
/// if let Some(step_ns) = clock.look() {
///     println!("Unix time was set: it is {step_ns} ns further than it would have been");
/// }
/// assert!(clock.offset().uncertainty_ns < 1_000_000_000);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct UnixClock {
    offset: UnixOffset,
    steps: u64,
}

impl Default for UnixClock {
    fn default() -> Self {
        Self::new()
    }
}

impl UnixClock {
    /// Measures for the first time.
    #[must_use]
    pub fn new() -> Self {
        Self { offset: UnixOffset::measure(), steps: 0 }
    }

    /// Measures again. Returns the size of a step since the last look \[ns\], if there was one.
    pub fn look(&mut self) -> Option<i64> {
        self.follow(UnixOffset::measure())
    }

    fn follow(&mut self, measured: UnixOffset) -> Option<i64> {
        let ([low, high], [new_low, new_high]) = (self.offset.ends(), measured.ends());
        let (low, high) = (low.max(new_low), high.min(new_high));
        if low > high {
            let step = measured.offset_ns.saturating_sub(self.offset.offset_ns);
            (self.offset, self.steps) = (measured, self.steps + 1);
            return Some(step);
        }
        let width = high.abs_diff(low);
        self.offset =
            UnixOffset { offset_ns: low.saturating_add((width / 2).cast_signed()), uncertainty_ns: width.div_ceil(2) };
        None
    }

    /// The present offset.
    #[must_use]
    pub const fn offset(&self) -> UnixOffset {
        self.offset
    }

    /// Steps that were seen so far.
    #[must_use]
    pub const fn steps(&self) -> u64 {
        self.steps
    }
}

const fn ns(time: Timespec) -> i64 {
    time.tv_sec.saturating_mul(1_000_000_000).saturating_add(time.tv_nsec)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::{monotonic_ns, unix_s};

    fn offset(offset_ns: i64, uncertainty_ns: u64) -> UnixOffset {
        UnixOffset { offset_ns, uncertainty_ns }
    }

    #[test]
    fn the_offset_lies_within_its_bound() {
        assert_eq!(UnixOffset::of_readings(1_000, 5_000, 1_100), offset(3_950, 51));
        let measured = UnixOffset::measure();
        let (before, unix, after) = (monotonic_ns(), unix_s(), monotonic_ns());
        let ends = [measured.unix_ns(before) as f64 / 1e9 - 1e-3, measured.unix_ns(after) as f64 / 1e9 + 1e-3];
        assert!(ends[0] < unix && unix < ends[1], "{ends:?} {unix}");
        assert_eq!(measured.monotonic_ns(measured.unix_ns(77)), Some(77));
        assert_eq!(offset(1_000, 0).monotonic_ns(999), None);
        assert_eq!(offset(i64::MAX, 0).unix_ns(u64::MAX), i64::MAX);
    }

    #[test]
    fn measurements_narrow_it_and_what_contradicts_them_is_a_step() {
        let mut clock = UnixClock { offset: offset(1_000, 50), steps: 0 };
        assert_eq!(clock.follow(offset(1_060, 60)), None);
        assert_eq!((clock.offset(), clock.steps()), (offset(1_025, 25), 0));
        // Interrupted: it knows less, and contradicts nothing.
        assert_eq!(clock.follow(offset(5_000, 1_000_000)), None);
        assert_eq!(clock.offset(), offset(1_025, 25));
        assert_eq!(clock.follow(offset(-2_000, 30)), Some(-3_025));
        assert_eq!((clock.offset(), clock.steps()), (offset(-2_000, 30), 1));
        assert_eq!(clock.follow(offset(-1_965, 30)), None);
    }

    #[test]
    fn a_clock_that_nobody_sets_does_not_step() {
        let mut clock = UnixClock::new();
        let first = clock.offset();
        let steps: Vec<_> = (0..1_000).filter_map(|_| clock.look()).collect();
        // Somebody may set the clock of this machine meanwhile.
        assert!(steps.is_empty() || steps.len() as u64 == clock.steps());
        assert!(!steps.is_empty() || clock.offset().uncertainty_ns <= first.uncertainty_ns);
    }
}
