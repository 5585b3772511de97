//! How many frames come in a second.

use std::collections::VecDeque;
use std::time::Instant;

/// The rate is that of so many looks.
const RATE_LOOKS: usize = 10;

/// Frames over the last seconds.
#[derive(Default)]
pub(crate) struct Rate(VecDeque<(Instant, u64)>);

impl Rate {
    pub(crate) fn note(&mut self, now: Instant, frames: u64) {
        if self.0.len() > RATE_LOOKS {
            self.0.pop_front();
        }
        self.0.push_back((now, frames));
    }

    /// Frames a second \[Hz\]; 0 while there are none.
    pub(crate) fn hz(&self) -> f64 {
        let (Some(first), Some(last)) = (self.0.front(), self.0.back()) else { return 0.0 };
        let seconds = (last.0 - first.0).as_secs_f64();
        if seconds > 0.0 { (last.1 - first.1) as f64 / seconds } else { 0.0 }
    }
}
