//! The start of the service, in this order: configuration -> tables (all faults are reported together, before any
//! stream is created) -> node -> status stream, which keeps a second service out -> workers with the IMUs' streams.

use crate::config::{Config, Imu, Strategy};
use crate::config_source::{ConfigError, ConfigFile, ConfigSource, LoadedConfig};
use crate::early_death::StartMark;
use crate::events::{EventQueue, EventSet, FileChange, FileReport};
use crate::guard::Guard;
use crate::imu::{FirstTable, ImuState, PendingImu};
use crate::keeper::Keeper;
use crate::lock::DomainLock;
use crate::memory::KeptTables;
use crate::reload::{TICK, TableFiles, WatchedFile};
use crate::status::StatusPublisher;
use crate::systemd::ServiceManager;
use crate::worker::Worker;
use crate::worker::channel::ChannelLink;
use crate::{create, leftovers, start, threads};
use isotherm_client::transport::stream::IpcNode;
use isotherm_client::{Realtime, check_descriptors, check_domain, check_owner, check_room, join, note_memory};
use isotherm_install::remove_notes;
use isotherm_shared::names::Domain;
use isotherm_support::failure::{Exit, Failure};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};
use tracing::{error, warn};

/// How long a start waits for the table file of an IMU whose table from before is known.
const FILE_PATIENCE: Duration = Duration::from_secs(2);
/// How long a start waits for the disk of the state folder.
const STATE_PATIENCE: Duration = Duration::from_secs(5);
/// How often a start that waits for a disk asks the service manager for more time, and how much it asks for.
const EXTENSION: (Duration, Duration) = (Duration::from_secs(1), Duration::from_secs(15));

/// The start of a service.
pub(crate) struct Startup {
    pub started: Instant,
    /// When the service manager was last asked for more time.
    extended: Instant,
    pub manager: ServiceManager,
}

/// What a start has made.
pub(crate) struct ServiceParts {
    pub lock: DomainLock,
    pub mark: StartMark,
    pub node: IpcNode,
    pub publisher: StatusPublisher,
    pub workers: Vec<Worker>,
    pub imus: Vec<ImuState>,
    pub files: TableFiles,
    pub keeper: Keeper,
    /// The file of the configuration, if there is one.
    pub config_file: Option<ConfigFile>,
}

/// What became of a wait.
enum Waited<T> {
    Done(T),
    /// A signal ends the start.
    Stopped,
    /// The limit has passed.
    TooLate,
}

/// The node, the status stream, the workers, and the IMUs with their streams.
type OpenedStreams = (IpcNode, StatusPublisher, Vec<Worker>, Vec<ImuState>);

impl Startup {
    /// Begins now.
    pub(crate) fn new() -> Self {
        Self { started: Instant::now(), extended: Instant::now(), manager: ServiceManager::from_environment() }
    }

    /// Starts everything; `None` if a signal ends the start.
    ///
    /// # Errors
    /// Why the service cannot start.
    pub(crate) fn start(
        &mut self,
        domain: &Domain,
        source: ConfigSource,
        allow_uncalibrated: bool,
        events: &Arc<EventQueue>,
    ) -> Result<Option<(Config, ServiceParts)>, Failure> {
        let trust = source.trust;
        let Some((config, config_file)) = self.configuration(domain, source, events)? else { return Ok(None) };
        let thread = |error: std::io::Error| Failure::new(Exit::Failed, format!("starting a thread: {error}"));
        let ids = config.imus.iter().map(|imu| imu.id.clone()).collect();
        let keeper = Keeper::start(domain, ids, events).map_err(thread)?;
        let file = |imu: &Imu| WatchedFile::new(imu.id.clone(), imu.table.clone(), trust);
        let files = TableFiles::start(config.imus.iter().map(file).collect(), events).map_err(thread)?;
        let Some(first_tables) = self.first_tables(domain, &config, allow_uncalibrated, events)? else {
            return Ok(None);
        };
        check_descriptors(config.imus.len())?;
        let lock = DomainLock::take(domain)?;
        remove_notes(domain);
        let mark = StartMark::leave(domain);
        let Some((node, publisher, workers, imus)) = Self::open(domain, &config, first_tables, &keeper, events)? else {
            mark.remove();
            return Ok(None);
        };
        Ok(Some((config, ServiceParts { lock, mark, node, publisher, workers, imus, files, keeper, config_file })))
    }

