//! The acquisition's side: send raw samples, receive compensated increments.

use crate::clock::{Clock, monotonic_ns};
use crate::connect::{Options, absent, deadline, join_existing, until};
use crate::error::{ConnectError, permission};
use crate::loan::{CompensateError, InFlight, Loan, SendError, TransportError, transport};
use crate::peers::{depth_of, publisher_of};
use crate::pending::Pending;
use crate::resources::reserve;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::prelude::BackpressureStrategy;
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use iceoryx2::service::port_factory::publish_subscribe;
use isotherm_shared::stream::{ImuId, Ipc, IpcNode};
use isotherm_shared::wire::{CompensatedIncrement, RawSample};
use std::hash::{BuildHasher as _, RandomState};
use std::thread;
use std::time::{Duration, Instant};

/// How often a silent service is looked after while samples are unanswered, and after how many empty looks at the
/// stream the clock is read to find out.
const LOOK_NS: u64 = 5_000_000;
const EMPTY_LOOKS: u32 = 16;
/// After this long without the oldest answer its sample is sent once more, even to the same service; then after twice as
/// long, and so on. It costs a service that is merely stopped no more than a few places in its queue.
const SILENCE_NS: u64 = 1_000_000_000;
/// Pause before samples that others have overtaken are sent again once more.
const OVERTAKEN_NS: u64 = 100_000_000;
/// Samples that may be in the caller's hands, loaned and not sent yet.
const LOANS: usize = 4;

/// The one acquisition process of an IMU.
///
/// Samples go out without being copied and answers come back each **once and in the order of sending**. What is
/// unanswered is kept, at most [`depth`](Self::depth) samples; when the service is replaced by a new one, they are sent
/// again, so that a service that is killed and restarted loses nothing. The caller decides how long to wait.
///
/// Not `Send`: create it in the thread that uses it.
#[derive(Debug)]
pub struct Acquisition {
    imu: ImuId,
    session: u64,
    next_sequence: u64,
    pending: Pending,
    clock: Clock,
    recovery: Recovery,
    spare: Option<SampleMut<Ipc, RawSample, ()>>,
    publisher: Publisher<Ipc, RawSample, ()>,
    subscriber: Subscriber<Ipc, CompensatedIncrement, ()>,
    notifier: Notifier<Ipc>,
    increments: publish_subscribe::PortFactory<Ipc, CompensatedIncrement, ()>,
    _node: IpcNode,
}

/// Which service has been sent the unanswered samples, and when it was last looked after.
#[derive(Debug)]
struct Recovery {
    service: u128,
    empty_looks: u32,
    looked_ns: u64,
    /// Since when the oldest sample has been waiting without another being answered, as far as is known.
    silent_since_ns: u64,
    /// How long that may last before the oldest sample is sent again.
    patience_ns: u64,
    /// When samples that others had overtaken were last sent again.
    resent_ns: u64,
    /// Whether an answer has been handed out since the last look.
    progress: bool,
}

impl Acquisition {
    /// Connects as the acquisition of `imu`, waiting for the service if need be.
    ///
    /// # Errors
    /// What still stood in the way when the time-out of `options` had passed, or at once what waiting cannot mend.
    pub fn connect(imu: &ImuId, options: &Options) -> Result<Self, ConnectError> {
        let deadline = deadline(options.timeout);
        let node = until(deadline, || join_existing(&options.domain))?;
        let parts = until(deadline, || Self::attach(&node, imu, options))?;
        reserve(&options.domain)?;
        Ok(parts(node))
    }

