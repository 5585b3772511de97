//! An even clock for rows whose stamps are those of their arrival: with jitter, or in bursts.
//!
//! A row arrives after it was measured, never before. So of the rows of a block the one that is least late, against an
//! even clock, shows the clock: all others are put where the line through the neighbouring blocks' least delays has
//! them. The line bends at the blocks' middles, so that a clock that drifts is followed.
//!
//! From a lost row on, all rows are late by a period. Where the least delay of all rows behind a row is higher by three
//! quarters of a period than that of the rows before it, a new stretch of the clock begins, behind a gap.

use super::interval::IntervalShape;
use isotherm_recording::foreign::ForeignRow;
use std::collections::VecDeque;

/// Rows of a block: enough for the ends of several bursts.
const BLOCK: usize = 1000;
/// Rows, and bursts, of which one is hardly late.
const ROWS: usize = 64;
const BURSTS: usize = 2;
/// A least delay that is higher by this part of the period is that of lost rows.
const LOST: f64 = 0.75;

/// Gives rows even times.
pub(super) struct EvenClock {
    shape: IntervalShape,
    /// The first stamp of the stretch \[ns\], and how many of its rows were given out.
    begin_ns: u64,
    given: usize,
    /// The rows that wait, each with its delay against the even clock \[ns\].
    waiting: VecDeque<(ForeignRow, f64)>,
    /// Middle of the last block, counted in rows of the stretch, and its least delay \[ns\].
    last: Option<(f64, f64)>,
    /// Rows of the open block: the last ones that wait.
    open: usize,
    last_stamp_ns: u64,
    /// What is added, so that no time is before 0 \[ns\], and the last time that was given out.
    shift_ns: f64,
    last_ns: Option<u64>,
}

impl EvenClock {
    /// For stamps of this shape.
    pub(super) fn new(shape: IntervalShape) -> Self {
        Self {
            shape,
            begin_ns: 0,
            given: 0,
            waiting: VecDeque::new(),
            last: None,
            open: 0,
            last_stamp_ns: 0,
            shift_ns: 0.0,
            last_ns: None,
        }
    }

    /// Takes the next row. Rows that have their time go to `ready`.
    pub(super) fn push(&mut self, row: ForeignRow, ready: &mut VecDeque<ForeignRow>) {
        let stamp_ns = row.timestamp_ns.unwrap_or(0);
        let is_gap =
            self.given + self.waiting.len() > 0 && stamp_ns.saturating_sub(self.last_stamp_ns) > self.shape.gap_ns;
        if is_gap || row.begins_session {
            self.end(ready);
        }
        let index = self.given + self.waiting.len();
        if index == 0 {
            self.begin_ns = stamp_ns;
        }
        self.last_stamp_ns = stamp_ns;
        // A stamp may be a little before the first one.
        let since_ns = (i128::from(stamp_ns) - i128::from(self.begin_ns)) as f64;
        let delay = since_ns - index as f64 * self.shape.period_ns;
        self.waiting.push_back((row, delay));
        self.open += 1;
        if self.open >= BLOCK {
            self.part(ready);
            if self.open >= BLOCK {
                self.close(self.open, ready);
                self.open = 0;
            }
        }
    }

    /// Gives all rows that wait their times. A stretch ends.
    pub(super) fn end(&mut self, ready: &mut VecDeque<ForeignRow>) {
        self.part(ready);
        self.finish(ready);
    }

    /// Ends the stretch before each row that waits before which rows were lost, and begins another one.
    fn part(&mut self, ready: &mut VecDeque<ForeignRow>) {
        while let Some(at) = self.lost_before() {
            let mut behind = self.waiting.split_off(at);
            self.open = at;
            self.finish(ready);
            let Some((first, first_delay)) = behind.front().copied() else { return };
            self.begin_ns = first.timestamp_ns.unwrap_or(0);
            behind.iter_mut().for_each(|(_, delay)| *delay -= first_delay);
            (self.open, self.waiting) = (behind.len(), behind);
        }
    }

    /// The first row that waits before which rows were lost.
    fn lost_before(&self) -> Option<usize> {
        let rows = ROWS.max(BURSTS * self.shape.burst);
        let mut least_behind: Vec<_> = self.waiting.iter().map(|(_, delay)| *delay).collect();
        for at in (1..least_behind.len()).rev() {
            least_behind[at - 1] = least_behind[at - 1].min(least_behind[at]);
        }
        let last = self.waiting.len().checked_sub(rows)?;
        let is_lost = |at: &usize| {
            let before = self.waiting.range(at.saturating_sub(rows)..*at).map(|(_, delay)| *delay);
            least_behind[*at] - before.fold(f64::INFINITY, f64::min) > LOST * self.shape.period_ns
        };
        (rows..=last).find(is_lost)
    }

    fn finish(&mut self, ready: &mut VecDeque<ForeignRow>) {
        if self.open > 0 {
            // A block of its own would have few rows; the last whole one ends with the stretch.
            self.close(BLOCK.min(self.waiting.len()), ready);
        }
        if let Some((_, delay)) = self.last {
            self.give(self.waiting.len(), |_| delay, ready);
        }
        (self.given, self.open, self.last) = (0, 0, None);
    }

