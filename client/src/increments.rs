//! Reading increments beside the acquisition: navigation, loggers.

use crate::connect::{ConnectError, Options, absent, deadline, join_existing, permission, until};
use crate::once::Once;
use crate::peers::subscribers_of;
use crate::resources::reserve;
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use isotherm_shared::stream::{Domain, ImuId, Ipc, IpcNode};
use isotherm_shared::wire::CompensatedIncrement;
use std::time::{Duration, Instant};

/// Pause between two attempts to find the service.
const RETRY: Duration = Duration::from_millis(20);

/// Reads the increments of one IMU as they are published, from the moment it is connected on.
///
/// It may be created before or after the service, stays connected across restarts of service and acquisition, and hands
/// each (session, sequence) out once, although a resend after a restart publishes some twice. It cannot disturb anyone:
/// when it sleeps for more than the queue's depth
/// ([`INCREMENT_DEPTH`](isotherm_shared::stream::INCREMENT_DEPTH)), the oldest increments are overwritten, which
/// shows as a gap in `sequence`.
///
/// Sequences rise, but for one case: after a restart of the service a sample sent just then may come before those that are
/// sent again.
#[derive(Debug)]
pub struct IncrementReader {
    domain: Domain,
    imu: ImuId,
    once: Once,
    repeats: u64,
    next_attempt: Instant,
    // The subscriber before its node: fields are dropped in this order.
    subscriber: Option<Subscriber<Ipc, CompensatedIncrement, ()>>,
    node: Option<IpcNode>,
}

impl IncrementReader {
    /// A reader that connects as soon as the service is there; it never waits (the time-out of `options` is not used).
    #[must_use]
    pub fn new(imu: ImuId, options: &Options) -> Self {
        Self {
            domain: options.domain.clone(),
            imu,
            once: Once::new(),
            repeats: 0,
            next_attempt: Instant::now(),
            subscriber: None,
            node: None,
        }
    }

    /// A reader that is connected.
    ///
    /// # Errors
    /// If it could not connect within the time-out of `options`.
    pub fn connect(imu: ImuId, options: &Options) -> Result<Self, ConnectError> {
        let mut reader = Self::new(imu, options);
        until(deadline(options.timeout), || reader.attach())?;
        Ok(reader)
    }

    /// Whether the stream has been found. Stays true when the service stops.
    #[must_use]
    pub const fn is_connected(&self) -> bool {
        self.subscriber.is_some()
    }

    /// Increments that came again after a resend and were not handed out.
    #[must_use]
    pub const fn repeats(&self) -> u64 {
        self.repeats
    }

    /// The next increment, or `None` if there is none now (or no service yet). Does not wait.
    ///
    /// # Errors
    /// [`ConnectError`] if connecting cannot succeed (another user's domain, no place left) or the connection is broken.
    pub fn receive(&mut self) -> Result<Option<CompensatedIncrement>, ConnectError> {
        let Some(subscriber) = &self.subscriber else {
            return self.try_attach().map(|()| None);
        };
        loop {
            let sample =
                subscriber.receive().map_err(|error| ConnectError::transport("receiving an increment", error))?;
            let Some(sample) = sample else { return Ok(None) };
            let increment = *sample;
            if self.once.first_time(increment.session, increment.sequence) {
                return Ok(Some(increment));
            }
            self.repeats += 1;
        }
    }

    /// As [`receive`](Self::receive), waiting up to `timeout`. Looks every 0.2 ms; spin on `receive` to be faster.
    ///
    /// # Errors
    /// As [`receive`](Self::receive).
    pub fn receive_timeout(&mut self, timeout: Duration) -> Result<Option<CompensatedIncrement>, ConnectError> {
        let started = Instant::now();
        loop {
            if let Some(increment) = self.receive()? {
                return Ok(Some(increment));
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
        let stream = node.service_builder(&self.imu.increment()).publish_subscribe::<CompensatedIncrement>().open();
        let stream = stream.map_err(|error| match error {
            PublishSubscribeOpenError::DoesNotExist => absent(node, &self.domain, &self.imu),
            PublishSubscribeOpenError::InsufficientPermissions => permission(&self.domain),
            other => ConnectError::transport("opening the increment stream", other),
        })?;
        let subscriber = stream.subscriber_builder().create().map_err(|error| match error {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => {
                node.try_cleanup_dead_nodes();
                ConnectError::NoRoom { imu: self.imu.clone(), pids: subscribers_of(&stream) }
            }
            other => ConnectError::transport("subscribing to the increment stream", other),
        })?;
        reserve(&self.domain)?;
        self.subscriber = Some(subscriber);
        Ok(())
    }
}
