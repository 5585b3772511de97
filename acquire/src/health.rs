//! Reports when the device's status says that sensors are not healthy, and when that ends.

use isotherm_client::Sensor;
use isotherm_support::failure::tell;
use std::time::{Duration, Instant};

/// The beginning and the end of an unhealthy status are logged at once. While the status flickers, at most this many
/// messages are logged in this time.
const MESSAGES: usize = 2;
const TIME: Duration = Duration::from_secs(60);

/// What the status has said.
#[derive(Debug, Default)]
pub(crate) struct Health {
    /// The sensors that are not healthy, one bit each, A1 first; and those that the last message named.
    now: u8,
    told: u8,
    /// Changes since the last message.
    changes: u64,
    /// When the last messages came, the oldest first.
    at: [Option<Instant>; MESSAGES],
}

impl Health {
    /// Takes the sensors that are not healthy in the next sample.
    pub(crate) fn note(&mut self, unhealthy: u8) {
        if let Some(message) = self.message(unhealthy, Instant::now) {
            tell("isotherm", message);
        }
    }

    fn message(&mut self, unhealthy: u8, clock: impl Fn() -> Instant) -> Option<String> {
        if unhealthy != self.now {
            self.now = unhealthy;
            self.changes += 1;
        }
        if self.now == self.told {
            return None;
        }
        let now = clock();
        if self.at[0].is_some_and(|at| now.saturating_duration_since(at) < TIME) {
            return None;
        }
        self.at.rotate_left(1);
        self.at[MESSAGES - 1] = Some(now);
        self.told = self.now;
        let changes = std::mem::take(&mut self.changes);
        let flickers = if changes > 1 { format!(", after {changes} changes") } else { String::new() };
        let sensors = Sensor::NAMES.into_iter().filter(|(sensor, _)| self.now & 1 << *sensor as u8 != 0);
        let sensors = sensors.map(|(_, name)| name).collect::<Vec<_>>().join(", ");
        Some(match self.now {
            0 => format!("the device's status is healthy again{flickers}"),
            _ => format!(
                "warning: by the device's status these are not healthy{flickers}: {sensors}; their temperature is sent as NaN, so that \
                 increments are flagged"
            ),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn begin_and_end_are_told_and_a_status_that_flickers_once_a_minute() {
        let (mut health, began) = (Health::default(), Instant::now());
        let mut at = |ms: u64, unhealthy| health.message(unhealthy, || began + Duration::from_millis(ms));
        assert_eq!(at(0, 0), None);
        let begin = at(10, 0b10_0001).unwrap();
        assert!(begin.contains("not healthy: A1, G3; their temperature"), "{begin}");
        assert_eq!(at(20, 0b10_0001), None);
        assert_eq!(at(5_000, 0).unwrap(), "the device's status is healthy again");
        let told: Vec<_> = (0..20_000).filter_map(|turn| at(5_010 + 10 * turn, (turn % 2) as u8)).collect();
        // 200 s are three times a minute: two messages each.
        assert!((6..=8).contains(&told.len()), "{told:?}");
        assert!(told[0].contains("changes: A1;"), "{told:?}");
        // What is so in the end is reported.
        let last = (0..7_000).filter_map(|turn| at(300_000 + 10 * turn, 0b111)).last();
        assert!(last.is_some_and(|last| last.contains("A1, A2, A3;")));
    }
}