    /// Closes a block of the last `rows` rows, and gives out all up to its middle.
    fn close(&mut self, rows: usize, ready: &mut VecDeque<ForeignRow>) {
        let first = self.waiting.len() - rows;
        let least = self.waiting.range(first..).fold(f64::INFINITY, |least, (_, delay)| least.min(*delay));
        let middle = (self.given + first) as f64 + rows as f64 / 2.0;
        let (from, delay) = self.last.replace((middle, least)).unwrap_or((middle, least));
        let slope = if middle > from { (least - delay) / (middle - from) } else { 0.0 };
        let at = |index: usize| delay + slope * (index as f64 - from).clamp(0.0, middle - from);
        let up_to = (middle as usize).saturating_sub(self.given);
        self.give(up_to, at, ready);
    }

    /// Gives out the next rows, by the delay of the clock at each.
    fn give(&mut self, rows: usize, delay: impl Fn(usize) -> f64, ready: &mut VecDeque<ForeignRow>) {
        for (mut row, _) in self.waiting.drain(..rows) {
            if row.begins_session {
                (self.shift_ns, self.last_ns) = (0.0, None);
            }
            let after_ns = self.given as f64 * self.shape.period_ns + delay(self.given) + self.shift_ns;
            self.given += 1;
            let time_ns = i128::from(self.begin_ns) + after_ns.round() as i128;
            let least_ns = self.last_ns.map_or(1, |last_ns| i128::from(last_ns) + 1);
            if self.last_ns.is_none() && time_ns < least_ns {
                // The first rows of a burst were measured before the clock of the stamps began.
                self.shift_ns = (least_ns - time_ns) as f64 + self.shape.period_ns;
            }
            let shifted = if self.last_ns.is_none() { time_ns + self.shift_ns as i128 } else { time_ns };
            let time_ns = u64::try_from(shifted.max(least_ns)).unwrap_or(u64::MAX);
            self.last_ns = Some(time_ns);
            row.timestamp_ns = Some(time_ns);
            ready.push_back(row);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convert::interval::found;
    use crate::convert::interval::tests::uniform;

    const INTERVAL: f64 = 5e6;

    /// The largest error of a rate over 10 s, of stamps and of even times, for rows that arrive so late.
    fn errors(rows: usize, late: impl Fn(usize) -> f64) -> [f64; 2] {
        let stamps: Vec<_> = (0..rows).map(|row| (1e9 + row as f64 * INTERVAL + late(row)) as u64).collect();
        let shape = found(&stamps).unwrap();
        assert!(!shape.is_even && (shape.period_ns / INTERVAL - 1.0).abs() < 2e-4, "{shape:?}");
        let (mut clock, mut ready) = (EvenClock::new(shape), VecDeque::new());
        let rows = stamps.iter().map(|stamp| ForeignRow { timestamp_ns: Some(*stamp), ..ForeignRow::default() });
        rows.for_each(|row| clock.push(row, &mut ready));
        clock.end(&mut ready);
        let even: Vec<_> = ready.iter().filter_map(|row| row.timestamp_ns).collect();
        assert!(even.len() == stamps.len() && even.windows(2).all(|pair| pair[0] < pair[1]));
        let worst = |times: &[u64]| {
            let rates = times.windows(2000).map(|part| 1999.0 * INTERVAL / (part[1999] - part[0]) as f64 - 1.0);
            rates.fold(0.0, |worst: f64, rate| worst.max(rate.abs()))
        };
        [worst(&stamps), worst(&even)]
    }

    #[test]
    fn jitter_and_bursts_get_an_even_clock() {
        let [stamps, even] = errors(20_000, |row| uniform(row as u64) * INTERVAL);
        assert!(stamps > 4e-4 && even < 2e-5, "{stamps} {even}");
        // Rows of a burst arrive with the last one, 50 us apart.
        for burst in [10, 25, 64] {
            let in_burst = |row: usize| (burst - 1 - row % burst) as f64;
            let late = |row: usize| in_burst(row) * (INTERVAL - 5e4) + uniform((row / burst) as u64) * 1e6;
            let [stamps, even] = errors(20_000, late);
            assert!(stamps > 4e-3 && even < 2e-4, "{burst}: {stamps} {even}");
        }
    }

    #[test]
    fn a_gap_begins_a_new_stretch_and_no_time_is_before_0() {
        let stamp = |row: u64| (row / 10 * 10 + 9) * 5_000_000 + if row >= 500 { 60_000_000_000 } else { 0 };
        let stamps: Vec<_> = (0..1000).map(|row| stamp(row) - 45_000_000).collect();
        let (mut clock, mut ready) = (EvenClock::new(found(&stamps).unwrap()), VecDeque::new());
        for stamp in stamps {
            clock.push(ForeignRow { timestamp_ns: Some(stamp), ..ForeignRow::default() }, &mut ready);
        }
        clock.end(&mut ready);
        let times: Vec<_> = ready.iter().filter_map(|row| row.timestamp_ns).collect();
        let gap = times[500] - times[499];
        assert!(times.len() == 1000 && times[0] > 0 && gap.abs_diff(60_005_000_000) < 100_000, "{gap}");
        assert!(times[..500].windows(2).all(|pair| (pair[1] - pair[0]).abs_diff(5_000_000) < 1000));
    }
}
