//! The rule for time stamps of texts and bags: a stamp that rises is kept as it is, and no time is invented.
//!
//! - A row is left out if its stamp does not rise; if it is ahead, and some of the 16 rows behind step back before it;
//!   or if it is off the lines through the 16 rows before and the 16 rows behind, to the same side, by more than five
//!   times their median deviation, and by more than half an interval. These are one line where no row is missing.
//! - If 48 of 64 rows stay below the last stamp, the clock has started again: they begin a session. A counter that
//!   rolls over is joined.
//! - A row that has the stamp and the values of one of the last 1024 rows is left out as repeated.
//! - Stamps of arrival may step back by their jitter, and may be off the line by two intervals, or by a burst.
//!
//! A row that is left out takes no time with it: the rows behind it keep their stamps, and it is missing by the time.
//! Each row of the 600 mixtures in `tests/all/convert_stamps_random.rs` has its true time, to half an interval, or is
//! left out.

use super::rhythm::{Rhythm, Twice};
use super::rollover::Rollover;
use super::stamp_tally::{Spot, StampTally};
use isotherm_recording::foreign::{Counter, ForeignRow, LEAP_NS};
use isotherm_shared::wire::AXES;
use std::collections::VecDeque;

/// Rows behind a row by which it is judged.
pub(super) const WINDOW: usize = 64;
/// Of these so many stay below the last stamp where the clock has started again, or this part of those that are left.
const BELOW: usize = 12;
const MOST_BELOW: f64 = 0.75;
/// Rows of the line on each side.
const SIDE: usize = 16;
/// A row may be off the line by so many times the median deviation.
const DEVIATIONS: f64 = 5.0;
/// Up to so many rows before the first leap, or behind the last one, have the time of a clock that was not set.
const FEW: usize = 3;
/// A leap is longer than so many intervals.
const LEAP_PERIODS: f64 = 1000.0;
/// Last rows that a row may repeat.
const REMEMBERED: usize = 1024;

type Values = [i64; 2 * AXES];

/// Leaves out rows whose stamps cannot be right, and finds where the clock starts again.
#[derive(Clone, Debug)]
pub(super) struct StampRule {
    rhythm: Rhythm,
    /// Which rows are left out, since they are there twice.
    twice: Twice,
    /// Whether the values of a row that is left out count for the next one.
    adds_up: bool,
    rollover: Rollover,
    waiting: VecDeque<StampedRow>,
    /// The last rows of the session, also those that were left out.
    before: VecDeque<u64>,
    /// Numbers of the rows, from those around the first one that waits, whose step from the row before is unusual.
    unusual: VecDeque<u64>,
    /// The last row that was kept.
    last: Option<StampedRow>,
    /// What the counter had before the session, by its rollovers \[ns\].
    base_ns: u64,
    /// What rows that were left out have counted.
    carried: Values,
    /// The last rows, without those that were left out as repeated: their stamps, and the highest of these \[ns\].
    remembered: VecDeque<(u64, Values)>,
    highest_ns: u64,
    read: u64,
    tally: StampTally,
}

#[derive(Clone, Copy, Debug)]
struct StampedRow {
    reading: ForeignRow,
    /// The stamp, with the rollovers before it \[ns\].
    time_ns: u64,
    /// Number of the row, from 1, and the same without repeated rows.
    row: u64,
    number: u64,
}

impl StampedRow {
    const fn stamp_ns(&self) -> u64 {
        match self.reading.timestamp_ns {
            Some(stamp_ns) => stamp_ns,
            None => 0,
        }
    }

    /// The time of another row less that of this one \[ns\].
    fn after(&self, time_ns: u64) -> f64 {
        (i128::from(time_ns) - i128::from(self.time_ns)) as f64
    }
}

/// What becomes of a row.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum Judgement {
    Kept,
    BeginsSession,
    LeftOut,
}

impl StampRule {
    /// For rows whose stamps have this rhythm. `adds_up`: the values count since the row before.
    pub(super) fn new(rhythm: Rhythm, twice: Twice, adds_up: bool) -> Self {
        Self {
            rhythm,
            twice,
            adds_up,
            rollover: Rollover::default(),
            waiting: VecDeque::new(),
            before: VecDeque::new(),
            unusual: VecDeque::new(),
            last: None,
            base_ns: 0,
            carried: Values::default(),
            remembered: VecDeque::new(),
            highest_ns: 0,
            read: 0,
            tally: StampTally::default(),
        }
    }

