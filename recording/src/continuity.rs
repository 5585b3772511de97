//! Whether the rows of a recording have all of the time that they span: missing rows, steps of time, and time that is
//! lost for good.
//!
//! A **gap** is a hole in `sequence`. A **time step** is that of [`time_step`]: no sequence is missing, but
//! `timestamp_ns` does not go on by `interval_ns`. A logger whose timestamps jitter, or that hands rows over late and
//! in bursts, has time steps and loses nothing. So it takes more for a [`TimeFault`]: one step that differs from its
//! interval by more than ten intervals, or over 1000 rows a sum of the steps that differs from the sum of the intervals
//! by more than one.
//!
//! # Jitter and bursts
//! The excess of a row is the sum of all steps so far less the sum of the intervals. A late timestamp raises it for
//! some rows, lost time for good. Rows are taken in blocks of 25, and the least excess of a block stands for it: one
//! step is late by at most ten intervals, so one row of a block is on time. Blocks that begin up to 1000 rows apart are
//! compared. A gap, a new session, a row without a timestamp or with an interval that cannot be (0, over an hour)
//! begins anew, and so does an isolated interval: time went on as before.

use crate::interval::{IntervalFault, Intervals};
use crate::nominal::not_nominal;
use crate::overlap::{Overlap, Span};
use core::fmt;
use isotherm_shared::sequence::{Period, Seen, excess_ns, periods_between, time_step};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::MAX_INTERVAL_NS;
use isotherm_support::finding::{Finding, name};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// More missing rows than this share of all are worth a warning.
pub const MISSING: f64 = 0.01;

/// Rows over which the sums are compared.
const ROWS: usize = 1000;
/// Rows of a block.
const BLOCK: usize = 25;
/// A single step that differs from its interval by more than this many intervals is a fault.
const LARGE_STEP: i128 = 10;
/// Up to so many rows one after the other may have an interval of their own while time goes on as before: these
/// readings are wrong, and no time is lost. They are time steps.
const ODD_ROWS: u32 = 10;

/// What is missing in a recording: counts over its rows, its first fault of time, and whether its intervals are the
/// time from row to row. A row costs a few operations, the memory is at most 100 kB.
///
/// ```
/// use isotherm_recording::Continuity;
/// use isotherm_shared::sequence::Period;
///
/// // Samples of 2.5 ms, of which those with the sequences 10 to 12 are missing.
/// let period = Period { session: 1, sequence: 0, timestamp_ns: 0, interval_ns: 2_500_000 };
/// let row = |sequence| Period { sequence, timestamp_ns: (sequence + 1) * 2_500_000, ..period };
/// let continuity: Continuity = (0..10).chain(13..20).map(row).collect();
/// assert_eq!((continuity.losses().missing, continuity.losses().gaps), (3, 1));
/// assert!(continuity.fault().is_none()); // the sequences say where the time went
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Continuity {
    last: Option<Period>,
    /// When the last row was recorded.
    last_recorded_ns: Option<u64>,
    losses: Losses,
    rows: u64,
    intervals: Intervals,
    fault: Option<TimeFault>,
    stretch: Stretch,
    /// Interval of the last row whose time went on by it.
    usual_ns: Option<u64>,
    /// Rows since then whose time went on by that interval too, and not by their own.
    odd_rows: u32,
    span: Span,
    overlap: Option<Overlap>,
}

/// How many rows are missing, and how often time steps.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq, Serialize)]
pub struct Losses {
    /// Rows that are missing within a session by their sequences.
    pub missing: u64,
    /// Holes in the sequences.
    pub gaps: u64,
    /// Rows whose time is not one interval after that of the row before: [`time_step`].
    pub time_steps: u64,
    /// How often another session follows.
    #[serde(skip_serializing_if = "is_zero")]
    pub session_changes: u64,
    /// Control periods between two sessions, in sum, where they are known: [`periods_between`].
    #[serde(skip_serializing_if = "is_zero")]
    pub session_missing: u64,
    /// Changes of session with an unknown number of periods between.
    #[serde(skip_serializing_if = "is_zero")]
    pub session_unknown: u64,
}

