//! Rows that have their times, and the holes between them.

/// Most rows by which a row is overtaken.
const OVERTAKEN: usize = 8;

/// A row that gets its time.
#[derive(Clone, Copy, Debug, Default, Eq, Ord, PartialEq, PartialOrd)]
pub(super) struct SessionRow {
    /// How often the clock has started again since the last row before the window.
    pub session: u32,
    pub time_ns: u64,
    /// Its place in the window.
    pub at: usize,
    pub is_fixed: bool,
}

impl SessionRow {
    /// The time up to a later row.
    pub(super) const fn hole(&self, later: &Self) -> ClockGap {
        ClockGap { from_ns: self.time_ns, to_ns: later.time_ns }
    }
}

/// The time between two good rows.
#[derive(Clone, Copy, Debug)]
pub(super) struct ClockGap {
    from_ns: u64,
    to_ns: u64,
}

impl ClockGap {
    pub(super) const fn contains(self, time_ns: u64) -> bool {
        self.from_ns < time_ns && time_ns < self.to_ns
    }

    pub(super) const fn length_ns(self) -> f64 {
        self.to_ns.saturating_sub(self.from_ns) as f64
    }

    /// Where a time within is, if the hole has so many steps.
    pub(super) fn slot(self, time_ns: u64, slots: f64) -> f64 {
        (time_ns - self.from_ns) as f64 * slots / self.length_ns()
    }

    /// The steps that rows have taken.
    pub(super) fn taken(self, session: u32, slots: f64, placed: &[SessionRow]) -> impl Iterator<Item = usize> {
        let within = placed.iter().filter(move |row| row.session == session && self.contains(row.time_ns));
        within.map(move |row| self.slot(row.time_ns, slots).round() as usize)
    }
}

/// The good rows near a place of the window.
pub(super) fn near(good: &[SessionRow], at: usize) -> &[SessionRow] {
    let from = good.partition_point(|row| row.at + OVERTAKEN < at);
    let to = good.partition_point(|row| row.at <= at + OVERTAKEN);
    &good[from..to]
}
