//! The lock that keeps a second service out of a domain.
//!
//! It is a lock on a file in the domain's folder, which the kernel releases when the process ends. It belongs to the
//! process, so a service that executes itself anew keeps it.

use isotherm_client::{Domain, prepare};
use isotherm_support::failure::{Exit, Failure};
use rustix::fs::{FlockOperation, OFlags, fcntl_lock};
use rustix::io::{FdFlags, fcntl_setfd};
use rustix::process::{Flock, FlockType, fcntl_getlk};
use std::fs::File;
use std::io::{self, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::PathBuf;

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
        let path = PathBuf::from(domain.root_path()).join(format!("{}service.lock", domain.prefix()));
        let failed = |error: io::Error| Failure::io("locking", &path, &error);
        let mut options = File::options();
        options.write(true).create(true).truncate(false).mode(0o600);
        options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC).bits().cast_signed());
        let mut file = options.open(&path).map_err(failed)?;
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
