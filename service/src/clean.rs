//! Removing what a domain leaves behind: a few small files that the transport keeps for its next start.

use crate::leftovers;
use isotherm_client::{Domain, NodeHolder, check_domain, own_files, sweep_half_created};
use isotherm_support::failure::{Exit, Failure};
use std::fs::{self, DirEntry};
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

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
    if let Some(user) = user_of(domain) {
        let message = format!("cleaning domain {:?}: {user} is using it; stop it first", domain.name());
        return Err(Failure::new(Exit::Failed, message));
    }
    let (root, prefix) = (Path::new(domain.root_path()), domain.prefix());
    let mut removed = streams(domain).remove()?;
    removed += remove_prefixed(root, &prefix)?;
    let remove_empty = |folder: &Path| remove_empty(folder).map_err(|error| Failure::io("removing", folder, &error));
    FOLDERS.into_iter().try_for_each(|folder| remove_empty(&root.join(folder)))?;
    match fs::remove_dir(root) {
        // As that of the packages, which lies in a folder of root.
        Err(error) if matches!(error.kind(), io::ErrorKind::PermissionDenied | io::ErrorKind::ResourceBusy) => {}
        _ => remove_empty(root)?,
    }
    Ok(removed)
}

/// What the transport has made of a domain: streams, members and shared memory. What processes note for each other in
/// the domain's folder does not belong to it.
pub(crate) struct TransportObjects {
    files: Vec<PathBuf>,
    /// Of the members.
    folders: Vec<PathBuf>,
}

/// What there is now. What a process makes afterwards, by joining, has other names.
pub(crate) fn streams(domain: &Domain) -> TransportObjects {
    /// How the names of the transport's files in the domain's folder end: sockets, and a counter.
    const ENDINGS: [&[u8]; 2] = [b".event", b".global_mgmt"];
    let (root, prefix) = (Path::new(domain.root_path()), domain.prefix());
    let mut files: Vec<_> = own_files("/dev/shm", &prefix).map(|object| object.path).collect();
    // Only what the transport has created: a user may have named a folder that has other files.
    let is_transports =
        |entry: &DirEntry| ENDINGS.iter().any(|ending| entry.file_name().as_encoded_bytes().ends_with(ending));
    files.extend(prefixed(root, &prefix).filter(is_transports).map(|entry| entry.path()));
    let mut folders = Vec::new();
    for folder in FOLDERS.map(|folder| root.join(folder)) {
        files.extend(prefixed(&folder, &prefix).map(|entry| entry.path()));
        for inner in fs::read_dir(&folder).into_iter().flatten().flatten() {
            if inner.file_type().is_ok_and(|kind| kind.is_dir()) {
                files.extend(prefixed(&inner.path(), &prefix).map(|entry| entry.path()));
                folders.push(inner.path());
            }
        }
    }
    TransportObjects { files, folders }
}

impl TransportObjects {
    /// Removes it. Returns how many objects were removed.
    ///
    /// # Errors
    /// If something cannot be removed.
    pub(crate) fn remove(self) -> Result<usize, Failure> {
        let mut removed = 0;
        for path in &self.files {
            removed += remove(path)?;
        }
        for folder in &self.folders {
            remove_empty(folder).map_err(|error| Failure::io("removing", folder, &error))?;
        }
        Ok(removed)
    }
}

/// A process that uses the domain, as a message names it. If somebody has removed the domain's folder, no node can be
/// looked at. Then a process that has the domain's memory mapped counts as a user, too.
fn user_of(domain: &Domain) -> Option<String> {
    let member = leftovers::living_nodes(domain).next().map(|number| match NodeHolder::of(domain, number) {
        NodeHolder::Process(pid) => format!("pid {pid}"),
        NodeHolder::Elsewhere | NodeHolder::Nobody => "a process of another pid namespace".to_owned(),
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
    member.or_else(|| mapped().map(|pid| format!("pid {pid}")))
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
    match fs::remove_file(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(0),
        result => result.map(|()| 1).map_err(|error| Failure::io("removing", path, &error)),
    }
}

/// Removes a folder if it is empty.
fn remove_empty(folder: &Path) -> io::Result<()> {
    match fs::remove_dir(folder) {
        Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::DirectoryNotEmpty) => Ok(()),
        result => result,
    }
}
