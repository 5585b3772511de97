//! Domains that belong to a group of users: what each process does with what it has made there, so that the others can
//! use it.

use crate::objects::{SHARED_MEMORY, entries, own_files};
use crate::transport::group;
use isotherm_shared::names::Domain;
use std::collections::BTreeSet;
use std::fs::{self, DirEntry};
use std::path::Path;

/// Opens what this user has made in the folder of a domain to the group that the domain belongs to, if it does. The
/// transport gives access to sockets, locks and marks only to their owner.
pub fn open_to_group(domain: &Domain) {
    let (root, prefix) = (Path::new(domain.root_path()), domain.prefix());
    if group::of(&prefix).is_none() {
        return;
    }
    let open = |path: &Path| group::open_path(&prefix, path);
    let is_transports = |entry: &DirEntry| {
        let name = entry.file_name();
        [&b".event"[..], b".global_mgmt"].iter().any(|ending| name.as_encoded_bytes().ends_with(ending))
    };
    entries(root, &prefix).filter(is_transports).for_each(|entry| open(&entry.path()));
    for folder in ["nodes", "services"].map(|name| root.join(name)) {
        open(&folder);
        for entry in fs::read_dir(&folder).into_iter().flatten().flatten() {
            open(&entry.path());
            if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                entries(&entry.path(), &prefix).for_each(|inner| open(&inner.path()));
            }
        }
    }
}

/// Removes the connections and samples that earlier processes of this user have left in shared memory, in a domain that
/// belongs to a group. Only their user can: `/dev/shm` has the sticky bit. In other domains the transport removes them.
pub(crate) fn remove_own_leftovers(domain: &Domain) {
    const ENDINGS: [&str; 3] = [".connection", ".data", ".event_mgmt"];
    let prefix = domain.prefix();
    if group::of(&prefix).is_none() {
        return;
    }
    let nodes = fs::read_dir(Path::new(domain.root_path()).join("nodes")).into_iter().flatten().flatten();
    let listed: BTreeSet<u32> = nodes
        .filter_map(|entry| pid_of(entry.file_name().to_str()?.trim_start_matches(&prefix).split('.').next()?))
        .collect();
    for file in own_files(SHARED_MEMORY, &prefix) {
        let Some(name) = file.path.file_name().and_then(|name| name.to_str()) else { continue };
        // After the prefix comes the kind, then the numbers of the ports.
        let ports = name.trim_start_matches(&prefix).split(['_', '.']).skip(1).filter_map(pid_of);
        let is_left = ports.into_iter().any(|pid| !listed.contains(&pid));
        if is_left && ENDINGS.iter().any(|ending| name.ends_with(ending)) {
            let _ = fs::remove_file(&file.path);
        }
    }
}

/// The process in the number of a node or a port; `None` if it is no such number.
fn pid_of(number: &str) -> Option<u32> {
    let number: u128 = number.parse().ok()?;
    Some((number >> 64) as u32).filter(|pid| *pid != 0)
}