    /// The configuration of the file, or the one that was kept of it if it cannot be used; `None` if a signal ends the
    /// start.
    fn configuration(
        &mut self,
        domain: &Domain,
        source: ConfigSource,
        events: &EventQueue,
    ) -> Result<Option<LoadedConfig>, Failure> {
        let failure = {
            let source = source.clone();
            match self.wait_for(events, None, move || source.load())? {
                Waited::Done(Ok(loaded)) => return Ok(Some(loaded)),
                Waited::Done(Err(ConfigError::Final(failure))) => return Err(failure),
                Waited::Done(Err(ConfigError::Unusable(failure))) => failure,
                Waited::Stopped | Waited::TooLate => return Ok(None),
            }
        };
        let domain = domain.clone();
        let message =
            format!("{}\nthe disk of the state folder, which has the last one, does not answer", failure.message);
        match self.wait_for(events, Some(STATE_PATIENCE), move || source.load_kept(&domain, failure))? {
            Waited::Done(kept) => kept.map(Some),
            Waited::TooLate => Err(Failure::new(Exit::Io, message)),
            Waited::Stopped => Ok(None),
        }
    }

    /// Joins the domain and opens all streams; `None` if a signal ends the start.
    fn open(
        domain: &Domain,
        config: &Config,
        first_tables: Vec<FirstTable>,
        keeper: &Keeper,
        events: &EventQueue,
    ) -> Result<Option<OpenedStreams>, Failure> {
        make_room(domain, config)?;
        let node = join(domain)?;
        if let Err(error) = note_memory(domain, &node) {
            warn!("noting which shared memory is used: {error}; a client with another one does not learn that");
        }
        let publisher = StatusPublisher::create(&node, domain)?;

        // The first tables are queued before the streams exist, so that no sample meets a channel without its table.
        let mut links: Vec<Vec<ChannelLink>> = (0..config.workers()).map(|_| Vec::new()).collect();
        let mut pending = Vec::new();
        for (imu, first) in config.imus.iter().zip(first_tables) {
            let (pending_imu, link) = PendingImu::new(domain, imu, first);
            links[imu.worker].push(link);
            pending.push(pending_imu);
        }
        let Some(workers) = start_workers(domain, config, links, || events.is_stopped())? else { return Ok(None) };
        let mut imus = Vec::with_capacity(pending.len());
        for (number, pending) in pending.into_iter().enumerate() {
            let (imu, request) = pending.open_streams(&node)?;
            if let Some(request) = request {
                keeper.keep(number, request);
            }
            imus.push(imu);
        }
        Ok(Some((node, publisher, workers, imus)))
    }