/// JSON has the counts of sessions only where there are several.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde calls it")]
const fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// Where time is lost, counted twice, or the intervals are wrong.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub struct TimeFault {
    /// Sequence of the row at which it shows.
    pub sequence: u64,
    /// The rows that it is found over, 1 for a single step.
    pub rows: usize,
    /// The steps of the timestamps less the intervals \[ns\].
    pub excess_ns: i128,
    /// Interval of the row, or mean interval of the rows \[ns\].
    pub interval_ns: u64,
}

/// Rows that follow each other without a gap.
#[derive(Clone, Debug, Default, PartialEq)]
struct Stretch {
    /// Of the last row, since the begin of the stretch \[ns\].
    excess_ns: i128,
    open: Block,
    /// Complete blocks of the last [`ROWS`] rows.
    blocks: VecDeque<Block>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Block {
    rows: usize,
    least_excess_ns: i128,
    /// Sum \[ns\].
    interval_ns: u128,
}

impl Continuity {
    /// Adds the next row. Returns whether the first fault shows at this row.
    pub fn add(&mut self, row: impl Into<Period>) -> bool {
        self.add_recorded(row, None)
    }

    /// As [`add`](Self::add), of a row that was recorded at this time \[ns\], on one clock for all rows: without it the
    /// periods between two sessions are unknown.
    pub fn add_recorded(&mut self, row: impl Into<Period>, recorded_ns: Option<u64>) -> bool {
        let row = row.into();
        let last_recorded_ns = core::mem::replace(&mut self.last_recorded_ns, recorded_ns);
        let overlap = self.span.add(row);
        self.overlap = self.overlap.or(overlap);
        let last = self.last.replace(row);
        let excess = last.and_then(|last| excess_ns(last, row));
        self.rows += 1;
        if (1..=MAX_INTERVAL_NS).contains(&row.interval_ns) {
            self.intervals.note(row.interval_ns);
        }
        if let Some(excess_ns) = excess.filter(|_| (1..=MAX_INTERVAL_NS).contains(&row.interval_ns)) {
            self.intervals.add(excess_ns + i128::from(row.interval_ns), row.interval_ns);
        }
        if let Some(last) = last {
            self.losses.time_steps += u64::from(time_step(last, row));
            let missing = if last.session == row.session { row.sequence.saturating_sub(last.sequence) } else { 0 };
            self.losses.missing = self.losses.missing.saturating_add(missing.saturating_sub(1));
            self.losses.gaps += u64::from(missing > 1);
            if last.session != row.session {
                let seen = |period, at_ns: Option<u64>| at_ns.map(|at_ns| Seen { period, at_ns });
                let both = seen(last, last_recorded_ns).zip(seen(row, recorded_ns));
                self.losses.add_change(both.and_then(|(earlier, later)| periods_between(earlier, later)));
            }
        }
        if self.fault.is_some() {
            return false;
        }
        let has_times = row.timestamp_ns != 0 && (1..=MAX_INTERVAL_NS).contains(&row.interval_ns);
        let is_judged = has_times && !self.is_odd(row, excess);
        let excess = excess.filter(|_| is_judged);
        if excess.is_none() {
            self.stretch = Stretch::default();
        }
        if is_judged {
            let step = excess.and_then(|excess| large_step(row, excess));
            self.fault = step.or_else(|| self.stretch.add(row, excess.unwrap_or(0)));
        }
        self.fault.is_some()
    }

    /// The first 1000 rows whose intervals exceed the time that passed, or all rows of a shorter session that is over.
    #[must_use]
    pub const fn overlap_so_far(&self) -> Option<Overlap> {
        self.overlap
    }

    /// The same after the last row.
    #[must_use]
    pub fn overlap(&self) -> Option<Overlap> {
        self.overlap.or_else(|| self.span.of_all())
    }

    /// Whether the timestamp goes on as before, and only the interval is another.
    fn is_odd(&mut self, row: Period, excess_ns: Option<i128>) -> bool {
        let Some(excess_ns) = excess_ns else { return false };
        let step_ns = excess_ns + i128::from(row.interval_ns);
        let fits = |interval_ns: u64| 2 * (step_ns - i128::from(interval_ns)).unsigned_abs() <= u128::from(interval_ns);
        if fits(row.interval_ns) {
            (self.usual_ns, self.odd_rows) = (Some(row.interval_ns), 0);
            return false;
        }
        self.odd_rows = if self.usual_ns.is_some_and(fits) { self.odd_rows.saturating_add(1) } else { 0 };
        (1..=ODD_ROWS).contains(&self.odd_rows)
    }