    fn attach(
        node: &IpcNode,
        imu: &ImuId,
        options: &Options,
    ) -> Result<impl FnOnce(IpcNode) -> Self + use<>, ConnectError> {
        let open = |error| match error {
            PublishSubscribeOpenError::DoesNotExist => absent(node, &options.domain, imu),
            PublishSubscribeOpenError::InsufficientPermissions => permission(&options.domain),
            other => ConnectError::transport("opening the streams", other),
        };
        let raw = node.service_builder(&imu.raw()).publish_subscribe::<RawSample>().open().map_err(open)?;
        let increments =
            node.service_builder(&imu.increment()).publish_subscribe::<CompensatedIncrement>().open().map_err(open)?;
        let wake = node.service_builder(&imu.wake()).event().open();
        let wake = wake.map_err(|error| ConnectError::transport("opening the wake-up event", error))?;
        // The service creates its increment publisher last: with that it is ready.
        let service = publisher_of(&increments).ok_or_else(|| absent(node, &options.domain, imu))?.0;

        let publisher = raw.publisher_builder().max_loaned_samples(LOANS + 2);
        let publisher = publisher.backpressure_strategy(BackpressureStrategy::DiscardData).create();
        let publisher = publisher.map_err(|error| match error {
            PublisherCreateError::ExceedsMaxSupportedPublishers => {
                // A dead predecessor holds the place until it is cleaned away.
                node.try_cleanup_dead_nodes();
                ConnectError::Occupied { imu: imu.clone(), pid: publisher_of(&raw).and_then(|(_, pid)| pid) }
            }
            other => ConnectError::transport("creating the raw publisher", other),
        })?;
        let depth = depth_of(&raw, &increments);
        let subscriber = increments.subscriber_builder().buffer_size(depth).create();
        let subscriber = subscriber.map_err(|error| match error {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => {
                // Dead ones hold their places until they are cleaned away.
                node.try_cleanup_dead_nodes();
                ConnectError::no_room(imu, &increments)
            }
            other => ConnectError::transport("subscribing to the increment stream", other),
        })?;
        let notifier = wake.notifier_builder().create();
        let notifier = notifier.map_err(|error| ConnectError::transport("creating the notifier", error))?;
        let imu = imu.clone();
        Ok(move |node| Self {
            imu,
            session: random(),
            next_sequence: 0,
            pending: Pending::new(depth),
            clock: Clock::new(),
            recovery: Recovery {
                service,
                empty_looks: 0,
                looked_ns: 0,
                silent_since_ns: 0,
                patience_ns: SILENCE_NS,
                resent_ns: 0,
                progress: false,
            },
            spare: None,
            publisher,
            subscriber,
            notifier,
            increments,
            _node: node,
        })
    }

    /// The IMU.
    #[must_use]
    pub const fn imu(&self) -> &ImuId {
        &self.imu
    }

    /// The session that all samples carry, random for each connection.
    #[must_use]
    pub const fn session(&self) -> u64 {
        self.session
    }

    /// Begins a new session: the next sample may have any sequence.
    ///
    /// # Errors
    /// While samples are unanswered.
    pub fn begin_session(&mut self) -> Result<(), InFlight> {
        match self.in_flight() {
            0 => {
                self.session = random();
                self.next_sequence = 0;
                Ok(())
            }
            unanswered => Err(InFlight(unanswered)),
        }
    }

    /// The most samples that can be unanswered at once: the depth of the service's queue.
    #[must_use]
    pub fn depth(&self) -> usize {
        self.pending.depth()
    }

    /// Samples sent whose answers have not been received.
    #[must_use]
    pub fn in_flight(&self) -> usize {
        self.pending.len()
    }

    /// A sample to fill in, in shared memory. One is always kept ready, so this costs nothing after a send.
    ///
    /// # Errors
    /// If the caller holds too many already (4).
    #[inline]
    pub fn loan(&mut self) -> Result<Loan, TransportError> {
        let mut sample = match self.spare.take() {
            Some(sample) => sample,
            None => self.fresh()?,
        };
        let raw = sample.payload_mut();
        raw.session = self.session;
        raw.sequence = self.next_sequence;
        Ok(Loan(sample))
    }

    /// Sends a sample and wakes the service. Never waits and never copies the sample through the transport.
    ///
    /// `session` and `sent_ns` are set here. A recorder that has no room for its copy is no failure.
    ///
    /// # Errors
    /// [`SendError`], with the sample in it where it can still be used.
    #[inline]
    pub fn send(&mut self, mut sample: Loan) -> Result<(), SendError> {
        if self.pending.is_full() {
            return Err(SendError::Full(sample));
        }
        let Some(next_sequence) = sample.sequence.checked_add(1).filter(|next| *next > self.next_sequence) else {
            return Err(SendError::Sequence(sample));
        };
        sample.session = self.session;
        sample.sent_ns = self.clock.now();
        if self.pending.len() == 0 {
            self.recovery.silent_since_ns = sample.sent_ns;
            self.recovery.patience_ns = SILENCE_NS;
        }
        // Even if sending fails, for some of its receivers it may not have: no other sample gets this sequence.
        self.next_sequence = next_sequence;
        let copy = *sample;
        if let Err(error) = sample.0.send() {
            return Err(SendError::Transport(error.to_string()));
        }
        self.pending.push(copy);
        // Without a listener in need this costs nothing; if it fails, the service's bounded wait still finds the sample.
        let _ = self.notifier.notify();
        self.spare = self.fresh().ok();
        Ok(())
    }

    /// The answer to the oldest unanswered sample, or `None` if it has not come yet. Does not wait.
    ///
    /// While something is unanswered this also looks, about every 5 ms, whether the service has been replaced, and sends the
    /// unanswered samples again if so.
    ///
    /// # Errors
    /// If the transport fails.
    #[inline]
    pub fn receive(&mut self) -> Result<Option<CompensatedIncrement>, TransportError> {
        if let Some(answer) = self.pending.pop_answered() {
            self.recovery.progress = true;
            return Ok(Some(answer));
        }
        while let Some(sample) =
            self.subscriber.receive().map_err(|error| transport("receiving an increment", error))?
        {
            let answer = *sample;
            drop(sample);
            if answer.session == self.session && self.pending.accept(&answer) {
                self.recovery.progress = true;
                return Ok(Some(answer));
            }
        }
        self.recovery.empty_looks = self.recovery.empty_looks.wrapping_add(1);
        if self.pending.len() > 0 && self.recovery.empty_looks.is_multiple_of(EMPTY_LOOKS) {
            self.look_after_the_service()?;
        }
        Ok(None)
    }

