//! How a process finds out that it is cut off from the others though none of them has died.
//!
//! systemd-logind unlinks the shared memory of a login user at logout, and people tidy `/dev/shm`. Processes that are
//! connected go on with what they have, but no new one reaches them. And another user who watches `/dev/shm` can make
//! the object of a connection before the processes that it is for.

use crate::objects::{SHARED_MEMORY, entries, is_own, memory_name};
use crate::peers::{is_own_node, monitor};
use crate::transport::stream::IpcNode;
use core::fmt;
use iceoryx2::service::service_hash::ServiceHash;
use isotherm_shared::names::Domain;
use isotherm_support::failure::shown;
use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What has cut a process off.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(crate) enum Loss {
    /// An object that it has open was removed.
    Removed(PathBuf),
    /// Another user has made the object of one of its connections first.
    Taken(PathBuf),
    /// No answer has come for this long, and the service lives.
    Silence(Duration),
}

impl fmt::Display for Loss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Removed(path) => write!(
                f,
                "{} was removed under the running processes: by systemd-logind at a logout (RemoveIPC), or by \
                 another process that cleaned up",
                shown(path)
            ),
            Self::Taken(path) => write!(f, "another user has made {} first", shown(path)),
            Self::Silence(time) => write!(f, "the service has not answered for {} s", time.as_secs()),
        }
    }
}

/// An object in shared memory or a file that describes a stream of `domain`, or the file that shows that this process
/// is alive, if this process has it open and it was removed.
///
/// The transport removes them only when nobody uses them any more.
#[must_use]
pub fn removed_object(domain: &Domain) -> Option<PathBuf> {
    const DELETED: &str = " (deleted)";
    let prefix = format!("{SHARED_MEMORY}/{}", domain.prefix());
    let [monitors, streams] =
        ["nodes", "services"].map(|folder| format!("{}/{folder}/{}", domain.root_path(), domain.prefix()));
    let names = fs::read_dir("/proc/self/fd").into_iter().flatten().flatten();
    let targets = names.filter_map(|entry| fs::read_link(entry.path()).ok()?.into_os_string().into_string().ok());
    let mut removed = targets.filter_map(|target| target.strip_suffix(DELETED).map(str::to_owned));
    let is_own_monitor = |path: &str| {
        let number = path.strip_prefix(&monitors).and_then(|rest| rest.strip_suffix(".node_monitor"));
        number.and_then(|number| number.parse().ok()).is_some_and(is_own_node)
    };
    let describes = |path: &String| {
        let is_stream = path.starts_with(&prefix) && path.ends_with(".dynamic") || path.starts_with(&streams);
        is_stream || is_own_monitor(path)
    };
    removed.find(describes).map(PathBuf::from)
}

/// The files that a handle needs, so that others reach it: those that describe its streams, the shared memory of these,
/// and the one that shows that its process is alive.
#[derive(Debug, Default)]
pub(crate) struct OwnObjects {
    /// Each with its device and inode.
    files: Vec<(PathBuf, (u64, u64))>,
    /// The ports whose connections another user could have made.
    ports: Vec<u128>,
}

impl OwnObjects {
    /// Those of a handle that has just opened these streams with this node.
    pub(crate) fn of(domain: &Domain, node: &IpcNode, streams: &[&ServiceHash], ports: Vec<u128>) -> Self {
        let folder = Path::new(domain.root_path()).join("services");
        let descriptions = streams.iter().map(|stream| {
            let name = format!("{}{}.service", domain.prefix(), stream.as_str());
            folder.join(name)
        });
        let descriptions: Vec<_> = descriptions.collect();
        let memories: Vec<_> = descriptions.iter().filter_map(|path| memory_name(path)).collect();
        let is_needed = |name: &str| memories.iter().any(|memory| name.ends_with(memory.as_str()));
        let objects = entries(Path::new(SHARED_MEMORY), &domain.prefix())
            .filter(|entry| entry.file_name().to_str().is_some_and(is_needed))
            .map(|entry| entry.path());
        let paths = descriptions.into_iter().chain(objects).chain([monitor(domain, node.id().value())]);
        Self { files: paths.filter_map(|path| number_of(&path).map(|number| (path, number))).collect(), ports }
    }

    /// What has happened to them, if anything.
    pub(crate) fn loss(&self, domain: &Domain) -> Option<Loss> {
        let removed = self.files.iter().find(|(path, number)| number_of(path) != Some(*number));
        let taken = || taken_connection(domain, &self.ports).map(Loss::Taken);
        removed.map(|(path, _)| Loss::Removed(path.clone())).or_else(taken)
    }
}

/// Device and inode of a file.
fn number_of(path: &Path) -> Option<(u64, u64)> {
    fs::symlink_metadata(path).ok().map(|found| (found.dev(), found.ino()))
}

/// The object of a connection of one of these ports that another user has made.
pub(crate) fn taken_connection(domain: &Domain, ports: &[u128]) -> Option<PathBuf> {
    let ports = ports.iter().map(u128::to_string).collect::<Vec<_>>();
    // Other users may make any number of objects, so names are compared before anything is looked at.
    let is_of_port = |name: &str| ports.iter().any(|port| name.contains(port.as_str()));
    let foreign = |path: &Path| fs::symlink_metadata(path).is_ok_and(|found| !is_own(&found));
    entries(Path::new(SHARED_MEMORY), &domain.prefix())
        .filter(|entry| entry.file_name().to_str().is_some_and(is_of_port))
        .map(|entry| entry.path())
        .find(|path| foreign(path))
}
