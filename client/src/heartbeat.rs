//! The heartbeats of a service's workers, for all readers of this process.
//!
//! The status has a limited number of places, and a program may have many readers. So they share one, which is given
//! back with the last of them.
#![expect(unsafe_code, reason = "the ports of the transport take turns between threads")]

use crate::process::Process;
use crate::status::{StatusError, StatusReader};
use core::sync::atomic::Ordering;
use isotherm_shared::names::{Domain, ImuId};
use isotherm_shared::status::ServiceStatus;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

/// Those of this process.
static ALL: Mutex<Vec<Weak<SharedStatus>>> = Mutex::new(Vec::new());

/// The status of a domain's service.
#[derive(Debug)]
pub(crate) struct SharedStatus {
    domain: Domain,
    /// A child with a copy of the memory takes a place of its own.
    process: Process,
    /// Whether a reader has seen that its streams were removed.
    is_lost: AtomicBool,
    content: Mutex<StatusContent>,
}

#[derive(Debug)]
struct StatusContent {
    reader: TakenInTurns,
    latest: Option<ServiceStatus>,
}

/// A reader with a node of its own, so that no other object has a part of it.
#[derive(Debug)]
struct TakenInTurns(StatusReader);

// SAFETY: the counts of the ports, which are not atomic, are all within this reader, and only the thread that has
// locked the content, or drops the last owner, reaches them.
unsafe impl Send for TakenInTurns {}

impl SharedStatus {
    /// That of a domain, which is joined if no reader of this process has done so.
    pub(crate) fn of(domain: &Domain) -> Result<Arc<Self>, StatusError> {
        let mut all = locked(&ALL);
        all.retain(|status| status.strong_count() > 0);
        if let Some(status) = all.iter().filter_map(Weak::upgrade).find(|status| status.serves(domain)) {
            return Ok(status);
        }
        let content = StatusContent { reader: TakenInTurns(StatusReader::connect(domain)?), latest: None };
        let (domain, process) = (domain.clone(), Process::current());
        let status = Self { domain, process, is_lost: AtomicBool::new(false), content: Mutex::new(content) };
        let status = Arc::new(status);
        all.push(Arc::downgrade(&status));
        Ok(status)
    }

    fn serves(&self, domain: &Domain) -> bool {
        self.domain == *domain && self.process.is_current() && !self.is_lost.load(Ordering::Relaxed)
    }

    /// The next reader joins anew.
    pub(crate) fn lose(&self) {
        self.is_lost.store(true, Ordering::Relaxed);
    }

    /// When the worker of an IMU was last seen at work, `CLOCK_MONOTONIC` \[ns\]; `None` if that is not known yet.
    pub(crate) fn heartbeat_ns(&self, imu: &ImuId) -> Result<Option<u64>, StatusError> {
        let StatusContent { reader, latest } = &mut *locked(&self.content);
        if let Some(status) = reader.0.latest()? {
            *latest = Some(status);
        }
        let serves = |imus: &[String]| imus.iter().any(|served| served == imu.as_str());
        let worker = latest.iter().flat_map(|status| &status.workers).find(|worker| serves(&worker.imus));
        Ok(worker.map(|worker| worker.heartbeat_ns).filter(|ns| *ns != 0))
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
