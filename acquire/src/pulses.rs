//! The time of a device whose clock begins its second with a pulse, which this machine receives, too.
//!
//! The kernel stamps each pulse (RFC 2783) and has the last one as text, such as `1764331200.000000042#1177` in
//! `/sys/class/pps/pps0/assert`: Unix time, and a number that rises with each pulse. A sample that the device took the
//! fraction f of its second after a pulse was taken at
//! ```text
//! t = p + f s + k s
//! ```
//! with the pulse p on `CLOCK_MONOTONIC`, the second s as the last two pulses show it, and the whole number k by which
//! t is the last such time before the sample came: so it may be late by up to a second.

use crate::notice::Notice;
use isotherm_client::{UnixOffset, monotonic_ns};
use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

/// A second \[ns\].
const SECOND: u64 = 1_000_000_000;
/// The next pulse is looked for from this age of the last one on \[ns\].
const LOOK_NS: u64 = 950_000_000;
/// A pulse that is older when it is seen first was of a source that is gone \[ns\].
const OLD_NS: u64 = 2_000_000_000;
/// By how much a second of the pulses may differ from one of this machine, relative.
const OFF: f64 = 500e-6;
/// How much earlier than its time a sample may seem to come \[ns\].
const EARLY: f64 = 1e6;
/// Without a pulse for so long that is said \[ns\].
const AWAY_NS: u64 = 5_000_000_000;
/// Longest text that is read \[bytes\].
const LONGEST: u64 = 64;

/// Follows the pulses of one source.
pub(crate) struct PulseClock {
    path: PathBuf,
    last: Option<Pulse>,
    /// One that came at another time than the one before it has it: the next one shows which of them is right.
    doubted: Option<Pulse>,
    notice: Notice,
}

/// A pulse.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pulse {
    number: u64,
    /// On `CLOCK_MONOTONIC` \[ns\].
    at_ns: u64,
    /// The time to the next one \[ns\].
    second: f64,
}

impl PulseClock {
    /// The source with this number; `sysfs` is `/`, or the root of a tree for tests.
    pub(crate) fn new(sysfs: &Path, number: u32) -> Self {
        let path = sysfs.join(format!("sys/class/pps/pps{number}/assert"));
        Self { path, last: None, doubted: None, notice: Notice::default() }
    }

    /// When a sample was taken that came at this time \[ns\], on `CLOCK_MONOTONIC`. `None` before the first pulse.
    pub(crate) fn stamp_ns(&mut self, device_ns: u64, by_ns: u64) -> Option<u64> {
        if self.last.is_none_or(|last| by_ns.saturating_sub(last.at_ns) >= LOOK_NS) {
            match self.read() {
                Ok(read) => read.into_iter().for_each(|(unix_ns, number)| {
                    let at_ns = UnixOffset::measure().monotonic_ns(unix_ns);
                    at_ns.into_iter().for_each(|at_ns| self.take(number, at_ns, monotonic_ns()));
                }),
                Err(error) => self.notice.tell(|| format!("warning: {}: {error}: no pulses", self.path.display())),
            }
            let is_away = self.last.is_none_or(|last| by_ns.saturating_sub(last.at_ns) >= AWAY_NS);
            if is_away {
                let goes_on =
                    if self.last.is_some() { "times go on from the last one" } else { "nothing is sent before" };
                self.notice.tell(|| format!("warning: {}: no pulse has come; {goes_on}", self.path.display()));
            }
        }
        self.last.map(|last| last.stamp_ns(device_ns, by_ns))
    }

    /// The last pulse: Unix time \[ns\], and number.
    fn read(&self) -> io::Result<Option<(i64, u64)>> {
        let mut text = String::new();
        File::open(&self.path)?.take(LONGEST).read_to_string(&mut text)?;
        Ok(parsed(&text))
    }

    /// Takes what is seen of the last pulse at this time \[ns\].
    fn take(&mut self, number: u64, at_ns: u64, now_ns: u64) {
        let found = Pulse { number, at_ns, second: SECOND as f64 };
        let Some(last) = self.last else {
            let is_new = now_ns.saturating_sub(at_ns) <= OLD_NS && at_ns <= now_ns;
            self.last = is_new.then_some(found);
            return;
        };
        if number == last.number {
            return;
        }
        let follows = |before: Pulse| before.second_to(found).map(|second| Pulse { second, ..found });
        match follows(last).or_else(|| self.doubted.and_then(follows)) {
            Some(pulse) => (self.last, self.doubted) = (Some(pulse), None),
            None if self.doubted.is_none_or(|doubted| doubted.number != number) => self.doubted = Some(found),
            None => {}
        }
    }
}

