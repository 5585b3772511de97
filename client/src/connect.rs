//! Joining a domain: where it is, how a process gets its node, and how long that may take.

use crate::error::{ConnectError, permission};
use crate::peers::publisher_of;
use crate::resources::{SHARED_MEMORY, check_folder, check_room};
use iceoryx2::node::NodeCreationFailure;
use iceoryx2::prelude::{NodeBuilder, SignalHandlingMode};
use isotherm_shared::stream::{self, CREATION_TIMEOUT, Domain, DomainError, ImuId, IpcNode};
use std::collections::HashMap;
use std::fs;
use std::io;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant, SystemTime};

/// Environment variable that names the domain.
pub const DOMAIN_VARIABLE: &str = "ISOTHERM_DOMAIN";
/// Environment variable with the folder under which domains keep their files.
pub const ROOT_VARIABLE: &str = "ISOTHERM_ROOT";
/// The folder used where it exists, as on an installed system.
const SYSTEM_ROOT: &str = "/run/isotherm";

/// Pause between two attempts to join.
const RETRY: Duration = Duration::from_millis(5);
/// A running service that does not serve an IMU for this long will not start to. One that finds leftovers of a killed
/// predecessor needs a second or two between its first stream and its last.
const PATIENCE: Duration = Duration::from_secs(3);

/// How to reach a service.
#[derive(Clone, Debug)]
pub struct Options {
    /// The world of service and clients.
    pub domain: Domain,
    /// How long connecting may take, waiting for a service that is not there yet included.
    pub timeout: Duration,
}

impl Options {
    /// The domain of the environment and a time-out of 5 s.
    ///
    /// # Errors
    /// If the environment names a domain or folder that cannot be used.
    pub fn from_environment() -> Result<Self, DomainError> {
        Ok(Self { domain: domain(None)?, timeout: Duration::from_secs(5) })
    }
}

/// The domain `name`, or the one of `ISOTHERM_DOMAIN`, or `default`.
///
/// Its files lie in `$ISOTHERM_ROOT/NAME`; without that variable in `/run/isotherm/NAME` where `/run/isotherm` exists,
/// else in `/tmp/isotherm-NAME`.
///
/// # Errors
/// If name or folder cannot be used.
pub fn domain(name: Option<&str>) -> Result<Domain, DomainError> {
    // What is not UTF-8 is no domain's name, and refused as such.
    let from_environment = std::env::var_os(DOMAIN_VARIABLE).map(|name| name.to_string_lossy().into_owned());
    let from_environment = from_environment.filter(|name| !name.is_empty());
    let name = name.map(str::to_owned).or(from_environment).unwrap_or_else(|| Domain::DEFAULT.to_owned());
    let root = match std::env::var(ROOT_VARIABLE) {
        Ok(root) if !root.is_empty() => {
            // Two spellings of a folder are one folder, and one domain.
            let canonical = fs::canonicalize(&root).ok().and_then(|path| path.into_os_string().into_string().ok());
            format!("{}/{name}", canonical.unwrap_or(root).trim_end_matches('/'))
        }
        _ if Path::new(SYSTEM_ROOT).is_dir() => format!("{SYSTEM_ROOT}/{name}"),
        _ => format!("/tmp/isotherm-{name}"),
    };
    Domain::new(&name, &root)
}

/// As [`join`], but only if a service has been there: a client leaves no trace in a domain that does not exist.
///
/// # Errors
/// [`ConnectError::NoService`] besides those of [`join`].
pub fn join_existing(domain: &Domain) -> Result<IpcNode, ConnectError> {
    check_owner(domain)?;
    match fs::exists(format!("{}/services", domain.root_path())) {
        Ok(false) => Err(ConnectError::NoService(domain.name().to_owned())),
        Ok(true) | Err(_) => join(domain),
    }
}

/// Gives this process a place in `domain`, after sweeping away what others left half-created.
///
/// # Errors
/// [`ConnectError::Permission`], [`ConnectError::Domain`] or [`ConnectError::Transport`].
pub fn join(domain: &Domain) -> Result<IpcNode, ConnectError> {
    check_owner(domain)?;
    check_room(0)?;
    check_folder(domain)?;
    sweep_half_created(domain);
    let config = domain.config()?;
    let node = NodeBuilder::new().config(&config).signal_handling_mode(SignalHandlingMode::Disabled);
    node.create().map_err(|error| match error {
        NodeCreationFailure::InsufficientPermissions => permission(domain),
        other => ConnectError::transport("creating a node", format!("{other:?}")),
    })
}