    /// Waits for what is done in a thread of its own, for `limit` at most if there is one.
    fn wait_for<T: Send + 'static>(
        &mut self,
        events: &EventQueue,
        limit: Option<Duration>,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<Waited<T>, Failure> {
        let begun = Instant::now();
        let (sender, done) = sync_channel(1);
        let body = move || {
            // Nobody waits for the result of a start that was ended.
            let _ = sender.send(work());
        };
        let failed = |cause: String| Failure::new(Exit::Failed, format!("starting: {cause}"));
        thread::Builder::new().name("start".to_owned()).spawn(body).map_err(|error| failed(error.to_string()))?;
        while !events.is_stopped() {
            match done.recv_timeout(Duration::from_millis(20)) {
                Ok(result) => return Ok(Waited::Done(result)),
                Err(RecvTimeoutError::Timeout) if limit.is_some_and(|limit| begun.elapsed() >= limit) => {
                    return Ok(Waited::TooLate);
                }
                Err(RecvTimeoutError::Timeout) => self.extend(),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(failed("reading the configuration panicked; report this".to_owned()));
                }
            }
        }
        Ok(Waited::Stopped)
    }

    /// Waits until it is known what was in force before, and what is in the table files, and chooses the first tables.
    /// A disk of table files that does not answer is not waited for where a table from before can be served. The disk
    /// of the state folder is waited for [`STATE_PATIENCE`]; then the table file is served whose digest is noted in the
    /// domain's folder. `None` if a signal ends the start.
    fn first_tables(
        &mut self,
        domain: &Domain,
        config: &Config,
        allow_uncalibrated: bool,
        events: &EventQueue,
    ) -> Result<Option<Vec<FirstTable>>, Failure> {
        let mut memories: BTreeMap<usize, KeptTables> = BTreeMap::new();
        let mut reports: BTreeMap<usize, FileReport> = BTreeMap::new();
        let (mut patience, begun) = (None, Instant::now());
        loop {
            let EventSet { stop, files, memories: read, .. } = events.wait(Instant::now() + TICK);
            if stop.is_some() {
                return Ok(None);
            }
            memories.extend(read);
            reports.extend(files);
            self.extend();
            if memories.len() < config.imus.len() && begun.elapsed() < STATE_PATIENCE {
                continue;
            }
            let patience = *patience.get_or_insert_with(|| Instant::now() + FILE_PATIENCE);
            // A disk that does not answer keeps its own IMUs from being served, and no others.
            let can_be_served = |imu: &usize| {
                let is_loaded = reports.get(imu).is_some_and(|report| matches!(report.change, FileChange::Loaded(_)));
                is_loaded || memories.get(imu).is_some_and(|memory| memory.reference().is_some())
            };
            let is_over = Instant::now() >= patience && (0..config.imus.len()).any(|imu| can_be_served(&imu));
            if reports.len() == config.imus.len() || is_over {
                break;
            }
        }
        if memories.len() < config.imus.len() {
            error!(
                "the disk of the state folder does not answer: without the tables from before, an IMU is served only with the table file \
                 whose digest was noted, or one that was accepted"
            );
        }
        let guards = config.imus.iter().enumerate().map(|(number, imu)| {
            let memory = memories.remove(&number).unwrap_or_else(|| KeptTables::pending(domain, &imu.id));
            Guard::new(imu, domain, memory)
        });
        let guards = guards.collect();
        let reports = (0..config.imus.len()).map(|imu| reports.remove(&imu)).collect();
        start::choose(config, guards, reports, allow_uncalibrated).map(Some)
    }

    /// Asks the service manager for more time, where the start waits for a disk.
    fn extend(&mut self) {
        let (pause, time) = EXTENSION;
        if self.extended.elapsed() >= pause {
            self.extended = Instant::now();
            self.manager.extend_start(time);
        }
    }
}

/// Locks memory, removes what killed processes have left, and looks whether there is room for all streams.
fn make_room(domain: &Domain, config: &Config) -> Result<(), Failure> {
    // Before the threads and the streams are created, so that all their memory is locked.
    let lock = Realtime { lock_memory: config.realtime.lock_memory, ..Realtime::default() };
    lock.apply().map_err(|error| Failure::new(Exit::Config, format!("realtime.{error}")))?;
    leftovers::use_domain_config(domain);
    check_owner(domain)?;
    create::remove_half_created(domain);
    check_domain(domain)?;
    leftovers::make_room(domain, config.imus.len());
    Ok(check_room(config.imus.len())?)
}

/// Starts all workers. Returns `None` if `give_up` returns true before the last one is ready.
fn start_workers(
    domain: &Domain,
    config: &Config,
    links: Vec<Vec<ChannelLink>>,
    mut give_up: impl FnMut() -> bool,
) -> Result<Option<Vec<Worker>>, Failure> {
    let mut workers = Vec::new();
    for (index, links) in links.into_iter().enumerate() {
        match Worker::start(domain, config, index, links, &mut give_up) {
            Ok(Some(worker)) => workers.push(worker),
            incomplete => {
                // Stop the workers that already run. Only the reason why this one did not start is reported.
                let _ = stop_all(workers);
                return incomplete.map(|_| None);
            }
        }
    }
    if let Some(priority) = config.realtime.priority
        && config.strategy == Strategy::Spin
    {
        warn!(
            "realtime.priority = {priority} and spin: unless the cores are isolated and the kernel's limit is lifted, it stops a worker \
             for some 50 ms of every second ({}); docs/operate.md explains how, status shows it as held back",
            threads::kernel_limit()
        );
    }
    Ok(Some(workers))
}

/// Stops all workers, and waits for their ends.
///
/// # Errors
/// The first failure of a worker.
pub(crate) fn stop_all(workers: Vec<Worker>) -> Result<(), Failure> {
    workers.iter().for_each(Worker::request_stop);
    workers.into_iter().map(Worker::join).fold(Ok(()), Result::and)
}
