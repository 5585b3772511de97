//! `CLOCK_MONOTONIC`, read for less where the processor's time stamp counter allows it.
//!
//! Two readings of the clock are part of every round trip. The kernel's own (`clock_gettime`, no system call) costs twice to three times
//! what reading the counter does. So a [`Clock`] reads the counter and adds what has passed since it last asked the kernel, which
//! it does again after [`REACH_NS`]: a rate that is off by the 500 ppm that the kernel may steer its clock with makes
//! 50 ns by then. Where the kernel does not use the counter itself, or there is none, every reading asks the kernel.
#![cfg_attr(target_arch = "x86_64", expect(unsafe_code, reason = "the counter has no safe intrinsic"))]

use rustix::time::{ClockId, clock_gettime};
use std::fs;
use std::thread;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// How far from its last reading of the kernel's clock a [`Clock`] trusts the counter \[ns\].
pub const REACH_NS: u64 = 100_000;
/// The counter's rate is taken over at least this long \[ns\], where a reading's uncertainty no longer matters.
const BASELINE_NS: u64 = 200_000;
/// A reading of both clocks that took more ticks was interrupted: what it is off by would be in every reading until the next.
const TOGETHER_TICKS: u64 = 500;
/// Attempts at a first reading of both clocks.
const ATTEMPTS: usize = 10;
/// Fixed point of the rate.
const FRACTION: u32 = 32;
const KERNELS_CLOCK: &str = "/sys/devices/system/clocksource/clocksource0/current_clocksource";

/// `CLOCK_MONOTONIC` \[ns\], the clock of `sent_ns`, from the kernel.
#[must_use]
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

/// The time now, in seconds of Unix time.
#[must_use]
pub fn unix_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}

/// A thread's reader of `CLOCK_MONOTONIC`. Two of them, in whatever threads and processes, agree to within 0.1 us.
#[derive(Debug)]
pub struct Clock {
    /// What both clocks said when the kernel's was asked last; `None` where the counter is not used.
    anchor: Option<Anchor>,
    /// \[ns per tick\], fixed point; 0 until it is known.
    rate: u64,
    /// [`REACH_NS`] in ticks; 0 until the rate is known.
    reach: u64,
}

#[derive(Clone, Copy, Debug)]
struct Anchor {
    ticks: u64,
    ns: u64,
}

impl Anchor {
    /// Both clocks, unless it was interrupted between the two.
    fn now() -> Option<Self> {
        let now = Self { ticks: ticks(), ns: monotonic_ns() };
        (ticks().wrapping_sub(now.ticks) <= TOGETHER_TICKS).then_some(now)
    }
}

impl Clock {
    /// One that finds out by itself whether the counter can be used; that takes less than a millisecond.
    #[must_use]
    pub fn new() -> Self {
        let usable =
            cfg!(target_arch = "x86_64") && fs::read_to_string(KERNELS_CLOCK).is_ok_and(|name| name.trim() == "tsc");
        let mut clock = Self { anchor: None, rate: 0, reach: 0 };
        if usable && let Some(first) = (0..ATTEMPTS).find_map(|_| Anchor::now()) {
            thread::sleep(Duration::from_nanos(BASELINE_NS));
            clock.renew(first);
            clock.anchor = clock.anchor.or(Some(first));
        }
        clock
    }

    /// Now \[ns\]. The processor may read the counter some tens of nanoseconds ahead of what stands before it.
    #[inline]
    pub fn now(&mut self) -> u64 {
        match self.anchor {
            Some(anchor) => self.at(ticks(), anchor),
            None => monotonic_ns(),
        }
    }

    /// Now \[ns\], once everything that stands before it has been computed.
    #[inline]
    pub fn now_in_order(&mut self) -> u64 {
        match self.anchor {
            Some(anchor) => self.at(ticks_in_order(), anchor),
            None => monotonic_ns(),
        }
    }

    #[inline]
    fn at(&mut self, ticks: u64, anchor: Anchor) -> u64 {
        // A counter that has gone backwards, as when a machine was moved, gives a huge difference.
        let since = ticks.wrapping_sub(anchor.ticks);
        if since < self.reach { anchor.ns + ((since * self.rate) >> FRACTION) } else { self.renew(anchor) }
    }

    /// Asks the kernel, and learns the rate from what has passed since it was asked last.
    #[cold]
    fn renew(&mut self, last: Anchor) -> u64 {
        let Some(now) = Anchor::now() else { return monotonic_ns() };
        let (passed, passed_ns) = (now.ticks.wrapping_sub(last.ticks), now.ns.saturating_sub(last.ns));
        if (BASELINE_NS..1 << (63 - FRACTION)).contains(&passed_ns) {
            let rate = (passed_ns << FRACTION) / passed.max(1);
            // A clock that was stopped or set gives another rate; that one is forgotten, and learned anew.
            let steady = self.rate == 0 || rate.abs_diff(self.rate) <= self.rate / 128;
            self.rate = if steady { rate } else { 0 };
            self.reach = (REACH_NS << FRACTION).checked_div(self.rate).unwrap_or(0);
        }
        self.anchor = Some(now);
        now.ns
    }
}

impl Default for Clock {
    fn default() -> Self {
        Self::new()
    }
}

/// The counter.
#[inline]
fn ticks() -> u64 {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: it only reads a register, which this processor has. It is called only where the kernel itself uses the counter.
    unsafe {
        core::arch::x86_64::_rdtsc()
    }
    #[cfg(not(target_arch = "x86_64"))]
    0
}

/// The counter, not before what stands before it in the program has been computed.
#[inline]
fn ticks_in_order() -> u64 {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: a fence has no precondition.
    unsafe {
        core::arch::x86_64::_mm_lfence();
    }
    ticks()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    #[test]
    fn it_tells_the_kernels_time() {
        let mut clock = Clock::new();
        let started = Instant::now();
        let mut readings = 0_u64;
        // Between two readings of the kernel's clock, unless it was interrupted there; rounding and the rate have 0.1 us.
        while started.elapsed() < Duration::from_millis(50) {
            let before = monotonic_ns();
            let (a, b) = (clock.now(), clock.now_in_order());
            let after = monotonic_ns();
            for now in [a, b] {
                assert!(now + 1_000 > before && now < after + 1_000, "{before} {now} {after}");
            }
            readings += 1;
        }
        assert!(readings > 1_000);
    }

    #[test]
    fn a_counter_that_jumps_is_forgotten() {
        let mut clock = Clock::new();
        let Some(mut anchor) = clock.anchor else { return };
        for jump in [1 << 40, u64::MAX - (1 << 40), 0] {
            anchor = Anchor { ticks: anchor.ticks.wrapping_add(jump), ..anchor };
            clock.anchor = Some(anchor);
            for _ in 0..3 {
                let (before, now, after) = (monotonic_ns(), clock.now(), monotonic_ns());
                assert!(now + 1_000 > before && now < after + 1_000, "{jump}: {before} {now} {after}");
            }
        }
    }
}
