//! The answers to an acquisition's samples: the next one, or that to one sample, for which the others wait.

use super::Acquisition;
use crate::loan::{CompensateError, Loan, TransportError, transport};
use crate::transport::ports::{Payload as _, copied};
use isotherm_shared::wire::CompensatedIncrement;
use std::thread;
use std::time::{Duration, Instant};

impl Acquisition {
    /// The answer to the oldest unanswered sample, or `None` if it has not come yet. Does not wait.
    ///
    /// First come the late answers that [`compensate`](Self::compensate) has kept aside while it waited for a later
    /// one.
    ///
    /// While samples are unanswered it also checks, about every 5 ms, whether the service has been replaced. If so, it
    /// sends the unanswered samples again.
    ///
    /// # Errors
    /// If the transport fails.
    #[inline]
    pub fn receive(&mut self) -> Result<Option<CompensatedIncrement>, TransportError> {
        match self.state.next_aside() {
            Some(answer) => Ok(Some(answer)),
            None => self.receive_next(),
        }
    }

    /// As [`receive`](Self::receive), without what was kept aside.
    #[inline]
    fn receive_next(&mut self) -> Result<Option<CompensatedIncrement>, TransportError> {
        if let Some(answer) = self.state.next_kept() {
            self.watch.note(&answer);
            return Ok(Some(answer));
        }
        let mut failed = Ok(None);
        while let Some(ports) = &mut self.ports {
            let sample = match CompensatedIncrement::receive(&ports.subscriber) {
                Ok(Some(sample)) => sample,
                Ok(None) => break,
                Err(error) => {
                    failed = Err(transport("receiving an increment", error));
                    break;
                }
            };
            let answer = copied(&*sample);
            ports.read = self.leaves_to_prepare.then_some(sample);
            if self.state.answered(answer.session, answer.sequence, &answer) {
                self.watch.note(&answer);
                return Ok(Some(answer));
            }
        }
        if self.state.nothing_came() {
            self.check_service()?;
        }
        failed
    }

    /// As [`receive`](Self::receive), but waits up to `timeout`: it spins for the first 100 us, then sleeps for short
    /// times.
    ///
    /// # Errors
    /// If the transport fails.
    pub fn receive_timeout(&mut self, timeout: Duration) -> Result<Option<CompensatedIncrement>, TransportError> {
        self.wait(timeout, Self::receive)
    }

    /// The round trip of one sample, for programs that send one now and then: sends `sample` and waits up to `timeout`
    /// for its increment, which comes before those of earlier samples whose time-out has passed. Where order matters,
    /// as for angles, use [`exchange`](Self::exchange).
    ///
    /// Answers to samples sent earlier, whose time-out has passed, are kept aside for [`receive`](Self::receive), at
    /// most [`depth`](Self::depth) of them. [`late`](Self::late) reports them, and continues to wait for the increment.
    ///
    /// # Errors
    /// [`CompensateError`].
    pub fn compensate(&mut self, sample: Loan, timeout: Duration) -> Result<CompensatedIncrement, CompensateError> {
        let sequence = sample.sequence;
        // Makes room, also for all that waits, and checks the service for a caller that never calls `receive`.
        while self.is_full()
            && let Some(answer) = self.receive_next()?
        {
            self.state.keep_aside(answer);
        }
        if self.state.is_full() {
            self.check_service()?;
        }
        self.send(sample)?;
        self.receive_answer(sequence, timeout)?.ok_or(CompensateError::Timeout)
    }

    /// What [`compensate`](Self::compensate) has left: answers that are late.
    pub const fn late(&mut self) -> LateAnswers<'_> {
        LateAnswers(self)
    }

    /// The answer to the sample with this `sequence`, waiting up to `timeout`. Answers to others are kept aside.
    fn receive_answer(
        &mut self,
        sequence: u64,
        timeout: Duration,
    ) -> Result<Option<CompensatedIncrement>, TransportError> {
        let session = self.session();
        let is_wanted = |answer: &CompensatedIncrement| (answer.session, answer.sequence) == (session, sequence);
        if let Some(answer) = self.state.take_aside(is_wanted) {
            return Ok(Some(answer));
        }
        self.wait(timeout, |this| {
            while let Some(answer) = this.receive_next()? {
                if is_wanted(&answer) {
                    return Ok(Some(answer));
                }
                this.state.keep_aside(answer);
            }
            Ok(None)
        })
    }

    fn wait(
        &mut self,
        timeout: Duration,
        mut receive: impl FnMut(&mut Self) -> Result<Option<CompensatedIncrement>, TransportError>,
    ) -> Result<Option<CompensatedIncrement>, TransportError> {
        let mut waiting = Waiting::new(timeout);
        loop {
            if let Some(answer) = receive(self)? {
                return Ok(Some(answer));
            }
            if !waiting.goes_on() {
                return Ok(None);
            }
            self.send_kept()?;
        }
    }
}

/// A wait between polls: it spins for the first 100 us, then sleeps for short times.
pub(super) struct Waiting {
    started: Instant,
    timeout: Duration,
}

impl Waiting {
    pub(super) fn new(timeout: Duration) -> Self {
        Self { started: Instant::now(), timeout }
    }

    /// Waits for a moment; false if the time is over.
    pub(super) fn goes_on(&mut self) -> bool {
        const SPIN: Duration = Duration::from_micros(100);
        let waited = self.started.elapsed();
        if waited >= self.timeout {
            return false;
        }
        if waited < SPIN {
            core::hint::spin_loop();
        } else {
            thread::sleep(Duration::from_micros(20));
        }
        true
    }
}

/// The answers whose time-out in [`Acquisition::compensate`] has passed: [`Acquisition::receive`] returns those that
/// have come, in their order. They count neither as in flight nor for a full queue.
#[derive(Debug)]
pub struct LateAnswers<'a>(&'a mut Acquisition);

impl LateAnswers<'_> {
    /// How many have come and wait for [`receive`](Acquisition::receive).
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.0.state.aside()
    }

    /// How many were dropped because [`depth`](Acquisition::depth) of them waited already.
    #[must_use]
    pub const fn dropped(&self) -> u64 {
        self.0.state.aside_dropped()
    }

    /// The answer to the sample of this session with this `sequence`, waiting up to `timeout`. Answers to earlier
    /// samples are kept aside.
    ///
    /// # Errors
    /// If the transport fails.
    pub fn receive(
        &mut self,
        sequence: u64,
        timeout: Duration,
    ) -> Result<Option<CompensatedIncrement>, TransportError> {
        self.0.receive_answer(sequence, timeout)
    }
}
