//! What the times at which the messages of a bag were recorded say of the stamps of its temperatures.
//!
//! A row has the last temperature up to its stamp, which is right while both topics are stamped by one clock. Where
//! stamps do not rise, or hardly any row is stamped between the first and the last temperature, they decide nothing,
//! and the order in which the messages were recorded does. Where the stamps decide, but those of messages that were
//! recorded at the same time are apart, so are the clocks.

use isotherm_support::finding::{Finding, name};

/// Most messages of a topic that are looked at.
const MOST: usize = 4096;
/// Stamps decide if at least one of so many rows is stamped between the first and the last temperature. Times rise if
/// at most one of so many does not.
const ONE_OF: usize = 10;
/// Messages may be recorded so late, or out of order by so much, while their clocks are one \[ns\].
const LATE_NS: u64 = 1_000_000_000;
/// The stamps of one clock may differ by up to so many times the time between two temperatures.
const DISTANCES: u64 = 2;

/// When a message was stamped, and when it was recorded \[ns\].
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub(super) struct MessageTimes {
    pub(super) stamp_ns: u64,
    pub(super) log_ns: u64,
}

/// A temperature \[degC\] and its times.
#[derive(Clone, Copy, Debug)]
pub(super) struct TimedTemperature {
    pub(super) times: MessageTimes,
    pub(super) celsius: f64,
}

/// Some of many, taken evenly, so that it has a limited size however many there are.
#[derive(Clone, Debug)]
pub(super) struct EvenSample<T> {
    /// One of so many is taken.
    every: u64,
    passed: u64,
    taken: Vec<T>,
}

/// The temperatures of a topic, in order of the times that decide which of them a row has.
#[derive(Default)]
pub(super) struct JoinedTemperatures {
    pub(super) values: Vec<TimedTemperature>,
    /// Whether the times of recording decide, not the stamps.
    pub(super) are_by_recording: bool,
    /// What is to be said of the stamps.
    pub(super) finding: Option<Finding>,
}

impl JoinedTemperatures {
    /// Whether there are temperatures, and all are after this time.
    pub(super) fn are_after(&self, time_ns: u64) -> bool {
        !self.values.is_empty() && self.passed(time_ns) == 0
    }

    /// The last temperature up to this time, otherwise the first.
    pub(super) fn at(&self, time_ns: u64) -> Option<f64> {
        self.values.get(self.passed(time_ns).saturating_sub(1)).map(|value| value.celsius)
    }

    /// Number of temperatures up to this time.
    fn passed(&self, time_ns: u64) -> usize {
        let time_of = |MessageTimes { stamp_ns, log_ns }| if self.are_by_recording { log_ns } else { stamp_ns };
        self.values.partition_point(|value| time_of(value.times) <= time_ns)
    }
}

impl<T> Default for EvenSample<T> {
    fn default() -> Self {
        Self { every: 1, passed: 0, taken: Vec::new() }
    }
}

impl<T> EvenSample<T> {
    /// Counts the next one, and takes it if it is its turn and there is one.
    pub(super) fn add(&mut self, next: impl FnOnce() -> Option<T>) {
        let is_taken = self.passed.is_multiple_of(self.every);
        self.passed += 1;
        if !is_taken {
            return;
        }
        self.taken.extend(next());
        if self.taken.len() == MOST {
            let mut is_kept = false;
            self.taken.retain(|_| {
                is_kept = !is_kept;
                is_kept
            });
            self.every *= 2;
        }
    }
}

impl EvenSample<MessageTimes> {
    /// The temperatures of a topic for rows of another one, by their stamps or in the order of recording. Both are in
    /// their order in the file.
    ///
    /// # Errors
    /// If neither stamps nor times of recording show which temperature a row has.
    pub(super) fn joined(
        &self,
        of_rows: &str,
        (topic, mut values): (&str, Vec<TimedTemperature>),
    ) -> Result<JoinedTemperatures, String> {
        let rising = |time_ns: fn(&MessageTimes) -> u64| {
            [rise(self.taken.iter().map(time_ns)), rise(values.iter().map(|value| time_ns(&value.times)))]
        };
        let (stamps, log) = (rising(|times| times.stamp_ns), rising(|times| times.log_ns));
        let is_one = values.windows(2).all(|pair| pair[0].celsius == pair[1].celsius);
        let why = match stamps {
            // A single temperature is that of all rows, whatever its stamp is.
            _ if is_one || self.taken.is_empty() => None,
            [true, true] => self.elsewhere(of_rows, topic, &values),
            [false, _] => Some(format!("the stamps of {of_rows} do not rise")),
            [true, false] => Some(format!("the stamps of {topic} do not rise")),
        };
        let Some(why) = why else {
            values.sort_by_key(|value| value.times.stamp_ns);
            let finding = (log == [true; 2]).then(|| self.apart(of_rows, topic, &values)).flatten();
            return Ok(JoinedTemperatures { values, are_by_recording: false, finding });
        };
        if log != [true; 2] {
            return Err(format!(
                "{why}, and the times at which the messages were recorded do not rise either: nothing shows which \
                 temperature a row has; give --temperature, or record the bag again"
            ));
        }
        let message = format!(
            "{why}: each row has the last temperature that was recorded before it; look whether one clock stamps both \
             topics, and whether the thermometer went on"
        );
        values.sort_by_key(|value| value.times.log_ns);
        let finding = Some(Finding::warning(name::STAMPS, message));
        Ok(JoinedTemperatures { values, are_by_recording: true, finding })
    }

