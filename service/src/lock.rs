//! The lock that keeps a second service out of a domain.
//!
//! It is a lock on a file in the domain's folder, which the kernel releases when the process ends, or closes any
//! descriptor of the file. So the file is this process's standard input, which nobody closes and which a service that
//! executes itself anew keeps, with the lock.

use isotherm_client::{Domain, prepare};
use isotherm_support::failure::{Exit, Failure};
use rustix::fs::{FlockOperation, OFlags, fcntl_lock, fstat, ftruncate};
use rustix::io::pwrite;
use rustix::process::{Flock, FlockType, fcntl_getlk};
use rustix::stdio::{dup2_stdin, stdin};
use std::fs::{self, File, Metadata};
use std::io;
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::PathBuf;

/// The sole right to serve a domain, until the process ends.
#[derive(Debug)]
pub(crate) struct DomainLock;

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
        // A service that has executed itself anew has the file already.
        let has_it =
            |found: Metadata| fstat(stdin()).is_ok_and(|own| (own.st_dev, own.st_ino) == (found.dev(), found.ino()));
        if !fs::symlink_metadata(&path).is_ok_and(has_it) {
            dup2_stdin(options.open(&path).map_err(failed)?).map_err(|error| failed(error.into()))?;
        }
        if let Err(error) = fcntl_lock(stdin(), FlockOperation::NonBlockingLockExclusive) {
            let holder = fcntl_getlk(stdin(), &Flock::from(FlockType::WriteLock)).ok().flatten();
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
        let _ = ftruncate(stdin(), 0).and_then(|()| pwrite(stdin(), format!("{}\n", std::process::id()).as_bytes(), 0));
        Ok(Self)
    }
}
