//! What recurs is reported at once, and then once per minute.

use isotherm_support::failure::tell;
use std::time::{Duration, Instant};

/// Pause between two lines about the same.
const PAUSE: Duration = Duration::from_secs(60);

/// Something that may recur often.
///
/// ```
/// use isotherm_acquire::Notice;
///
/// let mut notice = Notice::default();
/// for _ in 0..1000 {
///     notice.tell(|| "warning: the disk is full".to_owned()); // once
/// }
/// ```
#[derive(Debug, Default)]
pub struct Notice {
    /// When it was reported last, and how often at once.
    told: Option<(Instant, u32)>,
    /// This many more are reported at once.
    more: u32,
    /// How often it has happened since it was reported.
    untold: u64,
}

impl Notice {
    /// One of which this many are reported at once, one after the other.
    #[must_use]
    pub const fn of(many: u32) -> Self {
        Self { told: None, more: many.saturating_sub(1), untold: 0 }
    }

    /// Reports what has happened, unless that was reported within the last minute. A later line has the number of those
    /// that were not reported.
    pub fn tell(&mut self, text: impl FnOnce() -> String) {
        let (is_late, told) = self.told.map_or((true, 0), |(told, times)| (told.elapsed() >= PAUSE, times));
        if !is_late && told > self.more {
            self.untold += 1;
            return;
        }
        let times = match std::mem::take(&mut self.untold) {
            0 => String::new(),
            times => format!("; {times} times more in the last minute"),
        };
        self.told = Some((Instant::now(), if is_late { 1 } else { told + 1 }));
        tell("isotherm", format!("{}{times}", text()));
    }

    /// Reports the next one at once.
    pub fn is_over(&mut self) {
        *self = Self { told: None, more: self.more, untold: 0 };
    }
}
