//! The acquisition's side: send raw samples, receive compensated increments.

pub(crate) mod answers;
mod exchange;
mod joining;
mod keeping;
mod lag;
mod leaving;
mod ports;
mod readings;

pub use lag::LagAccess;

use crate::clock::{Clock, monotonic_ns};
use crate::closing::{self, ClosingNote};
use crate::connect::{Options, deadline, retry_until};
use crate::error::ConnectError;
use crate::helper::Helper;
use crate::kept::Kept;
use crate::lag::AcquisitionLag;
use crate::loan::{InFlight, Loan, LoanMergeError, LoanPlace, SendError, TransportError, transport};
use crate::process::Process;
use crate::source_pulses::SamplePulses;
use crate::table_watch::TableWatch;
use crate::transport::ports::Payload as _;
use core::mem::{self, ManuallyDrop};
use isotherm_shared::names::{Domain, ImuId};
use isotherm_shared::protocol::{AcquisitionState, Refusal, queue_depth};
use isotherm_shared::wire::{CompensatedIncrement, RawSample, device};
use joining::{Answer, Question, start_helper};
use ports::AcquisitionPorts;
use std::hash::{BuildHasher as _, RandomState};
use std::rc::Rc;

/// Increments that [`Acquisition::exchange`] returns at once, at most.
const MOST_EXCHANGED: usize = 512;
/// After this silence of a service that lives the acquisition joins the streams anew; then after twice as long, and so
/// on \[ns\].
const REJOIN_NS: u64 = 2_000_000_000;

/// The one acquisition process of an IMU.
///
/// Samples are sent without a copy, and each answer is received **once and in the order of sending**. Copies of the
/// unanswered samples, at most [`depth`](Self::depth), are kept and sent again when a new service replaces the old one,
/// so a service that is killed and restarted loses no sample. The caller decides how long to wait.
///
/// Not `Send`: create it in the thread that uses it.
///
/// # What it is used for
/// * Serve a control period: [`loan`](Self::loan) a sample, fill it in, [`exchange`](Self::exchange) it.
/// * Give temperature as it is measured: [`lag`](Self::lag). Turn readings in m/s2 and rad/s into pulses:
///   [`fill`](Self::fill).
/// * Warm the way of the next sample: [`prepare`](Self::prepare).
/// * Give a loan back that stands for no period, or sum two: [`cancel`](Self::cancel), [`merge`](Self::merge).
/// * Send a recording: [`loan_record`](Self::loan_record), [`complete`](Self::complete),
///   [`begin_session`](Self::begin_session).
/// * See what was lost or waits: [`lost`](Self::lost), [`kept`](Self::kept), [`in_flight`](Self::in_flight),
///   [`closing`](Self::closing), [`close`](Self::close).
/// * Send and receive by itself, with several samples in flight: [`send`](Self::send), [`receive`](Self::receive),
///   [`receive_timeout`](Self::receive_timeout), [`keep`](Self::keep), [`send_kept`](Self::send_kept),
///   [`is_full`](Self::is_full), [`depth`](Self::depth).
/// * Send one sample now and then: [`compensate`](Self::compensate), [`late`](Self::late).
#[derive(Debug)]
pub struct Acquisition {
    imu: ImuId,
    domain: Domain,
    /// Number of the device, for every sample.
    device: u64,
    state: AcquisitionState<RawSample, CompensatedIncrement>,
    clock: Clock,
    lag: AcquisitionLag,
    watch: TableWatch,
    /// `None` if nothing is known of them.
    pulses: Option<SamplePulses>,
    /// Control periods that wait to be sent.
    kept: Kept,
    /// Whether any of them was dropped since the line was last empty.
    is_line_full: bool,
    /// Whether [`prepare`](Self::prepare) has been called since the last sample.
    prepared: bool,
    /// Whether it was called before the last sample: then returning the increment and loaning the next sample are left
    /// to the next call, so that the samples of other IMUs, sent at the same moment, do not wait for it.
    leaves_to_prepare: bool,
    /// Increments that [`exchange`](Self::exchange) has returned last.
    exchanged: Vec<CompensatedIncrement>,
    /// When the helper thread looks next for what may have cut the acquisition off \[ns\].
    next_look_ns: u64,
    /// After this silence of a service that lives the streams are joined anew \[ns\].
    rejoin_after_ns: u64,
    /// It is cut off from the streams, and leaves its ports: until then \[ns\] when nothing is on loan from them.
    leaves_by_ns: Option<u64>,
    /// `None` while it is cut off from the streams.
    ports: Option<AcquisitionPorts>,
    helper: Helper<Question, Answer>,
    process: Process,
}

