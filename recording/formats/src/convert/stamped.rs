//! The rows of a source with times that rise: rows with bad stamps are left out, rollovers are joined, and stamps of
//! arrivals become an even clock.

use super::clock::EvenClock;
use super::interval::{self, IntervalShape};
use super::rhythm::{Twice, arrivals, rhythm, twice};
use super::settings::TimeSource;
use super::stamp_rule::{StampRule, WINDOW};
use isotherm_recording::RecordingError;
use isotherm_recording::foreign::{ForeignRow, ForeignRows, LeftOutRows};
use isotherm_support::finding::{Finding, name};
use std::collections::VecDeque;

/// Rows by which the stamps are judged.
const FOUND_FROM: usize = 1000;
/// The same, where they jitter or come in bursts.
const FOUND_FROM_UNEVEN: usize = 100_000;
/// Stamps of which more than one of so many cannot be right are those of arrivals, if any; and if more than one of so
/// many cannot, they are no others.
const FEW: u64 = 50;
const MANY: u64 = 3;

/// The rows of a source.
pub(super) struct StampedRows {
    pub(super) source: Box<dyn ForeignRows>,
    /// Where the times come from.
    time: TimeSource,
    /// Rows that have been read ahead.
    ahead: VecDeque<ForeignRow>,
    rule: StampRule,
    /// Rows that are kept by their stamps.
    kept: VecDeque<ForeignRow>,
    clock: Option<EvenClock>,
    /// Rows that have their time.
    ready: VecDeque<ForeignRow>,
    shape: Option<IntervalShape>,
    /// Rows that the shape was found from.
    found_from: u64,
    /// What ended the rows before the source did.
    failed: Option<RecordingError>,
    ended: bool,
    /// Whether all rows were given, or refused.
    closed: bool,
}

impl StampedRows {
    /// Reads the first rows, to judge their stamps.
    ///
    /// # Errors
    /// If there is no row; if all stamps are the same, or are those of arrivals that do not show how many rows are
    /// lost.
    pub(super) fn new(source: Box<dyn ForeignRows>, time: TimeSource) -> Result<Self, RecordingError> {
        let adds_up = source.counts_since_the_row_before();
        let mut rows = Self {
            source,
            time,
            ahead: VecDeque::new(),
            rule: StampRule::new(rhythm(&[]), Twice::default(), adds_up),
            kept: VecDeque::new(),
            clock: None,
            ready: VecDeque::new(),
            shape: None,
            found_from: 0,
            failed: None,
            ended: false,
            closed: false,
        };
        rows.read_ahead(FOUND_FROM + WINDOW);
        let Some(first) = rows.ahead.front().copied() else {
            return Err(rows.failed.take().unwrap_or_else(|| rows.source.error(0, rows.source.no_rows())));
        };
        let stamps = rows.stamps();
        if let Some(stamp_ns) = first.timestamp_ns
            && rows.failed.is_none()
            && stamps.len() > 2
            && stamps.iter().all(|of| *of == stamp_ns)
        {
            let remedy = rows.remedy();
            let message = format!("all stamps of the first {} rows are {stamp_ns} ns; {remedy}", stamps.len());
            return Err(rows.source.error(first.place, message));
        }
        rows.choose_rule(adds_up)?;
        Ok(rows)
    }

    /// Judges the stamps as those of the rows, or as those of their arrival.
    ///
    /// # Errors
    /// If they are those of arrival, and do not show how many rows are lost.
    fn choose_rule(&mut self, adds_up: bool) -> Result<(), RecordingError> {
        let [of_even, of_arrivals] = twice(&self.ahead);
        self.rule = StampRule::new(rhythm(&self.stamps()), of_even, adds_up);
        let (left_out, times) = self.kept_times(self.rule.clone(), FOUND_FROM);
        (self.shape, self.found_from) = (interval::found(&times), times.len() as u64);
        let is_even = self.shape.is_none_or(|shape| shape.is_even);
        let is_over = |one_of: u64| left_out.saturating_mul(one_of) > times.len() as u64 + left_out;
        if is_even && !is_over(FEW) {
            return Ok(());
        }
        self.read_ahead(FOUND_FROM_UNEVEN + WINDOW);
        let rule = StampRule::new(arrivals(&self.stamps()), of_arrivals, adds_up);
        let (_, times) = self.kept_times(rule.clone(), FOUND_FROM_UNEVEN);
        let Some(shape) = interval::found(&times) else { return Ok(()) };
        if shape.is_even {
            // More rows show that those of the beginning were no others.
            if !is_even {
                (self.shape, self.found_from) = (Some(shape), times.len() as u64);
            }
        } else if shape.shows_losses {
            (self.rule, self.clock) = (rule, Some(EvenClock::new(shape)));
            (self.shape, self.found_from) = (Some(shape), times.len() as u64);
        } else if !is_even || is_over(MANY) {
            let message = "the stamps are those of the rows' arrival, and do not show how many rows are lost";
            return Err(self.source.error(self.first(), format!("{message}; {}", self.remedy())));
        }
        Ok(())
    }

    /// The stamps of the rows that were read ahead \[ns\].
    pub(super) fn stamps(&self) -> Vec<u64> {
        self.ahead.iter().filter_map(|row| row.timestamp_ns).collect()
    }

