//! Which rows of a log have times that can be: damage leaves rows with wild times, and blocks of older or newer rows.
//!
//! The first reading gathers runs of rows whose times rise. Only those are kept that follow each other in time and have
//! the most rows. The second reading takes their rows.
//!
//! The rule for texts and bags does not serve here: it judges a row by the 64 rows behind it, and a damaged card gives
//! whole blocks of other rows, of hundreds of rows and up to a quarter of the log. A log that starts again is refused,
//! not divided into sessions.

use isotherm_recording::foreign::LEAP_NS;
use std::collections::VecDeque;
use std::ops::Range;

/// Last rows of a run that a step back may part from it.
const RECENT: usize = 1024;
/// Runs before the last one to which the time may return.
const PASSED: usize = 4;
/// Most runs of a log.
const MAX_RUNS: usize = 1 << 12;
/// A step over this time is a leap, which rows must be worth \[us\].
const LEAP_US: u64 = LEAP_NS / 1000;
/// A leap costs as many rows: a few rows behind one have wrong times.
const LEAP_COST: u64 = 10;
/// Times in nanoseconds have 64 bits.
const LATEST_US: u64 = u64::MAX / 1000;

/// Runs of rows of a sensor, in the order of the log.
#[derive(Debug, Default)]
pub(super) struct LogTimeline {
    runs: Vec<TimeRun>,
    /// Number and time of the last rows of the last run.
    recent: VecDeque<(u64, u64)>,
    rows: u64,
    /// Whether there are more runs than are kept: the rows of the others are left out.
    is_torn: bool,
}

/// Rows whose times rise.
#[derive(Clone, Debug)]
struct TimeRun {
    /// Their numbers. Rows in between that repeat a time are not counted.
    rows: Range<u64>,
    count: u64,
    first_us: u64,
    last_us: u64,
}

impl LogTimeline {
    /// Takes the next row.
    pub(super) fn take(&mut self, time_us: u64) {
        let number = self.rows;
        self.rows += 1;
        if time_us > LATEST_US {
            return;
        }
        let returns = self.returns(time_us);
        if let Some(last) = self.runs.last_mut() {
            if time_us == last.last_us {
                last.rows.end = number + 1;
                return;
            }
            if (1..=LEAP_US).contains(&time_us.saturating_sub(last.last_us)) && !returns {
                (last.rows.end, last.count, last.last_us) = (number + 1, last.count + 1, time_us);
                self.remember(number, time_us);
                return;
            }
            if time_us < last.last_us {
                self.part(time_us);
            }
        }
        self.recent.clear();
        self.remember(number, time_us);
        let run = TimeRun { rows: number..number + 1, count: 1, first_us: time_us, last_us: time_us };
        self.push(run);
    }

    /// Whether the time passes the end of a run before the last one: the last one may be wild, and its rows stepped
    /// back.
    fn returns(&self, time_us: u64) -> bool {
        let Some((last, before)) = self.runs.split_last() else { return false };
        before.iter().rev().take(PASSED).any(|run| (last.last_us..time_us).contains(&run.last_us))
    }

    /// Number of rows.
    pub(super) const fn rows(&self) -> u64 {
        self.rows
    }

    fn remember(&mut self, number: u64, time_us: u64) {
        if self.recent.len() == RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back((number, time_us));
    }

    fn push(&mut self, run: TimeRun) {
        if self.runs.len() < MAX_RUNS {
            self.runs.push(run);
        } else {
            self.is_torn = true;
        }
    }

    /// Parts the rows of the last run that are not before this time, if they are few: their times may be wild.
    fn part(&mut self, time_us: u64) {
        let at = self.recent.partition_point(|(_, of)| *of < time_us);
        let Some((number, first_us)) = self.recent.get(at).copied() else { return };
        let Some(last) = self.runs.last_mut() else { return };
        let Some((_, before_us)) = at.checked_sub(1).and_then(|before| self.recent.get(before)).copied() else {
            return;
        };
        let count = (self.recent.len() - at) as u64;
        let parted = TimeRun { rows: number..last.rows.end, count, first_us, last_us: last.last_us };
        (last.rows.end, last.count, last.last_us) = (number, last.count - count, before_us);
        self.push(parted);
    }

    /// The rows that are kept.
    pub(super) fn kept(&self) -> UsableTimes {
        let mut best: Vec<(u64, Option<usize>)> = Vec::with_capacity(self.runs.len());
        for (number, run) in self.runs.iter().enumerate() {
            let worth = |(before, earlier): (usize, &TimeRun)| {
                let step_us = run.first_us.checked_sub(earlier.last_us).filter(|step_us| *step_us > 0)?;
                let cost = if step_us > LEAP_US { LEAP_COST } else { 0 };
                Some((best[before].0.saturating_sub(cost), before))
            };
            let before = self.runs[..number].iter().enumerate().filter_map(worth);
            // Of the best the nearest.
            let before = before.max_by_key(|(worth, before)| (*worth, self.runs[*before].last_us));
            let before = before.filter(|(worth, _)| *worth > 0);
            best.push((run.count + before.map_or(0, |(worth, _)| worth), before.map(|(_, before)| before)));
        }
        let mut at = (0..best.len()).max_by_key(|number| best[*number].0);
        let mut kept = UsableTimes { last_us: at.map_or(0, |last| self.runs[last].last_us), ..UsableTimes::default() };
        while let Some(number) = at {
            let run = &self.runs[number];
            kept.rows.push(run.rows.clone());
            kept.count += run.count;
            kept.first_us = run.first_us;
            at = best[number].1;
        }
        kept.rows.reverse();
        kept
    }
}

