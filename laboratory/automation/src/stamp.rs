//! When something was: by the clock of day, which somebody may set, and by one that only rises while the machine runs.

use isotherm_instruments::Time;
use serde::{Deserialize, Serialize};

/// When something was.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Stamp {
    /// Unix time \[s\].
    pub unix_s: f64,
    /// The reading of the clock that only rises \[s\], and the name of the machine's start since which it counts;
    /// `None` on a system that does not name its starts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<UpTime>,
}

/// A reading of a clock that only rises.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct UpTime {
    /// The reading \[s\].
    pub s: f64,
    /// The name of the machine's start since which it counts.
    pub boot: String,
}

impl Stamp {
    /// The present time.
    #[must_use]
    pub fn now(time: &dyn Time) -> Self {
        let up = UpTime { s: time.now().ns() as f64 / 1e9, boot: time.boot() };
        Self { unix_s: time.unix_s(), up: (!up.boot.is_empty()).then_some(up) }
    }

    /// The time since then \[s\], whoever has set the clock of day meanwhile; `None` if the machine was started again:
    /// nothing says what its clock did. A stamp without such a reading goes by the clock of day.
    #[must_use]
    pub fn age_s(&self, time: &dyn Time) -> Option<f64> {
        let now = Self::now(time);
        match (&self.up, &now.up) {
            (Some(then), Some(now)) if then.boot == now.boot => Some((now.s - then.s).max(0.0)),
            (Some(_), Some(_)) => None,
            _ => Some((now.unix_s - self.unix_s).max(0.0)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_instruments::Moment;
    use std::sync::Mutex;

    /// A clock whose readings a test sets: up time \[s\], Unix time \[s\] and start.
    struct SetTime(Mutex<(f64, f64, &'static str)>);

    impl SetTime {
        fn set(&self, readings: (f64, f64, &'static str)) {
            *self.0.lock().unwrap() = readings;
        }
    }

    impl Time for SetTime {
        fn now(&self) -> Moment {
            Moment::of_ns((self.0.lock().unwrap().0 * 1e9) as u64)
        }

        fn unix_s(&self) -> f64 {
            self.0.lock().unwrap().1
        }

        fn boot(&self) -> String {
            self.0.lock().unwrap().2.to_owned()
        }

        fn sleep_until(&self, _: Moment) {}

        fn both(&self, _: &mut (dyn FnMut() + Send), _: &mut dyn FnMut()) {}
    }

    #[test]
    fn a_clock_that_was_set_makes_nothing_older_or_younger() {
        let time = SetTime(Mutex::new((100.0, 1.8e9, "a")));
        let stamp = Stamp::now(&time);
        for unix_s in [1.8e9 - 3600.0, 1.8e9 + 40.0, 1.8e9 + 3600.0] {
            time.set((140.0, unix_s, "a"));
            assert_eq!(stamp.age_s(&time), Some(40.0));
        }
        time.set((20.0, 1.8e9 + 80.0, "b"));
        assert_eq!(stamp.age_s(&time), None);
        time.set((140.0, 1.8e9 + 50.0, ""));
        assert_eq!(stamp.age_s(&time), Some(50.0), "of a system without a name of the start");
    }
}
