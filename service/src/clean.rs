//! Removing what a domain leaves behind: a few small files that the transport keeps for its next start.

use isotherm_client::transport::nodes::{DomainMember, member_of};
use isotherm_client::transport::stream::configuration;
use isotherm_client::{Domain, check_domain, own_files, pid_of, sweep_half_created};
use isotherm_support::failure::{Exit, Failure};
use std::fs::{self, DirEntry};
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

/// The folders that the transport creates in a domain's folder.
const FOLDERS: [&str; 2] = ["nodes", "services"];

/// Removes everything of `domain` from shared memory and from its folder, and the folder if it is then empty. A folder
/// that is a mount, or that lies in another user's folder, stays. Returns how many objects were removed.
///
/// # Errors
/// If a process of the domain is alive, or something cannot be removed.
pub fn clean(domain: &Domain) -> Result<usize, Failure> {
    check_domain(domain)?;
    sweep_half_created(domain)?;
    if let Some(user) = user_of(domain)? {
        let message = format!("cleaning domain {:?}: {user} is using it; stop it first", domain.name());
        return Err(Failure::new(Exit::Failed, message));
    }
    let (root, prefix) = (Path::new(domain.root_path()), domain.prefix());
    let mut removed = remove_streams(domain)?;
    removed += remove_prefixed(root, &prefix)?;
    match remove_empty(root) {
        // As that of the packages, which lies in a folder of root.
        Err(error) if matches!(error.kind(), io::ErrorKind::PermissionDenied | io::ErrorKind::ResourceBusy) => {}
        result => result.map_err(|error| Failure::io("removing", root, &error))?,
    }
    Ok(removed)
}

/// Removes what the transport has made of `domain`: streams, members and shared memory. What processes note for each
/// other in the domain's folder stays. Returns how many objects were removed.
///
/// # Errors
/// If something cannot be removed.
pub(crate) fn remove_streams(domain: &Domain) -> Result<usize, Failure> {
    /// How the names of the transport's files in the domain's folder end: sockets, and a counter.
    const ENDINGS: [&[u8]; 2] = [b".event", b".global_mgmt"];
    let (root, prefix) = (Path::new(domain.root_path()), domain.prefix());
    let mut removed = 0;
    for object in own_files("/dev/shm", &prefix) {
        removed += remove(&object.path)?;
    }
    // Remove only what the transport has created: a user may have named a folder that has other files.
    for entry in prefixed(root, &prefix) {
        if ENDINGS.iter().any(|ending| entry.file_name().as_encoded_bytes().ends_with(ending)) {
            removed += remove(&entry.path())?;
        }
    }
    for folder in FOLDERS.map(|folder| root.join(folder)) {
        removed += remove_prefixed(&folder, &prefix)?;
        for inner in fs::read_dir(&folder).into_iter().flatten().flatten() {
            if inner.file_type().is_ok_and(|kind| kind.is_dir()) {
                removed += remove_prefixed(&inner.path(), &prefix)?;
                remove_empty(&inner.path()).map_err(|error| Failure::io("removing", &inner.path(), &error))?;
            }
        }
        remove_empty(&folder).map_err(|error| Failure::io("removing", &folder, &error))?;
    }
    Ok(removed)
}

/// A process that uses the domain, for messages: one that the transport lists, or one that has the domain's memory
/// mapped.
fn user_of(domain: &Domain) -> Result<Option<String>, Failure> {
    configuration(domain).map_err(|error| Failure::new(Exit::Usage, error.to_string()))?;
    let folder = Path::new(domain.root_path()).join(FOLDERS[0]);
    let member = if folder.is_dir() { member_of(domain) } else { Ok(None) };
    let failed = |error: String| format!("listing the processes of domain {:?}: {error}", domain.name());
    let user = member.map_err(|error| Failure::new(Exit::Failed, failed(error)))?.map(|member| match member {
        DomainMember::Node(id) => match pid_of(domain, id) {
            Some(pid) => format!("pid {pid}"),
            None => "a process of another pid namespace".to_owned(),
        },
        DomainMember::Unknown => "a process that cannot be identified".to_owned(),
    });
    let needle = format!("/dev/shm/{}", domain.prefix());
    let mapped = || {
        let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
        // Another user's process can have only another user's object mapped.
        let own =
            |entry: &DirEntry| entry.metadata().is_ok_and(|found| found.uid() == rustix::process::geteuid().as_raw());
        let mut pids = processes.filter(own).filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
        pids.find(|pid| fs::read_to_string(format!("/proc/{pid}/maps")).is_ok_and(|maps| maps.contains(&needle)))
    };
    Ok(user.or_else(|| mapped().map(|pid| format!("pid {pid}"))))
}

/// Removes the files and sockets of the domain's folder, or a folder in it, whose names begin with `prefix`.
fn remove_prefixed(folder: &Path, prefix: &str) -> Result<usize, Failure> {
    prefixed(folder, prefix).try_fold(0, |removed, entry| Ok(removed + remove(&entry.path())?))
}

/// What is in a folder and no folder itself, and has a name that begins with `prefix`.
fn prefixed(folder: &Path, prefix: &str) -> impl Iterator<Item = DirEntry> + use<> {
    let prefix = prefix.as_bytes().to_owned();
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter(move |entry| {
        let ours = entry.file_name().as_encoded_bytes().starts_with(&prefix);
        ours && !entry.file_type().is_ok_and(|kind| kind.is_dir())
    })
}

fn remove(path: &Path) -> Result<usize, Failure> {
    fs::remove_file(path).map_err(|error| Failure::io("removing", path, &error))?;
    Ok(1)
}

/// Removes a folder if it is empty.
fn remove_empty(folder: &Path) -> io::Result<()> {
    match fs::remove_dir(folder) {
        Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::DirectoryNotEmpty) => Ok(()),
        result => result,
    }
}