impl Acquisition {
    /// Connects as the acquisition of `imu`, waiting for the service if necessary.
    ///
    /// # Errors
    /// The last error when the time-out of `options` has passed; at once an error that waiting cannot resolve.
    pub fn connect(imu: &ImuId, options: &Options) -> Result<Self, ConnectError> {
        let deadline = deadline(options.timeout);
        let (domain, mut node) = (&options.domain, None);
        let ports = retry_until(deadline, || AcquisitionPorts::attach(&mut node, domain, imu))?;
        let (service, depth) = ports.service().ok_or_else(|| ConnectError::NoService(domain.name().to_owned()))?;
        let mut acquisition = Self {
            imu: imu.clone(),
            domain: domain.clone(),
            device: options.serial.as_deref().map_or(0, device),
            state: AcquisitionState::new(random(), depth, queue_depth(depth), service),
            clock: Clock::new(),
            lag: AcquisitionLag::new(options.lag),
            watch: TableWatch::default(),
            pulses: SamplePulses::new(options.resolution, options.pulses),
            kept: Kept::new(options.kept),
            is_line_full: false,
            prepared: false,
            leaves_to_prepare: false,
            exchanged: Vec::with_capacity(MOST_EXCHANGED),
            next_look_ns: 0,
            rejoin_after_ns: REJOIN_NS,
            leaves_by_ns: None,
            ports: Some(ports),
            helper: start_helper(imu, domain)?,
            process: Process::current(),
        };
        acquisition.settle()?;
        Ok(acquisition)
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
            return Err(InFlight(self.state.in_flight() + self.kept.len()));
        }
        self.state.begin_session(random()).map_err(InFlight)?;
        self.lag.reset();
        self.pulses.iter_mut().for_each(SamplePulses::reset);
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

