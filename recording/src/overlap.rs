//! Intervals that add up to more time than has passed.

use crate::interval::unit_factor;
use core::fmt;
use isotherm_shared::sequence::Period;

/// Rows over which the sums are compared.
const ROWS: usize = 1000;
/// The intervals may exceed the elapsed time by one of this many parts.
const PARTS: u128 = 100;

/// Rows whose intervals add up to over 1.01 of the time that passed, and one interval more: pulses would be counted
/// twice. A late or early stamp, jitter and bursts are none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// Number of rows.
    pub rows: usize,
    /// Sum of their intervals \[ns\].
    pub intervals_ns: u128,
    /// The time from the row before them to the last one \[ns\].
    pub elapsed_ns: u64,
    /// Interval of the last one over the time since the row before it.
    pub ratio: f64,
}

/// Both values, and the cause if it is a unit.
impl fmt::Display for Overlap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rows, intervals_ns, elapsed_ns, ratio } = *self;
        write!(
            f,
            "the intervals of the {rows} rows up to here add up to {intervals_ns} ns, but only {elapsed_ns} ns have \
             passed; pulses would be counted twice"
        )?;
        match unit_factor(ratio).filter(|factor| *factor > 1.0) {
            Some(factor) => write!(
                f,
                ": {factor} times as long, so interval_ns or timestamp_ns is in another unit than nanoseconds"
            ),
            None => Ok(()),
        }
    }
}

/// Rows of a session, up to [`ROWS`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Span {
    /// The row before them.
    before: Option<Period>,
    last_ns: u64,
    ratio: f64,
    rows: usize,
    intervals_ns: u128,
    /// Whether they are all rows of the session so far.
    is_all: bool,
}

impl Span {
    /// Adds the next row. Returns the overlap that shows at it.
    pub(crate) fn add(&mut self, row: Period) -> Option<Overlap> {
        let goes_on = self.before.is_some_and(|before| before.session == row.session && row.timestamp_ns != 0);
        if !goes_on {
            let ended = self.of_all();
            *self = Self { before: Some(row), last_ns: row.timestamp_ns, is_all: true, ..Self::default() };
            return ended;
        }
        self.ratio = row.interval_ns as f64 / row.timestamp_ns.saturating_sub(self.last_ns) as f64;
        self.last_ns = row.timestamp_ns;
        self.rows += 1;
        self.intervals_ns += u128::from(row.interval_ns);
        if self.rows < ROWS {
            return None;
        }
        let overlap = self.overlap();
        *self = Self { before: Some(row), last_ns: row.timestamp_ns, is_all: false, ..Self::default() };
        overlap
    }

    /// The overlap of all rows of a session that has fewer than [`ROWS`].
    pub(crate) fn of_all(&self) -> Option<Overlap> {
        self.overlap().filter(|_| self.is_all)
    }

    fn overlap(&self) -> Option<Overlap> {
        let begin_ns = self.before.filter(|_| self.rows > 0)?.timestamp_ns;
        let elapsed_ns = self.last_ns.saturating_sub(begin_ns);
        let (rows, intervals_ns, ratio) = (self.rows, self.intervals_ns, self.ratio);
        let excess_ns = intervals_ns.saturating_sub(elapsed_ns.into());
        let is_over = excess_ns > u128::from(elapsed_ns) / PARTS && excess_ns > intervals_ns / rows as u128;
        is_over.then_some(Overlap { rows, intervals_ns, elapsed_ns, ratio })
    }
}

#[cfg(test)]
mod tests {
    use crate::Continuity;
    use isotherm_shared::sequence::Period;

    const INTERVAL: u64 = 10_000_000;

    /// The overlap of rows whose n-th stamp is this many intervals after the first.
    fn overlap(rows: u64, interval_ns: u64, at: impl Fn(u64) -> f64) -> bool {
        let stamp = |n: u64| 5_000_000_000 + (at(n) * INTERVAL as f64) as u64;
        let row = |n| Period { session: 1, sequence: n, timestamp_ns: stamp(n), interval_ns };
        (0..rows).map(row).collect::<Continuity>().overlap().is_some()
    }

    #[test]
    fn late_and_early_stamps_jitter_and_bursts_are_no_overlap() {
        for (late, by) in [(1, 0.9), (500, 5.0), (1000, -5.0), (1999, 9.0)] {
            assert!(!overlap(2000, INTERVAL, |n| n as f64 + if n == late { by } else { 0.0 }), "{late}");
        }
        assert!(!overlap(5000, INTERVAL, |n| n as f64 + (n * 7919 % 101) as f64 / 101.0));
        assert!(!overlap(5000, INTERVAL, |n| (n / 10 * 10 + 10) as f64));
        assert!(!overlap(5000, INTERVAL, |n| n as f64 * 0.995));
        assert!(!overlap(2, INTERVAL, |n| n as f64 * 1e-3), "one step shows nothing");
    }

    #[test]
    fn intervals_that_exceed_the_time_are_an_overlap_in_few_rows_and_in_many() {
        for rows in [4, 500, 5000] {
            assert!(overlap(rows, 1000 * INTERVAL, |n| n as f64), "{rows}");
            assert!(!overlap(rows, INTERVAL / 1000, |n| n as f64), "{rows}");
        }
        // 3 % over the first 1000 rows, or later ones.
        assert!(overlap(1001, INTERVAL, |n| n as f64 * 0.97) && !overlap(20, INTERVAL, |n| n as f64 * 0.97));
        assert!(overlap(4000, INTERVAL, |n| n as f64 - 0.03 * n.saturating_sub(2000) as f64));
    }
}
