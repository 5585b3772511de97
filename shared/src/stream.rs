//! The streams: names, limits of publishers and subscribers, queue depths, and the domain that they belong to. Streams
//! are opened and created with the settings of this module only.
//!
//! | service name | payload | publishers | subscribers |
//! |---|---|---|---|
//! | `isotherm/<imu>/raw` | [`RawSample`] | 1, the acquisition | the service, recorders |
//! | `isotherm/<imu>/increment` | [`CompensatedIncrement`] | 1, the service | the acquisition, navigation, loggers |
//! | `isotherm/<imu>/wake` | event | senders of raw samples, the service | the service |
//! | `isotherm/<imu>/arrival` | event | the service, after publishing, while anybody listens | readers that wait |
//! | `isotherm/status` | UTF-8 JSON, `[u8]`, history 1 | 1, the service | anybody |
//! | `isotherm/<imu>/rehearsal/raw`, `.../increment` | as without `/rehearsal` | the acquisition | the acquisition |
//! | `isotherm/rehearsal/<worker>/raw`, `.../increment` | as those of an IMU | the service | the service |
//!
//! The last two rows are for rehearsals: a process sends to itself what it would send to the other side, to keep the
//! way warm. Nobody else has a place in them.
//!
//! Only the service creates them, so that it decides depths and limits; all other processes open them.
//!
//! Over 400 lines: names, limits and settings of all streams, which other languages copy, stand in one place.

use crate::own_static::OwnStatic;
use crate::own_storage::OwnStorage;
use crate::recycled::Recycled;
use crate::wire::{CompensatedIncrement, RawSample};
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
use sha2::{Digest as _, Sha256};

/// Raw samples that an acquisition may have unanswered, unless the service is configured with fewer. The service's
/// queue is deeper, see [`queue_depth`](crate::protocol::queue_depth): samples that are sent again have room too, so it
/// does not overflow.
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
/// Readers of the status at once.
pub const STATUS_SUBSCRIBERS: usize = 32;

/// Name of the status stream.
pub const STATUS: &str = "isotherm/status";

/// Vanished publishers of whose unread samples a subscriber keeps track. The transport's own number, 128, makes every
/// poll walk through as many empty places: a twentieth of a round trip.
const VANISHED_PUBLISHERS: usize = 8;

/// Time limit for creating an object of the transport; one that takes longer counts as left behind by a dead process.
pub const CREATION_TIMEOUT: Duration = Duration::from_millis(500);

/// Length limit of IMU and domain names.
pub const MAX_NAME: usize = 32;

/// The samples of a publisher.
type Segment = Memory<PoolAllocator, OwnStorage<AllocatorDetails<PoolAllocator>>>;

/// iceoryx2's inter-process variant with four differences. Shared memory of other users is never opened, see
/// [`OwnStorage`]. A process removes no file that another one has made in the place of its own, see [`OwnStatic`]. The
/// bookkeeping of a loan uses [`Recycled`] memory instead of a new allocation for each loan. The counter of the
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
    type ArcThreadSafetyPolicy<T: Send + fmt::Debug + Abandonable> = Recycled<T>;
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
    let builder = node.service_builder(&imu.raw()).publish_subscribe::<RawSample>().max_publishers(1);
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
    let builder = node.service_builder(&imu.increment()).publish_subscribe::<CompensatedIncrement>();
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

/// Creates a stream for rehearsals of raw samples.
///
/// # Errors
/// Those of the transport.
pub fn create_raw_rehearsal(node: &IpcNode, name: &RehearsalNames) -> CreatedStream<RawSample> {
    alone(node.service_builder(&name.raw).publish_subscribe::<RawSample>()).enable_safe_overflow(false).open_or_create()
}

/// Creates a stream for rehearsals of increments.
///
/// # Errors
/// Those of the transport.
pub fn create_increment_rehearsal(node: &IpcNode, name: &RehearsalNames) -> CreatedStream<CompensatedIncrement> {
    alone(node.service_builder(&name.increment).publish_subscribe::<CompensatedIncrement>())
        .enable_safe_overflow(true)
        .open_or_create()
}

/// The settings of a stream that one process uses to send to itself.
fn alone<T: fmt::Debug + ZeroCopySend>(builder: PublishSubscribe<T>) -> PublishSubscribe<T> {
    builder
        .max_publishers(1)
        .max_subscribers(1)
        .max_nodes(NODES)
        .subscriber_max_buffer_size(BORROWED)
        .subscriber_max_borrowed_samples(BORROWED)
        .history_size(0)
}

