//! Checks and reservations before a process uses a domain: shared memory and file descriptors.
//!
//! The kernel allocates a page of shared memory when it is first touched. If none is left then, it ends the process by
//! SIGBUS. So the free space is checked before anything is created, and created objects get all their pages before
//! anything is written to them ([`crate::transport::own_storage`]).

use crate::error::{ConnectError, free_shared_memory, shared_memory_full};
use crate::objects::{Note, SHARED_MEMORY};
use crate::peers::is_alive;
use crate::transport::stream::IpcNode;
use isotherm_shared::names::Domain;
use rustix::fs::{Access, access};
use rustix::io::Errno;
use rustix::process::{Resource, getrlimit};
use std::os::unix::fs::MetadataExt as _;
use std::{fs, io};

/// Shared memory that a client needs at most, for its streams and their connections \[bytes\].
const ROOM_OF_A_CLIENT: u64 = 3 << 19;
/// A single object of the transport is smaller \[bytes\].
const LARGEST_OBJECT: u64 = 1408 << 10;
/// Shared memory that a service without IMUs needs at most \[bytes\].
const ROOM: u64 = 1 << 20;
/// Shared memory that a service needs at most for each IMU, with its connections \[bytes\].
const ROOM_OF_AN_IMU: u64 = 1664 << 10;
/// Descriptors that a client or a service without IMUs needs, in addition to those that it has open.
const DESCRIPTORS: usize = 36;
/// Descriptors that a service needs for each IMU and its clients.
const DESCRIPTORS_OF_AN_IMU: usize = 36;

/// Whether shared memory lacks the room that a client needs.
pub(crate) fn lacks_room() -> bool {
    free_shared_memory().is_some_and(|free| free < ROOM_OF_A_CLIENT)
}

/// Checks that there is enough shared memory, and enough descriptors, for a service of `imus` IMUs, or for a client
/// (0).
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
    if let Some(limit) = getrlimit(Resource::Fsize).current.filter(|limit| *limit < LARGEST_OBJECT) {
        return Err(ConnectError::Exhausted(format!(
            "this process may write files of {} kB and needs {} kB for shared memory; raise the limit (`ulimit -f`; systemd: LimitFSIZE=)",
            limit / 1024,
            LARGEST_OBJECT / 1024
        )));
    }
    if free_shared_memory().is_some_and(|free| free < needed) { Err(shared_memory_full(needed)) } else { Ok(()) }
}

/// The note of the service: the device of its shared memory, and its node.
fn memory_note(domain: &Domain) -> Note {
    Note::new(domain, "memory")
}

/// The device of the file system in which this process has its shared memory.
fn memory_device() -> io::Result<u64> {
    fs::metadata(SHARED_MEMORY).map(|found| found.dev())
}

/// Notes in the domain's folder which shared memory the service with this node uses. Its clients may share the folder
/// and not the memory, as in a container.
///
/// # Errors
/// The operating system's.
pub fn note_memory(domain: &Domain, node: &IpcNode) -> io::Result<()> {
    memory_note(domain).write(format!("{} {}\n", memory_device()?, node.id().value()).as_bytes())
}

/// Checks that the service of `domain`, if one lives, has the shared memory that this process has.
///
/// # Errors
/// [`ConnectError::OtherMemory`] if not.
pub(crate) fn check_memory(domain: &Domain) -> Result<(), ConnectError> {
    let noted = || {
        let text = String::from_utf8(memory_note(domain).read()?).ok()?;
        let (device, node) = text.trim_end().split_once(' ')?;
        Some((device.parse::<u64>().ok()?, node.parse().ok()?))
    };
    match noted().zip(memory_device().ok()) {
        Some(((device, node), own)) if device != own && is_alive(domain, node) => Err(ConnectError::OtherMemory),
        _ => Ok(()),
    }
}

/// Checks that this process may open enough files for a service of `imus` IMUs, or for a client (0).
///
/// # Errors
/// [`ConnectError::Exhausted`], which names the limit.
pub fn check_descriptors(imus: usize) -> Result<(), ConnectError> {
    let needed = fs::read_dir("/proc/self/fd").map_or(0, Iterator::count) + DESCRIPTORS + imus * DESCRIPTORS_OF_AN_IMU;
    match getrlimit(Resource::Nofile).current {
        Some(limit) if limit < needed as u64 => Err(ConnectError::Exhausted(format!(
            "this process may open {limit} files and needs {needed}; raise the limit (`ulimit -n`; systemd: LimitNOFILE={needed})"
        ))),
        _ => Ok(()),
    }
}