/// Rows whose times follow each other.
#[derive(Clone, Debug, Default)]
pub(super) struct UsableTimes {
    /// Their numbers.
    rows: Vec<Range<u64>>,
    /// Number of different times.
    pub(super) count: u64,
    pub(super) first_us: u64,
    pub(super) last_us: u64,
}

impl UsableTimes {
    /// The mean time from row to row \[us\].
    pub(super) const fn mean_us(&self) -> u64 {
        if self.count > 1 { (self.last_us - self.first_us) / (self.count - 1) } else { 0 }
    }

    /// Rows before the first and behind the last one that is kept, of so many.
    pub(super) fn outside(&self, rows: u64) -> u64 {
        let first = self.rows.first().map_or(0, |range| range.start);
        first + self.rows.last().map_or(0, |range| rows.saturating_sub(range.end))
    }
}

/// Decides for each row in turn whether it is kept.
#[derive(Debug, Default)]
pub(super) struct Sieve {
    kept: UsableTimes,
    /// The range of the row.
    at: usize,
    row: u64,
    last_us: Option<u64>,
}

/// What a row is by its time.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum StampPlace {
    Follows,
    /// It has the time of the row before.
    Repeats,
    Wild,
}

impl Sieve {
    pub(super) fn new(kept: UsableTimes) -> Self {
        Self { kept, ..Self::default() }
    }

    /// Judges the next row.
    pub(super) fn next(&mut self, time_us: u64) -> StampPlace {
        let row = self.row;
        self.row += 1;
        while self.kept.rows.get(self.at).is_some_and(|range| range.end <= row) {
            self.at += 1;
        }
        let is_kept = self.kept.rows.get(self.at).is_some_and(|range| range.contains(&row)) && time_us <= LATEST_US;
        match self.last_us {
            _ if !is_kept => StampPlace::Wild,
            Some(last_us) if last_us == time_us => StampPlace::Repeats,
            _ => {
                self.last_us = Some(time_us);
                StampPlace::Follows
            }
        }
    }

    /// What is kept.
    pub(super) const fn kept(&self) -> &UsableTimes {
        &self.kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The times that are kept.
    fn kept(times: &[u64]) -> Vec<u64> {
        let mut timeline = LogTimeline::default();
        times.iter().for_each(|time_us| timeline.take(*time_us));
        let mut sieve = Sieve::new(timeline.kept());
        times.iter().copied().filter(|time_us| sieve.next(*time_us) == StampPlace::Follows).collect()
    }

    fn rows(range: Range<u64>) -> Vec<u64> {
        range.map(|row| 5_000_000 + row * 10_000).collect()
    }

    #[test]
    fn wild_times_and_blocks_of_other_times_are_left_out() {
        let all = rows(0..500);
        assert_eq!(kept(&all), all);
        for wild in [0, 1, 4_999_999, 5_500_001, 9_000_000, 7_000_000_000, u64::MAX / 1000, u64::MAX] {
            for at in [1, 200, 498] {
                let mut times = all.clone();
                times[at] = wild;
                let mut expected = all.clone();
                expected.remove(at);
                assert_eq!(kept(&times), expected, "{wild} {at}");
            }
        }
        // Blocks of older and of newer rows.
        for other in [rows(10..50), rows(600..700), vec![1 << 50; 30]] {
            let times = [&all[..200], &other, &all[250..]].concat();
            assert_eq!(kept(&times), [&all[..200], &all[250..]].concat());
        }
        // The first time, and the last, may be wild too.
        assert_eq!(kept(&[&[1 << 52][..], &all].concat()), all);
        assert_eq!(kept(&[&all[..], &[1 << 52]].concat()), all);
    }

    #[test]
    fn repeated_times_are_told_apart_and_a_pause_is_none() {
        let all = rows(0..20);
        let times = [&all[..10], &[all[9]; 30], &all[10..]].concat();
        assert_eq!(kept(&times), all);
        let later: Vec<_> = all.iter().map(|time_us| time_us + 4 * LEAP_US).collect();
        let times = [all, later].concat();
        assert_eq!(kept(&times), times);
    }

    #[test]
    fn any_times_are_taken() {
        let mut state = 1_u64;
        let times: Vec<_> = (0..50_000)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                state >> (20 + state % 40)
            })
            .collect();
        let left = kept(&times[..3000]);
        assert!(left.len() > 10 && left.windows(2).all(|pair| pair[0] < pair[1]));
        let mut timeline = LogTimeline::default();
        times.iter().for_each(|time_us| timeline.take(*time_us));
        assert!(timeline.is_torn && timeline.runs.len() == MAX_RUNS);
    }
}
