//! Rehearsals: going through the motions of a sample before it comes, so that its way is in the caches.
//!
//! An IMU sends every few milliseconds. In between, other work takes the caches, and a sample then finds instructions
//! and data of its way cold: that is most of its latency. So whoever waits for a sample rehearses. A rehearsal sends a
//! sample through ports of its own, over a stream in which no other process has a port, and runs the same functions as
//! a real sample: an acquisition and the worker have no other way to the transport than [`publish`] and [`receive`].
//!
//! A rehearsal has no effect that a peer can see. [`Rehearsal`] holds its ports and gives none of them away, so no
//! rehearsed sample can get into a real stream.

use crate::error::{ConnectError, shortage};
use crate::transport::stream::{self, Ipc, IpcNode, RehearsalNames};
use core::fmt;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::port::{ReceiveError, SendError};
use iceoryx2::prelude::{BackpressureStrategy, ZeroCopySend};
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use isotherm_shared::names::ImuId;
use isotherm_shared::wire::{CompensatedIncrement, RawSample};
use std::thread;
use std::time::{Duration, Instant};

/// How long an acquisition waits for the place of a dead predecessor. The service frees the place of one that was
/// killed while it took it, after three searches, one a second.
const PLACE_TIMEOUT: Duration = Duration::from_secs(4);
/// Pause between two attempts.
const RETRY: Duration = Duration::from_millis(5);

/// What a stream carries.
pub trait Payload: ZeroCopySend + fmt::Debug + Default + Copy + 'static {}
impl<T: ZeroCopySend + fmt::Debug + Default + Copy + 'static> Payload for T {}

/// Sends a sample: the one place where real and rehearsed samples are sent, so that both run the same instructions.
///
/// # Errors
/// Those of the transport.
#[inline(never)]
pub fn publish<T: Payload>(sample: SampleMut<Ipc, T, ()>) -> Result<usize, SendError> {
    sample.send()
}

/// The next sample of a port, real or rehearsed, as [`publish`].
///
/// # Errors
/// Those of the transport.
#[inline(never)]
pub fn receive<T: Payload>(port: &Subscriber<Ipc, T, ()>) -> Result<Option<Sample<Ipc, T, ()>>, ReceiveError> {
    port.receive()
}

/// The only copy of a sample out of shared memory, which another process may change at any moment. The optimizer must
/// take the copy for changed by `black_box`, so no code that uses it reads shared memory again.
#[inline]
pub(crate) fn copied<T: Copy>(sample: &T) -> T {
    let mut copy = *sample;
    core::hint::black_box(&mut copy);
    copy
}

/// The two streams over which a process rehearses.
#[derive(Debug)]
pub struct RehearsalStreams {
    /// Carries raw samples.
    pub raw: PortFactory<Ipc, RawSample, ()>,
    /// Carries increments.
    pub increments: PortFactory<Ipc, CompensatedIncrement, ()>,
}

impl RehearsalStreams {
    /// Opens the streams, which the service has created.
    ///
    /// # Errors
    /// Those of the transport.
    pub fn open(node: &IpcNode, names: &RehearsalNames) -> Result<Self, PublishSubscribeOpenError> {
        Ok(Self {
            raw: stream::open_raw(node, &names.raw)?,
            increments: stream::open_increment(node, &names.increment)?,
        })
    }
}

/// The ports of a process's rehearsals, at both ends of two streams: `I` is what the process receives, `O` what it
/// sends.
pub struct Rehearsal<I: Payload, O: Payload> {
    spare: Option<SampleMut<Ipc, O, ()>>,
    outgoing: Publisher<Ipc, O, ()>,
    incoming: Subscriber<Ipc, I, ()>,
    /// The other ends.
    source: Publisher<Ipc, I, ()>,
    sink: Subscriber<Ipc, O, ()>,
}

