//! What a stream carries, and the ports of a stream: the one place where samples are loaned, sent, received and
//! returned.
//!
//! The transport is generic, and a generic function is compiled in each crate that calls it. [`Payload`] is implemented
//! for two types, and its functions for these are not generic: they are compiled here, in one unit with what they call,
//! and every program links the same instructions. They are not inlined into a caller, so real and rehearsed samples run
//! the same instructions, too.

use super::stream::{
    CreatedStream, Event, Ipc, IpcNode, OpenedStream, Stream, create_increment_rehearsal, create_raw_rehearsal,
    increment_name, open_increment, open_raw, raw_name,
};
use core::fmt;
use core::sync::atomic::{AtomicBool, Ordering};
use iceoryx2::port::listener::{Listener, ListenerCreateError};
use iceoryx2::port::notifier::{Notifier, NotifierCreateError};
use iceoryx2::port::publisher::{self, PublisherCreateError};
use iceoryx2::port::subscriber::{self, SubscriberCreateError};
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::port::{DegradationAction, DegradationCause, LoanError, ReceiveError, SendError};
use iceoryx2::prelude::{AllocationStrategy, BackpressureStrategy, ServiceName, ZeroCopySend};
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut::SampleMut;
use isotherm_shared::names::ImuId;
use isotherm_shared::sequence::Period;
use isotherm_shared::wire::{CompensatedIncrement, RawSample};

/// A port that sends.
pub type Publisher<T> = publisher::Publisher<Ipc, T, ()>;
/// A port that receives.
pub type Subscriber<T> = subscriber::Subscriber<Ipc, T, ()>;
/// A place in shared memory for a sample that is to be sent.
pub type Outgoing<T> = SampleMut<Ipc, T, ()>;
/// A sample in shared memory that was received; dropping it returns its place.
pub type Incoming<T> = Sample<Ipc, T, ()>;

/// The payload of an IMU's stream: [`RawSample`] or [`CompensatedIncrement`].
pub trait Payload: ZeroCopySend + fmt::Debug + Default + Copy + 'static {
    /// Whether the service notifies an event when it has published.
    const HAS_EVENT: bool;

    /// Name of the IMU's stream that carries this payload.
    fn stream(imu: &ImuId) -> ServiceName;
    /// Opens a stream with this payload.
    ///
    /// # Errors
    /// Those of the transport.
    fn open(node: &IpcNode, name: &ServiceName) -> OpenedStream<Self>;
    /// Creates the stream with this payload by which the process of a node rehearses.
    ///
    /// # Errors
    /// Those of the transport.
    fn create_rehearsal(node: &IpcNode) -> CreatedStream<Self>;
    /// Session, sequence and times.
    fn period(&self) -> Period;

    /// A publisher that has up to `loans` samples on loan, and sends nothing to a subscriber whose queue is full.
    ///
    /// # Errors
    /// Those of the transport.
    fn publisher(stream: &Stream<Self>, loans: usize) -> Result<Publisher<Self>, PublisherCreateError>;
    /// A subscriber whose queue holds `depth` samples, without it as many as the stream allows.
    ///
    /// # Errors
    /// Those of the transport.
    fn subscriber(stream: &Stream<Self>, depth: Option<usize>) -> Result<Subscriber<Self>, SubscriberCreateError>;
    /// Loans the place of a sample, with the default value in it.
    ///
    /// # Errors
    /// Those of the transport.
    fn loan(port: &Publisher<Self>) -> Result<Outgoing<Self>, LoanError>;
    /// Takes back the places that subscribers have returned, which the transport would else do before it sends.
    fn reclaim(port: &Publisher<Self>);
    /// Connects subscribers that have come, and takes back the places of those that have returned some.
    fn connect(port: &Publisher<Self>);
    /// Sends a sample.
    ///
    /// # Errors
    /// Those of the transport.
    fn publish(sample: Outgoing<Self>) -> Result<usize, SendError>;
    /// The next sample.
    ///
    /// # Errors
    /// Those of the transport.
    fn receive(port: &Subscriber<Self>) -> Result<Option<Incoming<Self>>, ReceiveError>;
    /// Whether a sample waits.
    fn waits(port: &Subscriber<Self>) -> bool;
    /// Returns the place of a sample. This writes to memory that its sender reads, which costs a round trip between the
    /// cores.
    fn give_back(sample: Incoming<Self>);
}

