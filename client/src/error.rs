//! Why a process could not connect, and the exit code of a program for each reason.

use crate::peers::{Peers, named, subscribers_of};
use crate::transport::own_storage::{SHARED_MEMORY, refused_bytes};
use crate::transport::stream::Ipc;
use core::fmt;
use iceoryx2::prelude::{IceoryxSend, PortFactory as _};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use isotherm_shared::names::{Domain, DomainError, ImuId};
#[cfg(feature = "failure")]
use isotherm_support::failure::{Exit, Failure};
use rustix::fs::statvfs;

/// Why a process could not connect.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
pub enum ConnectError {
    /// No service runs in this domain.
    #[error(
        "no service is running in domain {0:?}; start one with `isotherm serve --domain {0} --imu ID=TABLE`, or name its domain with --domain or ISOTHERM_DOMAIN"
    )]
    NoService(String),
    /// The service runs, but not for this IMU.
    #[error("the service of domain {domain:?} does not serve IMU {imu}; `isotherm status` lists those that it serves")]
    NoSuchImu {
        /// The requested IMU.
        imu: ImuId,
        /// The domain.
        domain: String,
    },
    /// Another process is this IMU's acquisition.
    #[error("IMU {imu} already has an acquisition process, {}; stop that one first", named(*pid))]
    Occupied {
        /// The requested IMU.
        imu: ImuId,
        /// Process id of the other acquisition as this process sees it; `None` if that is in another pid namespace.
        pid: Option<i32>,
    },
    /// The stream has no room for another reader.
    #[error("IMU {imu}: all {places} reader places are taken, by {readers}; stop one of them")]
    NoRoom {
        /// The requested IMU.
        imu: ImuId,
        /// Number of reader places.
        places: usize,
        /// The readers.
        readers: Peers,
    },
    /// The domain belongs to another user.
    #[error(
        "domain {domain:?} belongs to another user ({}); run as the service's user, use another --domain, or name a folder of your own \
         in ISOTHERM_ROOT",
        made_by.map_or_else(|| format!("{root} or its shared memory cannot be opened"), |uid| format!("user {uid} made {root}"))
    )]
    Permission {
        /// The domain.
        domain: String,
        /// Its folder.
        root: String,
        /// The number of the user who made the folder, if that is known.
        made_by: Option<u32>,
    },
    /// Something of the domain is another user's, or others could put something of theirs into its place. The message
    /// contains the remedy.
    #[error("joining the domain: {0}")]
    Foreign(String),
    /// The domain cannot be used.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// Shared memory, disk space or file descriptors are exhausted. The message contains the remedy.
    #[error("{0}")]
    Exhausted(String),
    /// A process of another version of Isotherm has made the stream: its payload has another type.
    #[error(
        "stream {stream} is of another version of Isotherm, with the payload {payload}; build service and clients from one version, stop \
         all processes of domain {domain:?}, and start the service first"
    )]
    OtherVersion {
        /// Name of the stream.
        stream: String,
        /// The domain.
        domain: String,
        /// Type name of the stream's payload.
        payload: String,
    },
    /// The service's `CLOCK_MONOTONIC` is not this process's, so that no time of it can be used.
    #[error(
        "the service's clock (CLOCK_MONOTONIC) is {} s {} this process's: they are in different time namespaces, as of containers; run \
         both in one",
        ahead_ns.unsigned_abs() as f64 / 1e9,
        if *ahead_ns < 0 { "behind" } else { "ahead of" }
    )]
    OtherClock {
        /// How far the service's clock is ahead \[ns\].
        ahead_ns: i64,
    },
    /// The readings of the acquisition cannot be pulses of the table in force. The message contains the remedy.
    #[error("the readings do not fit the table of IMU {imu}: {cause}")]
    Pulses {
        /// The requested IMU.
        imu: ImuId,
        /// Why.
        cause: String,
    },
    /// The service's shared memory is not this process's.
    #[error(
        "the service has another {SHARED_MEMORY} than this process: they are in different mount namespaces, as of containers; give both the \
         same one, as with --ipc=host or --volume {SHARED_MEMORY}:{SHARED_MEMORY}"
    )]
    OtherMemory,
    /// Any other error of the transport.
    #[error(
        "transport: {phase}: {cause}; {remedy}",
        remedy = "if it persists, stop all processes of the domain and restart the service"
    )]
    Transport {
        /// The operation, for example "opening the streams".
        phase: &'static str,
        /// The message of iceoryx2.
        cause: String,
    },
}

/// The error of the last object that this thread created, if shared memory was full.
#[must_use]
pub fn shortage() -> Option<ConnectError> {
    Some(refused_bytes()).filter(|needed| *needed > 0).map(shared_memory_full)
}

pub(crate) fn free_shared_memory() -> Option<u64> {
    statvfs(SHARED_MEMORY).ok().filter(|found| found.f_blocks > 0).map(|found| found.f_bavail * found.f_frsize)
}

pub(crate) fn shared_memory_full(needed: u64) -> ConnectError {
    let kb = |bytes: u64| bytes.div_ceil(1024);
    ConnectError::Exhausted(format!(
        "shared memory {SHARED_MEMORY} is full: {} kB free, {} kB needed; remove what is not needed there (`isotherm clean` removes what a \
         domain has left), or enlarge it (mount -o remount,size=..)",
        kb(free_shared_memory().unwrap_or(0)),
        kb(needed)
    ))
}

impl ConnectError {
    pub(crate) fn no_room<T: IceoryxSend + fmt::Debug>(
        domain: &Domain,
        imu: &ImuId,
        stream: &PortFactory<Ipc, T, ()>,
    ) -> Self {
        let places = stream.static_config().max_subscribers();
        Self::NoRoom { imu: imu.clone(), places, readers: subscribers_of(domain, stream) }
    }

    /// Whether connecting cannot succeed by waiting: an operator must change something first.
    #[must_use]
    pub const fn is_permanent(&self) -> bool {
        matches!(
            self,
            Self::Permission { .. }
                | Self::Domain(_)
                | Self::Exhausted(_)
                | Self::OtherVersion { .. }
                | Self::OtherClock { .. }
                | Self::OtherMemory
                | Self::Pulses { .. }
        )
    }

    pub(crate) fn transport(phase: &'static str, cause: impl ToString) -> Self {
        shortage().unwrap_or_else(|| Self::Transport { phase, cause: cause.to_string() })
    }
}

pub(crate) fn permission(domain: &Domain, made_by: Option<u32>) -> ConnectError {
    ConnectError::Permission { domain: domain.name().to_owned(), root: domain.root_path().to_owned(), made_by }
}

#[cfg(feature = "failure")]
impl From<ConnectError> for Failure {
    fn from(error: ConnectError) -> Self {
        let exit = match error {
            ConnectError::NoService(_)
            | ConnectError::NoSuchImu { .. }
            | ConnectError::OtherVersion { .. }
            | ConnectError::OtherClock { .. }
            | ConnectError::OtherMemory => Exit::Unavailable,
            ConnectError::Domain(_) => Exit::Usage,
            ConnectError::Pulses { .. } => Exit::Config,
            ConnectError::Exhausted(_) => Exit::Io,
            ConnectError::Permission { .. } | ConnectError::Foreign(_) => Exit::OtherUser,
            ConnectError::Occupied { .. } | ConnectError::NoRoom { .. } | ConnectError::Transport { .. } => {
                Exit::Failed
            }
        };
        Self::new(exit, error.to_string())
    }
}
