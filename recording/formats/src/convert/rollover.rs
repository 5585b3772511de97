//! Counters of time that roll over, and other steps back.

use isotherm_recording::foreign::Counter;
use std::collections::VecDeque;

/// A step forward over a rollover is at most this number of usual ones,
const USUAL_STEPS: f64 = 64.0;
/// or this number of the longest steps so far, up to this part of the counter's width.
const STEPS: u64 = 2;
const NEAR: u64 = 100;
/// A bad stamp may be among so many before a rollover.
const RECENT: usize = 4;

/// The rollovers of a counter.
#[derive(Clone, Debug, Default)]
pub(super) struct Rollover {
    counter: Counter,
    longest_step_ns: u64,
    /// The width \[ns\], and the row of the first one.
    found: Option<(u64, u64)>,
    count: u64,
    /// The last stamps, and what the rollovers before them add \[ns\].
    recent: VecDeque<(u64, u64)>,
}

impl Rollover {
    /// Says what the counter can roll over at.
    pub(super) const fn set_counter(&mut self, counter: Counter) {
        self.counter = counter;
    }

    /// Takes a step forward \[ns\].
    pub(super) fn step(&mut self, step_ns: u64) {
        self.longest_step_ns = self.longest_step_ns.max(step_ns);
    }

    /// A stamp with what the rollovers before it add \[ns\]. `period_ns` is the usual step.
    pub(super) fn joined(&mut self, stamp_ns: u64, period_ns: f64) -> u64 {
        let of = |(earlier_ns, added_ns): &(u64, u64)| {
            if let Some(width_ns) = self.width_between(*earlier_ns, stamp_ns, period_ns) {
                return added_ns.checked_add(width_ns);
            }
            if let Some(width_ns) = self.width_between(stamp_ns, *earlier_ns, period_ns).filter(|_| *added_ns > 0) {
                return added_ns.checked_sub(width_ns);
            }
            let is_near = stamp_ns.abs_diff(*earlier_ns) as f64 <= USUAL_STEPS * period_ns;
            is_near.then_some(*added_ns)
        };
        let added_ns = self.recent.iter().rev().find_map(of);
        let added_ns = added_ns.or(self.recent.back().map(|(_, added_ns)| *added_ns)).unwrap_or(0);
        let added_ns = if stamp_ns.checked_add(added_ns).is_some() { added_ns } else { 0 };
        if self.recent.len() == RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back((stamp_ns, added_ns));
        stamp_ns + added_ns
    }

    /// The width of the counter \[ns\], if it rolls over between these two stamps: the first is near the width, and
    /// the step is about as long as others are. `period_ns` is the usual one.
    fn width_between(&self, earlier_ns: u64, later_ns: u64, period_ns: f64) -> Option<u64> {
        let is_rollover = |width_ns: u64| {
            let found = self.found.map(|(found_ns, _)| found_ns);
            let gap_ns = match found {
                Some(_) => width_ns / NEAR,
                None => STEPS.saturating_mul(self.longest_step_ns).min(width_ns / NEAR),
            };
            let near_ns = gap_ns.max((USUAL_STEPS * period_ns) as u64).min(width_ns / 2);
            let is_same = found.is_none_or(|found_ns| found_ns == width_ns);
            is_same && earlier_ns < width_ns && (width_ns - earlier_ns).saturating_add(later_ns) <= near_ns
        };
        widths(self.counter).map(|(_, _, width_ns)| width_ns).find(|width_ns| is_rollover(*width_ns))
    }

    /// Counts a rollover of this width \[ns\]. `row` counts from 1.
    pub(super) fn take(&mut self, width_ns: u64, row: u64) {
        self.count += 1;
        self.found.get_or_insert((width_ns, row));
    }

    /// What was joined, in a line.
    pub(super) fn told(&self) -> Option<String> {
        let (found_ns, row) = self.found?;
        let (bits, unit_ns, _) = widths(self.counter).find(|(_, _, width_ns)| *width_ns == found_ns)?;
        let unit = UNITS.iter().find(|(ns, _)| *ns == unit_ns).map_or("counts", |(_, name)| *name);
        let name = if bits == 0 { "24 h".to_owned() } else { format!("2^{bits} {unit}") };
        let times = if self.count == 1 { "once".to_owned() } else { format!("{} times", self.count) };
        Some(format!("the time rolls over at {name}, {times}, first at row {row}; it is joined there"))
    }
}

