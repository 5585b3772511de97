//! An acquisition's waiting line: what is kept while the service has no room, or is away, and sent when it has.

use super::Acquisition;
use crate::loan::{Loan, SendError, TransportError, transport};
use crate::transport::ports::Payload as _;
use crate::warning::warn;
use isotherm_shared::wire::RawSample;

impl Acquisition {
    /// Keeps a control period that [`send`](Self::send) or [`compensate`](Self::compensate) has handed back, or any
    /// other: it waits in private memory until [`send_kept`](Self::send_kept) sends it. The loan is free again.
    ///
    /// Periods are summed ([`RawSample::merge`](crate::RawSample::merge)) while a sum fits; then another sum begins. It
    /// also begins where a sum would hide something: another unit, a missing interval, temperature that is not finite
    /// on one side, time that is missing between the two. Under a table of readings a sum has 64 nominal intervals at
    /// most, so that it is not flagged [`INTERVAL_NOT_NOMINAL`](isotherm_shared::wire::Flags::INTERVAL_NOT_NOMINAL).
    /// Where the table is not known, since [`LagOption::Service`](crate::LagOption::Service) was not given or the table
    /// has been replaced, it has 64 periods. Only the last loan is added to a sum, since its sequence can be given
    /// back; another one, and a [record](Self::loan_record), waits by itself. At most [`MOST_KEPT`](crate::MOST_KEPT)
    /// sums wait. Beyond that the oldest is dropped with all its periods, which count as [lost](Self::lost), and as
    /// many sequences are left out: a gap for every reader.
    ///
    /// Nothing overtakes what is kept: `send` and `compensate` hand later samples back ([`SendError::Full`]) until the
    /// line is empty, and those are kept too. The lagged temperature is that of this moment. It allocates nothing.
    ///
    /// ```no_run
    /// # use isotherm_client::{Acquisition, CompensateError, Loan, SendError};
    /// # use std::time::Duration;
    /// # fn control_period(acquisition: &mut Acquisition, sample: Loan) -> Result<(), Box<dyn std::error::Error>> {
    /// acquisition.send_kept()?; // what waits goes first
    /// match acquisition.compensate(sample, Duration::from_millis(1)) {
    ///     Ok(increment) => println!("{:?} m/s", increment.velocity_increment),
    ///     Err(CompensateError::Timeout) => {} // it comes from `receive`
    ///     Err(CompensateError::Send(SendError::Full(sample))) => acquisition.keep(sample)?,
    ///     Err(other) => return Err(other.into()),
    /// }
    /// while let Some(increment) = acquisition.receive()? {
    ///     println!("{:?} m/s, late", increment.velocity_increment);
    /// }
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`SendError::Sequence`] if its sequence is not above the last that was sent or kept, as that of one that was
    /// loaned before sums were dropped; the sample is handed back.
    pub fn keep(&mut self, sample: Loan) -> Result<(), SendError> {
        // Shared memory: read once.
        let mut raw = *sample;
        let is_own = sample.number == Some((self.state.session(), raw.sequence));
        raw.session = self.state.session();
        if raw.device == 0 {
            raw.device = self.device;
        }
        self.lag.fill(&mut raw);
        let before = self.kept.dropped();
        if self.kept.take(&mut self.state, raw, is_own, self.lag.ceiling()).is_err() {
            return Err(SendError::Sequence(sample));
        }
        if before == 0 && self.kept.dropped() > 0 {
            warn(
                &self.imu,
                "the service takes nothing, and no more fits into memory: the oldest control periods are lost",
            );
        }
        Ok(())
    }

    /// Sends what is [kept](Self::keep), oldest first, as far as the service takes it now: until
    /// [`depth`](Self::depth) samples are unanswered, and after an outage no faster than readers and recorders take it
    /// (256 samples at once, then 16 in a millisecond). Never waits. Call it in each control period, before the new
    /// sample is sent, and take the increments with [`receive`](Self::receive). Without anything kept it does nothing.
    ///
    /// # Errors
    /// If the transport fails. The sum that was being sent is then lost with all its periods, if there is one less
    /// [kept](Self::kept); the others go on to wait.
    pub fn send_kept(&mut self) -> Result<(), TransportError> {
        if self.kept.is_empty() {
            return Ok(());
        }
        let sent = self.send_sums();
        if let Some(ports) = &mut self.ports {
            // As in `send`.
            ports.wake();
            if ports.spare.is_none() {
                ports.spare = ports.loan().ok();
            }
        }
        sent
    }

    fn send_sums(&mut self) -> Result<(), TransportError> {
        let now = self.clock.now();
        while !self.kept.is_empty() && !self.state.is_full() && self.kept.pace.allows(now) {
            // Before the sum is taken out: it stays if there is no place.
            let place = self.ports.as_mut().map(|ports| ports.take_spare()).transpose()?;
            let Some(mut sum) = self.kept.next(&mut self.state) else { break };
            sum.raw.sent_ns = now;
            self.state.send(sum.raw.sequence, &sum.raw, now);
            let Some(mut place) = place else { continue };
            *place.payload_mut() = sum.raw;
            if let Err(error) = RawSample::publish(place) {
                self.state.send_failed();
                self.kept.failed(&mut self.state, &sum);
                return Err(transport("sending a kept sample", error));
            }
        }
        Ok(())
    }

    /// Control periods that are [kept](Self::keep).
    #[must_use]
    pub const fn kept(&self) -> u64 {
        self.kept.periods()
    }
}
