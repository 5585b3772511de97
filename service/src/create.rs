//! Creating streams, even if a killed process has left some half-created.
//!
//! Only the service creates streams. A process that is killed while it creates one leaves it half-created, and the
//! transport never removes it. This module removes a stream that is still half-created after twice the transport's
//! creation time-out. After any other temporary error it tries again for a bounded time.

use crate::leftovers::{self, Port, ports_of};
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::prelude::{IceoryxSend, ServiceName};
use iceoryx2::service::builder::event::{EventCreateError, EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeCreateError, PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::port_factory::publish_subscribe;
use isotherm_client::transport::nodes;
use isotherm_client::transport::stream::{CREATION_TIMEOUT, Ipc, IpcNode};
use isotherm_client::{OwnFile, foreign_object, own_files, payload_of, shortage, sweep};
use isotherm_shared::names::Domain;
use isotherm_support::failure::{Exit, Failure, shown};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use std::{fmt, fs, thread};

/// How long creating one stream may take.
const CREATE_TIMEOUT: Duration = Duration::from_secs(3);
/// How long freeing the place of a dead process may take.
const PLACE_TIMEOUT: Duration = Duration::from_secs(1);

/// Why an attempt to create a stream or port has failed.
pub enum CreateError {
    /// One of its files is half-created. The process that creates it may still be at work or may be dead.
    HalfCreated,
    /// Other processes are creating or removing it, or died while they did.
    InFlux,
    /// All places are taken, by these ports.
    Taken(Vec<Port>),
    /// It exists with another payload.
    OtherPayload,
    /// It exists with other settings.
    Incompatible(String),
    /// Anything else.
    Other(String),
}

/// Creates streams and ports of one process in one domain.
pub struct Creator<'a> {
    node: &'a IpcNode,
    domain: &'a Domain,
}

impl<'a> Creator<'a> {
    /// For the process with this node.
    pub const fn new(node: &'a IpcNode, domain: &'a Domain) -> Self {
        Self { node, domain }
    }

    /// Creates a stream. `name` is its name for the operator, `stream` its name in the transport.
    ///
    /// # Errors
    /// What still prevents it after `CREATE_TIMEOUT`.
    pub fn stream<T>(
        &self,
        name: &str,
        stream: &ServiceName,
        attempt: impl FnMut() -> Result<T, CreateError>,
    ) -> Result<T, Failure> {
        self.create(name, Some(stream), &|| "its places are taken".to_owned(), attempt)
    }

    /// Creates a port of a stream. `name` is its name for the operator. `taken` makes the message for a place that
    /// stays taken: cause and remedy.
    ///
    /// # Errors
    /// What still prevents it after `CREATE_TIMEOUT`; after `PLACE_TIMEOUT` if its place is taken.
    pub fn port<T>(
        &self,
        name: &str,
        taken: impl Fn() -> String,
        attempt: impl FnMut() -> Result<T, CreateError>,
    ) -> Result<T, Failure> {
        self.create(name, None, &taken, attempt)
    }

    /// Tries until it succeeds, the error is permanent, or the time is over.
    fn create<T>(
        &self,
        name: &str,
        stream: Option<&ServiceName>,
        taken: &dyn Fn() -> String,
        mut attempt: impl FnMut() -> Result<T, CreateError>,
    ) -> Result<T, Failure> {
        let (node, domain) = (self.node, self.domain);
        let failed = |cause: &str| Err(failed(name, domain, cause));
        let started = Instant::now();
        loop {
            let error = match attempt() {
                Ok(value) => return Ok(value),
                Err(error) => error,
            };
            let waited = started.elapsed();
            match error {
                CreateError::HalfCreated if waited < CREATE_TIMEOUT => remove_half_created(domain),
                CreateError::InFlux if waited < CREATE_TIMEOUT => {
                    nodes::clean_within(node, Duration::from_millis(100));
                    if waited > 2 * CREATION_TIMEOUT
                        && let Some(stream) = stream
                    {
                        remove_half_removed(domain, stream);
                    }
                }
                CreateError::Taken(ports) => {
                    if waited > PLACE_TIMEOUT {
                        return Err(Failure::new(Exit::Failed, taken()));
                    }
                    nodes::clean(node);
                    // First the transport gets the chance to free the place by itself.
                    if waited > PLACE_TIMEOUT / 4 {
                        leftovers::remove_dead(domain, node, &ports);
                    }
                }
                CreateError::OtherPayload => {
                    let payload = stream.and_then(|stream| payload_of(node, stream));
                    return Err(other_payload(name, domain, payload.as_deref().unwrap_or("unknown")));
                }
                CreateError::Incompatible(cause) => return Err(other_settings(name, domain, &cause)),
                CreateError::HalfCreated => return failed("it stays half-created"),
                CreateError::InFlux => return failed("other processes keep changing it"),
                CreateError::Other(cause) => return failed(&cause),
            }
            thread::sleep(Duration::from_millis(10));
        }
    }
}

