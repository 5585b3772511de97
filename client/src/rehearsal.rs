//! Rehearsals: going through the motions of a sample before it comes, so that its way is in the caches.
//!
//! An IMU sends every few milliseconds. In between, other work takes the caches, and a sample then finds instructions and data of its way
//! cold: that is most of its latency. So whoever waits for a sample rehearses. A rehearsal sends a sample through ports of its own, over a
//! stream of its own that no other process opens, and runs the same functions as a real sample: [`publish`] and [`receive`] are the only
//! ways to the transport.
//!
//! A rehearsal has no effect that a peer can see. [`Rehearsal`] holds its ports and gives none of them away, so no rehearsed sample can get
//! into a real stream.

use core::fmt;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::{ReceiveError, SendError};
use iceoryx2::prelude::{BackpressureStrategy, ZeroCopySend};
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use isotherm_shared::stream::{Ipc, IpcNode, RehearsalNames};
use isotherm_shared::wire::{CompensatedIncrement, RawSample};

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
            raw: node.service_builder(&names.raw).publish_subscribe::<RawSample>().open()?,
            increments: node.service_builder(&names.increment).publish_subscribe::<CompensatedIncrement>().open()?,
        })
    }
}

/// The ports of a process's rehearsals, at both ends of two streams: `I` is what the process receives, `O` what it sends.
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
    pub fn open(incoming: &PortFactory<Ipc, I, ()>, outgoing: &PortFactory<Ipc, O, ()>) -> Result<Self, String> {
        let (sink, sender) = (subscriber(outgoing)?, publisher(outgoing)?);
        let (receiver, source) = (subscriber(incoming)?, publisher(incoming)?);
        Ok(Self { spare: sender.loan().ok(), outgoing: sender, incoming: receiver, source, sink })
    }

    /// Goes through the motions once: receives `input`, makes the output from it, and sends that. Takes less than a microsecond in warm
    /// caches, some microseconds in cold ones; allocates nothing and makes no system call.
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

fn publisher<T: Payload>(stream: &PortFactory<Ipc, T, ()>) -> Result<Publisher<Ipc, T, ()>, String> {
    let builder = stream.publisher_builder().max_loaned_samples(2);
    builder.backpressure_strategy(BackpressureStrategy::DiscardData).create().map_err(|error| error.to_string())
}

fn subscriber<T: Payload>(stream: &PortFactory<Ipc, T, ()>) -> Result<Subscriber<Ipc, T, ()>, String> {
    stream.subscriber_builder().create().map_err(|error| error.to_string())
}
