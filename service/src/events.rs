//! What the other threads have to say to the control thread. Only the newest of each kind waits, so that nothing that
//! happens outside, however often, takes memory or holds a signal up.

use crate::memory::KeptTables;
use isotherm_documents::LoadError;
use isotherm_files::Identity;
use isotherm_shared::table::{CoefficientTable, Digest};
use std::collections::BTreeMap;
use std::mem;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// What was found in an IMU's table file.
#[derive(Debug)]
pub(crate) struct FileReport {
    /// The table, or why there is none.
    pub change: FileChange,
    /// The state of the file that was read; `None` if there is none.
    pub state: Option<Identity>,
    /// Whether there is no file.
    pub is_absent: bool,
    /// Whether it was to be loaded, whatever its state.
    pub is_requested: bool,
}

/// A state of a table's file that was read.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) struct JudgedFile {
    pub state: Identity,
    /// Digest of the table in it; `None` if it is no valid table.
    pub digest: Option<Digest>,
}

impl FileReport {
    /// What was read; `None` if there is no file.
    pub(crate) fn judged(&self) -> Option<JudgedFile> {
        let digest = match &self.change {
            FileChange::Loaded(table) => Some(*table.digest()),
            FileChange::Unchanged | FileChange::Refused(_) => None,
        };
        self.state.map(|state| JudgedFile { state, digest })
    }

    /// When the file was changed, Unix time \[s\].
    pub(crate) fn modified_unix_s(&self) -> Option<f64> {
        self.state.map(|state| state.modified_unix_s())
    }
}

/// The result of checking a table's file.
#[derive(Debug)]
pub(crate) enum FileChange {
    /// No new state, or a new one that may not be complete.
    Unchanged,
    /// A valid table.
    Loaded(Arc<CoefficientTable>),
    /// The file is not a valid table for this IMU, or is missing.
    Refused(LoadError),
}

/// How keeping a table has ended, for now.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(crate) struct KeepOutcome {
    /// Digest of the table in force that was to be kept.
    pub table: String,
    /// Why it is not kept.
    pub error: Option<String>,
}

/// What has happened since the control thread looked last. IMUs are given by their numbers in the configuration.
#[derive(Debug, Default)]
pub(crate) struct EventSet {
    /// The signal that ends the service.
    pub stop: Option<i32>,
    /// All tables are to be loaded.
    pub load_all: bool,
    /// What was found in a table's file.
    pub files: BTreeMap<usize, FileReport>,
    /// What the state folder has for an IMU.
    pub memories: BTreeMap<usize, KeptTables>,
    /// How keeping a table has ended.
    pub kept: BTreeMap<usize, KeepOutcome>,
}

impl EventSet {
    fn is_empty(&self) -> bool {
        let Self { stop, load_all, files, memories, kept } = self;
        stop.is_none() && !load_all && files.is_empty() && memories.is_empty() && kept.is_empty()
    }
}

/// The place where the threads meet.
#[derive(Debug, Default)]
pub(crate) struct EventQueue {
    pending: Mutex<EventSet>,
    changed: Condvar,
    has_started: AtomicBool,
}

impl EventQueue {
    fn lock(&self) -> MutexGuard<'_, EventSet> {
        self.pending.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn add(&self, add: impl FnOnce(&mut EventSet)) {
        add(&mut self.lock());
        self.changed.notify_one();
    }

    /// The service is to end because of this signal.
    pub(crate) fn stop(&self, signal: i32) {
        self.add(|pending| pending.stop = Some(signal));
    }

    /// All tables are to be loaded.
    pub(crate) fn load_all(&self) {
        self.add(|pending| pending.load_all = true);
    }

    /// Something was found in the file of an IMU's table.
    pub(crate) fn file(&self, imu: usize, report: FileReport) {
        self.add(|pending| {
            let is_requested = report.is_requested || pending.files.get(&imu).is_some_and(|before| before.is_requested);
            pending.files.insert(imu, FileReport { is_requested, ..report });
        });
    }

    /// The state folder was read for an IMU.
    pub(crate) fn memory(&self, imu: usize, memory: KeptTables) {
        self.add(|pending| drop(pending.memories.insert(imu, memory)));
    }

    /// Keeping an IMU's table has ended.
    pub(crate) fn kept(&self, imu: usize, outcome: KeepOutcome) {
        self.add(|pending| drop(pending.kept.insert(imu, outcome)));
    }

    /// Whether the service is to end. The signal stays for [`wait`](Self::wait).
    pub(crate) fn is_stopped(&self) -> bool {
        self.lock().stop.is_some()
    }

    /// The service has started: the control thread waits for events from now on.
    pub(crate) fn start(&self) {
        self.has_started.store(true, Ordering::Relaxed);
    }

    /// Whether the control thread waits for events.
    pub(crate) fn has_started(&self) -> bool {
        self.has_started.load(Ordering::Relaxed)
    }

    /// Waits until something happens, at most until the deadline, and takes it.
    pub(crate) fn wait(&self, deadline: Instant) -> EventSet {
        let mut pending = self.lock();
        while pending.is_empty() {
            let left = deadline.saturating_duration_since(Instant::now());
            if left == Duration::ZERO {
                break;
            }
            pending = self.changed.wait_timeout(pending, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        mem::take(&mut pending)
    }
}
