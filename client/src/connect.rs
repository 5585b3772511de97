//! Joining a domain: where its files are, how a process gets its node, and how long connecting may take.

use crate::error::{ConnectError, permission};
use crate::folder::{self, check_owner};
use crate::kept::MOST_KEPT;
use crate::lag_option::LagOption;
use crate::objects::{OwnFile, domain_files, refuse_foreign, removed_memory, sweep};
use crate::peers::{payload_of, publisher_of, register_own};
use crate::resources::{check_memory, check_room};
use crate::source_pulses::SourcePulses;
use crate::transport::own_static::close_on_exec;
use crate::transport::stream::{self, IpcNode};
use iceoryx2::node::NodeCreationFailure;
use iceoryx2::prelude::{NodeBuilder, ServiceName, SignalHandlingMode};
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use isotherm_shared::names::{Domain, DomainError, ImuId};
use isotherm_shared::readings::Resolution;
use isotherm_support::failure::shown;
use std::path::Path;
use std::time::{Duration, Instant};
use std::{fs, thread};

/// Environment variable that names the domain.
pub const DOMAIN_VARIABLE: &str = "ISOTHERM_DOMAIN";
/// Environment variable that names the parent of the domains' folders.
pub const ROOT_VARIABLE: &str = "ISOTHERM_ROOT";
/// Environment variable that names the folder in which services keep the tables in force.
pub const STATE_VARIABLE: &str = "ISOTHERM_STATE";
/// Parent of the domains' folders if it exists, as on an installed system.
const SYSTEM_ROOT: &str = "/run/isotherm";

/// Pause between two attempts to join.
const RETRY: Duration = Duration::from_millis(5);
/// If a running service does not serve an IMU after this long, connecting fails. A service that finds leftovers of a
/// killed predecessor needs a second or two between its first stream and its last.
const UNSERVED_LIMIT: Duration = Duration::from_secs(3);

/// How to reach a service, and what an acquisition reports to it. Readers use domain and time-out.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_client::{LagOption, Options, TimeConstant, domain};
/// use std::time::Duration;
///
/// let options = Options {
///     serial: Some("SN 42".to_owned()),
///     lag: LagOption::Fixed(TimeConstant::from_seconds(240.0)?),
///     ..Options::new(domain(Some("bench"))?, Duration::from_secs(2))
/// };
/// assert_eq!(options.domain.name(), "bench");
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct Options {
    /// The domain of service and clients.
    pub domain: Domain,
    /// How long connecting may take. This includes waiting for a service that has not started yet.
    pub timeout: Duration,
    /// Serial number of the device whose samples an acquisition sends; `None` if it is not known. The service flags
    /// samples of another device than the table's. Outer blanks do not count.
    pub serial: Option<String>,
    /// Which time constant the lagged temperature of an acquisition has.
    pub lag: LagOption,
    /// What one pulse over the nominal interval of the table stands for, of an acquisition whose samples are readings
    /// in m/s2 and rad/s: then [`Acquisition::fill`](crate::Acquisition::fill) makes its pulses. `None`: the samples
    /// have pulses of their own.
    pub resolution: Option<Resolution>,
    /// What the pulses are of an acquisition that makes them by itself. They are compared with the table in force;
    /// `None`: they are not.
    pub pulses: Option<SourcePulses>,
    /// How many control periods of an acquisition wait at most for a service that has no room or is away, 1 to 2^20:
    /// [`MOST_KEPT`] unless given. A number outside is taken for the nearest inside. Each takes 256 bytes, which are
    /// allocated when the acquisition connects.
    pub kept: usize,
}

impl Options {
    /// This domain and time-out; no serial number, and the time constant of the service.
    #[must_use]
    pub const fn new(domain: Domain, timeout: Duration) -> Self {
        Self { domain, timeout, serial: None, lag: LagOption::Service, resolution: None, pulses: None, kept: MOST_KEPT }
    }

    /// As [`new`](Self::new), with the domain of the environment variables and a time-out of 5 s.
    ///
    /// # Errors
    /// If they name a domain or folder that cannot be used.
    pub fn from_environment() -> Result<Self, DomainError> {
        Ok(Self::new(domain(None)?, Duration::from_secs(5)))
    }
}

/// The domain `name`; without a name the one of `ISOTHERM_DOMAIN`, otherwise `default`.
///
/// Its folder is `$ISOTHERM_ROOT/NAME`. Without that variable it is `/run/isotherm/NAME` if `/run/isotherm` exists,
/// otherwise `/tmp/isotherm-NAME`.
///
/// ```
/// use isotherm_client::domain;
///
/// assert!(domain(Some("bench-2")).is_ok_and(|domain| domain.root_path().ends_with("bench-2")));
/// assert!(domain(Some("no blanks")).is_err());
/// ```
///
/// # Errors
/// If the name or the folder cannot be used.
pub fn domain(name: Option<&str>) -> Result<Domain, DomainError> {
    // A value that is not UTF-8 becomes an invalid name, which `Domain::new` refuses.
    let from_environment = std::env::var_os(DOMAIN_VARIABLE).map(|name| name.to_string_lossy().into_owned());
    let from_environment = from_environment.filter(|name| !name.is_empty());
    let name = name.map(str::to_owned).or(from_environment).unwrap_or_else(|| Domain::DEFAULT.to_owned());
    let root = match std::env::var(ROOT_VARIABLE) {
        Ok(root) if !root.is_empty() => {
            // Different paths of the same folder must give the same domain.
            let canonical = fs::canonicalize(&root).ok().and_then(|path| path.into_os_string().into_string().ok());
            format!("{}/{name}", canonical.unwrap_or(root).trim_end_matches('/'))
        }
        _ if Path::new(SYSTEM_ROOT).is_dir() => format!("{SYSTEM_ROOT}/{name}"),
        _ => format!("/tmp/isotherm-{name}"),
    };
    Domain::new(&name, &root)
}

