//! The one call that serves a control period.

use super::answers::Waiting;
use super::{Acquisition, MOST_EXCHANGED};
use crate::loan::{ExchangeError, Loan};
use core::mem;
use isotherm_shared::wire::CompensatedIncrement;
use std::time::Duration;

impl Acquisition {
    /// Serves a control period: sends all that waits, oldest first, then `sample`, waits up to `timeout` for its
    /// increment, and returns **all** increments that have arrived, each once and in the order of sending.
    ///
    /// What the service has no room for waits in the memory of this process ([`kept`](Self::kept)), and a later call
    /// sends it: 256 samples at once, then 16 in a millisecond, which readers and recorders can take. So a loop of only
    /// this call loses no control period while the service stalls, is away for up to [`Options::kept`] periods, or is
    /// replaced. Then fewer increments come, or none, which is no error, and later more than one.
    ///
    /// Give a `timeout` that is shorter than the control period. With [`Duration::ZERO`] it does not wait.
    ///
    /// ```no_run
    /// # use isotherm_client::{Acquisition, CompensatedIncrement, Triad};
    /// # use std::time::Duration;
    /// # fn navigate(_: &CompensatedIncrement) {}
    /// # fn period(acquisition: &mut Acquisition, counts: Triad) -> Result<(), Box<dyn std::error::Error>> {
    /// let mut sample = acquisition.loan()?;
    /// (sample.interval_ns, sample.accelerometers) = (2_500_000, counts);
    /// for increment in acquisition.exchange(sample, Duration::from_millis(1))? {
    ///     navigate(increment);
    /// }
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`ExchangeError`], with the sample.
    ///
    /// [`Options::kept`]: crate::Options::kept
    pub fn exchange(&mut self, sample: Loan, timeout: Duration) -> Result<&[CompensatedIncrement], ExchangeError> {
        let mut increments = mem::take(&mut self.exchanged);
        increments.clear();
        let exchanged = self.exchange_each(sample, timeout, MOST_EXCHANGED, |increment| increments.push(increment));
        self.exchanged = increments;
        exchanged.map(|()| self.exchanged.as_slice())
    }

    /// As [`exchange`](Self::exchange), but hands at most `most` increments over, one after the other; others that have
    /// arrived come with the next call. With 0 none is taken, so not every call may have that.
    ///
    /// # Errors
    /// As `exchange`.
    pub fn exchange_each(
        &mut self,
        sample: Loan,
        timeout: Duration,
        most: usize,
        mut take: impl FnMut(CompensatedIncrement),
    ) -> Result<(), ExchangeError> {
        // Shared memory: read once.
        let sequence = sample.sequence;
        if !self.process.is_current() {
            return Err(ExchangeError::Forked(sample));
        }
        if !self.state.rises(sequence) {
            return Err(ExchangeError::Sequence(sample));
        }
        let mut left = most;
        if self.state.in_flight() > 0 || self.state.aside() > 0 {
            // Makes room.
            self.hand_over(&mut left, &mut take);
        }
        self.send_waiting();
        if self.is_full() {
            // Only a sequence that does not rise is refused.
            let _ = self.keep(sample);
        } else {
            // Where the transport fails, the sample is unanswered and will be sent again.
            let _ = self.send_now(sample, sequence);
        }
        if self.leaves_by_ns.is_some() {
            // Nothing is on loan any more, as far as this call is concerned.
            let now = self.clock.now();
            self.leave(now);
        }
        let mut waiting = Waiting::new(timeout);
        loop {
            let newest = self.hand_over(&mut left, &mut take);
            self.send_waiting();
            if newest == Some(sequence) || left == 0 || !waiting.goes_on() {
                return Ok(());
            }
        }
    }

    /// What the transport cannot send now counts as unanswered, and is sent again.
    fn send_waiting(&mut self) {
        let _ = self.send_kept();
    }

    /// Hands over the increments that have come, as long as any are `left` to take. Returns the sequence of the last.
    /// Where the transport fails, none has come; a silence has the streams joined anew.
    fn hand_over(&mut self, left: &mut usize, take: &mut impl FnMut(CompensatedIncrement)) -> Option<u64> {
        let mut newest = None;
        while *left > 0
            && let Ok(Some(increment)) = self.receive()
        {
            *left -= 1;
            newest = Some(increment.sequence);
            take(increment);
        }
        newest
    }
}
