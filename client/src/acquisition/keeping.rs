//! An acquisition's waiting line: what is kept while the service has no room, or is away, and sent when it has.

use super::{Acquisition, copy_into};
use crate::loan::{Loan, SendError, TransportError};
use crate::warning::warn;

impl Acquisition {
    /// Keeps a control period that [`send`](Self::send) or [`compensate`](Self::compensate) has handed back, or any
    /// other: it waits in private memory, as it is, and is sent before all that comes later. The loan is free again.
    /// [`exchange`](Self::exchange) does this by itself.
    ///
    /// [`Options::kept`](crate::Options::kept) periods wait at most. Beyond that the oldest is dropped and counts as
    /// [lost](Self::lost): a gap for every reader. `sent_ns` and the lagged temperature are those of this moment, so
    /// the increment's latency shows how long it waited. It allocates nothing.
    ///
    /// # Errors
    /// [`SendError::Sequence`] if its sequence is not above the last that was sent or kept; the sample is handed back.
    pub fn keep(&mut self, sample: Loan) -> Result<(), SendError> {
        // Shared memory: read once.
        let mut raw = *sample;
        if !self.state.rises(raw.sequence) {
            return Err(SendError::Sequence(sample));
        }
        raw.session = self.state.session();
        if raw.device == 0 {
            raw.device = self.device;
        }
        self.lag.fill(&mut raw);
        self.judge(&mut raw);
        raw.sent_ns = self.clock.now();
        self.state.take(raw.sequence);
        if self.kept.push(&raw) {
            if !self.is_line_full {
                warn(&self.imu, "the service takes nothing, and no more fits into memory: the oldest periods are lost");
            }
            self.is_line_full = true;
            self.state.lose();
        }
        Ok(())
    }

    /// Sends what is [kept](Self::keep), oldest first, as far as the service takes it now: until
    /// [`depth`](Self::depth) samples are unanswered, and after an outage no faster than readers and recorders take it
    /// (256 samples at once, then 16 in a millisecond). Never waits. Every sending call begins with it. Without
    /// anything kept it does nothing.
    ///
    /// # Errors
    /// If the transport fails. The period that was being sent counts as unanswered, and will be sent again.
    pub fn send_kept(&mut self) -> Result<(), TransportError> {
        if self.kept.is_empty() {
            return Ok(());
        }
        let now = self.clock.now();
        let mut sent = Ok(());
        while !self.kept.is_empty() && !self.state.is_full() && sent.is_ok() && self.kept.pace.allows(now) {
            let Some(raw) = self.kept.pop() else { break };
            self.state.send(raw.sequence, &raw, now);
            if let Some(ports) = &mut self.ports {
                sent = copy_into(ports, &raw);
            }
        }
        self.is_line_full &= !self.kept.is_empty();
        if let Some(ports) = &mut self.ports {
            // As in `send`.
            ports.wake();
            if ports.spare.is_none() {
                ports.spare = ports.loan().ok();
            }
        }
        sent
    }

    /// Control periods that wait: they are [kept](Self::keep), and not sent yet.
    #[must_use]
    pub const fn kept(&self) -> u64 {
        self.kept.len() as u64
    }
}