    /// Takes the next row. Rows that are kept go to `ready`.
    pub(super) fn push(&mut self, reading: ForeignRow, counter: Counter, ready: &mut VecDeque<ForeignRow>) {
        let Some(stamp_ns) = reading.timestamp_ns else { return ready.push_back(reading) };
        self.read += 1;
        if self.is_twice(stamp_ns, &reading.pulses) {
            return self.tally.take_twice(reading.place);
        }
        self.remember(stamp_ns, reading.pulses);
        self.rollover.set_counter(counter);
        let time_ns = self.rollover.joined(stamp_ns, self.rhythm.period_ns);
        let before = self.waiting.back().or(self.last.as_ref());
        let number = before.map_or(0, |before| before.number + 1);
        if before.is_some_and(|before| !self.rhythm.is_usual(before.after(time_ns))) {
            self.unusual.push_back(number);
        }
        self.waiting.push_back(StampedRow { reading, time_ns, row: self.read, number });
        if self.waiting.len() > WINDOW {
            self.judge_first(false, ready);
        }
    }

    /// Judges all rows that wait.
    pub(super) fn end(&mut self, ready: &mut VecDeque<ForeignRow>) {
        while !self.waiting.is_empty() {
            self.judge_first(true, ready);
        }
    }

    /// Number of rows that have been read.
    pub(super) const fn rows(&self) -> u64 {
        self.read
    }

    /// The rows that were left out, and the sessions.
    pub(super) const fn tally(&self) -> &StampTally {
        &self.tally
    }

    /// The rollovers.
    pub(super) const fn rollover(&self) -> &Rollover {
        &self.rollover
    }

    /// Whether a row has the stamp and the values of an earlier one.
    fn is_twice(&self, stamp_ns: u64, values: &Values) -> bool {
        let Some((newest_ns, _)) = self.remembered.back().filter(|_| stamp_ns <= self.highest_ns) else { return false };
        let is_judged = if *newest_ns == stamp_ns { self.twice.standing } else { self.twice.earlier };
        is_judged && self.remembered.iter().rev().any(|(of, their)| *of == stamp_ns && their == values)
    }

    fn remember(&mut self, stamp_ns: u64, values: Values) {
        let oldest = if self.remembered.len() == REMEMBERED { self.remembered.pop_front() } else { None };
        if oldest.is_some_and(|(oldest_ns, _)| oldest_ns == self.highest_ns) {
            self.highest_ns = self.remembered.iter().map(|(of, _)| *of).max().unwrap_or(0);
        }
        self.remembered.push_back((stamp_ns, values));
        self.highest_ns = self.highest_ns.max(stamp_ns);
    }

    /// Judges the first row that waits.
    fn judge_first(&mut self, is_end: bool, ready: &mut VecDeque<ForeignRow>) {
        let Some(row) = self.waiting.pop_front() else { return };
        while self.unusual.front().is_some_and(|number| number + (SIDE as u64) < row.number) {
            self.unusual.pop_front();
        }
        let judgement = self.judgement(&row, is_end);
        if judgement == Judgement::BeginsSession {
            let before_ns = self.last.map(|last| last.stamp_ns());
            self.tally.take_restart(Spot { place: row.reading.place, stamp_ns: row.stamp_ns(), before_ns });
            self.base_ns = row.time_ns - row.stamp_ns();
            self.before.clear();
        }
        match judgement {
            Judgement::LeftOut => self.leave_out(&row),
            _ => self.keep(row, judgement == Judgement::BeginsSession, ready),
        }
        if self.before.len() == SIDE {
            self.before.pop_front();
        }
        self.before.push_back(row.time_ns);
    }

    fn judgement(&self, row: &StampedRow, is_end: bool) -> Judgement {
        let Some(last) = self.last else {
            return if self.is_below_others(row) { Judgement::Kept } else { Judgement::LeftOut };
        };
        if !self.rhythm.rises(last.after(row.time_ns)) {
            let is_restart = self.stays_below(&last) && self.is_below_others(row);
            return if is_restart { Judgement::BeginsSession } else { Judgement::LeftOut };
        }
        let is_odd = !self.is_calm(row) && (self.is_ahead(&last, row) || self.is_off_line(&last, row))
            || is_end && self.waiting.len() < FEW && self.leaps(last.after(row.time_ns));
        if is_odd { Judgement::LeftOut } else { Judgement::Kept }
    }

    /// Whether all steps around a row are usual.
    fn is_calm(&self, row: &StampedRow) -> bool {
        self.unusual.front().is_none_or(|number| *number > row.number + SIDE as u64)
    }

    fn leaps(&self, step_ns: f64) -> bool {
        step_ns > LEAP_NS as f64 && step_ns > LEAP_PERIODS * self.rhythm.period_ns
    }

    /// Whether a row can be the first of a session: most rows behind it rise over it, and no leap comes at once.
    fn is_below_others(&self, row: &StampedRow) -> bool {
        let behind = self.waiting.iter().take(SIDE);
        let rising = behind.clone().filter(|next| self.rhythm.rises(row.after(next.time_ns))).count();
        let steps = [row].into_iter().chain(self.waiting.iter()).zip(&self.waiting).take(FEW);
        let leaps = steps.into_iter().any(|(earlier, later)| self.leaps(earlier.after(later.time_ns)));
        2 * rising >= behind.len() && !leaps
    }

