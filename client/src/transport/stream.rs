//! The streams: names, limits of publishers and subscribers, queue depths. Streams
//! are opened and created with the settings of this module only.
//!
//! | service name | payload | publishers | subscribers |
//! |---|---|---|---|
//! | `isotherm/<imu>/raw` | [`RawSample`] | 1, the acquisition | the service, recorders |
//! | `isotherm/<imu>/increment` | [`CompensatedIncrement`] | 1, the service | the acquisition, navigation, loggers |
//! | `isotherm/<imu>/wake` | event | senders of raw samples, the service | the service |
//! | `isotherm/<imu>/arrival` | event | the service, after publishing, while anybody listens | readers that wait |
//! | `isotherm/status` | UTF-8 JSON, `[u8]`, history 1 | 1, the service | anybody |
//! | `isotherm/rehearsal/<node>/raw`, `.../increment` | as those of an IMU | one process | the same process |
//!
//! The last row is for rehearsals: a process sends to itself what it would send to the other side, to keep the way
//! warm. It makes these two streams by itself, and nobody else has a place in them.
//!
//! Only the service creates all others, so that it decides depths and limits; all other processes open them.

use super::own_static::OwnStatic;
use super::own_storage::OwnStorage;
use super::recycled::RecycledRc;
use core::fmt;
use core::time::Duration;
use iceoryx2::prelude::{Config, FileName, Node, Path, SemanticString as _, ServiceName, ZeroCopySend, ipc};
use iceoryx2::service::builder::event::{EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    self, PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::internal::ServiceInternal;
use iceoryx2::service::{Service, port_factory};
use iceoryx2_bb_elementary_traits::testing::abandonable::Abandonable;
use iceoryx2_bb_lock_free::mpmc::counting_bit_set::RelocatableCountingBitSet;
use iceoryx2_cal::dynamic_storage::file;
use iceoryx2_cal::event::trigger::State;
use iceoryx2_cal::event::trigger::unix_datagram_socket::GenericUnixDatagramSocketTrigger;
use iceoryx2_cal::resizable_shared_memory::dynamic::DynamicMemory;
use iceoryx2_cal::shared_memory::common::details::{AllocatorDetails, Memory};
use iceoryx2_cal::shm_allocator::pool_allocator::PoolAllocator;
use iceoryx2_cal::zero_copy_connection::common::details::{Connection, SharedManagementData};
use isotherm_shared::names::{Domain, DomainError, ImuId, StreamKind};
use isotherm_shared::wire::{CompensatedIncrement, RawSample};

/// Raw samples that an acquisition may have unanswered, unless the service is configured with fewer. The service's
/// queue is deeper, see [`queue_depth`](isotherm_shared::protocol::queue_depth): samples that are sent again have room
/// too, so it does not overflow.
pub const RAW_DEPTH: usize = 64;
/// Raw samples that a recorder's queue holds. A recorder may sleep until it is full: 51 ms at 10 kHz.
pub const RECORDER_DEPTH: usize = 512;
/// Subscribers of a raw stream: the service and recorders.
pub const RAW_SUBSCRIBERS: usize = 8;
/// Increments that a reader's queue holds; a full queue overwrites the oldest.
pub const INCREMENT_DEPTH: usize = 512;
/// Subscribers of an increment stream.
pub const INCREMENT_SUBSCRIBERS: usize = 16;
/// Samples that a subscriber may hold at once.
pub const BORROWED: usize = 2;
/// Processes that may have one stream open at once.
pub const NODES: usize = 64;
/// Processes that may notify the wake-up event of one IMU: its senders, and the service itself.
pub const NOTIFIERS: usize = 16;
/// Events have one id: a listener that was notified looks through all of them.
const EVENT_ID_MAX: usize = 0;
/// Readers of the status at once.
pub const STATUS_SUBSCRIBERS: usize = 32;

/// Name of the status stream.
pub const STATUS: &str = "isotherm/status";

/// Vanished publishers of whose unread samples a subscriber keeps track. The transport's own number, 128, makes every
/// poll walk through as many empty places: a twentieth of a round trip.
const VANISHED_PUBLISHERS: usize = 8;

/// Time limit for creating an object of the transport; one that takes longer counts as left behind by a dead process.
pub const CREATION_TIMEOUT: Duration = Duration::from_millis(500);

/// The samples of a publisher.
type Segment = Memory<PoolAllocator, OwnStorage<AllocatorDetails<PoolAllocator>>>;

/// iceoryx2's inter-process variant with four differences. Shared memory of other users is never opened, see
/// [`OwnStorage`]. A process removes no file that another one has made in the place of its own, see [`OwnStatic`]. The
/// bookkeeping of a loan uses [`RecycledRc`] memory instead of a new allocation for each loan. The counter of the
/// domain's nodes is a file in the domain's folder, which other users cannot enter: in shared memory the transport
/// would leave it writable by everybody, and would wait for it without limit if somebody cut it.
///
/// Other processes see no difference to [`ipc::Service`]; both variants can use the same streams.
#[derive(Clone, Debug)]
pub struct Ipc;

impl Service for Ipc {
    type StaticStorage = OwnStatic;
    type ConfigSerializer = <ipc::Service as Service>::ConfigSerializer;
    type PersistentDynamicStorage<T: fmt::Debug + Send + Sync + ZeroCopySend + 'static> = file::Storage<T>;
    type Bag = <ipc::Service as Service>::Bag;
    type DynamicStorage<T: fmt::Debug + Send + Sync + ZeroCopySend + 'static> = OwnStorage<T>;
    type ServiceNameHasher = <ipc::Service as Service>::ServiceNameHasher;
    type SharedMemory = Segment;
    type ResizableSharedMemory = DynamicMemory<PoolAllocator, Segment>;
    type Connection = Connection<OwnStorage<SharedManagementData>>;
    type Event =
        GenericUnixDatagramSocketTrigger<RelocatableCountingBitSet, OwnStorage<State<RelocatableCountingBitSet, ()>>>;
    type Monitoring = <ipc::Service as Service>::Monitoring;
    type Reactor = <ipc::Service as Service>::Reactor;
    type ArcThreadSafetyPolicy<T: Send + fmt::Debug + Abandonable> = RecycledRc<T>;
    type BlackboardMgmt<T: Send + Sync + fmt::Debug + ZeroCopySend + 'static> =
        <ipc::Service as Service>::BlackboardMgmt<T>;
    type BlackboardPayload = <ipc::Service as Service>::BlackboardPayload;
    type UniqueId = <ipc::Service as Service>::UniqueId;
}

impl ServiceInternal<Self> for Ipc {}

/// The node that makes a process a member of a domain.
pub type IpcNode = Node<Ipc>;
type PublishSubscribe<T> = publish_subscribe::Builder<T, (), Ipc>;

/// A stream, for making ports of it.
pub type Stream<T> = port_factory::publish_subscribe::PortFactory<Ipc, T, ()>;
/// An event, for making ports of it.
pub type Event = port_factory::event::PortFactory<Ipc>;
/// A stream that was opened, or created if it did not exist.
pub type CreatedStream<T> = Result<Stream<T>, PublishSubscribeOpenOrCreateError>;
/// A stream that was opened.
pub type OpenedStream<T> = Result<Stream<T>, PublishSubscribeOpenError>;
/// An event that was opened, or created if it did not exist.
pub type CreatedEvent = Result<Event, EventOpenOrCreateError>;

// The service calls the functions `create_..`, all others `open_..`. None is generic, so that the transport's code for
// it, which writes and reads TOML, is compiled here and not again in each crate that calls it.

/// Creates the raw stream.
///
/// # Errors
/// Those of the transport.
pub fn create_raw(node: &IpcNode, imu: &ImuId) -> CreatedStream<RawSample> {
    let builder = node.service_builder(&raw_name(imu)).publish_subscribe::<RawSample>().max_publishers(1);
    builder
        .max_subscribers(RAW_SUBSCRIBERS)
        .max_nodes(NODES)
        .subscriber_max_buffer_size(RECORDER_DEPTH)
        .subscriber_max_borrowed_samples(BORROWED)
        .history_size(0)
        .enable_safe_overflow(false)
        .open_or_create()
}

/// Creates the increment stream. In a domain that a relay copies increments into it has two publishers, the relay and
/// the tunnel to another machine: a tunnel registers as publisher, subscriber and node on each stream that it carries,
/// whatever the direction.
///
/// # Errors
/// Those of the transport.
pub fn create_increment(node: &IpcNode, imu: &ImuId, relayed: bool) -> CreatedStream<CompensatedIncrement> {
    let builder = node.service_builder(&increment_name(imu)).publish_subscribe::<CompensatedIncrement>();
    builder
        .max_publishers(if relayed { 2 } else { 1 })
        .max_subscribers(INCREMENT_SUBSCRIBERS)
        .max_nodes(NODES)
        .subscriber_max_buffer_size(INCREMENT_DEPTH)
        .subscriber_max_borrowed_samples(BORROWED)
        .history_size(0)
        .enable_safe_overflow(true)
        .open_or_create()
}

/// Creates the stream of raw samples by which the process of a node rehearses.
///
/// # Errors
/// Those of the transport.
pub fn create_raw_rehearsal(node: &IpcNode) -> CreatedStream<RawSample> {
    alone::<RawSample>(node, StreamKind::Raw).enable_safe_overflow(false).open_or_create()
}

/// Creates the stream of increments by which the process of a node rehearses.
///
/// # Errors
/// Those of the transport.
pub fn create_increment_rehearsal(node: &IpcNode) -> CreatedStream<CompensatedIncrement> {
    alone::<CompensatedIncrement>(node, StreamKind::Increment).enable_safe_overflow(true).open_or_create()
}

/// The settings of a stream that one process uses to send to itself. Its name has the number of the node.
fn alone<T: fmt::Debug + ZeroCopySend>(node: &IpcNode, stream: StreamKind) -> PublishSubscribe<T> {
    let name = service_name(&format!("isotherm/rehearsal/{:x}/{}", node.id().value(), stream.name()));
    let builder = node.service_builder(&name).publish_subscribe::<T>();
    builder
        .max_publishers(1)
        .max_subscribers(1)
        .max_nodes(1)
        .subscriber_max_buffer_size(BORROWED)
        .subscriber_max_borrowed_samples(BORROWED)
        .history_size(0)
}

/// Creates the wake-up event.
///
/// # Errors
/// Those of the transport.
pub fn create_wake(node: &IpcNode, imu: &ImuId) -> CreatedEvent {
    let event = node.service_builder(&wake_name(imu)).event();
    event.max_listeners(1).max_notifiers(NOTIFIERS).max_nodes(NODES).event_id_max_value(EVENT_ID_MAX).open_or_create()
}

/// Creates the event of published increments.
///
/// # Errors
/// Those of the transport.
pub fn create_arrival(node: &IpcNode, imu: &ImuId) -> CreatedEvent {
    let event = node.service_builder(&arrival_name(imu)).event();
    let event = event.max_listeners(INCREMENT_SUBSCRIBERS).max_notifiers(1).max_nodes(NODES);
    event.event_id_max_value(EVENT_ID_MAX).open_or_create()
}

/// Creates the status stream.
///
/// # Errors
/// Those of the transport.
pub fn create_status(node: &IpcNode) -> CreatedStream<[u8]> {
    let builder = node.service_builder(&service_name(STATUS)).publish_subscribe::<[u8]>().max_publishers(1);
    builder
        .max_subscribers(STATUS_SUBSCRIBERS)
        .max_nodes(NODES)
        .subscriber_max_buffer_size(1)
        .subscriber_max_borrowed_samples(BORROWED)
        .history_size(1)
        .enable_safe_overflow(true)
        .open_or_create()
}

/// Opens a stream of raw samples.
///
/// # Errors
/// Those of the transport.
pub fn open_raw(node: &IpcNode, name: &ServiceName) -> OpenedStream<RawSample> {
    node.service_builder(name).publish_subscribe::<RawSample>().open()
}

/// Opens a stream of increments.
///
/// # Errors
/// Those of the transport.
pub fn open_increment(node: &IpcNode, name: &ServiceName) -> OpenedStream<CompensatedIncrement> {
    node.service_builder(name).publish_subscribe::<CompensatedIncrement>().open()
}

/// Opens the status stream.
///
/// # Errors
/// Those of the transport.
pub fn open_status(node: &IpcNode) -> OpenedStream<[u8]> {
    node.service_builder(&status_name()).publish_subscribe::<[u8]>().open()
}

/// Opens an event.
///
/// # Errors
/// Those of the transport.
pub fn open_event(node: &IpcNode, name: &ServiceName) -> Result<Event, EventOpenError> {
    node.service_builder(name).event().open()
}

// The service's names of an IMU's streams.

/// `isotherm/<imu>/raw`.
#[must_use]
pub fn raw_name(imu: &ImuId) -> ServiceName {
    service_name(&format!("isotherm/{imu}/raw"))
}

/// `isotherm/<imu>/increment`.
#[must_use]
pub fn increment_name(imu: &ImuId) -> ServiceName {
    service_name(&format!("isotherm/{imu}/increment"))
}

/// `isotherm/<imu>/wake`.
#[must_use]
pub fn wake_name(imu: &ImuId) -> ServiceName {
    service_name(&format!("isotherm/{imu}/wake"))
}

/// `isotherm/<imu>/arrival`.
#[must_use]
pub fn arrival_name(imu: &ImuId) -> ServiceName {
    service_name(&format!("isotherm/{imu}/arrival"))
}

/// The name of the status stream.
#[must_use]
pub fn status_name() -> ServiceName {
    service_name(STATUS)
}

#[expect(clippy::expect_used, reason = "built from checked names of at most 32 characters; the limit is 255")]
fn service_name(name: &str) -> ServiceName {
    ServiceName::new(name).expect("a short name")
}

/// The transport's configuration in a domain. It is explicit, so that no configuration file of iceoryx2 has an effect.
///
/// # Errors
/// A folder whose path the transport does not take.
pub fn configuration(domain: &Domain) -> Result<Config, DomainError> {
    let invalid = || DomainError::Root(domain.root_path().to_owned());
    let mut config = Config::default();
    config.global.prefix = FileName::new(domain.prefix().as_bytes()).map_err(|_| invalid())?;
    config.global.set_root_path(&Path::new(domain.root_path().as_bytes()).map_err(|_| invalid())?);
    config.global.creation_timeout = CREATION_TIMEOUT;
    config.defaults.publish_subscribe.subscriber_expired_connection_buffer = VANISHED_PUBLISHERS;
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_streams_have_the_imu_in_them() {
        let imu = ImuId::new("imu-a_2").unwrap();
        assert_eq!(raw_name(&imu).as_str(), "isotherm/imu-a_2/raw");
    }
}
