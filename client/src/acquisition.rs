//! The acquisition's side: send raw samples, receive compensated increments.

pub(crate) mod answers;
mod keeping;
mod lag;
mod ports;

pub use lag::LagAccess;

use crate::clock::{Clock, monotonic_ns};
use crate::closing::{self, ClosingNote};
use crate::connect::{Options, deadline, join_existing, retry_until};
use crate::error::ConnectError;
use crate::kept::{Kept, MOST_KEPT};
use crate::lag::AcquisitionLag;
use crate::loan::{InFlight, Loan, LoanMergeError, LoanPlace, SendError, TransportError, transport};
use crate::loss::Loss;
use crate::peers::{publisher_is_alive, publisher_of};
use crate::rehearsal;
use crate::resources::reserve;
use crate::transport::ports::Payload as _;
use crate::transport::stream::IpcNode;
use crate::warning::warn;
use isotherm_shared::names::{Domain, ImuId};
use isotherm_shared::protocol::{AcquisitionState, Refusal, queue_depth};
use isotherm_shared::wire::{CompensatedIncrement, RawSample, device};
use ports::AcquisitionPorts;
use std::hash::{BuildHasher as _, RandomState};
use std::time::{Duration, Instant};

/// After this silence the acquisition looks whether it was cut off from the service, and then again after the same time
/// \[ns\].
const LOOK_NS: u64 = 250_000_000;
/// After this silence of a service that lives the acquisition joins the streams anew; then after twice as long, and so
/// on \[ns\].
const REJOIN_NS: u64 = 2_000_000_000;
/// The longest silence before it does so \[ns\].
const MAX_REJOIN_NS: u64 = 64_000_000_000;
/// Pause between two attempts to join the streams anew \[ns\].
const JOIN_PAUSE_NS: u64 = 20_000_000;

/// The one acquisition process of an IMU.
///
/// Samples are sent without a copy, and each answer is received **once and in the order of sending**. Copies of the
/// unanswered samples, at most [`depth`](Self::depth), are kept and sent again when a new service replaces the old one,
/// so a service that is killed and restarted loses no sample. The caller decides how long to wait.
///
/// Not `Send`: create it in the thread that uses it.
#[derive(Debug)]
pub struct Acquisition {
    imu: ImuId,
    domain: Domain,
    /// Number of the device, for every sample.
    device: u64,
    state: AcquisitionState<RawSample, CompensatedIncrement>,
    clock: Clock,
    lag: AcquisitionLag,
    /// Control periods that wait to be sent.
    kept: Kept,
    /// Whether [`prepare`](Self::prepare) has been called since the last sample.
    prepared: bool,
    /// Whether it was called before the last sample: then returning the increment and loaning the next sample are left
    /// to the next call, so that the samples of other IMUs, sent at the same moment, do not wait for it.
    leaves_to_prepare: bool,
    /// How often the streams were joined.
    joins: u32,
    /// The next look at what may have cut it off, or the next attempt to join \[ns\].
    next_look_ns: u64,
    /// After this silence of a service that lives the streams are joined anew \[ns\].
    rejoin_after_ns: u64,
    /// `None` while it is cut off from the streams. They are dropped before the node.
    ports: Option<AcquisitionPorts>,
    /// `None` if the domain has to be joined anew.
    node: Option<IpcNode>,
}

impl Acquisition {
    /// Connects as the acquisition of `imu`, waiting for the service if necessary.
    ///
    /// # Errors
    /// The last error when the time-out of `options` has passed; at once an error that waiting cannot resolve.
    pub fn connect(imu: &ImuId, options: &Options) -> Result<Self, ConnectError> {
        let deadline = deadline(options.timeout);
        let domain = &options.domain;
        let node = retry_until(deadline, || join_existing(domain))?;
        let (mut ports, service) = retry_until(deadline, || AcquisitionPorts::attach(&node, domain, imu))?;
        // At once, and again with the streams of rehearsals, whose places it may have to wait for.
        reserve(domain)?;
        ports.rehearsal = rehearsal::of_acquisition(&node, imu, deadline)?;
        reserve(domain)?;
        let mut lag = AcquisitionLag::new(options.lag);
        lag.connect(&node, domain, imu);
        Ok(Self {
            imu: imu.clone(),
            domain: domain.clone(),
            device: options.serial.as_deref().map_or(0, device),
            state: AcquisitionState::new(random(), service.depth, queue_depth(service.depth), service.id),
            clock: Clock::new(),
            lag,
            kept: Kept::new(MOST_KEPT),
            prepared: false,
            leaves_to_prepare: false,
            joins: 0,
            next_look_ns: 0,
            rejoin_after_ns: REJOIN_NS,
            ports: Some(ports),
            node: Some(node),
        })
    }