macro_rules! payload {
    ($payload:ty, $name:path, $open:path, $rehearsal:path, has_event: $has_event:literal) => {
        impl Payload for $payload {
            const HAS_EVENT: bool = $has_event;

            fn stream(imu: &ImuId) -> ServiceName {
                $name(imu)
            }
            fn open(node: &IpcNode, name: &ServiceName) -> OpenedStream<Self> {
                $open(node, name)
            }
            fn create_rehearsal(node: &IpcNode) -> CreatedStream<Self> {
                $rehearsal(node)
            }
            fn period(&self) -> Period {
                self.into()
            }
            fn publisher(stream: &Stream<Self>, loans: usize) -> Result<Publisher<Self>, PublisherCreateError> {
                let builder = stream.publisher_builder().max_loaned_samples(loans);
                let builder = builder.backpressure_strategy(BackpressureStrategy::DiscardData);
                builder.set_degradation_handler(|cause, _| note_unconnected(&cause)).create()
            }
            fn subscriber(
                stream: &Stream<Self>,
                depth: Option<usize>,
            ) -> Result<Subscriber<Self>, SubscriberCreateError> {
                let builder = stream.subscriber_builder();
                match depth {
                    Some(depth) => builder.buffer_size(depth).create(),
                    None => builder.create(),
                }
            }
            #[inline(never)]
            fn loan(port: &Publisher<Self>) -> Result<Outgoing<Self>, LoanError> {
                Ok(port.loan_uninit()?.write_payload(Self::default()))
            }
            #[inline(never)]
            fn reclaim(port: &Publisher<Self>) {
                // This loan may be over the limit and fail: the transport takes places back before it looks.
                let _ = port.loan_uninit();
            }
            #[inline(never)]
            fn connect(port: &Publisher<Self>) {
                let _ = port.update_connections();
                Self::reclaim(port);
            }
            #[inline(never)]
            fn publish(sample: Outgoing<Self>) -> Result<usize, SendError> {
                sample.send()
            }
            #[inline(never)]
            fn receive(port: &Subscriber<Self>) -> Result<Option<Incoming<Self>>, ReceiveError> {
                port.receive()
            }
            #[inline(never)]
            fn waits(port: &Subscriber<Self>) -> bool {
                port.has_samples().unwrap_or(false)
            }
            #[inline(never)]
            fn give_back(sample: Incoming<Self>) {
                drop(sample);
            }
        }
    };
}

payload!(RawSample, raw_name, open_raw, create_raw_rehearsal, has_event: false);
payload!(CompensatedIncrement, increment_name, open_increment, create_increment_rehearsal, has_event: true);

/// Whether a publisher of this process could not connect a subscriber.
static UNCONNECTED: AtomicBool = AtomicBool::new(false);

/// The transport goes on without a subscriber that it could not connect, and tries it again only when a subscriber
/// comes or goes.
fn note_unconnected(cause: &DegradationCause) -> DegradationAction {
    if matches!(cause, DegradationCause::FailedToEstablishConnection) {
        UNCONNECTED.store(true, Ordering::Relaxed);
    }
    DegradationAction::Warn
}

/// Whether a publisher of this process could not connect a subscriber since the last call.
#[must_use]
pub fn take_unconnected() -> bool {
    UNCONNECTED.swap(false, Ordering::Relaxed)
}

/// Lets the publisher of a stream try again to connect all subscribers when it sends next: one comes, and goes.
///
/// # Errors
/// Those of the transport. Nothing has changed then.
pub fn reconnect<T: Payload>(stream: &Stream<T>) -> Result<(), SubscriberCreateError> {
    T::subscriber(stream, Some(1)).map(drop)
}

/// A port that notifies an event.
///
/// # Errors
/// Those of the transport.
pub fn notifier(event: &Event) -> Result<Notifier<Ipc>, NotifierCreateError> {
    event.notifier_builder().create()
}

/// A port that is notified of an event.
///
/// # Errors
/// Those of the transport.
pub fn listener(event: &Event) -> Result<Listener<Ipc>, ListenerCreateError> {
    event.listener_builder().create()
}

/// Notifies an event: a system call for each listener that has not been notified since it last looked. A listener that
/// is not reached looks by itself within a bounded time, so a failure is none.
#[inline(never)]
pub fn notify(port: &Notifier<Ipc>) {
    let _ = port.notify();
}

/// Connects listeners that have come.
#[inline(never)]
pub fn connect_listeners(port: &Notifier<Ipc>) {
    let _ = port.update_connections();
}

/// Takes all notifications, so that the next one is noticed.
#[inline(never)]
pub fn lower(port: &Listener<Ipc>) {
    let _ = port.try_wait(|_| {});
}

/// The publisher of the status, whose length changes.
///
/// # Errors
/// Those of the transport.
pub fn status_publisher(stream: &Stream<[u8]>, bytes: usize) -> Result<Publisher<[u8]>, PublisherCreateError> {
    let builder = stream.publisher_builder().initial_max_slice_len(bytes);
    builder.allocation_strategy(AllocationStrategy::PowerOfTwo).create()
}

/// Publishes a status.
///
/// # Errors
/// Those of the transport.
pub fn publish_status(port: &Publisher<[u8]>, document: &[u8]) -> Result<(), String> {
    let sample = port.loan_slice_uninit(document.len()).map_err(|error| error.to_string())?;
    sample.write_from_slice(document).send().map(drop).map_err(|error| error.to_string())
}

/// The only copy of a sample out of shared memory, which another process may change at any moment. The optimizer must
/// take the copy for changed by `black_box`, so no code that uses it reads shared memory again.
#[inline]
pub fn copied<T: Copy>(sample: &T) -> T {
    let mut copy = *sample;
    core::hint::black_box(&mut copy);
    copy
}
