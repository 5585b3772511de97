//! The rows of a source with times that rise: rollovers are joined, and stamps of arrivals become an even clock.

use super::clock::EvenClock;
use super::interval::{self, Shape};
use super::rollover::Rollover;
use super::source::{Reading, Source};
use isotherm_finding::{Finding, name};
use isotherm_recording::RecordingError;
use std::collections::VecDeque;

/// Rows by which the stamps are judged.
const FOUND_FROM: usize = 1000;
/// The same, where they jitter or come in bursts.
const FOUND_FROM_UNEVEN: usize = 100_000;

/// The rows of a source.
pub(super) struct Stamped {
    pub(super) source: Box<dyn Source>,
    rollover: Rollover,
    /// Rows that have their time.
    ready: VecDeque<Reading>,
    clock: Option<EvenClock>,
    shape: Option<Shape>,
    /// Rows that have been read.
    read: u64,
    /// What ended the rows before the source did.
    failed: Option<RecordingError>,
    ended: bool,
}

impl Stamped {
    /// Reads the first rows, to judge their stamps.
    ///
    /// # Errors
    /// If there is no row.
    pub(super) fn new(source: Box<dyn Source>) -> Result<Self, RecordingError> {
        let mut rows = Self {
            source,
            rollover: Rollover::default(),
            ready: VecDeque::new(),
            clock: None,
            shape: None,
            read: 0,
            failed: None,
            ended: false,
        };
        rows.read_ahead(FOUND_FROM);
        rows.shape = interval::found(&rows.times());
        if rows.is_uneven() {
            rows.read_ahead(FOUND_FROM_UNEVEN);
            rows.shape = interval::found(&rows.times());
        }
        if rows.is_uneven()
            && let Some(shape) = rows.shape
        {
            let waiting = core::mem::take(&mut rows.ready);
            let mut clock = EvenClock::new(shape);
            waiting.into_iter().for_each(|row| clock.push(row, &mut rows.ready));
            rows.clock = Some(clock);
        }
        if rows.read > 0 {
            return Ok(rows);
        }
        Err(rows.failed.take().unwrap_or_else(|| rows.source.error(0, rows.source.no_rows())))
    }

    fn is_uneven(&self) -> bool {
        self.shape.is_some_and(|shape| !shape.is_even)
    }

    /// The times of the rows that have been read ahead \[ns\].
    pub(super) fn times(&self) -> Vec<u64> {
        self.ready.iter().filter_map(|row| row.timestamp_ns).collect()
    }

    fn read_ahead(&mut self, rows: usize) {
        while self.ready.len() < rows && !self.ended {
            match self.read() {
                Ok(Some(row)) => self.ready.push_back(row),
                Ok(None) => {}
                Err(error) => self.failed = Some(error),
            }
        }
    }

    /// The next row of the source, with a rollover joined.
    fn read(&mut self) -> Result<Option<Reading>, RecordingError> {
        let row = self.source.read().and_then(|row| {
            let Some(mut row) = row else { return Ok(None) };
            self.read += 1;
            if let Some(stamp_ns) = row.timestamp_ns {
                let joined = self.rollover.join(stamp_ns, self.source.counter(), self.read);
                row.timestamp_ns = Some(joined.map_err(|message| self.source.error(row.place, message))?);
            }
            Ok(Some(row))
        });
        self.ended = !matches!(row, Ok(Some(_)));
        row
    }

    /// The next row.
    ///
    /// # Errors
    /// Of the source, and of a time that falls; after the rows before it.
    pub(super) fn next(&mut self) -> Result<Option<Reading>, RecordingError> {
        while self.ready.is_empty() && !self.ended {
            match (self.read(), &mut self.clock) {
                (Ok(Some(row)), Some(clock)) => clock.push(row, &mut self.ready),
                (Ok(Some(row)), None) => return Ok(Some(row)),
                (Ok(None), _) => {}
                (Err(error), _) => self.failed = Some(error),
            }
        }
        if self.ended
            && let Some(clock) = &mut self.clock
        {
            clock.end(&mut self.ready);
        }
        match self.ready.pop_front() {
            Some(row) => Ok(Some(row)),
            None => self.failed.take().map_or(Ok(None), Err),
        }
    }

    /// The place of the first row. Valid before [`next`](Self::next).
    pub(super) fn first(&self) -> u64 {
        self.ready.front().map_or(0, |row| row.place)
    }

    /// Whether the rows have times. Valid before [`next`](Self::next).
    pub(super) fn has_times(&self) -> bool {
        self.ready.front().is_none_or(|row| row.timestamp_ns.is_some())
    }

    /// The nominal interval \[ns\], and the number of rows that it was found from.
    ///
    /// # Errors
    /// What ended the rows, if they do not show it, or within the rows that it is found from.
    pub(super) fn nominal(&mut self) -> Result<Option<(u64, u64)>, RecordingError> {
        if let Some(error) = self.failed.take() {
            return Err(error);
        }
        Ok(self.shape.as_ref().and_then(interval::rounded).map(|nominal_ns| (nominal_ns, self.read)))
    }

    /// Whether the rows have the times of an even clock.
    pub(super) const fn is_by_clock(&self) -> bool {
        self.clock.is_some()
    }

    /// What was done to the stamps. `is_found` says whether the interval was found from them.
    pub(super) fn findings(&self, is_found: bool) -> Vec<Finding> {
        let rollover = self.rollover.told().map(|told| Finding::warning(name::ROLLOVER, told));
        let uneven = self.shape.filter(|_| self.clock.is_some()).map(|shape| {
            let how = match shape.burst {
                0 | 1 => "the stamps jitter by over a fifth of the interval".to_owned(),
                rows => format!("rows come in bursts of about {rows}"),
            };
            let lost = if is_found { "; lost rows cannot be told from it: give interval_s" } else { "" };
            Finding::warning(name::STAMPS, format!("{how}: they are given the times of an even clock{lost}"))
        });
        rollover.into_iter().chain(uneven).collect()
    }
}