fn other_settings(name: &str, domain: &Domain, cause: &str) -> Failure {
    let domain = domain.name();
    Failure::new(
        Exit::Failed,
        format!(
            "creating {name}: another process has created it with other settings ({cause}); stop all processes of domain {domain:?} and \
             start the service first"
        ),
    )
}

fn other_payload(name: &str, domain: &Domain, payload: &str) -> Failure {
    if !payload.starts_with("isotherm.") {
        return other_settings(name, domain, &format!("payload {payload}"));
    }
    let domain = domain.name();
    Failure::new(
        Exit::Unavailable,
        format!(
            "creating {name}: a process of another version of Isotherm uses it, with the payload {payload}; stop all processes of domain \
             {domain:?}, replace those of the other version, and start the service first"
        ),
    )
}

fn failed(name: &str, domain: &Domain, cause: &str) -> Failure {
    if let Some(full) = shortage() {
        return full.into();
    }
    let (root, prefix) = (domain.root_path(), domain.prefix());
    let foreign = foreign_object(domain);
    let foreign =
        foreign.map(|path| format!(" ({} is not this user's: its owner or root can remove it)", shown(&path)));
    let foreign = foreign.unwrap_or_default();
    Failure::new(
        Exit::Failed,
        format!(
            "creating {name}: {cause}; if nothing of domain {:?} runs, remove {root} and /dev/shm/{prefix}* and start again{foreign}",
            domain.name()
        ),
    )
}

/// Removes a service's file if it is still unreadable long after its creation began ([`sweep`]), or if its shared
/// memory is gone: a process that removes a service removes the memory first, and this one was killed before it removed
/// the file.
pub fn remove_half_created(domain: &Domain) {
    let (folder, prefix) = (format!("{}/services", domain.root_path()), domain.prefix());
    let remove = |path: &Path| {
        tracing::warn!(path = %path.display(), "removing a stream that is half-created, or whose memory is gone");
        let _ = fs::remove_file(path);
    };
    // One that stays is reported when its stream is created.
    let _ = sweep(|| own_files(&folder, &prefix).filter(|file| file.mode() == 0o600), remove);
    for file in own_files(&folder, &prefix).filter(|file| file.mode() == 0o400) {
        if ServiceFile::read(&file.path).is_some_and(|service| service.memory(&prefix).is_none()) {
            remove(&file.path);
        }
    }
}

/// Removes what is left of a stream that is unusable and stays: its last user was killed after it had marked the stream
/// for destruction.
fn remove_half_removed(domain: &Domain, stream: &ServiceName) {
    let (folder, prefix) = (format!("{}/services", domain.root_path()), domain.prefix());
    for OwnFile { path, .. } in own_files(folder, &prefix).filter(|file| file.mode() == 0o400) {
        let Some(file) = ServiceFile::read(&path).filter(|file| file.service_name == stream.as_str()) else {
            continue;
        };
        tracing::warn!(path = %path.display(), "removing a stream that a killed process left half-removed");
        // The memory first, as the transport does it.
        file.memory(&prefix).into_iter().chain([path]).for_each(|path| drop(fs::remove_file(path)));
    }
}

/// The fields that are read from the file that the transport writes for a service.
#[derive(Deserialize)]
struct ServiceFile {
    service_name: String,
    unique_service_id: ServiceId,
}

