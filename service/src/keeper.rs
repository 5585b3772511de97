//! Keeps the tables in force, and the configuration, in the state folder, in a thread of its own: a disk may take its
//! time.
//!
//! Only the newest table of each IMU waits. One that cannot be kept is tried again until it is, or until a newer one
//! replaces it. The configuration is kept once after each start.

use crate::config_source::ConfigFile;
use crate::events::{EventQueue, KeepOutcome};
use crate::memory::{KeptTables, StateFolder, kept_note, remedy};
use isotherm_client::{Domain, ImuId, STATE_VARIABLE};
use isotherm_install::Acceptance;
use isotherm_support::failure::shown;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use std::{io, thread};
use tracing::warn;

/// Pause before what could not be kept is tried again.
const RETRY: Duration = Duration::from_secs(10);

/// What is to be kept for an IMU.
#[derive(Clone, Debug)]
pub(crate) struct KeepRequest {
    /// The table in force, and those that the next one is compared with.
    pub memory: KeptTables,
    /// What was accepted when the table was taken, which may be another one: an acceptance that was not needed does not
    /// wait for a later table. It is used up when the table is kept. One that came meanwhile stays.
    pub accepted: Vec<Acceptance>,
}

/// The control thread's handle. Dropping it ends the thread when it has nothing to do.
pub(crate) struct Keeper {
    link: Arc<KeeperLink>,
}

#[derive(Default)]
struct KeeperLink {
    queue: Mutex<KeeperQueue>,
    changed: Condvar,
}

#[derive(Default)]
struct KeeperQueue {
    /// By the number of the IMU.
    requests: BTreeMap<usize, KeepRequest>,
    /// The configuration that is to be kept.
    configuration: Option<ConfigFile>,
    /// Whether the thread is at work on a request.
    is_busy: bool,
    ended: bool,
}

impl KeeperLink {
    fn lock(&self) -> MutexGuard<'_, KeeperQueue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Keeper {
    /// Starts the thread. It first reads what is kept for each IMU, and passes that to `events`.
    ///
    /// # Errors
    /// If the operating system refuses the thread.
    pub(crate) fn start(domain: &Domain, imus: Vec<ImuId>, events: &Arc<EventQueue>) -> io::Result<Self> {
        let link = Arc::<KeeperLink>::default();
        let body = {
            let (link, domain, events) = (Arc::clone(&link), domain.clone(), Arc::clone(events));
            move || KeeperThread::new(domain, imus, link, events).run()
        };
        thread::Builder::new().name("keeper".to_owned()).spawn(body)?;
        Ok(Self { link })
    }

    /// Requests that the tables of an IMU are kept. The outcome comes as an event.
    pub(crate) fn keep(&self, imu: usize, request: KeepRequest) {
        self.link.lock().requests.insert(imu, request);
        self.link.changed.notify_all();
    }

    /// Requests that the configuration is kept, with which the service has started.
    pub(crate) fn keep_configuration(&self, file: ConfigFile) {
        self.link.lock().configuration = Some(file);
        self.link.changed.notify_all();
    }

    /// Waits until nothing is left to do, but no longer than this.
    pub(crate) fn finish(&self, limit: Duration) {
        let is_at_work =
            |queue: &mut KeeperQueue| queue.is_busy || !queue.requests.is_empty() || queue.configuration.is_some();
        // What is not kept then is kept after the next start.
        drop(self.link.changed.wait_timeout_while(self.link.lock(), limit, is_at_work));
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        self.link.lock().ended = true;
        self.link.changed.notify_all();
    }
}

/// What the thread does next.
enum KeeperTask {
    /// Keeps what is in force for the IMU of this number.
    Table(usize, KeepRequest),
    /// Keeps a configuration.
    Configuration(ConfigFile),
}

struct KeeperThread {
    domain: Domain,
    imus: Vec<ImuId>,
    link: Arc<KeeperLink>,
    events: Arc<EventQueue>,
    folder: Result<StateFolder, &'static str>,
    /// What is in the folder, by the number of the IMU.
    kept: Vec<KeptTables>,
    /// What could not be kept.
    failed: BTreeMap<usize, KeepRequest>,
    told_in_memory: bool,
}

impl KeeperThread {
    fn new(domain: Domain, imus: Vec<ImuId>, link: Arc<KeeperLink>, events: Arc<EventQueue>) -> Self {
        let folder = StateFolder::of(&domain);
        Self { domain, imus, link, events, folder, kept: Vec::new(), failed: BTreeMap::new(), told_in_memory: false }
    }