    /// The counts so far.
    #[must_use]
    pub const fn losses(&self) -> Losses {
        self.losses
    }

    /// The first fault of time; `None` if time is whole so far.
    #[must_use]
    pub const fn fault(&self) -> Option<TimeFault> {
        self.fault
    }

    /// The intervals, if they are not the time from row to row. Gaps do not count.
    #[must_use]
    pub fn interval(&self) -> Option<IntervalFault> {
        self.intervals.fault()
    }

    /// The fault that the scale factors of `table` are of another interval than the rows: the usual one is not within 1
    /// % of 1 to 64 times the nominal one. Nothing is said where the table has none. Where `interval_ns` is not the
    /// time from row to row, that time counts.
    #[must_use]
    pub fn not_nominal(&self, table: &CoefficientTable) -> Option<Finding> {
        not_nominal(table.nominal_ns(), self.intervals.usual_ns()?)
    }

    /// What is to be said of the rows: intervals that are not the time from row to row, a fault; otherwise lost time, a
    /// warning. Then rows that are missing, if they are over this share of all.
    ///
    /// ```
    /// use isotherm_recording::Continuity;
    /// use isotherm_shared::sequence::Period;
    ///
    /// // Samples of 2.5 ms whose intervals are in microseconds.
    /// let row = |n| Period { session: 1, sequence: n, timestamp_ns: (n + 1) * 2_500_000, interval_ns: 2500 };
    /// let found = (0..100).map(row).collect::<Continuity>().findings(0.01);
    /// assert!(found[0].message.starts_with("interval_ns is 1.000e-3 of the time from row to row, 0.0000025 s"));
    /// assert_eq!(found.len(), 1);
    /// ```
    #[must_use]
    pub fn findings(&self, share: f64) -> Vec<Finding> {
        let interval = self.interval().map(|fault| fault.finding());
        let time = self.fault.filter(|_| interval.is_none()).map(|fault| fault.finding());
        let Losses { missing, gaps, .. } = self.losses;
        let all = missing.saturating_add(self.rows);
        let lost = (missing as f64 > share * all as f64).then(|| {
            let [rows, holes] = [(missing, "row"), (gaps, "gap")].map(|(n, word)| counted(n, word));
            Finding::warning(name::MISSING_ROWS, format!("{rows} missing in {holes}, of {all}"))
        });
        interval.into_iter().chain(time).chain(lost).collect()
    }
}

/// That of all these rows, in order.
impl<P: Into<Period>> FromIterator<P> for Continuity {
    fn from_iter<T: IntoIterator<Item = P>>(rows: T) -> Self {
        let mut continuity = Self::default();
        for row in rows {
            continuity.add(row);
        }
        continuity
    }
}

fn large_step(row: Period, excess_ns: i128) -> Option<TimeFault> {
    let limit_ns = LARGE_STEP * i128::from(row.interval_ns);
    (excess_ns.abs() > limit_ns).then_some(TimeFault {
        sequence: row.sequence,
        rows: 1,
        excess_ns,
        interval_ns: row.interval_ns,
    })
}

impl Stretch {
    fn add(&mut self, row: Period, excess_ns: i128) -> Option<TimeFault> {
        self.excess_ns += excess_ns;
        let open = &mut self.open;
        open.least_excess_ns = if open.rows == 0 { self.excess_ns } else { open.least_excess_ns.min(self.excess_ns) };
        open.rows += 1;
        open.interval_ns += u128::from(row.interval_ns);
        if open.rows < BLOCK {
            return None;
        }
        let block = core::mem::take(open);
        let fault = (self.blocks.iter().rev().zip(1..)).find_map(|(earlier, apart)| {
            let excess_ns = block.least_excess_ns - earlier.least_excess_ns;
            // The mean of the block with the longer intervals.
            let interval_ns = block.interval_ns.max(earlier.interval_ns) / BLOCK as u128;
            let interval_ns = u64::try_from(interval_ns).unwrap_or(u64::MAX);
            let is_fault = excess_ns.unsigned_abs() > u128::from(interval_ns);
            is_fault.then_some(TimeFault { sequence: row.sequence, rows: apart * BLOCK, excess_ns, interval_ns })
        });
        self.blocks.push_back(block);
        if self.blocks.len() > ROWS / BLOCK {
            self.blocks.pop_front();
        }
        fault
    }
}

impl Losses {
    /// Counts a change of session with so many periods between.
    fn add_change(&mut self, missing: Option<u64>) {
        self.session_changes += 1;
        self.session_missing = self.session_missing.saturating_add(missing.unwrap_or(0));
        self.session_unknown += u64::from(missing.is_none());
    }

