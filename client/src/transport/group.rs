//! Domains that belong to a group of users.
//!
//! By default all processes of a domain run as one user. Where the service is configured for a group, what the
//! processes create belongs to that group, its members may read and write it, and nobody else may. Only a member of a
//! group can give a file to it, so a file of the group was made by a member, or by root.
//!
//! The transport opens its files only to their owner, by constants of iceoryx2-cal 0.10. So they are opened to the
//! group after they were created: here what [`OwnStorage`](super::own_storage::OwnStorage) and
//! [`OwnStatic`](super::own_static::OwnStatic) create, by the client library the rest.

use rustix::fs::{AtFlags, Mode, OFlags, chownat, open};
use rustix::process::Gid;
use std::collections::BTreeMap;
use std::fs::{self, File, Metadata, Permissions};
use std::io;
use std::os::fd::AsRawFd as _;
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _, PermissionsExt as _};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The groups of the domains that this process has joined, by the prefixes of their files.
static GROUPS: Mutex<BTreeMap<String, u32>> = Mutex::new(BTreeMap::new());

fn groups() -> MutexGuard<'static, BTreeMap<String, u32>> {
    GROUPS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Notes for this process that the domain with this prefix belongs to this group, or only to its own user.
pub fn set(prefix: &str, group: Option<u32>) {
    let mut groups = groups();
    match group {
        Some(group) => drop(groups.insert(prefix.to_owned(), group)),
        None => drop(groups.remove(prefix)),
    }
}

/// The group of the domain with this prefix, if it has one.
#[must_use]
pub fn of(prefix: &str) -> Option<u32> {
    groups().get(prefix).copied()
}

/// Whether a file can be trusted in the domain with this prefix: it is this user's, or the group's.
#[must_use]
pub fn owns(prefix: &str, found: &Metadata) -> bool {
    found.uid() == rustix::process::geteuid().as_raw() || of(prefix) == Some(found.gid())
}

/// Gives a file, socket or folder that this user has made to the group of the domain with this prefix, if it has one.
/// What its owner may do with it, the group may do then, and nobody else may do anything.
///
/// Other members may exchange what has the name. So it is looked at and changed by one descriptor, and nothing is
/// changed that is not this user's.
pub fn open_path(prefix: &str, path: &Path) {
    if let Some(group) = of(prefix) {
        // What the group cannot open shows where it needs it.
        let _ = open_to(group, path);
    }
}

fn open_to(group: u32, path: &Path) -> io::Result<()> {
    let file = File::from(open(path, OFlags::PATH | OFlags::NOFOLLOW | OFlags::CLOEXEC, Mode::empty())?);
    let found = file.metadata()?;
    let kind = found.file_type();
    if found.uid() != rustix::process::geteuid().as_raw() || !(kind.is_file() || kind.is_dir() || kind.is_socket()) {
        return Ok(());
    }
    if found.gid() != group {
        chownat(&file, "", None, Some(Gid::from_raw(group)), AtFlags::EMPTY_PATH)?;
    }
    let owner = found.mode() & 0o700;
    let hands_on = if kind.is_dir() { 0o2000 } else { 0 };
    let mode = owner | owner >> 3;
    if found.mode() & 0o7777 != mode | hands_on || found.gid() != group {
        let set =
            |mode| fs::set_permissions(format!("/proc/self/fd/{}", file.as_raw_fd()), Permissions::from_mode(mode));
        // A service manager may keep a service from setting this bit. Then each file is given to the group by itself.
        set(mode | hands_on).or_else(|_| set(mode))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_owner_may_do_the_group_may_do_and_nobody_else() {
        let folder = std::env::temp_dir().join(format!("isotherm-group-{}", std::process::id()));
        fs::create_dir(&folder).unwrap();
        let (read_only, inner, link) = (folder.join("read"), folder.join("inner"), folder.join("link"));
        fs::write(&read_only, "").unwrap();
        fs::set_permissions(&read_only, Permissions::from_mode(0o404)).unwrap();
        fs::create_dir(&inner).unwrap();
        std::os::unix::fs::symlink(&read_only, &link).unwrap();
        let group = fs::metadata(&folder).unwrap().gid();
        let mode = |path: &Path| fs::symlink_metadata(path).unwrap().mode() & 0o7777;
        open_path("isotherm_test_", &read_only);
        assert_eq!(mode(&read_only), 0o404, "the domain has no group");
        set("isotherm_test_", Some(group));
        open_path("isotherm_test_", &link);
        assert_eq!(mode(&read_only), 0o404, "a link is not followed");
        for path in [&read_only, &inner, &folder.join("absent")] {
            open_path("isotherm_test_", path);
        }
        assert_eq!((mode(&read_only), mode(&inner)), (0o440, 0o2770));
        assert!(owns("isotherm_test_", &fs::metadata(&read_only).unwrap()));
        set("isotherm_test_", None);
        assert_eq!(of("isotherm_test_"), None);
        fs::remove_dir_all(&folder).unwrap();
    }
}
