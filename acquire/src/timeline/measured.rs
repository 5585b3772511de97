//! The measurement of the rate over a long time.

/// Periods and time since the measurement began.
#[derive(Clone, Copy, Debug)]
pub(super) struct RateMeasurement {
    /// When it began or will begin \[ns\].
    since: f64,
    /// Periods since then.
    periods: u64,
    has_begun: bool,
}

impl RateMeasurement {
    /// Begins a second later: what comes first may have waited.
    pub(super) const fn after(by_ns: u64) -> Self {
        Self { since: by_ns as f64 + 1e9, periods: 0, has_begun: false }
    }

    pub(super) fn count(&mut self, by_ns: u64, periods: u64) {
        let now = by_ns as f64;
        if self.has_begun {
            self.periods = self.periods.saturating_add(periods);
        } else if now >= self.since {
            *self = Self { since: now, periods: 0, has_begun: true };
        }
    }

    /// How much the measured interval is over this one \[ns\], relative, and over how long that was measured \[s\].
    pub(super) fn deviation(&self, interval: f64, by_ns: u64) -> Option<(f64, f64)> {
        let passed = by_ns as f64 - self.since;
        (self.periods > 0).then(|| (passed / (self.periods as f64 * interval) - 1.0, passed / 1e9))
    }
}