    /// What is between sessions, `2 changes of session with 599 periods between, 1 unknown`; `None` if there is one
    /// session.
    #[must_use]
    pub fn between_sessions(self) -> Option<String> {
        let Self { session_changes, session_missing, session_unknown, .. } = self;
        let plural = if session_changes == 1 { "" } else { "s" };
        let unknown = if session_unknown > 0 { format!(", {session_unknown} unknown") } else { String::new() };
        (session_changes > 0).then(|| {
            format!(
                "{session_changes} change{plural} of session with {} between{unknown}",
                counted(session_missing, "period")
            )
        })
    }

    /// Whether no session lacks rows, and time does not step.
    #[must_use]
    pub const fn is_none(self) -> bool {
        self.missing == 0 && self.time_steps == 0
    }

    /// These and those of another part of the recording.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self {
            missing: self.missing.saturating_add(other.missing),
            gaps: self.gaps.saturating_add(other.gaps),
            time_steps: self.time_steps.saturating_add(other.time_steps),
            session_changes: self.session_changes.saturating_add(other.session_changes),
            session_missing: self.session_missing.saturating_add(other.session_missing),
            session_unknown: self.session_unknown.saturating_add(other.session_unknown),
        }
    }
}

/// `571 rows missing in 12 gaps, 3 time steps`, and what is between sessions.
impl fmt::Display for Losses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { missing, gaps, time_steps, .. } = self;
        let [rows, gaps, steps] =
            [(missing, "row"), (gaps, "gap"), (time_steps, "time step")].map(|(n, word)| counted(*n, word));
        write!(f, "{rows} missing in {gaps}, {steps}")?;
        self.between_sessions().map_or(Ok(()), |words| write!(f, ", {words}"))
    }
}