/// Units of counters \[ns\], with their names.
const UNITS: [(u64, &str); 4] = [(1, "ns"), (1000, "us"), (1_000_000, "ms"), (1_000_000_000, "s")];

/// The widths of counters: bits (0 for a day), unit \[ns\] and width \[ns\].
fn widths(counter: Counter) -> impl Iterator<Item = (u32, u64, u64)> {
    let own: [Option<(u32, u64)>; 3] = match counter {
        Counter::None => [None; 3],
        Counter::Whole(unit_ns) => [16, 24, 32].map(|bits| Some((bits, unit_ns))),
        Counter::Day => [Some((0, DAY_NS)), None, None],
    };
    let all = [Some((32, 1000)), Some((32, 1_000_000))].into_iter().chain(own);
    all.flatten().map(|(bits, unit_ns)| (bits, unit_ns, unit_ns << bits))
}

/// A day \[ns\].
const DAY_NS: u64 = 86_400_000_000_000;

#[cfg(test)]
mod tests {
    use super::*;

    const US: u64 = 1000;
    const MS: u64 = 1_000_000;

    fn of(counter: Counter) -> Rollover {
        Rollover { counter, ..Rollover::default() }
    }

    #[test]
    fn counters_of_every_width_are_told_from_two_stamps() {
        for (bits, step, unit_ns, counter, name) in [
            (32, 10_000, US, Counter::Whole(US), "2^32 us"),
            (32, 10_000, US, Counter::None, "2^32 us"),
            (32, 10, MS, Counter::Whole(MS), "2^32 ms"),
            (16, 10, MS, Counter::Whole(MS), "2^16 ms"),
            (16, 5000, US, Counter::Whole(US), "2^16 us"),
            (24, 10_000, US, Counter::Whole(US), "2^24 us"),
            (32, 10_000_000, 1, Counter::Whole(1), "2^32 ns"),
        ] {
            let (width_ns, step_ns, mut rollover) = (unit_ns << bits, step * unit_ns, of(counter));
            let between = |earlier, later| rollover.width_between(earlier, later, step_ns as f64);
            assert_eq!(between(width_ns - 7 * unit_ns, step_ns - 7 * unit_ns), Some(width_ns), "{name}");
            // Three rows are lost.
            assert_eq!(between(width_ns - unit_ns, 4 * step_ns), Some(width_ns), "{name}");
            assert_eq!(between(width_ns / 2 - unit_ns, unit_ns), None, "{name}");
            rollover.take(width_ns, 9);
            let told = format!("the time rolls over at {name}, once, first at row 9; it is joined there");
            assert_eq!(rollover.told(), Some(told));
        }
        assert_eq!(of(Counter::Day).width_between(DAY_NS - MS, 9 * MS, 1e7), Some(DAY_NS));
        assert_eq!(of(Counter::None).width_between((MS << 16) - MS, 9 * MS, 1e7), None);
    }

    #[test]
    fn no_other_step_back_is_one() {
        // The counter is far from its end, the step is a hundred usual ones, or it goes back by half.
        for (earlier, later) in
            [(5_000_000, 0), (3 << 30, 0), ((1 << 32) - 900_000, 900_000), ((1 << 32) - 10, 1 << 31)]
        {
            assert_eq!(of(Counter::Whole(US)).width_between(earlier * US, later * US, 1e7), None, "{earlier} {later}");
        }
        // Where rows are lost for seconds elsewhere, they may be lost there.
        let mut gaps = of(Counter::Whole(US));
        gaps.step(2_000_000_000);
        assert!(gaps.width_between(((1 << 32) - 900_000) * US, 900_000 * US, 1e7).is_some());
        // A gap of an hour says nothing.
        gaps.step(3_600_000_000_000);
        assert!(gaps.width_between(3_612_496_000_000, 12_501_000_000, 5e6).is_none());
    }
}
