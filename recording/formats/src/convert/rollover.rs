//! Counters of time that roll over, and other steps back.

/// What a column of the time can roll over at, besides 2^32 us and 2^32 ms.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub(super) enum Counter {
    /// Nothing else.
    #[default]
    None,
    /// Whole numbers of this unit \[ns\]: counters of 16, 24 and 32 bits.
    Whole(u64),
    /// Times of a day.
    Day,
}

/// A step forward over a rollover is at most this part of the counter's width.
const NEAR: u64 = 100;
/// Or this number of the longest steps so far.
const STEPS: u64 = 2;

/// Joins the stamps of a counter that rolls over.
#[derive(Debug, Default)]
pub(super) struct Rollover {
    /// The last stamp as it was read \[ns\].
    last_ns: Option<u64>,
    longest_step_ns: u64,
    /// What all earlier rollovers add \[ns\].
    added_ns: u64,
    /// The width, its name, the row of the first one and how many there were.
    found: Option<(u64, String, u64)>,
    count: u64,
}

impl Rollover {
    /// The stamp without rollovers. `row` counts from 1.
    ///
    /// # Errors
    /// What is wrong with a step back that is no rollover.
    pub(super) fn join(&mut self, stamp_ns: u64, counter: Counter, row: u64) -> Result<u64, String> {
        let last_ns = self.last_ns.replace(stamp_ns).unwrap_or(stamp_ns);
        if let Some(step_ns) = stamp_ns.checked_sub(last_ns) {
            self.longest_step_ns = self.longest_step_ns.max(step_ns);
        } else {
            let width =
                widths(counter).into_iter().find(|(width_ns, _)| self.is_rollover(last_ns, stamp_ns, *width_ns));
            let Some((width_ns, name)) = width else {
                return Err(format!(
                    "the time is {stamp_ns} ns after {last_ns} ns; it must rise from row to row. This is no rollover of \
                     2^32 us or ms: the logger was started again, the clock was set back, or rows are out of order; \
                     convert the parts one by one, each with --session"
                ));
            };
            self.added_ns = self.added_ns.saturating_add(width_ns);
            self.count += 1;
            self.found.get_or_insert((width_ns, name, row));
        }
        self.added_ns.checked_add(stamp_ns).ok_or_else(|| format!("the time {stamp_ns} ns is over 2^64 ns"))
    }

    fn is_rollover(&self, last_ns: u64, stamp_ns: u64, width_ns: u64) -> bool {
        let is_same = self.found.as_ref().is_none_or(|(found_ns, ..)| *found_ns == width_ns);
        let near_ns = (width_ns / NEAR).max(STEPS.saturating_mul(self.longest_step_ns)).min(width_ns / 2);
        is_same && last_ns < width_ns && width_ns - last_ns + stamp_ns <= near_ns
    }

    /// What was joined, in a line.
    pub(super) fn told(&self) -> Option<String> {
        let (_, name, row) = self.found.as_ref()?;
        let times = if self.count == 1 { "once".to_owned() } else { format!("{} times", self.count) };
        Some(format!("the time rolls over at {name}, {times}, first at row {row}; it is joined there"))
    }
}

/// The widths of counters \[ns\], with their names.
fn widths(counter: Counter) -> Vec<(u64, String)> {
    const UNITS: [(u64, &str); 4] = [(1, "ns"), (1000, "us"), (1_000_000, "ms"), (1_000_000_000, "s")];
    let mut all = Vec::new();
    let mut add = |bits: u32, unit_ns: u64| {
        let unit = UNITS.iter().find(|(ns, _)| *ns == unit_ns).map_or("counts", |(_, name)| *name);
        all.push((unit_ns << bits, format!("2^{bits} {unit}")));
    };
    add(32, 1000);
    add(32, 1_000_000);
    match counter {
        Counter::None => {}
        Counter::Whole(unit_ns) => [16, 24, 32].into_iter().for_each(|bits| add(bits, unit_ns)),
        Counter::Day => all.push((86_400_000_000_000, "24 h".to_owned())),
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    const US: u64 = 1000;
    const MS: u64 = 1_000_000;

    /// Rows every `step` of a counter of this width, in units \[ns\], that begins shortly before it rolls over.
    fn joined(width: u64, step: u64, unit_ns: u64, counter: Counter) -> Result<Vec<u64>, String> {
        let mut rollover = Rollover::default();
        let stamp = |row: u64| (2 * width - 20 * step + 7 + row * step) % width * unit_ns;
        let joined: Result<Vec<_>, _> = (0..60).map(|row| rollover.join(stamp(row), counter, row + 1)).collect();
        assert!(joined.is_err() || rollover.told().is_some_and(|told| told.contains("first at row ")));
        joined
    }

    #[test]
    fn counters_of_every_width_go_on_evenly() {
        for (bits, step, unit_ns, counter) in [
            (32, 10_000, US, Counter::Whole(US)),
            (32, 10_000, US, Counter::None),
            (32, 10, MS, Counter::Whole(MS)),
            (16, 10, MS, Counter::Whole(MS)),
            (16, 5000, US, Counter::Whole(US)),
            (24, 10_000, US, Counter::Whole(US)),
            (32, 10_000_000, 1, Counter::Whole(1)),
        ] {
            let times = joined(1 << bits, step, unit_ns, counter).unwrap();
            assert!(times.windows(2).all(|pair| pair[1] - pair[0] == step * unit_ns), "{bits} {unit_ns}");
        }
        let day = joined(86_400_000, 10, MS, Counter::Day).unwrap();
        assert!(day.windows(2).all(|pair| pair[1] - pair[0] == 10 * MS));
        assert!(joined(1 << 16, 10, MS, Counter::None).is_err());
    }

    #[test]
    fn another_step_back_is_refused_with_both_values() {
        for (last, next) in [(5_000_000, 0), (3 << 30, 0), ((1 << 32) + 10, 5), ((1_u64 << 32) - 10, 1 << 31)] {
            let mut rollover = Rollover::default();
            rollover.join(last * US, Counter::Whole(US), 1).unwrap();
            let refused = rollover.join(next * US, Counter::Whole(US), 2).unwrap_err();
            assert!(
                refused.starts_with(&format!("the time is {} ns after {} ns; ", next * US, last * US)),
                "{refused}"
            );
        }
    }
}