/// As [`join`], but only if a service has used the domain: a client creates nothing in a domain that does not exist.
///
/// # Errors
/// [`ConnectError::NoService`] and [`ConnectError::OtherMemory`] in addition to those of [`join`].
pub fn join_existing(domain: &Domain) -> Result<IpcNode, ConnectError> {
    check_domain(domain)?;
    check_memory(domain)?;
    match fs::exists(format!("{}/services", domain.root_path())) {
        Ok(false) => Err(ConnectError::NoService(domain.name().to_owned())),
        Ok(true) | Err(_) => join(domain),
    }
}

/// Makes this process a member of `domain`, after [`sweep_half_created`].
///
/// # Errors
/// [`ConnectError::Permission`], [`ConnectError::Foreign`], [`ConnectError::Domain`] or [`ConnectError::Transport`].
pub fn join(domain: &Domain) -> Result<IpcNode, ConnectError> {
    folder::prepare(domain)?;
    check_room(0)?;
    sweep_half_created(domain)?;
    refuse_foreign(domain)?;
    let config = stream::configuration(domain)?;
    let node = NodeBuilder::new().config(&config).signal_handling_mode(SignalHandlingMode::Disabled);
    let node = node.create().map_err(|error| match error {
        NodeCreationFailure::InsufficientPermissions => permission(domain, None),
        other => ConnectError::transport("creating a node", format!("{other:?}")),
    })?;
    register_own(&node);
    // The files by which others see that this process lives.
    let monitor = format!("{}.node_monitor", node.id().value());
    close_on_exec(|name| name.contains(&monitor));
    domain_files(domain).for_each(|file| file.close_to_others());
    Ok(node)
}

/// Checks that `domain`, if it exists, is this user's, and that no other user's object is in the place of a stream.
///
/// # Errors
/// [`ConnectError::Permission`], [`ConnectError::Foreign`] or [`ConnectError::Transport`].
pub fn check_domain(domain: &Domain) -> Result<(), ConnectError> {
    check_owner(domain)?;
    refuse_foreign(domain)
}

/// Removes objects of `domain` whose creator died before it set their size.
///
/// Such an object keeps mode 0200 for ever, and the transport waits for it without limit. An object counts as left
/// behind when it is older than twice the transport's creation time-out. Waits until each younger object is complete or
/// has reached this age, but no longer than two seconds. Objects of other users do not count.
///
/// # Errors
/// [`ConnectError::Transport`] if at the end of that time there still is a half-created object.
pub fn sweep_half_created(domain: &Domain) -> Result<(), ConnectError> {
    let half_created = || domain_files(domain).filter(OwnFile::is_half_created);
    sweep(half_created, |path| drop(fs::remove_file(path))).map_err(|path| {
        let cause = format!("processes of this user keep creating objects, the last one {}", shown(&path));
        ConnectError::transport("joining the domain", cause)
    })
}

/// The time when `timeout` has passed; decades ahead if the clock cannot represent it.
pub(crate) fn deadline(timeout: Duration) -> Instant {
    let now = Instant::now();
    now.checked_add(timeout).unwrap_or(now + Duration::from_secs(1 << 30))
}

/// Repeats `attempt` until it succeeds, its error is permanent, or the deadline has passed.
pub(crate) fn retry_until<T>(
    deadline: Instant,
    mut attempt: impl FnMut() -> Result<T, ConnectError>,
) -> Result<T, ConnectError> {
    let mut unserved_since = None;
    loop {
        let error = match attempt() {
            Ok(value) => return Ok(value),
            Err(error) => error,
        };
        let now = Instant::now();
        let permanent = match error {
            ref error if error.is_permanent() => true,
            ConnectError::NoSuchImu { .. } => now.duration_since(*unserved_since.get_or_insert(now)) > UNSERVED_LIMIT,
            _ => {
                unserved_since = None;
                false
            }
        };
        if permanent || now >= deadline {
            return Err(error);
        }
        thread::sleep(RETRY);
    }
}

/// The error for a stream of `imu` that could not be opened.
pub(crate) fn unopened(
    node: &IpcNode,
    domain: &Domain,
    imu: &ImuId,
    stream: &ServiceName,
    error: PublishSubscribeOpenError,
) -> ConnectError {
    match error {
        PublishSubscribeOpenError::DoesNotExist => absent(node, domain, imu),
        PublishSubscribeOpenError::InsufficientPermissions => permission(domain, None),
        PublishSubscribeOpenError::IncompatibleTypes => ConnectError::OtherVersion {
            domain: domain.name().to_owned(),
            payload: payload_of(node, stream).unwrap_or_else(|| "unknown".to_owned()),
            stream: stream.to_string(),
        },
        other => {
            let cause = removed_memory(domain).unwrap_or_else(|| other.to_string());
            ConnectError::transport("opening the stream", cause)
        }
    }
}

/// The error for a stream of `imu` that does not exist: the service does not serve the IMU, or no service is running.
pub(crate) fn absent(node: &IpcNode, domain: &Domain, imu: &ImuId) -> ConnectError {
    let serving = stream::open_status(node);
    match serving {
        Ok(status) if publisher_of(&status).is_some() => {
            ConnectError::NoSuchImu { imu: imu.clone(), domain: domain.name().to_owned() }
        }
        _ => ConnectError::NoService(domain.name().to_owned()),
    }
}