/// Whether the domain, if it exists, belongs to this process's user. Even root gets nothing out of another user's.
///
/// # Errors
/// [`ConnectError::Permission`] if not.
pub fn check_owner(domain: &Domain) -> Result<(), ConnectError> {
    match fs::metadata(domain.root_path()) {
        Ok(metadata) if !metadata.is_dir() => {
            let cause = format!("{} is not a folder; remove it, or use another --domain", domain.root_path());
            Err(ConnectError::transport("joining the domain", cause))
        }
        Ok(metadata) if metadata.permissions().mode() & 0o002 != 0 => {
            let cause = format!("everybody may write {0}; chmod o-w {0}", domain.root_path());
            Err(ConnectError::transport("joining the domain", cause))
        }
        Ok(metadata) if metadata.uid() != rustix::process::geteuid().as_raw() => Err(permission(domain)),
        Err(error) if error.kind() == io::ErrorKind::PermissionDenied => Err(permission(domain)),
        _ => Ok(()),
    }
}

/// Removes shared memory objects of `domain` that a process created and died before giving them a size.
///
/// Such an object stays at mode 0200 for ever, and the transport waits for it without bound. One counts as left behind
/// when it is older than twice the transport's creation time-out; for younger ones this waits that long.
pub fn sweep_half_created(domain: &Domain) {
    let limit = 2 * CREATION_TIMEOUT;
    let mut seen: HashMap<PathBuf, Instant> = HashMap::new();
    loop {
        let mut waiting = false;
        for (path, age) in in_mode(SHARED_MEMORY, &domain.prefix(), 0o200) {
            // An age from a clock that was stepped says nothing; having watched it for the limit does.
            let watched = seen.entry(path.clone()).or_insert_with(Instant::now).elapsed();
            if age.is_some_and(|age| age > limit) || watched > limit {
                let _ = fs::remove_file(path);
            } else {
                waiting = true;
            }
        }
        if !waiting {
            return;
        }
        thread::sleep(RETRY);
    }
}

/// The files of `folder` with `prefix` whose permissions are exactly `mode`, with their ages.
pub fn in_mode(folder: &str, prefix: &str, mode: u32) -> Vec<(PathBuf, Option<Duration>)> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let ours = entries.filter(|entry| entry.file_name().as_encoded_bytes().starts_with(prefix.as_bytes()));
    ours.filter_map(|entry| {
        let metadata = entry.metadata().ok()?;
        let age = metadata.modified().ok().and_then(|modified| SystemTime::now().duration_since(modified).ok());
        (metadata.permissions().mode() & 0o777 == mode).then(|| (entry.path(), age))
    })
    .collect()
}

/// The moment after which `timeout` has passed; far away if it is too long for the clock.
pub(crate) fn deadline(timeout: Duration) -> Instant {
    let now = Instant::now();
    now.checked_add(timeout).unwrap_or(now + Duration::from_secs(1 << 30))
}

/// Tries until it works, the error is final, or the deadline has passed.
pub(crate) fn until<T>(
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
        let hopeless = match error {
            ConnectError::Permission { .. } | ConnectError::Domain(_) | ConnectError::Exhausted(_) => true,
            ConnectError::NoSuchImu { .. } => now.duration_since(*unserved_since.get_or_insert(now)) > PATIENCE,
            _ => {
                unserved_since = None;
                false
            }
        };
        if hopeless || now >= deadline {
            return Err(error);
        }
        thread::sleep(RETRY);
    }
}

/// What it means that a stream of `imu` does not exist.
pub(crate) fn absent(node: &IpcNode, domain: &Domain, imu: &ImuId) -> ConnectError {
    let serving = node.service_builder(&stream::status_name()).publish_subscribe::<[u8]>().open();
    match serving {
        Ok(status) if publisher_of(&status).is_some() => {
            ConnectError::NoSuchImu { imu: imu.clone(), domain: domain.name().to_owned() }
        }
        _ => ConnectError::NoService(domain.name().to_owned()),
    }
}