#[derive(Deserialize)]
struct ServiceId {
    payload_value: u64,
    unique_value: u64,
}

impl ServiceFile {
    fn read(path: &Path) -> Option<Self> {
        toml::from_str(&fs::read_to_string(path).ok()?).ok()
    }

    /// The service's object in shared memory.
    fn memory(&self, prefix: &str) -> Option<PathBuf> {
        let ServiceId { payload_value, unique_value } = self.unique_service_id;
        let ending = format!("_{}.dynamic", (u128::from(unique_value) << 64) | u128::from(payload_value));
        let mut objects = own_files("/dev/shm", prefix).map(|object| object.path);
        objects.find(|path| path.to_str().is_some_and(|path| path.ends_with(&ending)))
    }
}

impl From<PublishSubscribeOpenOrCreateError> for CreateError {
    fn from(error: PublishSubscribeOpenOrCreateError) -> Self {
        use PublishSubscribeCreateError as Create;
        use PublishSubscribeOpenError as Open;
        use PublishSubscribeOpenOrCreateError as Either;
        match error {
            Either::PublishSubscribeOpenError(Open::HangsInCreation)
            | Either::PublishSubscribeCreateError(Create::HangsInCreation) => Self::HalfCreated,
            Either::SystemInFlux
            | Either::PublishSubscribeOpenError(
                Open::ServiceInCorruptedState | Open::IsMarkedForDestruction | Open::DoesNotExist,
            )
            | Either::PublishSubscribeCreateError(
                Create::ServiceInCorruptedState | Create::AlreadyExists | Create::IsBeingCreatedByAnotherInstance,
            ) => Self::InFlux,
            Either::PublishSubscribeOpenError(Open::IncompatibleTypes) => Self::OtherPayload,
            Either::PublishSubscribeOpenError(
                cause @ (Open::IncompatibleMessagingPattern
                | Open::IncompatibleOverflowBehavior
                | Open::DoesNotSupportRequestedMinBufferSize
                | Open::DoesNotSupportRequestedMinHistorySize
                | Open::DoesNotSupportRequestedMinSubscriberBorrowedSamples
                | Open::DoesNotSupportRequestedAmountOfPublishers
                | Open::DoesNotSupportRequestedAmountOfSubscribers
                | Open::DoesNotSupportRequestedAmountOfNodes
                | Open::VersionMismatch),
            ) => Self::Incompatible(format!("{cause:?}")),
            other => Self::Other(other.to_string()),
        }
    }
}

impl From<EventOpenOrCreateError> for CreateError {
    fn from(error: EventOpenOrCreateError) -> Self {
        use EventCreateError as Create;
        use EventOpenError as Open;
        use EventOpenOrCreateError as Either;
        match error {
            Either::EventOpenError(Open::HangsInCreation) => Self::HalfCreated,
            Either::SystemInFlux
            | Either::EventOpenError(
                Open::ServiceInCorruptedState | Open::IsMarkedForDestruction | Open::DoesNotExist,
            )
            | Either::EventCreateError(
                Create::ServiceInCorruptedState | Create::AlreadyExists | Create::IsBeingCreatedByAnotherInstance,
            ) => Self::InFlux,
            Either::EventOpenError(
                cause @ (Open::IncompatibleMessagingPattern
                | Open::DoesNotSupportRequestedAmountOfListeners
                | Open::DoesNotSupportRequestedAmountOfNotifiers
                | Open::DoesNotSupportRequestedAmountOfNodes
                | Open::VersionMismatch),
            ) => Self::Incompatible(format!("{cause:?}")),
            other => Self::Other(other.to_string()),
        }
    }
}

impl CreateError {
    /// The reason why a publisher of `stream` was not created.
    pub fn of_publisher<T: IceoryxSend + fmt::Debug + ?Sized>(
        error: PublisherCreateError,
        stream: &publish_subscribe::PortFactory<Ipc, T, ()>,
    ) -> Self {
        match error {
            PublisherCreateError::ExceedsMaxSupportedPublishers => Self::Taken(ports_of(stream)),
            other => Self::Other(other.to_string()),
        }
    }
}