    /// Whether a sample would have to wait: [`depth`](Self::depth) samples are unanswered, or samples are
    /// [kept](Self::keep), which go first, or, after several restarts of the service within a short time, its queue may
    /// still be full of samples that were sent again.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.state.is_full() || !self.kept.is_empty()
    }

    /// The lag of the temperatures, for the functions that inform it of them: its readings, or one that was saved.
    pub fn lag(&mut self) -> LagAccess<'_> {
        self.renew();
        LagAccess { lag: &mut self.lag }
    }

    /// Completes a copy of a sample as [`send`](Self::send) would now: session, and, where they are 0, `device` and
    /// `lag_ns` with the lagged temperature. What is recorded so replays to the increment of the service.
    pub fn complete(&self, sample: &mut RawSample) {
        sample.session = self.state.session();
        if sample.device == 0 {
            sample.device = self.device;
        }
        self.lag.fill(sample);
        self.judge(sample);
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
            // A child of a fork has no part in the memory of its parent's samples.
            Some(ports) if self.process.is_current() => {
                Ok(LoanPlace::Shared { sample: ports.take_spare()?, generation: Rc::clone(&ports.generation) })
            }
            _ => Ok(LoanPlace::Private(Box::default())),
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
    /// is lost, and no sequence is left out. If the sum is dropped, that is one sequence, whatever it holds. This is
    /// for devices that sum by themselves: periods for which the service has no room wait as they are
    /// ([`exchange`](Self::exchange), [`keep`](Self::keep)).
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

    /// Control periods, of all sessions of this connection, that have a sequence and are gone: loans that were dropped,
    /// sequences that were left out, periods for which the waiting line had no room, and samples whose sending has
    /// failed. A sample that is on loan counts until it is sent or kept. What waits is not lost: see
    /// [`kept`](Self::kept).
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.state.lost()
    }

    /// Leaves the streams, and returns what was lost. If anything was, it is logged, and the service keeps it in its
    /// status: a loss with no sample after it is seen too. Dropping the acquisition does the same.
    pub fn close(self) -> ClosingNote {
        self.closing()
    }

    /// What [`close`](Self::close) would return now.
    #[must_use]
    pub fn closing(&self) -> ClosingNote {
        ClosingNote { lost: self.lost() + self.kept(), unanswered: self.state.in_flight() as u64 }
    }

    /// Sends a sample and wakes the service, after all that is [kept](Self::keep). Never waits, and the transport never
    /// copies the sample.
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
    pub fn send(&mut self, sample: Loan) -> Result<(), SendError> {
        if !self.kept.is_empty() {
            // What the transport could not send is unanswered, and is sent again.
            let _ = self.send_kept();
        }
        // Shared memory: read once.
        let sequence = sample.sequence;
        match self.state.may_send(sequence) {
            // What is kept goes first.
            Ok(()) if self.kept.is_empty() => {}
            Ok(()) | Err(Refusal::Full) => return Err(SendError::Full(sample)),
            Err(Refusal::Sequence) => return Err(SendError::Sequence(sample)),
        }
        self.send_now(sample, sequence).map_err(|cause| {
            self.state.send_failed();
            SendError::Transport(cause)
        })
    }

    /// Sends a sample that may be sent. Where the transport fails, it counts as unanswered.
    #[inline]
    fn send_now(&mut self, mut sample: Loan, sequence: u64) -> Result<(), String> {
        // Read first: the processor goes on with the rest meanwhile.
        let now = self.clock.now();
        // Each is written only where it differs: the copy below would wait until what has just been written is in the
        // cache.
        if sample.session != self.state.session() {
            sample.session = self.state.session();
        }
        if sample.device == 0 && self.device != 0 {
            sample.device = self.device;
        }
        self.lag.fill(&mut sample);
        self.judge(&mut sample);
        self.state.take(sequence);
        let copy = self.state.send(sequence, &sample, now);
        (copy.sent_ns, sample.sent_ns) = (now, now);
        let Some(ports) = &mut self.ports else { return Ok(()) };
        match sample.place {
            LoanPlace::Shared { sample, generation } if Rc::ptr_eq(&generation, &ports.generation) => {
                RawSample::publish(sample).map(drop).map_err(|error| error.to_string())
            }
            place => copy_into(ports, &Loan { place, number: None }).map_err(|error| error.to_string()),
        }?;
        // Cheap if the service does not sleep. If it fails, the service finds the sample at the end of its bounded
        // wait.
        ports.wake();
        self.leaves_to_prepare = mem::take(&mut self.prepared);
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
        let (clock, lag) = (&mut self.clock, &mut self.lag);
        ports.rehearsal.go(&CompensatedIncrement::default(), |_, raw| {
            *raw = RawSample::default();
            lag.fill(raw);
            raw.sent_ns = clock.now();
        });
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
        self.take_answer(now);
        self.look_for_loss(now);
        let Some(ports) = &mut self.ports else { return Ok(()) };
        // A dead service stays listed until its successor cleans it up, which it does before it creates its own
        // publisher.
        let Some((service, depth)) = ports.service() else { return Ok(()) };
        let Some(resend) = self.state.resend_due(service, now) else { return Ok(()) };
        if !self.state.is_known(service) {
            self.kept.put_back(&self.state.set_depth(depth, queue_depth(depth)));
        }
        for sample in self.state.samples(resend) {
            copy_into(ports, sample)?;
        }
        self.state.resent(resend, service, now);
        ports.wake();
        Ok(())
    }
}

/// Sends a sample that is not in the memory of these ports.
#[cold]
fn copy_into(ports: &mut AcquisitionPorts, sample: &RawSample) -> Result<(), TransportError> {
    let mut copy = ports.take_spare()?;
    *copy.payload_mut() = *sample;
    RawSample::publish(copy).map(drop).map_err(|error| transport("sending a raw sample", error))
}

impl Drop for Acquisition {
    fn drop(&mut self) {
        if !self.process.is_current() {
            // Only the parent may leave the streams.
            let _ = ManuallyDrop::new(self.ports.take());
            return;
        }
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