    /// Whether the rows that wait stay below the last stamp, and rise among themselves.
    fn stays_below(&self, last: &StampedRow) -> bool {
        let below = self.waiting.iter().filter(|next| !self.rhythm.rises(last.after(next.time_ns))).count();
        let pairs = self.waiting.iter().zip(self.waiting.iter().skip(1));
        let rising = pairs.filter(|(earlier, later)| earlier.time_ns < later.time_ns).count();
        let is_lasting = below as f64 >= MOST_BELOW * self.waiting.len() as f64 && below >= BELOW;
        is_lasting && (2 * rising >= self.waiting.len() || !self.rhythm.is_even())
    }

    /// Whether a row is ahead of its place: rows behind it step back before it. A single one of them steps back itself
    /// if the row is on the line through the others.
    fn is_ahead(&self, last: &StampedRow, row: &StampedRow) -> bool {
        let Rhythm { period_ns, tolerance_ns, .. } = self.rhythm;
        let is_jump = last.after(row.time_ns) > (row.number - last.number) as f64 * period_ns + tolerance_ns;
        let is_between = |next: &&StampedRow| {
            self.rhythm.rises(last.after(next.time_ns)) && self.rhythm.steps_back(row.after(next.time_ns))
        };
        let between = self.waiting.iter().take(SIDE).filter(is_between).count();
        let is_on_line = || self.behind(row).is_some_and(|(behind_ns, _)| behind_ns.abs() <= tolerance_ns);
        is_jump && (between > 1 || between == 1 && !is_on_line())
    }

    /// Whether a row is off the lines through the rows before it and behind it, to the same side.
    fn is_off_line(&self, last: &StampedRow, row: &StampedRow) -> bool {
        let Rhythm { period_ns, tolerance_ns, .. } = self.rhythm;
        let is_next = (last.after(row.time_ns) - period_ns).abs() <= tolerance_ns;
        let lines = self.before(row).zip(self.behind(row)).filter(|_| !is_next);
        lines.is_some_and(|(before, behind)| {
            let off_ns = tolerance_ns.max(DEVIATIONS * before.1.max(behind.1));
            // Where rows are missing, the line before is below the row, and the line behind above.
            before.0.min(behind.0) > off_ns || before.0.max(behind.0) < -off_ns
        })
    }

    /// Where the rows before have a row, less its stamp, and their median deviation \[ns\].
    fn before(&self, row: &StampedRow) -> Option<(f64, f64)> {
        let place = |back: usize| row.after(self.before[SIDE - 1 - back]) + (back + 1) as f64 * self.rhythm.period_ns;
        (self.before.len() == SIDE).then(|| line(place))
    }

    /// The same of the rows behind.
    fn behind(&self, row: &StampedRow) -> Option<(f64, f64)> {
        let place = |on: usize| row.after(self.waiting[on].time_ns) - (on + 1) as f64 * self.rhythm.period_ns;
        (self.waiting.len() >= SIDE).then(|| line(place))
    }

    fn keep(&mut self, row: StampedRow, begins_session: bool, ready: &mut VecDeque<ForeignRow>) {
        if let Some(last) = self.last.filter(|_| !begins_session) {
            self.rollover.step(row.time_ns.saturating_sub(last.time_ns));
            let [earlier_ns, later_ns] = [last, row].map(|row| row.time_ns - row.stamp_ns());
            if later_ns > earlier_ns {
                self.rollover.take(later_ns - earlier_ns, row.row);
            }
        }
        self.last = Some(row);
        let carried = core::mem::take(&mut self.carried);
        let mut reading =
            ForeignRow { timestamp_ns: Some(row.time_ns.saturating_sub(self.base_ns)), begins_session, ..row.reading };
        reading.pulses.iter_mut().zip(carried).for_each(|(pulses, carried)| *pulses += carried);
        ready.push_back(reading);
    }

    fn leave_out(&mut self, row: &StampedRow) {
        let before_ns = self.last.map(|last| last.stamp_ns());
        self.tally.leave_out(Spot { place: row.reading.place, stamp_ns: row.stamp_ns(), before_ns });
        if self.adds_up {
            let counted = row.reading.pulses;
            self.carried.iter_mut().zip(counted).for_each(|(carried, counted)| *carried += counted);
        }
    }
}

/// The median of what the rows of a side show, and the median deviation from it.
fn line(of: impl Fn(usize) -> f64) -> (f64, f64) {
    let mut values: [f64; SIDE] = core::array::from_fn(of);
    let median = *values.select_nth_unstable_by(SIDE / 2, f64::total_cmp).1;
    values.iter_mut().for_each(|value| *value = (*value - median).abs());
    (median, *values.select_nth_unstable_by(SIDE / 2, f64::total_cmp).1)
}
