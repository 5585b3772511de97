//! The time of foreign rows: counters of it that roll over, and stamps that jitter or come in bursts.

use super::interval::Nominal;

/// Widths of `micros()` and `millis()`, whatever the unit of the column \[ns\].
const COUNTERS_NS: [u64; 2] = [(1 << 32) * 1_000, (1 << 32) * 1_000_000];
/// Bits of counters in a column of whole numbers.
const BITS: [u32; 3] = [16, 24, 32];
/// A day, after which the time of day begins anew \[ns\].
pub(super) const DAY_NS: u64 = 86_400_000_000_000;
/// Shares of the width that a counter has at least before it rolls over, and at most after it.
const NEAR: f64 = 0.05;
/// Share of its distance from the stamps by which the even clock follows them.
const FOLLOWS: f64 = 1e-3;

/// Joins a counter of the time that rolls over.
#[derive(Debug, Default)]
pub(super) struct Counter {
    last_ns: Option<u64>,
    offset_ns: u64,
    /// Rollovers so far, and the width of the last \[ns\].
    pub rollovers: u64,
    pub width_ns: u64,
}

impl Counter {
    /// The time that a stamp stands for. `unit_ns` is that of a column of whole numbers; `of_day` says that the stamps
    /// are times of day.
    pub(super) fn join(&mut self, stamp_ns: u64, unit_ns: Option<u64>, of_day: bool) -> u64 {
        if let Some(last_ns) = self.last_ns.filter(|last_ns| stamp_ns < *last_ns) {
            let counted = BITS.iter().filter_map(|bits| unit_ns?.checked_mul(1 << bits));
            let day = of_day.then_some(DAY_NS);
            let rolls = |width: &u64| {
                last_ns <= *width
                    && last_ns as f64 > (1.0 - NEAR) * *width as f64
                    && (stamp_ns as f64) < NEAR * *width as f64
            };
            if let Some(width_ns) = COUNTERS_NS.into_iter().chain(counted).chain(day).filter(rolls).min() {
                self.rollovers += 1;
                self.width_ns = width_ns;
                self.offset_ns = self.offset_ns.saturating_add(width_ns);
            }
        }
        self.last_ns = Some(stamp_ns);
        stamp_ns.saturating_add(self.offset_ns)
    }
}

/// A clock whose rows are one nominal interval apart, and which follows stamps that jitter or come in bursts.
#[derive(Debug)]
pub(super) struct EvenClock {
    nominal_ns: f64,
    /// A stamp that is further off is after a gap \[ns\].
    gap_ns: f64,
    follows: f64,
    now_ns: Option<f64>,
}

impl EvenClock {
    pub(super) fn new(nominal: &Nominal) -> Self {
        let (nominal_ns, gap_ns) = (nominal.interval_ns as f64, nominal.gap_ns.max(nominal.interval_ns) as f64);
        Self { nominal_ns, gap_ns, follows: FOLLOWS.min(nominal_ns / (2.0 * gap_ns)), now_ns: None }
    }

    /// The time of the next row, and the rows that are missing before it.
    pub(super) fn next(&mut self, stamp_ns: u64) -> (u64, u64) {
        let stamp = stamp_ns as f64;
        let Some(last) = self.now_ns else {
            self.now_ns = Some(stamp);
            return (stamp_ns, 0);
        };
        let expected = last + self.nominal_ns;
        let off = stamp - expected;
        let missing = if off > self.gap_ns { (off / self.nominal_ns).round() } else { 0.0 };
        let off = (off - missing * self.nominal_ns).max(-self.gap_ns);
        let now = expected + missing * self.nominal_ns + self.follows * off;
        self.now_ns = Some(now);
        (now.round() as u64, missing as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The times of a counter of `bits` in `unit_ns` over rows of 10 ms that start near its end.
    fn rolled(bits: u32, unit_ns: u64, whole: bool) -> (Vec<u64>, u64) {
        let mut counter = Counter::default();
        let width = (1_u64 << bits) * unit_ns;
        let begin = width - 50_000_000;
        let stamps = (0..10).map(|row| (begin + row * 10_000_000) / unit_ns * unit_ns % width);
        let times = stamps.map(|stamp| counter.join(stamp, whole.then_some(unit_ns), false)).collect();
        (times, counter.rollovers)
    }

    #[test]
    fn counters_of_microseconds_milliseconds_and_ticks_are_joined() {
        for (bits, unit_ns, whole) in
            [(32, 1000, false), (32, 1_000_000, false), (16, 1_000_000, true), (24, 1000, true)]
        {
            let (times, rollovers) = rolled(bits, unit_ns, whole);
            assert_eq!(rollovers, 1, "{bits} {unit_ns}");
            let steps = times.windows(2).map(|pair| pair[1] - pair[0]);
            assert!(steps.into_iter().all(|step| step.abs_diff(10_000_000) <= unit_ns), "{times:?}");
        }
        // A restart is none: the counter was not near its end.
        let mut counter = Counter::default();
        assert_eq!(
            [5_000_000_000, 10_000_000].map(|stamp| counter.join(stamp, Some(1000), false)),
            [5_000_000_000, 10_000_000]
        );
        assert_eq!(counter.rollovers, 0);
    }

    #[test]
    fn midnight_is_a_rollover_of_the_time_of_day() {
        let mut counter = Counter::default();
        assert_eq!(counter.join(DAY_NS - 5, None, true), DAY_NS - 5);
        assert_eq!((counter.join(5, None, true), counter.rollovers), (DAY_NS + 5, 1));
    }

    #[test]
    fn bursts_get_an_even_clock_and_a_pause_stays() {
        let nominal = Nominal { interval_ns: 10_000_000, is_regular: false, gap_ns: 1_920_000_000 };
        let mut clock = EvenClock::new(&nominal);
        let burst = |row: u64| (row / 64 + 1) * 640_000_000 + row % 64;
        let times: Vec<_> = (0..64_000).map(|row| clock.next(burst(row))).collect();
        let steps = times.windows(2).map(|pair| (pair[1].0 - pair[0].0) as f64 / 1e7 - 1.0);
        assert!(steps.into_iter().all(|off| off.abs() < 0.07));
        assert!(times.iter().all(|(_, missing)| *missing == 0));
        let (_, missing) = clock.next(burst(64_000) + 60_000_000_000);
        assert!(missing.abs_diff(6000) < 70, "{missing}");
    }
}