/// `1 row`, `3 rows`.
fn counted(count: u64, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

impl TimeFault {
    /// The fault as a finding.
    #[must_use]
    pub fn finding(&self) -> Finding {
        Finding::warning(name::TIME_STEP, self.to_string())
    }
}

/// What is wrong and what to look at, without the place.
impl fmt::Display for TimeFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let &Self { sequence, rows, excess_ns, interval_ns } = self;
        let seconds = |ns: f64| ns / 1e9;
        let (off, interval) = (seconds(excess_ns.unsigned_abs() as f64), seconds(interval_ns as f64));
        let more = if excess_ns > 0 { "more" } else { "less" };
        match rows {
            1 => write!(
                f,
                "at sequence {sequence} timestamp_ns steps by {off} s {more} than interval_ns, {interval} s: "
            )?,
            _ => write!(
                f,
                "over {rows} rows to sequence {sequence} timestamp_ns rises by {off} s {more} than the intervals of \
                 {interval} s add up to: "
            )?,
        }
        f.write_str(if excess_ns > 0 {
            "periods are lost without a hole in sequence, or interval_ns is too short"
        } else {
            "the clock was set back, periods are there twice, or interval_ns is too long"
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INTERVAL: u64 = 2_500_000;

    /// Rows of one session, the n-th with this excess over n intervals \[parts of an interval\].
    fn rows(count: u64, excess: impl Fn(u64) -> f64) -> Vec<Period> {
        let at = |n: u64| 1_000_000_000 + n * INTERVAL + (excess(n) * INTERVAL as f64) as u64;
        let row = |n| Period { session: 1, sequence: n, timestamp_ns: at(n), interval_ns: INTERVAL };
        (0..count).map(row).collect()
    }

    fn read(rows: &[Period]) -> Continuity {
        let mut continuity = Continuity::default();
        let faults = rows.iter().filter(|row| continuity.add(**row)).count();
        assert_eq!(faults, usize::from(continuity.fault().is_some()), "the first fault is reported once");
        continuity
    }

    fn losses(missing: u64, gaps: u64, time_steps: u64) -> Losses {
        Losses { missing, gaps, time_steps, ..Losses::default() }
    }

    #[test]
    fn rows_that_go_on_have_no_losses() {
        let whole = read(&rows(5000, |_| 0.0));
        assert_eq!((whole.losses(), whole.fault()), (Losses::default(), None));
        assert!(whole.losses().is_none());
    }

    #[test]
    fn jitter_and_bursts_of_a_logger_are_no_fault() {
        // Every 7 rows come with the timestamp of the last; every 10; jitter of a third; a row that is 9 intervals late
        // now and then.
        let late = |n: u64| if n % 97 == 50 { 9.0 } else { 0.0 };
        let stall = |n: u64| (10.0 - (n % 500) as f64).max(0.0);
        for excess in [
            &(|n: u64| (6 - n % 7) as f64) as &dyn Fn(u64) -> f64,
            &|n| (9 - n % 10) as f64,
            &|n| (n * 7919 % 101) as f64 / 101.0 * 0.66,
            &late,
            &stall,
            // Two oscillators that are 500 ppm apart.
            &|n| n as f64 * 500e-6,
        ] {
            let found = read(&rows(5000, excess));
            assert_eq!(found.fault(), None);
            assert_eq!((found.losses().missing, found.losses().gaps), (0, 0));
        }
        assert!(read(&rows(5000, late)).losses().time_steps > 50);
    }

    #[test]
    fn two_periods_lost_in_1000_rows_are_a_fault_and_one_is_none() {
        let lost = |at: &'static [u64]| rows(3000, move |n| at.iter().filter(|at| n >= **at).count() as f64);
        assert_eq!((read(&lost(&[700])).losses(), read(&lost(&[700])).fault()), (losses(0, 0, 1), None));
        assert_eq!(read(&lost(&[700, 2300])).fault(), None);
        for at in [&[700, 1400], &[100, 101], &[1300, 1320], &[1330, 2200]] {
            let found = read(&lost(at));
            let fault = found.fault().expect("two are lost");
            assert_eq!((found.losses().time_steps, fault.excess_ns), (2, 2 * i128::from(INTERVAL)));
            assert!(fault.rows <= ROWS && fault.sequence >= at[1] && fault.sequence < at[1] + 2 * BLOCK as u64);
        }
    }

    #[test]
    fn every_seventh_period_lost_and_renumbered_is_found() {
        let found = read(&rows(400, |n| (n / 6) as f64));
        assert_eq!(found.losses(), losses(0, 0, 66));
        let text = found.fault().expect("it is lost").to_string();
        assert!(text.starts_with("over 25 rows to sequence 49 timestamp_ns rises by 0.01 s more"), "{text}");
        // Not renumbered it is a gap, and the steps are not looked at.
        let mut rows = rows(700, |_| 0.0);
        rows.retain(|row| row.sequence % 7 != 3);
        assert_eq!((read(&rows).losses(), read(&rows).fault()), (losses(100, 100, 0), None));
    }

    #[test]
    fn one_step_of_more_than_ten_intervals_is_a_fault() {
        for (excess, is_fault) in [(10.0, false), (10.1, true)] {
            let found = read(&rows(2000, |n| if n == 1200 { excess } else { 0.0 }));
            assert_eq!(found.fault().is_some(), is_fault, "{excess}");
            assert_eq!(found.losses().time_steps, 2);
        }
        // Intervals 1000 times too short.
        let mut rows = rows(10, |_| 0.0);
        rows.iter_mut().for_each(|row| row.interval_ns /= 1000);
        let found = read(&rows);
        assert_eq!((found.losses().time_steps, found.fault().map(|fault| fault.sequence)), (9, Some(1)));
        let text = found.fault().expect("it is wrong").to_string();
        assert!(
            text.starts_with("at sequence 1 timestamp_ns steps by 0.0024975 s more than interval_ns, 0.0000025 s: ")
        );
    }

    #[test]
    fn intervals_that_are_too_long_and_a_clock_that_is_set_back_are_faults() {
        let mut long = rows(100, |_| 0.0);
        long.iter_mut().for_each(|row| row.interval_ns *= 3);
        assert!(read(&long).fault().is_some_and(|fault| fault.excess_ns < 0));
        let back = read(&rows(3000, |n| if n < 1000 { 3.0 } else { 0.0 })).fault().expect("set back");
        assert!(back.excess_ns < 0 && back.to_string().contains("set back"));
    }

    #[test]
    fn sessions_gaps_sums_and_rows_without_timestamps_begin_anew() {
        let mut sessions = rows(3000, |_| 0.0);
        for (n, row) in sessions.iter_mut().enumerate() {
            let jump = (n / 300) as u64;
            row.session = jump;
            row.timestamp_ns += jump * 1_000_000_000;
        }
        let changes = Losses { session_changes: 9, session_unknown: 9, ..Losses::default() };
        assert_eq!((read(&sessions).losses(), read(&sessions).fault()), (changes, None));
        assert!(changes.is_none());
        let mut without = rows(3000, |_| 0.0);
        without.iter_mut().for_each(|row| row.timestamp_ns = 0);
        assert_eq!((read(&without).losses(), read(&without).fault()), (Losses::default(), None));
        // Sums of one to five periods.
        let (mut n, mut sums) = (0, Vec::new());
        for (place, row) in rows(3000, |_| 0.0).into_iter().enumerate() {
            let periods = 1 + place as u64 % 5;
            n += periods;
            let (timestamp_ns, interval_ns) = (1_000_000_000 + n * INTERVAL, periods * INTERVAL);
            sums.push(Period { timestamp_ns, interval_ns, ..row });
        }
        assert_eq!((read(&sums).losses(), read(&sums).fault()), (Losses::default(), None));
    }

    #[test]
    fn an_interval_that_cannot_be_is_no_fault_of_time() {
        for interval_ns in [0, MAX_INTERVAL_NS + 1, u64::MAX] {
            let mut rows = rows(3000, |_| 0.0);
            rows.iter_mut().skip(700).step_by(300).for_each(|row| row.interval_ns = interval_ns);
            assert_eq!((read(&rows).losses(), read(&rows).fault()), (losses(0, 0, 8), None));
        }
    }

    #[test]
    fn an_interval_that_stands_alone_is_no_fault_and_one_that_stays_is() {
        let with = |wrong: core::ops::Range<usize>| {
            let mut rows = rows(3000, |_| 0.0);
            rows[wrong].iter_mut().for_each(|row| row.interval_ns = 7);
            read(&rows)
        };
        assert_eq!((with(700..710).losses(), with(700..710).fault()), (losses(0, 0, 10), None));
        assert_eq!(with(700..3000).fault().map(|fault| fault.sequence), Some(710));
        assert_eq!(with(0..100).fault().map(|fault| fault.sequence), Some(1));
    }

    #[test]
    fn any_values_are_taken() {
        let ends = [0, 1, u64::MAX - 1, u64::MAX];
        let mut continuity = Continuity::default();
        for sequence in 0..2000 {
            let [timestamp_ns, interval_ns] = [sequence, sequence / 4].map(|n| ends[n as usize % 4]);
            continuity.add(Period { session: 0, sequence, timestamp_ns, interval_ns });
        }
        continuity.add(Period { session: 0, sequence: u64::MAX, timestamp_ns: 1, interval_ns: 1 });
        assert!(continuity.losses().missing > u64::MAX / 2);
    }

    #[test]
    fn periods_between_sessions_are_counted_where_they_are_known() {
        let mut continuity = Continuity::default();
        let mut losses = |session, timestamp_ns, recorded_ns: Option<u64>| {
            continuity.add_recorded(Period { session, sequence: 0, timestamp_ns, interval_ns: INTERVAL }, recorded_ns);
            continuity.losses()
        };
        let second = 1_000_000_000;
        assert_eq!(losses(1, second, Some(7)), Losses::default());
        let all = losses(2, 2 * second, Some(7 + second));
        assert_eq!(all.between_sessions().as_deref(), Some("1 change of session with 399 periods between"));
        // A clock that begins anew, then rows without the time of recording.
        losses(3, INTERVAL, Some(7 + 2 * second));
        let all = losses(4, second, None);
        let words = "0 rows missing in 0 gaps, 0 time steps, 3 changes of session with 399 periods between, 2 unknown";
        assert_eq!(all.to_string(), words);
    }

    #[test]
    fn counts_in_words() {
        assert_eq!(losses(1, 1, 1).to_string(), "1 row missing in 1 gap, 1 time step");
        assert_eq!(losses(571, 12, 0).to_string(), "571 rows missing in 12 gaps, 0 time steps");
        assert_eq!(losses(1, 1, 2).and(losses(2, 1, 3)), losses(3, 2, 5));
    }
}