/// Creates the wake-up event.
///
/// # Errors
/// Those of the transport.
pub fn create_wake(node: &IpcNode, imu: &ImuId) -> CreatedEvent {
    let event = node.service_builder(&imu.wake()).event();
    event.max_listeners(1).max_notifiers(NOTIFIERS).max_nodes(NODES).open_or_create()
}

/// Creates the event of published increments.
///
/// # Errors
/// Those of the transport.
pub fn create_arrival(node: &IpcNode, imu: &ImuId) -> CreatedEvent {
    let event = node.service_builder(&imu.arrival()).event();
    event.max_listeners(INCREMENT_SUBSCRIBERS).max_notifiers(1).max_nodes(NODES).open_or_create()
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

/// Opens a stream of raw samples: the IMU's or one for rehearsals.
///
/// # Errors
/// Those of the transport.
pub fn open_raw(node: &IpcNode, name: &ServiceName) -> OpenedStream<RawSample> {
    node.service_builder(name).publish_subscribe::<RawSample>().open()
}

/// Opens a stream of increments: the IMU's or one for rehearsals.
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

/// One of an IMU's two streams of samples.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum StreamKind {
    /// Raw samples.
    Raw,
    /// Compensated increments.
    Increment,
}

impl StreamKind {
    /// Both streams.
    pub const BOTH: [Self; 2] = [Self::Raw, Self::Increment];

    /// The last part of the stream's name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Raw => "raw",
            Self::Increment => "increment",
        }
    }
}

/// Rule for the names of IMUs and domains, as text for messages.
pub const NAME_RULE: &str = "1 to 32 of a-z 0-9 - _";

/// The name of an IMU; follows [`NAME_RULE`].
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_shared::stream::ImuId;
///
/// let imu: ImuId = "imu-a".parse()?;
/// assert_eq!(imu.raw().as_str(), "isotherm/imu-a/raw");
/// assert_eq!(ImuId::new("IMU A"), None); // 1 to 32 of a-z 0-9 - _
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, Eq, Hash, Ord, PartialEq, PartialOrd)]
pub struct ImuId(String);

impl ImuId {
    /// `None` unless `name` follows [`NAME_RULE`].
    #[must_use]
    pub fn new(name: &str) -> Option<Self> {
        is_name(name).then(|| Self(name.to_owned()))
    }

    /// The name.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// `isotherm/<imu>/raw`.
    #[must_use]
    pub fn raw(&self) -> ServiceName {
        service_name(&format!("isotherm/{self}/raw"))
    }

    /// `isotherm/<imu>/increment`.
    #[must_use]
    pub fn increment(&self) -> ServiceName {
        service_name(&format!("isotherm/{self}/increment"))
    }

    /// `isotherm/<imu>/wake`.
    #[must_use]
    pub fn wake(&self) -> ServiceName {
        service_name(&format!("isotherm/{self}/wake"))
    }

    /// `isotherm/<imu>/arrival`.
    #[must_use]
    pub fn arrival(&self) -> ServiceName {
        service_name(&format!("isotherm/{self}/arrival"))
    }

    /// The streams for the rehearsals of its acquisition.
    #[must_use]
    pub fn rehearsal(&self) -> RehearsalNames {
        RehearsalNames::new(&format!("isotherm/{self}/rehearsal"))
    }
}

/// The names of the two streams over which one process rehearses.
#[derive(Clone, Debug)]
pub struct RehearsalNames {
    /// Carries raw samples.
    pub raw: ServiceName,
    /// Carries increments.
    pub increment: ServiceName,
}

impl RehearsalNames {
    fn new(start: &str) -> Self {
        let name = |stream: StreamKind| service_name(&format!("{start}/{}", stream.name()));
        Self { raw: name(StreamKind::Raw), increment: name(StreamKind::Increment) }
    }

    /// Those of a worker of the service.
    #[must_use]
    pub fn of_worker(index: usize) -> Self {
        Self::new(&format!("isotherm/rehearsal/{index}"))
    }
}

