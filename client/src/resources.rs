//! Checks and reservations before a process uses a domain: shared memory and file descriptors.
//!
//! The kernel allocates a page of shared memory when it is first touched. If none is left then, it ends the process by SIGBUS.
//! So the free space is checked before anything is created, and created objects get all their pages at once.

use crate::error::ConnectError;
use isotherm_shared::stream::Domain;
use rustix::fs::{Access, FallocateFlags, access, fallocate, statvfs};
use rustix::io::Errno;
use rustix::process::{Resource, getrlimit};
use std::fs::{self, DirBuilder, File};
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};

/// Folder of the transport's shared memory.
pub(crate) const SHARED_MEMORY: &str = "/dev/shm";
/// Shared memory that a client needs at most, for its streams and their connections \[bytes\].
const ROOM_OF_A_CLIENT: u64 = 1 << 20;
/// Shared memory that a service without IMUs needs at most \[bytes\].
const ROOM: u64 = 1 << 20;
/// Shared memory that a service needs at most for each IMU, with its connections \[bytes\].
const ROOM_OF_AN_IMU: u64 = 1408 << 10;
/// Descriptors that a client or a service without IMUs needs, in addition to those that it has open.
const DESCRIPTORS: usize = 24;
/// Descriptors that a service needs for each IMU and its clients.
const DESCRIPTORS_OF_AN_IMU: usize = 20;

/// Checks that there is enough shared memory, and enough descriptors, for a service of `imus` IMUs, or for a client (0).
///
/// # Errors
/// [`ConnectError::Exhausted`], which names what is missing.
pub fn check_room(imus: usize) -> Result<(), ConnectError> {
    check_descriptors(imus)?;
    let needed = if imus == 0 { ROOM_OF_A_CLIENT } else { ROOM + imus as u64 * ROOM_OF_AN_IMU };
    let unwritable = |error: Errno| {
        ConnectError::Exhausted(format!("shared memory {SHARED_MEMORY} cannot be written ({error}); mount it writable"))
    };
    access(SHARED_MEMORY, Access::WRITE_OK).map_err(unwritable)?;
    if free_shared_memory().is_some_and(|free| free < needed) { Err(shared_memory_full(needed)) } else { Ok(()) }
}

/// Creates the domain's folder if necessary, and checks that it is writable and has space for the small files of streams and
/// processes.
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

/// Makes the kernel allocate all pages of this user's shared memory of `domain` now, so that none can be missing later.
///
/// # Errors
/// [`ConnectError::Exhausted`] if there is not enough.
pub fn reserve(domain: &Domain) -> Result<(), ConnectError> {
    for entry in fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten() {
        if !entry.file_name().as_encoded_bytes().starts_with(domain.prefix().as_bytes()) {
            continue;
        }
        // Another process is just removing or creating the object; this process does not need it.
        let Ok(object) = File::options().write(true).open(entry.path()) else { continue };
        let Ok(metadata) = object.metadata() else { continue };
        let missing = metadata.size().saturating_sub(metadata.blocks() * 512);
        if missing > 0 && fallocate(&object, FallocateFlags::empty(), 0, metadata.size()) == Err(Errno::NOSPC) {
            return Err(shared_memory_full(missing));
        }
    }
    Ok(())
}

fn free_shared_memory() -> Option<u64> {
    statvfs(SHARED_MEMORY).ok().filter(|found| found.f_blocks > 0).map(|found| found.f_bavail * found.f_frsize)
}

fn shared_memory_full(needed: u64) -> ConnectError {
    let kb = |bytes: u64| bytes.div_ceil(1024);
    ConnectError::Exhausted(format!(
        "shared memory {SHARED_MEMORY} is full: {} kB free, {} kB needed; remove what is not needed there (`isotherm clean` removes what a \
         domain has left), or enlarge it (mount -o remount,size=..)",
        kb(free_shared_memory().unwrap_or(0)),
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
