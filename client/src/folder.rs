//! The domain's folder: who made it, and whether it can be used.

use crate::error::{ConnectError, permission};
use isotherm_shared::names::Domain;
use isotherm_support::failure::shown;
use rustix::fs::{Access, Mode, OFlags, access, open, statvfs};
use rustix::io::Errno;
use rustix::process::geteuid;
use std::fs::{self, DirBuilder, File};
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};
use std::path::Path;

/// Permission to write for everybody.
const EVERYBODY: u32 = 0o002;
/// Only the owner of an entry may rename or remove it.
const STICKY: u32 = 0o1000;

/// Checks that the domain's folder, if it exists, belongs to this process's user. Even root is refused another user's
/// domain.
///
/// A symbolic link is followed only where nobody else could have made it. A user who owns the parent folder, or may
/// write it as a member of its group, is trusted.
///
/// # Errors
/// [`ConnectError::Permission`] or [`ConnectError::Foreign`] if not, and [`ConnectError::Transport`] if it is not
/// usable.
pub fn check_owner(domain: &Domain) -> Result<(), ConnectError> {
    inspect(domain, false).map(drop)
}

/// Who has made the domain's folder; `None` if there is none. This is for reading what a service has noted there: root
/// may read that of every user, and every other user that of his own domains.
///
/// # Errors
/// Those of [`check_owner`].
pub fn domain_owner(domain: &Domain) -> Result<Option<u32>, ConnectError> {
    inspect(domain, geteuid().is_root())
}

/// Opens the domain's folder without following a link, and checks that it belongs to this user, unless it may be
/// `of_anybody`. Returns its owner, if it exists.
fn inspect(domain: &Domain, of_anybody: bool) -> Result<Option<u32>, ConnectError> {
    let root = domain.root_path();
    let own = geteuid().as_raw();
    let foreign = |cause: String| Err(ConnectError::Foreign(cause));
    let opened = |flags| open(root, OFlags::PATH | OFlags::CLOEXEC | flags, Mode::empty());
    let mut folder = match opened(OFlags::NOFOLLOW) {
        Ok(folder) => File::from(folder),
        Err(Errno::NOENT) => return Ok(None),
        Err(Errno::ACCESS) => return Err(permission(domain, None)),
        Err(error) => return Err(failed(root, &error.to_string())),
    };
    let failed = |error: io::Error| failed(root, &error.to_string());
    let parent = Path::new(root).parent().unwrap_or(Path::new("/"));
    let parent_mode = fs::metadata(parent).map_err(failed)?.mode();
    let shared = parent_mode & EVERYBODY != 0;
    if shared && parent_mode & STICKY == 0 {
        let parent = shown(parent);
        return foreign(format!(
            "everybody may replace {root}; chmod o-w {parent}, or name another folder in ISOTHERM_ROOT"
        ));
    }
    let mut found = folder.metadata().map_err(failed)?;
    if found.is_symlink() {
        if shared {
            return foreign(format!(
                "{root} is a link of user {}, and everybody may make one there; remove it, use another --domain, or name a folder of \
                 your own in ISOTHERM_ROOT",
                found.uid()
            ));
        }
        match opened(OFlags::empty()) {
            Ok(target) => folder = File::from(target),
            Err(error) => {
                let cause = format!("{root} is a link: {error}; remove it, or make what it names");
                return Err(ConnectError::transport("joining the domain", cause));
            }
        }
        found = folder.metadata().map_err(failed)?;
    }
    if !found.is_dir() {
        let cause = format!(
            "{root} of user {} is not a folder; remove it, use another --domain, or name another folder in ISOTHERM_ROOT",
            found.uid()
        );
        return if found.uid() == own {
            Err(ConnectError::transport("joining the domain", cause))
        } else {
            foreign(cause)
        };
    }
    if found.uid() != own && !of_anybody {
        return Err(permission(domain, Some(found.uid())));
    }
    if found.mode() & EVERYBODY != 0 {
        return foreign(format!("everybody may write {root}; chmod o-w {root}"));
    }
    Ok(Some(found.uid()))
}

/// Creates the domain's folder if necessary, and checks that it is this user's, is writable and has space for the small
/// files of streams and processes.
///
/// # Errors
/// Those of [`check_owner`], and [`ConnectError::Exhausted`].
pub fn prepare(domain: &Domain) -> Result<(), ConnectError> {
    const ROOM: u64 = 64 << 10;
    const FILES: u64 = 64;
    let root = domain.root_path();
    let failed = |cause: String| failed(root, &cause);
    if inspect(domain, false)?.is_none() {
        let parent = Path::new(root).parent().unwrap_or(Path::new("/"));
        DirBuilder::new().recursive(true).mode(0o750).create(parent).map_err(|error| failed(error.to_string()))?;
        // This one call never follows a link; if somebody else was faster, the inspection below finds out who.
        match DirBuilder::new().mode(0o750).create(root) {
            Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(failed(error.to_string())),
            _ => {}
        }
        inspect(domain, false)?;
    }
    access(root, Access::WRITE_OK | Access::EXEC_OK).map_err(|error| failed(error.to_string()))?;
    let Ok(room) = statvfs(root) else { return Ok(()) };
    let (bytes, files) = (room.f_bavail * room.f_frsize, room.f_favail);
    if (room.f_blocks > 0 && bytes < ROOM) || (room.f_files > 0 && files < FILES) {
        return Err(failed(format!("its file system is full ({} kB and {files} files free)", bytes / 1024)));
    }
    Ok(())
}

fn failed(root: &str, cause: &str) -> ConnectError {
    ConnectError::Exhausted(format!(
        "the domain's folder {root}: {cause}; ISOTHERM_ROOT names the folder above, which must be writable; below /run/isotherm root \
         makes it (a line in /etc/tmpfiles.d)"
    ))
}
