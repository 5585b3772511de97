//! What recurs is told at once, and then once a minute.

use isotherm_failure::tell;
use std::time::{Duration, Instant};

/// Pause between two lines about the same.
const PAUSE: Duration = Duration::from_secs(60);

/// Something that may recur often.
#[derive(Debug, Default)]
pub(crate) struct Notice {
    told: Option<Instant>,
    /// How often it has happened since it was told.
    untold: u64,
}

impl Notice {
    /// Tells what has happened, unless that was told within the last minute. A later line has the number of those that
    /// were not told.
    pub(crate) fn tell(&mut self, text: impl FnOnce() -> String) {
        let is_due = self.told.is_none_or(|told| told.elapsed() >= PAUSE);
        if !is_due {
            self.untold += 1;
            return;
        }
        let times = match std::mem::take(&mut self.untold) {
            0 => String::new(),
            times => format!("; {times} times more in the last minute"),
        };
        self.told = Some(Instant::now());
        tell("isotherm", format!("{}{times}", text()));
    }

    /// Tells of the next one at once.
    pub(crate) fn is_over(&mut self) {
        *self = Self::default();
    }
}
