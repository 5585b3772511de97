//! The clocks that lines and campaigns read, and how they wait: of the machine, or simulated.

use core::ops::Add;
use rustix::time::{ClockId, clock_gettime};
use std::sync::OnceLock;
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use std::{fs, thread};

/// A moment of a clock that only rises; of [`RealTime`] a reading of `CLOCK_MONOTONIC`.
#[derive(Clone, Copy, Debug, Eq, Ord, PartialEq, PartialOrd)]
pub struct Moment {
    ns: u64,
}

impl Moment {
    /// The moment of this reading of the clock \[ns\].
    #[must_use]
    pub const fn of_ns(ns: u64) -> Self {
        Self { ns }
    }

    /// The reading of the clock \[ns\].
    #[must_use]
    pub const fn ns(self) -> u64 {
        self.ns
    }

    /// The time since an earlier moment; 0 since a later one.
    #[must_use]
    pub const fn since(self, earlier: Self) -> Duration {
        Duration::from_nanos(self.ns.saturating_sub(earlier.ns))
    }
}

impl Add<Duration> for Moment {
    type Output = Self;

    fn add(self, duration: Duration) -> Self {
        Self { ns: self.ns.saturating_add(u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)) }
    }
}

/// Two clocks, and a wait.
pub trait Time: Send + Sync {
    /// The present moment.
    fn now(&self) -> Moment;

    /// Unix time \[s\]. Somebody may set this clock, also back.
    fn unix_s(&self) -> f64;

    /// The name of the time since which [`now`](Self::now) counts: of the machine's last start. Moments of two names do
    /// not compare.
    fn boot(&self) -> String;

    /// Returns at this moment, or at once if it has passed.
    fn sleep_until(&self, moment: Moment);

    /// Does both at the same time, the first in a thread of its own, and returns when both have ended. A panic of the
    /// first ends only that one.
    fn both(&self, beside: &mut (dyn FnMut() + Send), here: &mut dyn FnMut());
}

/// The clocks of the machine.
#[derive(Clone, Copy, Debug, Default)]
pub struct RealTime;

impl Time for RealTime {
    fn now(&self) -> Moment {
        let now = clock_gettime(ClockId::Monotonic);
        Moment { ns: now.tv_sec.cast_unsigned() * 1_000_000_000 + now.tv_nsec.cast_unsigned() }
    }

    fn unix_s(&self) -> f64 {
        SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()
    }

    fn boot(&self) -> String {
        static BOOT: OnceLock<String> = OnceLock::new();
        let read = || fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default().trim().to_owned();
        BOOT.get_or_init(read).clone()
    }

    fn sleep_until(&self, moment: Moment) {
        thread::sleep(moment.since(self.now()));
    }

    fn both(&self, beside: &mut (dyn FnMut() + Send), here: &mut dyn FnMut()) {
        thread::scope(|scope| {
            let beside = scope.spawn(beside);
            here();
            // What it has not done shows that it has failed.
            let _ = beside.join();
        });
    }
}