    /// How many of the rows that were read ahead are left out, and the times of the first others, in order.
    fn kept_times(&self, mut rule: StampRule, rows: usize) -> (u64, Vec<u64>) {
        let (counter, mut kept, mut times) = (self.source.counter(), VecDeque::new(), Vec::new());
        let mut highest_ns = 0;
        let mut take = |kept: &mut VecDeque<ForeignRow>| {
            for row in kept.drain(..) {
                let Some(time_ns) = row.timestamp_ns.filter(|_| times.len() < rows) else { continue };
                // Where a stamp is a little before the one of the row before, it is the same.
                highest_ns = if row.begins_session { time_ns } else { time_ns.max(highest_ns) };
                times.push(highest_ns);
            }
        };
        for row in &self.ahead {
            rule.push(*row, counter, &mut kept);
            take(&mut kept);
        }
        if self.ended {
            rule.end(&mut kept);
            take(&mut kept);
        }
        (rule.tally().left_out(), times)
    }

    fn read_ahead(&mut self, rows: usize) {
        while self.ahead.len() < rows && !self.ended {
            if let Some(row) = self.read() {
                self.ahead.push_back(row);
            }
        }
    }

    /// The next row of the source.
    fn read(&mut self) -> Option<ForeignRow> {
        match self.source.read() {
            Ok(Some(mut row)) => {
                if self.time == TimeSource::Rate {
                    row.timestamp_ns = None;
                }
                return Some(row);
            }
            Ok(None) => {}
            Err(error) => self.failed = Some(error),
        }
        self.ended = true;
        None
    }

    /// The next row.
    ///
    /// # Errors
    /// Of the source, after the rows before it; after the last row, if too many stamps were bad.
    pub(super) fn next(&mut self) -> Result<Option<ForeignRow>, RecordingError> {
        while self.ready.is_empty() && !self.closed {
            let row = self.ahead.pop_front();
            match row.or_else(|| if self.ended { None } else { self.read() }) {
                Some(row) => self.rule.push(row, self.source.counter(), &mut self.kept),
                None => {
                    self.rule.end(&mut self.kept);
                    self.closed = true;
                }
            }
            match &mut self.clock {
                Some(clock) => self.kept.drain(..).for_each(|row| clock.push(row, &mut self.ready)),
                None => core::mem::swap(&mut self.kept, &mut self.ready),
            }
            if self.closed
                && let Some(clock) = &mut self.clock
            {
                clock.end(&mut self.ready);
            }
        }
        if let Some(row) = self.ready.pop_front() {
            return Ok(Some(row));
        }
        match self.failed.take() {
            Some(error) => Err(error),
            None => self.refuse_bad().map_or(Ok(None), Err),
        }
    }

    /// Refuses rows of which too many have bad stamps. Valid after the last row.
    fn refuse_bad(&self) -> Option<RecordingError> {
        let refusal = self.rule.tally().refusal(self.rule.rows(), &|place| self.source.name(place), &self.remedy());
        refusal.map(|(place, message)| self.source.error(place, message))
    }

    /// What the user can do where the stamps cannot be used.
    fn remedy(&self) -> String {
        let log = if self.time == TimeSource::Header && self.source.has_log_time() {
            "give --time log for the times at which the messages were recorded, or "
        } else {
            "give "
        };
        format!("{log}--time rate --interval S for rows that are S seconds apart")
    }

    /// The place of the first row. Valid before [`next`](Self::next).
    pub(super) fn first(&self) -> u64 {
        self.ahead.front().map_or(0, |row| row.place)
    }

    /// Whether the rows have times. Valid before [`next`](Self::next).
    pub(super) fn has_times(&self) -> bool {
        self.ahead.front().is_none_or(|row| row.timestamp_ns.is_some())
    }

    /// The nominal interval \[ns\], and the number of rows that it was found from.
    ///
    /// # Errors
    /// What ended the rows, if they do not show it, or within the rows that it is found from.
    pub(super) fn nominal(&mut self) -> Result<Option<(u64, u64)>, RecordingError> {
        let limit = if self.clock.is_some() { FOUND_FROM_UNEVEN } else { FOUND_FROM };
        if self.ahead.len() < limit
            && let Some(error) = self.failed.take()
        {
            return Err(error);
        }
        Ok(self.shape.as_ref().and_then(interval::rounded).map(|nominal_ns| (nominal_ns, self.found_from)))
    }

    /// Whether the rows have the times of an even clock.
    pub(super) const fn is_by_clock(&self) -> bool {
        self.clock.is_some()
    }

    /// The rows that are left out by their stamps. Valid after the last row.
    pub(super) fn left_out(&self) -> LeftOutRows {
        let own = LeftOutRows { rows: self.rule.tally().left_out(), of: self.rule.rows() };
        own.or_more(self.source.left_out_by_stamps())
    }

    /// What was done to the stamps. `session` is the first.
    pub(super) fn findings(&self, session: u64) -> Vec<Finding> {
        let rollover = self.rule.rollover().told().map(|told| Finding::warning(name::ROLLOVER, told));
        let uneven = self.shape.filter(|_| self.clock.is_some()).map(|shape| {
            let how = match shape.burst {
                0 | 1 => "the stamps jitter by over a fifth of the interval".to_owned(),
                rows => format!("rows come in bursts of about {rows}"),
            };
            let lost = "rows are missing where all behind them come later";
            Finding::warning(name::STAMPS, format!("{how}: they are given the times of an even clock; {lost}"))
        });
        let bad = self.rule.tally().findings(self.rule.rows(), &|place| self.source.name(place), session);
        let rate = (self.time == TimeSource::Rate).then(|| {
            let message = "the rows are one interval apart, whatever their stamps say: lost rows cannot be detected";
            Finding::warning(name::STAMPS, message.to_owned())
        });
        rollover.into_iter().chain(uneven).chain(rate).chain(bad).collect()
    }
}