impl fmt::Display for ImuId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl core::str::FromStr for ImuId {
    type Err = InvalidName;
    fn from_str(name: &str) -> Result<Self, InvalidName> {
        Self::new(name).ok_or_else(|| InvalidName(name.to_owned()))
    }
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

/// A name that does not follow [`NAME_RULE`].
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
#[error("{0:?} is no valid name; give {NAME_RULE}")]
pub struct InvalidName(pub String);

fn is_name(name: &str) -> bool {
    let valid = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-' || byte == b'_';
    (1..=MAX_NAME).contains(&name.len()) && name.bytes().all(valid)
}

/// Separates one service and its clients from others: processes communicate only within one domain.
///
/// A domain is a name prefix for all shared memory objects, and a folder for the transport's files. A peer that does
/// not use this crate sets both in its iceoryx2 configuration; `isotherm status --json` prints them.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Domain {
    name: String,
    root: String,
}

/// Longest path of the root folder \[bytes\]: the operating system limits the paths of the sockets in it.
pub const MAX_ROOT: usize = 52;

impl Domain {
    /// Name of the domain if none is given.
    pub const DEFAULT: &'static str = "default";

    /// `name` follows [`NAME_RULE`]; `root` is the folder for the files of this domain only.
    ///
    /// # Errors
    /// [`DomainError`] for an invalid name, or a folder that is not absolute or longer than [`MAX_ROOT`].
    pub fn new(name: &str, root: &str) -> Result<Self, DomainError> {
        if !is_name(name) {
            return Err(DomainError::Name(InvalidName(name.to_owned())));
        }
        if !root.starts_with('/') || root.len() > MAX_ROOT || Path::new(root.as_bytes()).is_err() {
            return Err(DomainError::Root(root.to_owned()));
        }
        Ok(Self { name: name.to_owned(), root: root.to_owned() })
    }

    /// The domain's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Prefix of all shared memory objects of this domain: `isotherm_`, the first 8 hexadecimal digits of the SHA-256
    /// of the folder's path, and `_`. So it is short for every name, is not a prefix of another domain's prefix, and
    /// differs for the same name under another folder.
    #[must_use]
    pub fn prefix(&self) -> String {
        let digest = Sha256::digest(&self.root);
        let digits: String = digest.iter().take(4).map(|byte| format!("{byte:02x}")).collect();
        format!("isotherm_{digits}_")
    }

    /// Folder of all files of this domain.
    #[must_use]
    pub fn root_path(&self) -> &str {
        &self.root
    }

    /// The transport's configuration. It is explicit, so that no configuration file of iceoryx2 has an effect.
    ///
    /// # Errors
    /// Never for a valid domain.
    pub fn config(&self) -> Result<Config, DomainError> {
        let invalid = || DomainError::Root(self.root.clone());
        let mut config = Config::default();
        config.global.prefix = FileName::new(self.prefix().as_bytes()).map_err(|_| invalid())?;
        config.global.set_root_path(&Path::new(self.root.as_bytes()).map_err(|_| invalid())?);
        config.global.creation_timeout = CREATION_TIMEOUT;
        config.defaults.publish_subscribe.subscriber_expired_connection_buffer = VANISHED_PUBLISHERS;
        Ok(config)
    }
}

/// Why a domain cannot be used.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
pub enum DomainError {
    /// The name does not follow [`NAME_RULE`].
    #[error("domain: {0}")]
    Name(InvalidName),
    /// The folder cannot be used.
    #[error(
        "domain: the folder {0:?} must be absolute and at most {MAX_ROOT} characters; set ISOTHERM_ROOT to a shorter one"
    )]
    Root(String),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_checked() {
        for name in ["a", "imu-a_2", "0123456789abcdefghijklmnopqrstuv"] {
            assert_eq!(ImuId::new(name).unwrap().raw().as_str(), format!("isotherm/{name}/raw"));
        }
        for name in ["", "IMU", "a/b", "a b", "\u{e4}", "0123456789abcdefghijklmnopqrstuvw"] {
            assert_eq!(ImuId::new(name), None, "{name}");
            assert!(Domain::new(name, "/tmp").is_err());
        }
        assert!(matches!(Domain::new("x", "relative"), Err(DomainError::Root(_))));
        assert!(matches!(Domain::new("x", &format!("/{}", "r".repeat(60))), Err(DomainError::Root(_))));
        let prefix = |name: &str, root: &str| Domain::new(name, root).unwrap().prefix();
        assert_eq!(prefix("x", "/tmp/x").len(), "isotherm_01234567_".len());
        assert_ne!(prefix("x", "/tmp/x"), prefix("x", "/run/x"));
        assert_ne!(prefix("x", "/tmp/x"), prefix("x_y", "/tmp/x_y"));
    }
}