    /// The IMU.
    #[must_use]
    pub const fn imu(&self) -> &ImuId {
        &self.imu
    }

    /// The session of all samples; a new random number for each connection.
    #[must_use]
    pub const fn session(&self) -> u64 {
        self.state.session()
    }

    /// Begins a new session: the next sample may have any sequence. What the temperatures have been is not known then,
    /// unless the lag is [restored](LagAccess::restore), or the IMU said to be [soaked](LagAccess::soaked), after this.
    ///
    /// # Errors
    /// If samples are unanswered, or [kept](Self::keep).
    pub fn begin_session(&mut self) -> Result<(), InFlight> {
        if !self.kept.is_empty() {
            return Err(InFlight(self.state.in_flight() + self.kept.sums()));
        }
        self.state.begin_session(random()).map_err(InFlight)?;
        self.lag.reset();
        Ok(())
    }

    /// The most samples that can be unanswered at once.
    #[must_use]
    pub fn depth(&self) -> usize {
        self.state.depth()
    }

    /// Samples that have been sent and whose answers have not been received.
    #[must_use]
    pub fn in_flight(&self) -> usize {
        self.state.in_flight()
    }

    /// Whether [`send`](Self::send) would hand a sample back: [`depth`](Self::depth) samples are unanswered, or samples
    /// are [kept](Self::keep), which go first, or, after several restarts of the service within a short time, its queue
    /// may still be full of samples that were sent again.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.state.is_full() || !self.kept.is_empty()
    }

    /// The lag of the temperatures, for the functions that inform it of them: its readings, or one that was saved.
    pub fn lag(&mut self) -> LagAccess<'_> {
        let Self { lag, node, domain, imu, .. } = self;
        LagAccess { lag, node: node.as_ref(), domain, imu }
    }

    /// Completes a copy of a sample as [`send`](Self::send) would now: session, and, where they are 0, `device` and
    /// `lag_ns` with the lagged temperature. What is recorded so replays to the increment of the service.
    pub fn complete(&self, sample: &mut RawSample) {
        sample.session = self.state.session();
        if sample.device == 0 {
            sample.device = self.device;
        }
        self.lag.fill(sample);
    }

    /// Loans a sample in shared memory, to be filled in: [`RawSample::default`] with its session and sequence, so every
    /// temperature is NaN. It is loaned already after a send or [`prepare`](Self::prepare), so this call is cheap.
    ///
    /// Its sequence is one above the highest that was loaned or sent in the session. So a loan that is dropped leaves
    /// its sequence out, and the service flags the gap; [`cancel`](Self::cancel) gives back one that stands for no
    /// control period.
    ///
    /// # Errors
    /// If the caller has 4 samples on loan already.
    #[inline]
    pub fn loan(&mut self) -> Result<Loan, TransportError> {
        let place = self.take_place()?;
        let (session, sequence) = (self.state.session(), self.state.loan());
        let mut loan = Loan { place, number: Some((session, sequence)) };
        (loan.session, loan.sequence) = (session, sequence);
        Ok(loan)
    }

    /// Loans a sample with the content of `record`, as one of a recording, in this session. It keeps the record's
    /// sequence, and takes no number of its own.
    ///
    /// # Errors
    /// As [`loan`](Self::loan).
    pub fn loan_record(&mut self, record: &RawSample) -> Result<Loan, TransportError> {
        let mut loan = Loan { place: self.take_place()?, number: None };
        *loan = RawSample { session: self.state.session(), sent_ns: 0, ..*record };
        Ok(loan)
    }

    #[inline]
    fn take_place(&mut self) -> Result<LoanPlace, TransportError> {
        match &mut self.ports {
            Some(ports) => Ok(LoanPlace::Shared { sample: ports.take_spare()?, joins: self.joins }),
            None => Ok(LoanPlace::Private(Box::default())),
        }
    }

    /// Gives a loan back that stands for no control period, as at the end of a recording, and takes its sequence back.
    /// Only that of the last loan: the sequence of an earlier one stays left out.
    pub fn cancel(&mut self, sample: Loan) {
        if let Some((session, number)) = sample.number
            && session == self.state.session()
        {
            self.state.cancel(number);
        }
    }

    /// Adds the next control period to a sample ([`RawSample::merge`]) and cancels its loan: no velocity and no angle
    /// is lost, and no sequence is left out. If the sum is dropped, that is one sequence, whatever it holds. For a
    /// service that has no room use [`keep`](Self::keep), which begins another sum where one is full, and counts all
    /// periods.
    ///
    /// # Errors
    /// [`LoanMergeError`] when a sum would overflow.
    pub fn merge(&mut self, sample: &mut Loan, later: Loan) -> Result<(), LoanMergeError> {
        match sample.merge(&later) {
            Ok(()) => {
                self.cancel(later);
                Ok(())
            }
            Err(error) => Err(LoanMergeError { error, later }),
        }
    }

    /// Control periods, of all sessions of this connection, that have a sequence and were not sent: see
    /// [`ClosingNote::lost`]. A sample that is on loan, and each period that is [kept](Self::keep), counts until it is
    /// sent.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.state.lost().saturating_add(self.kept.unnumbered())
    }

    /// Leaves the streams, and returns what was lost. If anything was, it is logged, and the service keeps it in its
    /// status: a loss with no sample after it is seen too. Dropping the acquisition does the same.
    pub fn close(self) -> ClosingNote {
        self.closing()
    }

    /// What [`close`](Self::close) would return now.
    #[must_use]
    pub fn closing(&self) -> ClosingNote {
        ClosingNote { lost: self.lost(), unanswered: self.state.in_flight() as u64 }
    }

    /// Sends a sample and wakes the service. Never waits, and the transport never copies the sample.
    ///
    /// While the acquisition is cut off from the service, since the shared memory was removed, the sample counts as
    /// sent and unanswered, and is sent when it has joined again.
    ///
    /// Sets `session` and `sent_ns`; also `device`, and `lag_ns` with the lagged temperature, where they are 0. A
    /// recorder whose queue is full is not an error.
    ///
    /// # Errors
    /// [`SendError`], which contains the sample if it can still be used.
    #[inline]
    pub fn send(&mut self, mut sample: Loan) -> Result<(), SendError> {
        // Read first: the processor goes on with the rest meanwhile.
        let now = self.clock.now();
        // Shared memory: read once.
        let sequence = sample.sequence;
        match self.state.may_send(sequence) {
            // What is kept goes first.
            Ok(()) if self.kept.is_empty() => {}
            Ok(()) | Err(Refusal::Full) => return Err(SendError::Full(sample)),
            Err(Refusal::Sequence) => return Err(SendError::Sequence(sample)),
        }
        // Each is written only where it differs: the copy below would wait until what has just been written is in the
        // cache.
        if sample.session != self.state.session() {
            sample.session = self.state.session();
        }
        if sample.device == 0 && self.device != 0 {
            sample.device = self.device;
        }
        self.lag.fill(&mut sample);
        let kept = self.state.send(sequence, &sample, now);
        (kept.sent_ns, sample.sent_ns) = (now, now);
        let Some(ports) = &mut self.ports else { return Ok(()) };
        let sent = match sample.place {
            LoanPlace::Shared { sample, joins } if joins == self.joins => {
                RawSample::publish(sample).map(drop).map_err(|error| error.to_string())
            }
            place => copy_into(ports, &Loan { place, number: None }),
        };
        if let Err(error) = sent {
            self.state.send_failed();
            return Err(SendError::Transport(error));
        }
        // Cheap if the service does not sleep. If it fails, the service finds the sample at the end of its bounded
        // wait.
        ports.wake();
        self.leaves_to_prepare = core::mem::take(&mut self.prepared);
        if !self.leaves_to_prepare {
            ports.spare = ports.loan().ok();
        }
        Ok(())
    }

    /// Goes through the motions of sending a sample and receiving its increment, so that the next sample finds its way
    /// warm. Nobody else sees anything of it.
    ///
    /// Call it while you wait for the end of a control period, some tens of microseconds before it. It takes about a
    /// microsecond, in cold caches some ten, allocates nothing and makes no system call. A sample that is ready
    /// meanwhile waits for its end. If the service has been replaced or a reader has come since the last sample, it is
    /// connected now and not in [`send`](Self::send), with memory and system calls.
    pub fn prepare(&mut self) {
        self.prepared = true;
        let Some(ports) = &mut self.ports else { return };
        ports.read = None;
        if ports.spare.is_none() {
            ports.spare = ports.loan().ok();
        }
        if let Some(spare) = &mut ports.spare {
            *spare.payload_mut() = RawSample::default();
        }
        if let Some(rehearsal) = &mut ports.rehearsal {
            let (clock, lag) = (&mut self.clock, &mut self.lag);
            rehearsal.go(&CompensatedIncrement::default(), |_, raw| {
                *raw = RawSample::default();
                lag.fill(raw);
                raw.sent_ns = clock.now();
            });
        }
        ports.connect();
    }

    /// Sends samples again if the protocol says so, and joins the streams anew if they are lost. Called only while
    /// samples are unanswered.
    #[cold]
    #[inline(never)]
    fn check_service(&mut self) -> Result<(), TransportError> {
        let now = self.clock.now();
        if !self.state.check_due(now) {
            return Ok(());
        }
        self.check_ports(now);
        let Some(ports) = &mut self.ports else { return Ok(()) };
        // A dead service stays listed until its successor cleans it up, which it does before it creates its own
        // publisher.
        let Some((service, _)) = publisher_of(&ports.increments) else { return Ok(()) };
        let Some(resend) = self.state.resend_due(service, now) else { return Ok(()) };
        for sample in self.state.samples(resend) {
            let mut copy = ports.take_spare()?;
            *copy.payload_mut() = *sample;
            RawSample::publish(copy).map_err(|error| transport("sending a raw sample again", error))?;
        }
        self.state.resent(resend, service, now);
        ports.wake();
        Ok(())
    }

    /// Leaves streams that are lost, and joins them anew as soon as a service is there.
    fn check_ports(&mut self, now: u64) {
        let silence = self.state.silence_ns(now);
        if silence < LOOK_NS {
            self.rejoin_after_ns = REJOIN_NS;
        }
        if now < self.next_look_ns || silence < LOOK_NS && self.ports.is_some() {
            return;
        }
        self.next_look_ns = now + LOOK_NS;
        if let Some(ports) = &self.ports {
            let silent = |acquisition: &Self| {
                let lives = || publisher_is_alive(&acquisition.domain, &ports.increments).then_some(());
                let long = silence >= acquisition.rejoin_after_ns;
                long.then(lives)?.map(|()| Loss::Silence(Duration::from_nanos(silence)))
            };
            let Some(loss) = ports.find_loss(&self.domain).or_else(|| silent(self)) else { return };
            self.leave(&loss);
        }
        self.next_look_ns = now + JOIN_PAUSE_NS;
        self.rejoin(now);
    }

    /// Gives up the ports, and after a removal the membership of the domain. Samples that are unanswered stay.
    fn leave(&mut self, loss: &Loss) {
        warn(&self.imu, format_args!("cut off from the service: {loss}; joining the streams again"));
        self.rejoin_after_ns = (2 * self.rejoin_after_ns).min(MAX_REJOIN_NS);
        self.ports = None;
        if matches!(loss, Loss::Removed(_)) {
            self.node = None;
        }
    }

    /// Tries to join the streams. Everything that is unanswered will be sent again.
    fn rejoin(&mut self, now: u64) {
        let node = self.node.take().or_else(|| join_existing(&self.domain).ok());
        let attached = node.as_ref().and_then(|node| AcquisitionPorts::attach(node, &self.domain, &self.imu).ok());
        if let (Some(node), Some((ports, _))) = (&node, attached) {
            let ports = self.ports.insert(ports);
            let reserved = reserve(&self.domain).and_then(|()| {
                ports.rehearsal = rehearsal::of_acquisition(node, &self.imu, Instant::now())?;
                reserve(&self.domain)
            });
            if let Err(error) = reserved {
                warn(&self.imu, format_args!("joining the streams again: {error}"));
            }
            self.joins += 1;
            self.state.rejoined(now);
            let unanswered = self.state.in_flight();
            warn(&self.imu, format_args!("the streams are joined again, with {unanswered} samples unanswered"));
        }
        self.node = node;
    }
}

/// Sends a sample that is not in the memory of these ports.
#[cold]
fn copy_into(ports: &mut AcquisitionPorts, sample: &RawSample) -> Result<(), String> {
    let mut copy = ports.take_spare().map_err(|error| error.to_string())?;
    *copy.payload_mut() = *sample;
    RawSample::publish(copy).map(drop).map_err(|error| error.to_string())
}

impl Drop for Acquisition {
    fn drop(&mut self) {
        let closing = self.closing();
        if closing == ClosingNote::default() {
            return;
        }
        let ClosingNote { lost, unanswered } = closing;
        tracing::warn!(imu = %self.imu, lost, unanswered, "the acquisition closes with control periods lost or unanswered");
        if let Err(error) = closing::write(&self.domain, &self.imu, self.session(), closing) {
            tracing::warn!(imu = %self.imu, "reporting to the service what was lost: {error}");
        }
    }
}

/// A random number, for a session. The standard library's hash keys are random in every process.
fn random() -> u64 {
    RandomState::new().hash_one(monotonic_ns())
}