    fn run(mut self) {
        for (number, imu) in self.imus.iter().enumerate() {
            let (memory, faults) = match &self.folder {
                Ok(folder) => folder.load(&self.domain, imu),
                Err(_) => (KeptTables::default(), Vec::new()),
            };
            for cause in faults {
                warn!(%imu, "the table that was in force last cannot be read: {cause}");
            }
            if let Some(digest) = memory.forgotten.as_ref().and_then(|forgotten| forgotten.digest.as_ref()) {
                warn!(%imu, "the table {digest} was kept, and is missing now: no other table is taken unless it is accepted");
            }
            self.kept.push(memory.clone());
            self.events.memory(number, memory);
        }
        while let Some(task) = self.next() {
            match task {
                KeeperTask::Table(number, request) => self.keep(number, request),
                KeeperTask::Configuration(file) => self.keep_configuration(&file),
            }
        }
    }

    /// Waits for the next request; `None` at the end.
    fn next(&mut self) -> Option<KeeperTask> {
        let mut queue = self.link.lock();
        queue.is_busy = false;
        self.link.changed.notify_all();
        loop {
            let table = queue.requests.pop_first().map(|(number, request)| KeeperTask::Table(number, request));
            if let Some(task) = table.or_else(|| queue.configuration.take().map(KeeperTask::Configuration)) {
                queue.is_busy = true;
                return Some(task);
            }
            if queue.ended {
                return None;
            }
            if self.failed.is_empty() {
                queue = self.link.changed.wait(queue).unwrap_or_else(PoisonError::into_inner);
            } else {
                let (again, waited) =
                    self.link.changed.wait_timeout(queue, RETRY).unwrap_or_else(PoisonError::into_inner);
                queue = again;
                if waited.timed_out() && queue.requests.is_empty() {
                    return self.failed.pop_first().map(|(number, request)| KeeperTask::Table(number, request));
                }
            }
        }
    }

    fn keep(&mut self, number: usize, request: KeepRequest) {
        let imu = &self.imus[number];
        let Some(table) = request.memory.in_force.as_ref().map(|table| table.digest().to_string()) else { return };
        let stored = match &self.folder {
            Ok(folder) => folder
                .store(imu, &request.memory, &self.kept[number])
                .map_err(|error| format!("keeping the table in force as {}: {error}", shown(&folder.path(imu)))),
            Err(cause) => Err(format!("keeping the table in force: {cause}")),
        };
        let is_again =
            self.failed.remove(&number).is_some_and(|before| before.memory.in_force == request.memory.in_force);
        match stored {
            Ok(()) => {
                self.note_kept(imu, &table);
                request.accepted.iter().for_each(Acceptance::remove);
                self.kept[number] = request.memory;
                self.tell_if_in_memory();
                self.events.kept(number, KeepOutcome { table, error: None });
            }
            Err(error) => {
                if !is_again {
                    warn!(%imu, "{error}; the next start compares with an older one, or with none; {}", remedy());
                }
                self.failed.insert(number, request);
                self.events.kept(number, KeepOutcome { table, error: Some(error) });
            }
        }
    }

    fn keep_configuration(&mut self, file: &ConfigFile) {
        let stored = match &self.folder {
            Ok(folder) => folder.store_configuration(&file.path, &file.text).map_err(|error| error.to_string()),
            Err(cause) => Err((*cause).to_owned()),
        };
        if let Err(cause) = stored {
            warn!(
                "keeping the configuration {}: {cause}; a start with a damaged one has no other, or an older one; {}",
                shown(&file.path),
                remedy()
            );
        }
    }

    /// Notes in the domain's folder that a table is kept, so that the next start misses it.
    fn note_kept(&self, imu: &ImuId, table: &str) {
        if let Err(error) = kept_note(&self.domain, imu).write(table.as_bytes()) {
            warn!(%imu, "noting in {} that its table is kept: {error}", shown(Path::new(self.domain.root_path())));
        }
    }

    fn tell_if_in_memory(&mut self) {
        if !std::mem::replace(&mut self.told_in_memory, true)
            && let Ok(Some(cause)) = self.folder.as_ref().map(StateFolder::is_in_memory)
        {
            warn!(
                "a power cycle forgets which tables were in force, and the next start takes any: {cause}; name another folder in \
                 {STATE_VARIABLE}"
            );
        }
    }
}
