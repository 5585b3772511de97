//! Reading the streams of an IMU: for navigation, loggers and recorders.

use crate::connect::{Options, deadline, join_existing, retry_until, unopened};
use crate::error::ConnectError;
use crate::objects::refuse_foreign;
use crate::resources::reserve;
use core::fmt;
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::prelude::{ServiceName, ZeroCopySend};
use isotherm_shared::protocol::ReaderState;
use isotherm_shared::stream::{Domain, ImuId, Ipc, IpcNode};
use isotherm_shared::wire::{CompensatedIncrement, RawSample};
use std::time::{Duration, Instant};

/// Pause between two attempts to find the service.
const RETRY: Duration = Duration::from_millis(20);

/// The payload of a stream: [`RawSample`] or [`CompensatedIncrement`].
pub trait Streamed: ZeroCopySend + fmt::Debug + Copy + 'static {
    /// Name of the IMU's stream that carries this payload.
    fn stream(imu: &ImuId) -> ServiceName;
    /// Session and sequence.
    fn key(&self) -> (u64, u64);
}

impl Streamed for RawSample {
    fn stream(imu: &ImuId) -> ServiceName {
        imu.raw()
    }
    fn key(&self) -> (u64, u64) {
        (self.session, self.sequence)
    }
}

impl Streamed for CompensatedIncrement {
    fn stream(imu: &ImuId) -> ServiceName {
        imu.increment()
    }
    fn key(&self) -> (u64, u64) {
        (self.session, self.sequence)
    }
}

/// Reads the increments of one IMU as they are published: for navigation and loggers.
///
/// The queue holds [`INCREMENT_DEPTH`](isotherm_shared::stream::INCREMENT_DEPTH) increments. If the reader sleeps for longer,
/// the oldest are overwritten.
pub type IncrementReader = Reader<CompensatedIncrement>;

/// Reads the raw samples of one IMU as the acquisition sends them: for recorders.
///
/// The queue holds [`RECORDER_DEPTH`](isotherm_shared::stream::RECORDER_DEPTH) samples. If the reader sleeps for longer, the
/// newest are lost. Acquisition and service are not affected.
pub type RawReader = Reader<RawSample>;

/// Reads one stream of an IMU as it is published, beginning when it is connected: [`IncrementReader`], [`RawReader`].
///
/// It may be created before or after the service, and it stays connected across restarts of service and acquisition. It
/// returns each (session, sequence) once, although a resend after a restart publishes some twice. It cannot disturb other
/// processes: if its queue is full, only this reader loses samples, which is a gap in `sequence`.
///
/// Sequences rise, with one exception: after a restart of the service, or a loss, a new sample may come before samples that are sent
/// again. [`isotherm_shared::protocol`] has the rules.
#[derive(Debug)]
pub struct Reader<T: Streamed> {
    domain: Domain,
    imu: ImuId,
    state: ReaderState,
    next_attempt: Instant,
    // The subscriber must be dropped before its node; fields are dropped in this order.
    subscriber: Option<Subscriber<Ipc, T, ()>>,
    node: Option<IpcNode>,
}

impl<T: Streamed> Reader<T> {
    /// A reader that connects as soon as the service is there; it never waits (the time-out of `options` is not used).
    #[must_use]
    pub fn new(imu: ImuId, options: &Options) -> Self {
        Self {
            domain: options.domain.clone(),
            imu,
            state: ReaderState::new(),
            next_attempt: Instant::now(),
            subscriber: None,
            node: None,
        }
    }

    /// A connected reader; waits for the service up to the time-out of `options`.
    ///
    /// # Errors
    /// If it could not connect in that time.
    pub fn connect(imu: ImuId, options: &Options) -> Result<Self, ConnectError> {
        let mut reader = Self::new(imu, options);
        retry_until(deadline(options.timeout), || reader.attach())?;
        Ok(reader)
    }

    /// Whether the stream has been found. Stays true when the service stops.
    #[must_use]
    pub const fn is_connected(&self) -> bool {
        self.subscriber.is_some()
    }

    /// The IMU.
    #[must_use]
    pub const fn imu(&self) -> &ImuId {
        &self.imu
    }

    /// Samples or increments that came again after a resend and were not returned.
    #[must_use]
    pub const fn repeats(&self) -> u64 {
        self.state.repeats()
    }

    /// The next sample or increment, or `None` if there is none now (or no service yet). Does not wait.
    ///
    /// # Errors
    /// [`ConnectError`] if connecting cannot succeed (another user's domain, no reader place free) or reading fails.
    pub fn receive(&mut self) -> Result<Option<T>, ConnectError> {
        let Some(subscriber) = &self.subscriber else {
            return self.try_attach().map(|()| None);
        };
        loop {
            let sample = subscriber.receive().map_err(|error| ConnectError::transport("reading the stream", error))?;
            // Copy it out of shared memory once, then use the copy.
            let Some(received) = sample.map(|sample| *sample) else { return Ok(None) };
            let (session, sequence) = received.key();
            if self.state.first_time(session, sequence) {
                return Ok(Some(received));
            }
        }
    }

    /// As [`receive`](Self::receive), but waits up to `timeout`. Polls every 0.2 ms; for less delay call `receive` in a loop.
    ///
    /// # Errors
    /// As [`receive`](Self::receive).
    pub fn receive_timeout(&mut self, timeout: Duration) -> Result<Option<T>, ConnectError> {
        let started = Instant::now();
        loop {
            if let Some(received) = self.receive()? {
                return Ok(Some(received));
            }
            if started.elapsed() >= timeout {
                return Ok(None);
            }
            std::thread::sleep(Duration::from_micros(200));
        }
    }

    fn try_attach(&mut self) -> Result<(), ConnectError> {
        if Instant::now() < self.next_attempt {
            return Ok(());
        }
        self.next_attempt = Instant::now() + RETRY;
        match self.attach() {
            Err(ConnectError::NoService(_) | ConnectError::NoSuchImu { .. } | ConnectError::Transport { .. }) => Ok(()),
            other => other,
        }
    }

    fn attach(&mut self) -> Result<(), ConnectError> {
        let node = match &self.node {
            Some(node) => node,
            None => self.node.insert(join_existing(&self.domain)?),
        };
        refuse_foreign(&self.domain)?;
        let name = T::stream(&self.imu);
        let stream = node.service_builder(&name).publish_subscribe::<T>().open();
        let stream = stream.map_err(|error| unopened(node, &self.domain, &self.imu, &name, error))?;
        let subscriber = stream.subscriber_builder().create().map_err(|error| match error {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => {
                node.try_cleanup_dead_nodes();
                ConnectError::no_room(&self.imu, &stream)
            }
            other => ConnectError::transport("subscribing to the stream", other),
        })?;
        reserve(&self.domain)?;
        self.subscriber = Some(subscriber);
        Ok(())
    }
}