impl Pulse {
    /// A second, if the other pulse comes whole seconds later.
    fn second_to(self, other: Self) -> Option<f64> {
        let passed = other.at_ns.checked_sub(self.at_ns)? as f64;
        let seconds = (passed / SECOND as f64).round();
        let second = passed / seconds.max(1.0);
        (seconds >= 1.0 && (second / SECOND as f64 - 1.0).abs() <= OFF / seconds.max(1.0)).then_some(second)
    }

    fn stamp_ns(self, device_ns: u64, by_ns: u64) -> u64 {
        let after = (device_ns % SECOND) as f64 * self.second / SECOND as f64;
        let until = by_ns as f64 - self.at_ns as f64 + EARLY;
        let whole = ((until - after) / self.second).floor();
        let passed = after + whole * self.second;
        self.at_ns.saturating_add_signed(passed.round() as i64)
    }
}

/// The time and the number in a text of the kernel; `None` before the first pulse.
fn parsed(text: &str) -> Option<(i64, u64)> {
    let (time, number) = text.trim_end().split_once('#')?;
    let (seconds, fraction) = time.split_once('.')?;
    let nanoseconds: i64 = (fraction.len() == 9).then(|| fraction.parse().ok())??;
    let unix_ns = seconds.parse::<i64>().ok()?.checked_mul(1_000_000_000)?.checked_add(nanoseconds)?;
    let number = number.parse().ok()?;
    (unix_ns > 0 && number > 0).then_some((unix_ns, number))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    const BEGIN: u64 = 7_000_000_000_123;

    fn clock() -> PulseClock {
        PulseClock::new(Path::new("/nowhere"), 0)
    }

    #[test]
    fn the_kernels_text_is_a_time_and_a_number() {
        assert_eq!(parsed("1764331200.000000042#1177\n"), Some((1_764_331_200_000_000_042, 1177)));
        for wrong in [
            "",
            "0.000000000#0\n",
            "1764331200.42#7",
            "1764331200#7",
            "x.000000042#7",
            "-5.000000000#7",
            "9.000000000#",
        ] {
            assert_eq!(parsed(wrong), None, "{wrong:?}");
        }
        assert_eq!(parsed(&format!("{}.000000000#7", i64::MAX)), None);
    }

    #[test]
    fn a_sample_is_the_fraction_of_its_second_after_the_pulse_however_late_it_comes() {
        let mut clock = clock();
        assert_eq!(clock.stamp_ns(0, BEGIN), None);
        // This machine's clock is slow by 20 ppm: a second of the pulses has fewer of its nanoseconds.
        let second = SECOND - 20_000;
        for number in 0..5 {
            let at_ns = BEGIN + number * second;
            clock.take(number + 9, at_ns, at_ns + 3 * MS);
        }
        let last = clock.last.unwrap();
        assert_eq!((last.number, last.at_ns, last.second), (13, BEGIN + 4 * second, second as f64));
        for (fraction_ns, late_ns) in [(0, 0), (0, 900 * MS), (999 * MS, 3 * MS), (400 * MS, 0), (400 * MS, 998 * MS)] {
            for seconds in 0..3 {
                let device_ns = 77 * SECOND + fraction_ns;
                let true_ns = BEGIN + (4 + seconds) * second + fraction_ns * second / SECOND;
                let stamp_ns = last.stamp_ns(device_ns, true_ns + late_ns);
                assert!(stamp_ns.abs_diff(true_ns) <= 2, "{fraction_ns} {late_ns} {seconds}: {stamp_ns} {true_ns}");
            }
        }
        // Before the pulse: the second before.
        assert!(last.stamp_ns(990 * MS, last.at_ns + MS).abs_diff(last.at_ns - 10 * MS) < 1_000);
    }

    #[test]
    fn one_wrong_pulse_moves_nothing_and_two_right_ones_begin_anew() {
        let mut clock = clock();
        // That of a source that is gone, and one of a time that is to come.
        clock.take(5, BEGIN, BEGIN + 3 * SECOND);
        clock.take(5, BEGIN, BEGIN - 1);
        assert_eq!(clock.last, None);
        clock.take(6, BEGIN, BEGIN + MS);
        clock.take(7, BEGIN + SECOND + 700_000, BEGIN + SECOND + MS);
        assert_eq!(clock.last.unwrap().number, 6);
        clock.take(8, BEGIN + 2 * SECOND, BEGIN + 2 * SECOND + MS);
        assert_eq!(clock.last.unwrap().number, 8);
        // Some that this process did not see.
        clock.take(20, BEGIN + 14 * SECOND + 12_000, BEGIN + 14 * SECOND + MS);
        assert_eq!((clock.last.unwrap().number, clock.last.unwrap().second), (20, SECOND as f64 + 1_000.0));
        for number in 21..24 {
            let at_ns = BEGIN + (number - 6) * SECOND + 300 * MS;
            clock.take(number, at_ns, at_ns + MS);
            assert_eq!(clock.last.unwrap().number, if number == 21 { 20 } else { number });
        }
    }
}