impl<I: Payload, O: Payload> Rehearsal<I, O> {
    /// Opens the ports on streams that only this process uses.
    ///
    /// # Errors
    /// Why the transport gave no port.
    pub fn open(
        incoming: &PortFactory<Ipc, I, ()>,
        outgoing: &PortFactory<Ipc, O, ()>,
    ) -> Result<Self, RehearsalError> {
        let (sink, sender) = (subscriber(outgoing)?, publisher(outgoing)?);
        let (receiver, source) = (subscriber(incoming)?, publisher(incoming)?);
        let mut rehearsal = Self { spare: sender.loan().ok(), outgoing: sender, incoming: receiver, source, sink };
        // The first one makes the connections, with memory and system calls.
        rehearsal.go(&I::default(), |_, _| ());
        shortage().map_or(Ok(rehearsal), |full| Err(RehearsalError::Other(full.to_string())))
    }

    /// Goes through the motions once: receives `input`, makes the output from it, and sends that. Takes less than a
    /// microsecond in warm caches, some microseconds in cold ones; allocates nothing and makes no system call.
    ///
    /// A failure of the transport ends the rehearsal. It is no error: the next sample is only slower.
    pub fn go(&mut self, input: &I, make: impl FnOnce(&I, &mut O)) {
        let Ok(mut sample) = self.source.loan() else { return };
        *sample.payload_mut() = *input;
        let _ = publish(sample);
        if let (Ok(Some(sample)), Some(mut spare)) = (receive(&self.incoming), self.spare.take()) {
            make(sample.payload(), spare.payload_mut());
            let _ = publish(spare);
        }
        self.spare = self.spare.take().or_else(|| self.outgoing.loan().ok());
        let _ = receive(&self.sink);
    }
}

impl<I: Payload, O: Payload> fmt::Debug for Rehearsal<I, O> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Rehearsal").finish_non_exhaustive()
    }
}

/// Why there are no ports for rehearsals.
#[derive(Debug, thiserror::Error)]
pub enum RehearsalError {
    /// Another process, which may be dead, has the place.
    #[error("another process has the place")]
    Taken,
    /// Anything else.
    #[error("{0}")]
    Other(String),
}

fn publisher<T: Payload>(stream: &PortFactory<Ipc, T, ()>) -> Result<Publisher<Ipc, T, ()>, RehearsalError> {
    let builder = stream.publisher_builder().max_loaned_samples(2);
    builder.backpressure_strategy(BackpressureStrategy::DiscardData).create().map_err(|error| match error {
        PublisherCreateError::ExceedsMaxSupportedPublishers => RehearsalError::Taken,
        other => RehearsalError::Other(other.to_string()),
    })
}

fn subscriber<T: Payload>(stream: &PortFactory<Ipc, T, ()>) -> Result<Subscriber<Ipc, T, ()>, RehearsalError> {
    stream.subscriber_builder().create().map_err(|error| match error {
        SubscriberCreateError::ExceedsMaxSupportedSubscribers => RehearsalError::Taken,
        other => RehearsalError::Other(other.to_string()),
    })
}

/// The rehearsals of an acquisition; `None` if the service has no streams for them, as one of an earlier version, or if
/// the place of a dead predecessor does not get free in time.
///
/// # Errors
/// [`ConnectError::Exhausted`].
pub(crate) fn of_acquisition(
    node: &IpcNode,
    imu: &ImuId,
    deadline: Instant,
) -> Result<Option<Rehearsal<CompensatedIncrement, RawSample>>, ConnectError> {
    let deadline = deadline.min(Instant::now() + PLACE_TIMEOUT);
    loop {
        match RehearsalStreams::open(node, &RehearsalNames::of_acquisition(imu)) {
            Err(PublishSubscribeOpenError::DoesNotExist) => return Ok(None),
            Err(_) => {}
            Ok(streams) => match Rehearsal::open(&streams.increments, &streams.raw) {
                Ok(rehearsal) => return Ok(Some(rehearsal)),
                Err(_) => match shortage() {
                    Some(full) => return Err(full),
                    None => drop(node.try_cleanup_dead_nodes()),
                },
            },
        }
        if Instant::now() > deadline {
            return Ok(None);
        }
        thread::sleep(RETRY);
    }
}
