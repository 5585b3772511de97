//! Sends a whole array of samples through the service, as `isotherm feed` sends a recording.

use crate::records::{Fields, INCREMENT, RAW, increment_bytes};
use isotherm_client::{Acquisition, RawSample};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::time::{Duration, Instant};

/// Why [`Run::step`] returned.
pub(crate) enum End {
    /// Its time slice is over; call it again.
    Slice,
    /// Every sample has been answered.
    Done,
    /// No answer has come for longer than the time-out.
    Silent,
}

/// A run and its progress.
pub(crate) struct Run<'a> {
    samples: &'a [u8],
    increments: &'a mut [u8],
    window: usize,
    timeout: Duration,
    period: Option<Duration>,
    /// Whether the library keeps the lag of the samples' temperature, which have none.
    follows: bool,
    /// Whether the answers to samples sent before this run have been discarded.
    drained: bool,
    begin_session: bool,
    session: Option<u64>,
    sent: usize,
    received: usize,
    /// When the last increment came, or the first unanswered sample was sent.
    last_answer: Instant,
    /// When the next sample is to be sent.
    due: Instant,
}

impl<'a> Run<'a> {
    /// # Errors
    /// If a sequence does not rise within its session, or an option is out of range.
    pub(crate) fn new(
        samples: &'a [u8],
        increments: &'a mut [u8],
        window: usize,
        timeout: Duration,
        rate: Option<f64>,
        begin_session: bool,
    ) -> PyResult<Self> {
        if window == 0 {
            return Err(PyValueError::new_err("window is 0, give a number of samples from 1"));
        }
        if let Some(rate) = rate.filter(|rate| !(1e-3..=1e6).contains(rate)) {
            return Err(PyValueError::new_err(format!("rate is {rate}, give 0.001 to 1000000 Hz")));
        }
        let mut previous: Option<RawSample> = None;
        let mut follows = true;
        for (index, record) in samples.chunks_exact(RAW).enumerate() {
            let sample = Fields(record).raw();
            if let Some(previous) = previous.filter(|p| p.session == sample.session && p.sequence >= sample.sequence) {
                return Err(PyValueError::new_err(format!(
                    "sample {index}: sequence {} after {}; it must rise within a session",
                    sample.sequence, previous.sequence
                )));
            }
            follows &= sample.lag_ns == 0;
            previous = Some(sample);
        }
        let now = Instant::now();
        let period = rate.map(|rate| Duration::from_secs_f64(1.0 / rate));
        Ok(Self {
            samples,
            increments,
            window,
            timeout,
            period,
            follows,
            drained: false,
            begin_session,
            session: None,
            sent: 0,
            received: 0,
            last_answer: now,
            due: now,
        })
    }

    /// Increments received.
    pub(crate) const fn received(&self) -> usize {
        self.received
    }

    /// Sends and receives for about as long as `slice`.
    ///
    /// # Errors
    /// If the transport fails, or a sample cannot be sent.
    pub(crate) fn step(&mut self, acquisition: &mut Acquisition, slice: Duration) -> Result<End, String> {
        let started = Instant::now();
        while self.received < self.samples.len() / RAW {
            let now = Instant::now();
            let left = slice.saturating_sub(now - started);
            if left.is_zero() {
                return Ok(End::Slice);
            }
            let waiting = acquisition.in_flight();
            let room = waiting < self.window && !acquisition.is_full();
            let next =
                self.samples.get(self.sent * RAW..).filter(|rest| !rest.is_empty()).map(|rest| Fields(rest).raw());
            let changes_session = next.filter(|sample| self.session.is_some_and(|session| session != sample.session));
            match next {
                Some(sample)
                    if (self.drained || (waiting == 0 && acquisition.late().waiting() == 0))
                        && room
                        && (changes_session.is_none() || waiting == 0)
                        && (self.period.is_none() || now >= self.due) =>
                {
                    self.send(acquisition, &sample, waiting, now)?;
                }
                _ => {
                    let pause = if next.is_some() && room && self.period.is_some() {
                        self.due.saturating_duration_since(now).min(left)
                    } else {
                        left
                    };
                    self.receive(acquisition, pause)?;
                    if acquisition.in_flight() > 0 && self.last_answer.elapsed() > self.timeout {
                        return Ok(End::Silent);
                    }
                }
            }
        }
        Ok(End::Done)
    }

    fn send(
        &mut self,
        acquisition: &mut Acquisition,
        sample: &RawSample,
        waiting: usize,
        now: Instant,
    ) -> Result<(), String> {
        let other = self.session.is_some_and(|session| session != sample.session);
        if other || (self.session.is_none() && self.begin_session) {
            acquisition.begin_session().map_err(|error| error.to_string())?;
            // As in a recording.
            acquisition.lag().soaked();
        }
        (self.session, self.drained) = (Some(sample.session), true);
        if waiting == 0 {
            self.last_answer = now;
        }
        if self.follows {
            acquisition.lag().follow(sample);
        }
        let loan = acquisition.loan_record(sample).map_err(|error| error.to_string())?;
        let sent = acquisition.send(loan);
        sent.map_err(|error| format!("sending sample {} (sequence {}): {error}", self.sent, sample.sequence))?;
        self.sent += 1;
        self.due = self.period.map_or(now, |period| self.due + period);
        Ok(())
    }

    fn receive(&mut self, acquisition: &mut Acquisition, pause: Duration) -> Result<(), String> {
        let Some(answer) = acquisition.receive_timeout(pause).map_err(|error| error.to_string())? else {
            return Ok(());
        };
        self.last_answer = Instant::now();
        if self.drained
            && let Some(place) = self.increments.chunks_exact_mut(INCREMENT).nth(self.received)
        {
            place.copy_from_slice(&increment_bytes(&answer));
            self.received += 1;
        }
        Ok(())
    }
}