    /// Why the stamps decide nothing: hardly any row is stamped between those of the temperatures.
    fn elsewhere(&self, of_rows: &str, topic: &str, temperatures: &[TimedTemperature]) -> Option<String> {
        let stamps = || temperatures.iter().map(|value| value.times.stamp_ns);
        let (first_ns, last_ns) = (stamps().min()?, stamps().max()?);
        let between = self.taken.iter().filter(|row| (first_ns..=last_ns).contains(&row.stamp_ns)).count();
        (between * ONE_OF < self.taken.len()).then(|| {
            format!(
                "{:.1} % of the messages of {of_rows} are stamped between the first temperature of {topic}, at \
                 {first_ns} ns, and the last one, at {last_ns} ns",
                100.0 * between as f64 / self.taken.len() as f64
            )
        })
    }

    /// How far the clocks are apart, by temperatures and rows that were recorded at the same time. The topics as a
    /// whole would have other differences: of a bag that was played faster and recorded again, or where the
    /// temperatures begin late. The temperatures are in order of their stamps.
    fn apart(&self, of_rows: &str, topic: &str, temperatures: &[TimedTemperature]) -> Option<Finding> {
        let mut rows = self.taken.clone();
        rows.sort_by_key(|times| times.log_ns);
        let recorded = rows.first()?.log_ns..=rows.last()?.log_ns;
        // What is published again and again with one stamp was new the first time.
        let (mut news, mut distances, mut before_ns) = (EvenSample::default(), EvenSample::default(), None);
        for TimedTemperature { times, .. } in temperatures {
            match before_ns.replace(times.stamp_ns) {
                Some(before_ns) if before_ns == times.stamp_ns => continue,
                Some(before_ns) => distances.add(|| Some(times.stamp_ns - before_ns)),
                None => {}
            }
            news.add(|| Some(*times));
        }
        let ahead = news.taken.iter().filter(|times| recorded.contains(&times.log_ns)).map(|times| {
            let after = rows.partition_point(|row| row.log_ns < times.log_ns);
            let beside = [after.saturating_sub(1), after].map(|at| rows[at]);
            let nearest = beside.into_iter().min_by_key(|row| row.log_ns.abs_diff(times.log_ns));
            times.waited_ns() - nearest.unwrap_or_default().waited_ns()
        });
        let (ahead_ns, distance_ns) = (median(ahead.collect())?, median(distances.taken)?);
        let least_ns = LATE_NS.max(DISTANCES.saturating_mul(distance_ns));
        (ahead_ns.unsigned_abs() > u128::from(least_ns)).then(|| {
            let side = if ahead_ns < 0 { "behind" } else { "ahead of" };
            let [ahead_s, distance_s] = [ahead_ns.unsigned_abs() as f64 / 1e9, distance_ns as f64 / 1e9];
            let message = format!(
                "the stamps of {of_rows} are {ahead_s:.3} s {side} those of {topic}, as the times of recording show, \
                 and the temperatures are {distance_s:.3} s apart: rows have the temperature of another \
                 time; set the clocks, or give --time log for the times at which both topics were recorded"
            );
            Finding::warning(name::CLOCKS_APART, message)
        })
    }
}

impl MessageTimes {
    /// From the stamp to the recording \[ns\].
    fn waited_ns(self) -> i128 {
        i128::from(self.log_ns) - i128::from(self.stamp_ns)
    }
}

/// Whether times rise, all in all: hardly any is 0, or far before what two others had reached, and they are not all the
/// same. A single one does.
fn rise(times: impl Iterator<Item = u64>) -> bool {
    let (mut last_ns, mut reached_ns, mut fallen, mut count, mut stand) = (None, 0, 0_usize, 0_usize, true);
    for time_ns in times {
        fallen += usize::from(time_ns == 0 || time_ns.saturating_add(LATE_NS) < reached_ns);
        let before_ns = last_ns.replace(time_ns).unwrap_or(time_ns);
        stand &= before_ns == time_ns;
        (reached_ns, count) = (reached_ns.max(before_ns.min(time_ns)), count + 1);
    }
    count < 2 || !stand && fallen * ONE_OF <= count
}

fn median<T: Copy + Ord>(mut values: Vec<T>) -> Option<T> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable(middle).1)
}