    /// As [`receive`](Self::receive), waiting up to `timeout`: spinning for the first 100 us, then in short sleeps.
    ///
    /// # Errors
    /// If the transport fails.
    pub fn receive_timeout(&mut self, timeout: Duration) -> Result<Option<CompensatedIncrement>, TransportError> {
        const SPIN: Duration = Duration::from_micros(100);
        let started = Instant::now();
        loop {
            if let Some(answer) = self.receive()? {
                return Ok(Some(answer));
            }
            let waited = started.elapsed();
            if waited >= timeout {
                return Ok(None);
            }
            if waited < SPIN {
                core::hint::spin_loop();
            } else {
                thread::sleep(Duration::from_micros(20));
            }
        }
    }

    /// The round trip in one call: sends `sample` and waits up to `timeout` for its increment.
    ///
    /// Answers to samples sent earlier, whose callers have given up on them, are passed over.
    ///
    /// # Errors
    /// [`CompensateError`].
    pub fn compensate(&mut self, sample: Loan, timeout: Duration) -> Result<CompensatedIncrement, CompensateError> {
        let sequence = sample.sequence;
        // Makes room, and looks after the service, even if nobody else calls `receive`.
        while self.pending.is_full() && self.receive()?.is_some() {}
        if self.pending.is_full() {
            self.look_after_the_service()?;
        }
        self.send(sample)?;
        let started = Instant::now();
        loop {
            match self.receive_timeout(timeout.saturating_sub(started.elapsed()))? {
                Some(answer) if answer.sequence == sequence => return Ok(answer),
                Some(_) => {}
                None => return Err(CompensateError::Timeout),
            }
        }
    }

    #[inline]
    fn fresh(&self) -> Result<SampleMut<Ipc, RawSample, ()>, TransportError> {
        let sample = self.publisher.loan_uninit().map_err(|error| transport("loaning a raw sample", error))?;
        Ok(sample.write_payload(RawSample::default()))
    }

    /// Off the fast path: only while an answer is awaited, and at most every [`LOOK_NS`].
    #[cold]
    #[inline(never)]
    fn look_after_the_service(&mut self) -> Result<(), TransportError> {
        let now = self.clock.now();
        if now.saturating_sub(self.recovery.looked_ns) < LOOK_NS {
            return Ok(());
        }
        self.recovery.looked_ns = now;
        // As long as answers come there is nothing to find out; asking the transport allocates.
        if core::mem::take(&mut self.recovery.progress) {
            self.recovery.silent_since_ns = now;
            self.recovery.patience_ns = SILENCE_NS;
            return Ok(());
        }
        // A dead service stays listed until it is cleaned away, which its successor does before it takes the place.
        let Some((service, _)) = publisher_of(&self.increments) else { return Ok(()) };
        if service != self.recovery.service {
            // Those too that are answered and wait for their turn: the new service would take the next ones for a gap otherwise.
            self.send_again(self.pending.len(), true)?;
            self.recovery.service = service;
            self.recovery.silent_since_ns = now;
        } else if self.pending.overtaken() > 0 && now.saturating_sub(self.recovery.resent_ns) > OVERTAKEN_NS {
            // The service answers in order: what an answered sample has overtaken never reached it.
            self.recovery.resent_ns = now;
            self.send_again(self.pending.overtaken(), false)?;
        } else if now.saturating_sub(self.recovery.silent_since_ns) > self.recovery.patience_ns {
            self.recovery.silent_since_ns = now;
            self.recovery.patience_ns = self.recovery.patience_ns.saturating_mul(2);
            self.send_again(1, false)?;
        }
        Ok(())
    }

    /// Sends the oldest samples once more, as they were; those without an answer, or `answered` ones too.
    fn send_again(&mut self, count: usize, answered: bool) -> Result<(), TransportError> {
        for sample in self.pending.samples(answered).take(count) {
            let mut copy = match self.spare.take() {
                Some(spare) => spare,
                None => self.fresh()?,
            };
            *copy.payload_mut() = *sample;
            copy.send().map_err(|error| transport("sending a raw sample again", error))?;
        }
        let _ = self.notifier.notify();
        Ok(())
    }
}

/// A number that no other session is likely to have; the standard library's hash keys are random in every process.
fn random() -> u64 {
    RandomState::new().hash_one(monotonic_ns())
}
