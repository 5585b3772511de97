//! `CLOCK_MONOTONIC`, read by the processor's time stamp counter where this is possible.
//!
//! Every round trip reads the clock twice. `clock_gettime` (no system call) takes two to three times as long as reading
//! the counter. So a [`Clock`] reads the counter and adds the time since its last reading of the kernel's clock. It
//! reads the kernel's clock again after [`EXTRAPOLATION_NS`]: the kernel may steer its clock by 500 ppm, which is an
//! error of 50 ns by then. If the kernel does not use the counter itself, or there is none, every reading is the
//! kernel's.
#![cfg_attr(target_arch = "x86_64", expect(unsafe_code, reason = "the counter has no safe intrinsic"))]

use rustix::time::{ClockId, clock_gettime};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use std::{fs, thread};

/// A [`Clock`] uses the counter for this long after its last reading of the kernel's clock \[ns\].
pub(crate) const EXTRAPOLATION_NS: u64 = 100_000;
/// The counter's rate is measured over at least this long \[ns\], so that the uncertainty of a reading does not matter.
const BASELINE_NS: u64 = 200_000;
/// A reading of both clocks that took more ticks was interrupted. It is not used: its error would be in all readings
/// until the next one.
const MAX_READING_TICKS: u64 = 500;
/// Attempts to get a first reading of both clocks.
const ATTEMPTS: usize = 10;
/// Fractional bits of the rate.
const FRACTION: u32 = 32;
const BOOT_ID: &str = "/proc/sys/kernel/random/boot_id";
const CLOCKSOURCE: &str = "/sys/devices/system/clocksource/clocksource0/current_clocksource";

/// `CLOCK_MONOTONIC` \[ns\], the clock of `sent_ns`, from the kernel.
#[must_use]
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

/// The number of the machine's present start, with which `CLOCK_MONOTONIC` began; 0 if the kernel does not report it.
/// Times of another start are of another clock.
#[must_use]
pub fn boot() -> u64 {
    let id = fs::read_to_string(BOOT_ID).unwrap_or_default();
    let digits: String = id.chars().filter(char::is_ascii_hexdigit).take(16).collect();
    u64::from_str_radix(&digits, 16).unwrap_or(0)
}

/// How far `CLOCK_MONOTONIC` of this process's time namespace is ahead of the machine's \[ns\]; 0 where there are no
/// such namespaces.
#[must_use]
pub fn clock_offset_ns() -> i64 {
    let offsets = fs::read_to_string("/proc/self/timens_offsets").unwrap_or_default();
    let of_line = |line: &str| {
        let mut numbers = line.strip_prefix("monotonic")?.split_whitespace().map(str::parse::<i64>);
        let (seconds, ns) = (numbers.next()?.ok()?, numbers.next()?.ok()?);
        Some(seconds.saturating_mul(1_000_000_000).saturating_add(ns))
    };
    offsets.lines().find_map(of_line).unwrap_or(0)
}

/// The present Unix time \[s\].
#[must_use]
pub fn unix_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}

/// Reads `CLOCK_MONOTONIC` for one thread. Any two clocks, in any threads and processes, agree to within 0.1 us.
///
/// ```
/// use isotherm_client::{Clock, monotonic_ns};
///
/// let mut clock = Clock::new();
/// let before = monotonic_ns();
/// let now = clock.now();
/// assert!(now + 1_000 > before && now < monotonic_ns() + 1_000); // ns
/// ```
#[derive(Debug)]
pub struct Clock {
    /// The last reading of both clocks; `None` if the counter is not used.
    anchor: Option<Anchor>,
    /// Rate of the counter \[ns per tick\], fixed point; 0 until it is known.
    rate: u64,
    /// [`EXTRAPOLATION_NS`] in ticks; 0 until the rate is known.
    max_ticks: u64,
}

#[derive(Clone, Copy, Debug)]
struct Anchor {
    ticks: u64,
    ns: u64,
}

impl Anchor {
    /// Reads both clocks; `None` if it was interrupted between them.
    fn now() -> Option<Self> {
        let now = Self { ticks: ticks(), ns: monotonic_ns() };
        (ticks().wrapping_sub(now.ticks) <= MAX_READING_TICKS).then_some(now)
    }
}

impl Clock {
    /// Creates a clock and checks whether the counter can be used; this takes less than a millisecond.
    #[must_use]
    pub fn new() -> Self {
        let usable =
            cfg!(target_arch = "x86_64") && fs::read_to_string(CLOCKSOURCE).is_ok_and(|name| name.trim() == "tsc");
        let mut clock = Self { anchor: None, rate: 0, max_ticks: 0 };
        if usable && let Some(first) = (0..ATTEMPTS).find_map(|_| Anchor::now()) {
            thread::sleep(Duration::from_nanos(BASELINE_NS));
            clock.renew(first);
            clock.anchor = clock.anchor.or(Some(first));
        }
        clock
    }

    /// Now \[ns\]. The processor may read the counter some tens of nanoseconds before it has completed earlier
    /// instructions: to wait for them would cost a sample as much.
    #[inline]
    pub fn now(&mut self) -> u64 {
        match self.anchor {
            Some(anchor) => self.at(ticks(), anchor),
            None => monotonic_ns(),
        }
    }

    #[inline]
    fn at(&mut self, ticks: u64, anchor: Anchor) -> u64 {
        // A counter that has gone backwards (a virtual machine was migrated) gives a huge difference, and the kernel is
        // asked.
        let since = ticks.wrapping_sub(anchor.ticks);
        if since < self.max_ticks { anchor.ns + ((since * self.rate) >> FRACTION) } else { self.renew(anchor) }
    }

    /// Reads the kernel's clock, and computes the rate from the time since the last reading.
    #[cold]
    fn renew(&mut self, last: Anchor) -> u64 {
        let Some(now) = Anchor::now() else { return monotonic_ns() };
        let (passed, passed_ns) = (now.ticks.wrapping_sub(last.ticks), now.ns.saturating_sub(last.ns));
        if (BASELINE_NS..1 << (63 - FRACTION)).contains(&passed_ns) {
            let rate = (passed_ns << FRACTION) / passed.max(1);
            // A clock that was stopped or set gives another rate. That rate is not used; the next reading measures a
            // new one.
            let steady = self.rate == 0 || rate.abs_diff(self.rate) <= self.rate / 128;
            self.rate = if steady { rate } else { 0 };
            self.max_ticks = (EXTRAPOLATION_NS << FRACTION).checked_div(self.rate).unwrap_or(0);
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

/// Reads the counter.
#[inline]
fn ticks() -> u64 {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: it only reads a register that this processor has. It is called only if the kernel itself uses the
    // counter.
    unsafe {
        core::arch::x86_64::_rdtsc()
    }
    #[cfg(not(target_arch = "x86_64"))]
    0
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    #[test]
    fn it_gives_the_kernels_time() {
        let mut clock = Clock::new();
        let started = Instant::now();
        let mut readings = 0_u64;
        // A reading lies between two readings of the kernel's clock. The margin of 1 us covers rounding and the rate
        // (0.1 us).
        while started.elapsed() < Duration::from_millis(50) {
            let before = monotonic_ns();
            let now = clock.now();
            let after = monotonic_ns();
            assert!(now + 1_000 > before && now < after + 1_000, "{before} {now} {after}");
            readings += 1;
        }
        assert!(readings > 1_000);
    }

    #[test]
    fn the_number_of_the_start_is_the_kernels() {
        assert_ne!(boot(), 0);
        let id = fs::read_to_string(BOOT_ID).unwrap();
        assert!(id.replace('-', "").starts_with(&format!("{:016x}", boot())));
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
