//! What a process needs of the machine before it joins a domain: room in shared memory, and descriptors.
//!
//! Shared memory is given by the kernel page by page when it is first touched, and a process that touches a page when there is none left
//! is ended by SIGBUS. So room is asked for before anything is created, and what has been created is reserved at once.

use crate::error::ConnectError;
use isotherm_shared::stream::Domain;
use rustix::fs::{Access, FallocateFlags, access, fallocate, statvfs};
use rustix::io::Errno;
use rustix::process::{Resource, getrlimit};
use std::fs::{self, DirBuilder, File};
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};

/// Where the transport's memory is.
pub(crate) const SHARED_MEMORY: &str = "/dev/shm";
/// What a client's streams and their connections take at most, and a service without IMUs \[bytes\].
const ROOM_OF_A_CLIENT: u64 = 1 << 20;
const ROOM: u64 = 1 << 20;
/// What an IMU takes of a service at most, its connections included \[bytes\].
const ROOM_OF_AN_IMU: u64 = 1408 << 10;
/// Descriptors that a client needs besides those it has open, or a service without IMUs, and what an IMU adds with its clients.
const DESCRIPTORS: usize = 24;
const DESCRIPTORS_OF_AN_IMU: usize = 20;

/// Whether there is room, and descriptors, for a service of `imus` IMUs, or for a client (0).
///
/// # Errors
/// [`ConnectError::Exhausted`], with what is missing and where.
pub fn check_room(imus: usize) -> Result<(), ConnectError> {
    check_descriptors(imus)?;
    let needed = if imus == 0 { ROOM_OF_A_CLIENT } else { ROOM + imus as u64 * ROOM_OF_AN_IMU };
    let unwritable = |error: Errno| {
        ConnectError::Exhausted(format!("shared memory {SHARED_MEMORY} cannot be written ({error}); mount it writable"))
    };
    access(SHARED_MEMORY, Access::WRITE_OK).map_err(unwritable)?;
    if free().is_some_and(|free| free < needed) { Err(full(needed)) } else { Ok(()) }
}

/// Whether the domain's folder, which is made if need be, can be written and has room for the small files of streams and processes.
pub(crate) fn check_folder(domain: &Domain) -> Result<(), ConnectError> {
    const ROOM: u64 = 64 << 10;
    const FILES: u64 = 64;
    let root = domain.root_path();
    let failed = |cause: String| {
        ConnectError::Exhausted(format!(
            "the domain's folder {root}: {cause}; ISOTHERM_ROOT names the folder above, which must be writable"
        ))
    };
    let made = DirBuilder::new().recursive(true).mode(0o750).create(root);
    made.map_err(|error| failed(error.to_string()))?;
    access(root, Access::WRITE_OK | Access::EXEC_OK).map_err(|error| failed(error.to_string()))?;
    let Ok(room) = statvfs(root) else { return Ok(()) };
    let (bytes, files) = (room.f_bavail * room.f_frsize, room.f_favail);
    if (room.f_blocks > 0 && bytes < ROOM) || (room.f_files > 0 && files < FILES) {
        return Err(failed(format!("its file system is full ({} kB and {files} files free)", bytes / 1024)));
    }
    Ok(())
}

/// Has the kernel give this user's memory of `domain` its pages now, so that none is missing later.
///
/// # Errors
/// [`ConnectError::Exhausted`] if there is not enough.
pub fn reserve(domain: &Domain) -> Result<(), ConnectError> {
    for entry in fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten() {
        if !entry.file_name().as_encoded_bytes().starts_with(domain.prefix().as_bytes()) {
            continue;
        }
        // One that has just been removed, or is being created, is another process's and not needed.
        let Ok(object) = File::options().write(true).open(entry.path()) else { continue };
        let Ok(metadata) = object.metadata() else { continue };
        let missing = metadata.size().saturating_sub(metadata.blocks() * 512);
        if missing > 0 && fallocate(&object, FallocateFlags::empty(), 0, metadata.size()) == Err(Errno::NOSPC) {
            return Err(full(missing));
        }
    }
    Ok(())
}

fn free() -> Option<u64> {
    statvfs(SHARED_MEMORY).ok().filter(|found| found.f_blocks > 0).map(|found| found.f_bavail * found.f_frsize)
}

fn full(needed: u64) -> ConnectError {
    let kb = |bytes: u64| bytes.div_ceil(1024);
    ConnectError::Exhausted(format!(
        "shared memory {SHARED_MEMORY} is full: {} kB free, {} kB needed; remove what is not needed there (`isotherm clean` what a domain \
         has left), or enlarge it (mount -o remount,size=..)",
        kb(free().unwrap_or(0)),
        kb(needed)
    ))
}

fn check_descriptors(imus: usize) -> Result<(), ConnectError> {
    let needed = fs::read_dir("/proc/self/fd").map_or(0, Iterator::count) + DESCRIPTORS + imus * DESCRIPTORS_OF_AN_IMU;
    match getrlimit(Resource::Nofile).current {
        Some(limit) if limit < needed as u64 => Err(ConnectError::Exhausted(format!(
            "this process may open {limit} files and needs {needed}; raise the limit (`ulimit -n`; systemd: LimitNOFILE={needed})"
        ))),
        _ => Ok(()),
    }
}
