//! The lock that keeps a second service out of a domain.
//!
//! It is a lock on a file in the domain's folder, which the kernel releases when the process ends. It belongs to the
//! process, so a service that executes itself anew keeps it.
#![expect(unsafe_code, reason = "a descriptor that was inherited is taken over by its number")]

use isotherm_client::{Domain, prepare};
use isotherm_install::service_lock;
use isotherm_support::failure::{Exit, Failure};
use rustix::fs::{FlockOperation, OFlags, fcntl_lock};
use rustix::io::{FdFlags, fcntl_setfd};
use rustix::process::{Flock, FlockType, fcntl_getlk};
use std::fs::{self, DirEntry, File, Metadata};
use std::io::{self, Write as _};
use std::os::fd::{FromRawFd as _, RawFd};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// The sole right to serve a domain. The file stays open until the process ends: closing it would release the lock.
#[derive(Debug)]
pub(crate) struct DomainLock {
    file: File,
}

impl DomainLock {
    /// Takes the lock.
    ///
    /// # Errors
    /// If another service has it, or the domain's folder cannot be used.
    pub(crate) fn take(domain: &Domain) -> Result<Self, Failure> {
        prepare(domain)?;
        let path = service_lock(domain);
        let failed = |error: io::Error| Failure::io("locking", &path, &error);
        let mut options = File::options();
        options.write(true).create(true).truncate(false).mode(0o600);
        options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC).bits().cast_signed());
        let mut file = match inherited(&path) {
            Some(file) => file,
            None => options.open(&path).map_err(failed)?,
        };
        if let Err(error) = fcntl_lock(&file, FlockOperation::NonBlockingLockExclusive) {
            let holder = fcntl_getlk(&file, &Flock::from(FlockType::WriteLock)).ok().flatten();
            let Some(holder) = holder else { return Err(failed(error.into())) };
            let pid = match holder.pid {
                Some(pid) => format!(", pid {}", pid.as_raw_nonzero()),
                None => ", in another pid namespace".to_owned(),
            };
            let domain = domain.name();
            let message = format!(
                "another service is running in domain {domain:?}{pid}; stop it, or give this one another --domain"
            );
            return Err(Failure::new(Exit::Failed, message));
        }
        // For people who look at it.
        let _ = file.set_len(0).and_then(|()| writeln!(file, "{}", std::process::id()));
        Ok(Self { file })
    }

    /// Keeps the lock when the process executes itself anew.
    ///
    /// # Errors
    /// The operating system's.
    pub(crate) fn keep_over_exec(&self) -> io::Result<()> {
        Ok(fcntl_setfd(&self.file, FdFlags::empty())?)
    }
}

/// The file of the lock as this process had it open before it executed itself anew. Opening it again would leave that
/// descriptor behind, and closing that would release the lock.
fn inherited(path: &Path) -> Option<File> {
    static WAS_CALLED: AtomicBool = AtomicBool::new(false);
    if WAS_CALLED.swap(true, Ordering::Relaxed) {
        return None;
    }
    let identity = |found: Metadata| (found.dev(), found.ino());
    let lock = fs::symlink_metadata(path).ok().map(identity)?;
    let is_lock = |entry: &DirEntry| fs::metadata(entry.path()).is_ok_and(|found| identity(found) == lock);
    let descriptor = fs::read_dir("/proc/self/fd").ok()?.flatten().find(is_lock)?;
    let number: RawFd = descriptor.file_name().to_str()?.parse().ok()?;
    // SAFETY: nothing else opens this file, and this process has not done so yet. So the descriptor was inherited, and
    // nothing in this process owns it.
    Some(unsafe { File::from_raw_fd(number) })
}
