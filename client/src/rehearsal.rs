//! Rehearsals: going through the motions of a sample before it comes, so that its way is in the caches.
//!
//! An IMU sends every few milliseconds. In between, other work takes the caches, and a sample then finds instructions
//! and data of its way cold: that is most of its latency. So a process that waits for a sample rehearses. A rehearsal
//! sends a sample through ports of its own, over a stream in which no other process has a port, and runs the same
//! functions as a real sample: an acquisition and the worker have no other way to the transport than those of
//! [`Payload`].
//!
//! A rehearsal has no effect that a peer can see. [`Rehearsal`] holds its ports and gives none of them away, so no
//! rehearsed sample can get into a real stream.

use crate::error::{ConnectError, shortage};
use crate::transport::nodes;
use crate::transport::ports::{Outgoing, Payload, Publisher, Subscriber};
use crate::transport::stream::{self, IpcNode, RehearsalNames, Stream};
use core::fmt;
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use isotherm_shared::names::ImuId;
use isotherm_shared::wire::{CompensatedIncrement, RawSample};
use std::thread;
use std::time::{Duration, Instant};

/// How long an acquisition waits for the place of a dead predecessor. The service frees the place of one that was
/// killed while it took it, after three searches, one a second.
const PLACE_TIMEOUT: Duration = Duration::from_secs(4);
/// Pause between two attempts.
const RETRY: Duration = Duration::from_millis(5);

/// The two streams over which a process rehearses.
#[derive(Debug)]
pub struct RehearsalStreams {
    /// Carries raw samples.
    pub raw: Stream<RawSample>,
    /// Carries increments.
    pub increments: Stream<CompensatedIncrement>,
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
    spare: Option<Outgoing<O>>,
    outgoing: Publisher<O>,
    incoming: Subscriber<I>,
    /// The other ends.
    source: Publisher<I>,
    sink: Subscriber<O>,
}

impl<I: Payload, O: Payload> Rehearsal<I, O> {
    /// Opens the ports on streams that only this process uses.
    ///
    /// # Errors
    /// Why the transport gave no port.
    pub fn open(incoming: &Stream<I>, outgoing: &Stream<O>) -> Result<Self, RehearsalError> {
        let (sink, sender) = (subscriber(outgoing)?, publisher(outgoing)?);
        let (receiver, source) = (subscriber(incoming)?, publisher(incoming)?);
        let mut rehearsal = Self { spare: O::loan(&sender).ok(), outgoing: sender, incoming: receiver, source, sink };
        // The first one makes the connections, with memory and system calls.
        rehearsal.go(&I::default(), |_, _| ());
        shortage().map_or(Ok(rehearsal), |full| Err(RehearsalError::Other(full.to_string())))
    }

    /// Goes through the motions once: receives `input`, makes the output from it, and sends that. Takes less than a
    /// microsecond in warm caches, some microseconds in cold ones; allocates nothing and makes no system call.
    ///
    /// A failure of the transport ends the rehearsal. It is no error: the next sample is only slower.
    pub fn go(&mut self, input: &I, make: impl FnOnce(&I, &mut O)) {
        let Ok(mut sample) = I::loan(&self.source) else { return };
        *sample.payload_mut() = *input;
        let _ = I::publish(sample);
        if let (Ok(Some(sample)), Some(mut spare)) = (I::receive(&self.incoming), self.spare.take()) {
            make(sample.payload(), spare.payload_mut());
            let _ = O::publish(spare);
            I::give_back(sample);
        }
        self.spare = self.spare.take().or_else(|| O::loan(&self.outgoing).ok());
        if let Ok(Some(sample)) = O::receive(&self.sink) {
            O::give_back(sample);
        }
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

fn publisher<T: Payload>(stream: &Stream<T>) -> Result<Publisher<T>, RehearsalError> {
    T::publisher(stream, 2).map_err(|error| match error {
        PublisherCreateError::ExceedsMaxSupportedPublishers => RehearsalError::Taken,
        other => RehearsalError::Other(other.to_string()),
    })
}

fn subscriber<T: Payload>(stream: &Stream<T>) -> Result<Subscriber<T>, RehearsalError> {
    T::subscriber(stream, None).map_err(|error| match error {
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
                    None => nodes::clean(node),
                },
            },
        }
        if Instant::now() > deadline {
            return Ok(None);
        }
        thread::sleep(RETRY);
    }
}
