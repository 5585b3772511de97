//! The control thread: it starts the service, then reloads tables, publishes the status and does the housekeeping, and
//! stops the service.
//!
//! Start-up order: configuration -> tables (all faults are reported together, before any stream is created) -> node ->
//! status stream, which keeps a second service out -> workers with the IMUs' streams -> loop. The service stops in the
//! reverse order.
//!
//! It never waits for a disk, the log or a peer: what may take long has a thread that is allowed to, and what that has
//! to say comes as an event.

use crate::config::{Config, Strategy};
use crate::early_death::StartMark;
use crate::events::{EventSet, Events, FileChange, FileReport};
use crate::guard::Guard;
use crate::imu::{FirstTable, ImuState, PendingImu};
use crate::keeper::{KeepRequest, Keeper};
use crate::leftovers::{self, Leftovers};
use crate::lock::DomainLock;
use crate::logging::DroppedLines;
use crate::memory::Memory;
use crate::metrics::Metrics;
use crate::reload::{TICK, TableFile, TableFiles};
use crate::start;
use crate::status::{StatusPublisher, imu_status};
use crate::systemd::{ServiceManager, has_supervisor};
use crate::threads::{self, HeartbeatChange, WorkerThread};
use crate::worker::Worker;
use crate::worker::channel::ChannelLink;
use crate::worker::counters::CounterReader;
use crate::{crash, create, login};
use isotherm_client::transport::nodes;
use isotherm_client::transport::stream::IpcNode;
use isotherm_client::{
    Realtime, check_descriptors, check_domain, check_owner, check_room, clock_offset_ns, join, monotonic_ns,
    pid_namespace, process_kb, removed_object, reserve, unix_s,
};
use isotherm_files::Trust;
use isotherm_shared::names::Domain;
use isotherm_shared::status::ServiceStatus;
use isotherm_support::failure::{Exit, Failure, shown};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};
use tracing::{error, info, warn};

/// How often the status is published while it has a reader; without one it is published with the housekeeping.
const STATUS_INTERVAL: Duration = Duration::from_millis(100);
/// How often dead peers are cleaned up, and counters and worker threads inspected.
const HOUSEKEEPING_INTERVAL: Duration = Duration::from_secs(1);
/// How long a start waits for the table file of an IMU whose table from before is known.
const FILE_PATIENCE: Duration = Duration::from_secs(2);
/// How long the end waits for the last table to be kept.
const KEEP_LIMIT: Duration = Duration::from_millis(300);
/// How long the end may take after a signal that comes while the service starts.
const START_END_LIMIT: Duration = Duration::from_millis(700);
/// How long the service manager is told that tables are being reloaded, if a disk does not answer.
const RELOAD_LIMIT: Duration = Duration::from_secs(5);
/// How often a start that waits for a disk asks the service manager for more time, and how much it asks for.
const EXTENSION: (Duration, Duration) = (Duration::from_secs(1), Duration::from_secs(15));

/// What the command line says besides the configuration.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ServeOptions {
    /// An IMU whose table does not exist yet is served without one.
    pub allow_uncalibrated: bool,
    /// Whether files that everybody may write are taken.
    pub trust: Trust,
}

/// How a service has ended.
#[derive(Debug)]
pub(crate) enum Outcome {
    /// By a signal.
    Stopped,
    /// Its shared memory was removed: it has to begin anew, with this lock.
    BeginsAnew(DomainLock),
}

/// Runs the service until SIGTERM or SIGINT. `load` reads the configuration; it may wait for a disk.
///
/// # Errors
/// Why it could not start or continue.
pub(crate) fn run(
    domain: &Domain,
    load: impl FnOnce() -> Result<Config, Failure> + Send + 'static,
    options: ServeOptions,
) -> Result<Outcome, Failure> {
    let events = Arc::<Events>::default();
    forward_signals(&events)?;
    raise_descriptor_limit();
    let mut starting =
        Starting { started: Instant::now(), extended: Instant::now(), manager: ServiceManager::from_environment() };
    match starting.start(domain, load, options, &events)? {
        Some((config, parts)) => Service::new(domain, &config, parts, starting, events)?.run(),
        None => {
            info!("stopped while starting");
            Ok(Outcome::Stopped)
        }
    }
}

/// A service that starts.
struct Starting {
    started: Instant,
    /// When the service manager was last asked for more time.
    extended: Instant,
    manager: ServiceManager,
}

/// What a start has made.
struct StartedParts {
    lock: DomainLock,
    mark: StartMark,
    node: IpcNode,
    publisher: StatusPublisher,
    workers: Vec<Worker>,
    imus: Vec<ImuState>,
    metrics: Option<Metrics>,
    files: TableFiles,
    keeper: Keeper,
}

/// The node, the status stream, the workers, and the IMUs with their streams.
type OpenedStreams = (IpcNode, StatusPublisher, Vec<Worker>, Vec<ImuState>);

impl Starting {
    /// Starts everything; `None` if a signal ends the start.
    fn start(
        &mut self,
        domain: &Domain,
        load: impl FnOnce() -> Result<Config, Failure> + Send + 'static,
        options: ServeOptions,
        events: &Arc<Events>,
    ) -> Result<Option<(Config, StartedParts)>, Failure> {
        let Some(config) = self.wait_for(events, load)? else { return Ok(None) };
        let config = config?;
        let thread = |error: std::io::Error| Failure::new(Exit::Failed, format!("starting a thread: {error}"));
        let ids = config.imus.iter().map(|imu| imu.id.clone()).collect();
        let keeper = Keeper::start(domain, ids, events).map_err(thread)?;
        let file = |imu: &crate::config::Imu| TableFile::new(imu.id.clone(), imu.table.clone(), options.trust);
        let files = TableFiles::start(config.imus.iter().map(file).collect(), events).map_err(thread)?;
        let Some(first_tables) = self.first_tables(domain, &config, options.allow_uncalibrated, events)? else {
            return Ok(None);
        };
        let metrics = config.metrics.map(Metrics::start).transpose()?;
        check_descriptors(config.imus.len())?;
        let lock = DomainLock::take(domain, config.group.as_deref())?;
        let mark = StartMark::leave(domain);
        let Some((node, publisher, workers, imus)) = Self::open(domain, &config, first_tables, &keeper, events)? else {
            mark.remove();
            return Ok(None);
        };
        Ok(Some((config, StartedParts { lock, mark, node, publisher, workers, imus, metrics, files, keeper })))
    }

    /// Joins the domain and opens all streams; `None` if a signal ends the start.
    fn open(
        domain: &Domain,
        config: &Config,
        first_tables: Vec<FirstTable>,
        keeper: &Keeper,
        events: &Events,
    ) -> Result<Option<OpenedStreams>, Failure> {
        make_room(domain, config)?;
        let node = join(domain)?;
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
        reserve(domain)?;
        if let Some(warning) = login::warning() {
            warn!("{warning}");
        }
        Ok(Some((node, publisher, workers, imus)))
    }

    /// Waits for what is done in a thread of its own; `None` if a signal ends the start.
    fn wait_for<T: Send + 'static>(
        &mut self,
        events: &Events,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<Option<T>, Failure> {
        let (sender, done) = sync_channel(1);
        let body = move || {
            // Nobody waits for the result of a start that was ended.
            let _ = sender.send(work());
        };
        let failed = |cause: String| Failure::new(Exit::Failed, format!("starting: {cause}"));
        thread::Builder::new().name("start".to_owned()).spawn(body).map_err(|error| failed(error.to_string()))?;
        while !events.is_stopped() {
            match done.recv_timeout(Duration::from_millis(20)) {
                Ok(result) => return Ok(Some(result)),
                Err(RecvTimeoutError::Timeout) => self.extend(),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(failed("reading the configuration panicked; report this".to_owned()));
                }
            }
        }
        Ok(None)
    }

    /// Waits until it is known what was in force before, and what is in the table files, and chooses the first tables.
    /// A disk that does not answer is not waited for where a table from before can be served. `None` if a signal ends
    /// the start.
    fn first_tables(
        &mut self,
        domain: &Domain,
        config: &Config,
        allow_uncalibrated: bool,
        events: &Events,
    ) -> Result<Option<Vec<FirstTable>>, Failure> {
        let mut memories: BTreeMap<usize, Memory> = BTreeMap::new();
        let mut reports: BTreeMap<usize, FileReport> = BTreeMap::new();
        let (mut patience, begun, mut is_told) = (None, Instant::now(), false);
        loop {
            let EventSet { stop, files, memories: read, .. } = events.wait(Instant::now() + TICK);
            if stop.is_some() {
                return Ok(None);
            }
            memories.extend(read);
            reports.extend(files);
            self.extend();
            if memories.len() < config.imus.len() {
                if !is_told && begun.elapsed() >= FILE_PATIENCE {
                    is_told = true;
                    warn!("the disk of the state folder does not answer; the service starts when it does");
                }
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
        let guards = config.imus.iter().zip(memories.into_values());
        let guards = guards.map(|(imu, memory)| Guard::new(imu, domain, memory)).collect();
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

/// What is logged once, until it changes.
#[derive(Default)]
struct Logged {
    /// Of each worker.
    held_back: Vec<bool>,
    /// Whether the last status could not be published.
    unpublished: bool,
    /// Folders of tables whose disk does not answer.
    silent_folders: Vec<PathBuf>,
    dropped_lines: DroppedLines,
}

struct Service<'a> {
    domain: &'a Domain,
    config: &'a Config,
    started: Instant,
    started_unix_s: f64,
    events: Arc<Events>,
    lock: DomainLock,
    /// `None` when it has been removed.
    mark: Option<StartMark>,
    publisher: StatusPublisher,
    metrics: Option<Metrics>,
    workers: Vec<Worker>,
    threads: Vec<WorkerThread>,
    manager: ServiceManager,
    /// When the service manager is told that the tables were reloaded as requested, at the latest.
    reloading_until: Option<Instant>,
    leftovers: Leftovers,
    files: TableFiles,
    keeper: Keeper,
    imus: Vec<ImuState>,
    logged: Logged,
    // The ports must be dropped before their node; fields are dropped in this order.
    node: IpcNode,
}

impl<'a> Service<'a> {
    /// The service that was started. It is ready.
    fn new(
        domain: &'a Domain,
        config: &'a Config,
        parts: StartedParts,
        starting: Starting,
        events: Arc<Events>,
    ) -> Result<Self, Failure> {
        let StartedParts { lock, mark, node, publisher, workers, imus, metrics, files, keeper } = parts;
        let Starting { started, mut manager, .. } = starting;
        events.start();
        manager.ready();
        info!(
            domain = domain.name(),
            imus = config.imus.len(),
            wait = config.strategy.name(),
            workers = config.workers(),
            pid = std::process::id(),
            "ready"
        );
        Ok(Self {
            domain,
            config,
            started,
            started_unix_s: unix_s() - started.elapsed().as_secs_f64(),
            events,
            lock,
            mark: Some(mark),
            leftovers: Leftovers::new(domain, &node),
            node,
            publisher,
            metrics,
            logged: Logged { held_back: vec![false; workers.len()], ..Logged::default() },
            threads: threads_of(config, &workers),
            workers,
            manager,
            reloading_until: None,
            files,
            keeper,
            imus,
        })
    }

    fn run(mut self) -> Result<Outcome, Failure> {
        let (mut next_tick, mut next_status, mut next_housekeeping) = (self.started, self.started, self.started);
        loop {
            let EventSet { stop, load_all, files, kept, .. } = self.events.wait(next_tick);
            if let Some(signal) = stop {
                info!("{}: stopping", if signal == SIGINT { "SIGINT" } else { "SIGTERM" });
                return self.stop().map(|_| Outcome::Stopped);
            }
            if load_all {
                self.load_all();
            }
            for (imu, report) in files {
                let is_requested = report.is_requested;
                let request = self.imus[imu].apply(report);
                self.keep(imu, request);
                if is_requested {
                    self.imus[imu].awaits_load = false;
                }
            }
            for (imu, outcome) in kept {
                self.imus[imu].note_kept(outcome);
            }
            let now = Instant::now();
            if now >= next_tick {
                next_tick = now + TICK;
                self.tick(now);
            }
            if self.workers.iter().any(Worker::is_finished) {
                return stop_all(self.workers).and(Err(Failure::new(Exit::Failed, "a worker thread ended by itself")));
            }
            let housekeeping = now >= next_housekeeping;
            if housekeeping {
                next_housekeeping = now + HOUSEKEEPING_INTERVAL;
                if let Some(object) = removed_object(self.domain) {
                    return self.begin_anew(&object);
                }
                self.keep_house();
            }
            if housekeeping || (now >= next_status && self.publisher.has_readers()) {
                next_status = now + STATUS_INTERVAL;
                self.publish();
            }
        }
    }

    /// Orders to load all tables. The service manager is told when that is done, or when a disk does not answer.
    fn load_all(&mut self) {
        info!("SIGHUP: loading all tables");
        self.manager.reloading();
        self.reloading_until = Some(Instant::now() + RELOAD_LIMIT);
        self.imus.iter_mut().for_each(|imu| imu.awaits_load = true);
        self.files.load_all();
    }

    /// Has what is in force for an IMU now kept, if there is anything new.
    fn keep(&self, imu: usize, request: Option<KeepRequest>) {
        if let Some(request) = request {
            self.keeper.keep(imu, request);
        }
    }

    /// Looks at what the operator has accepted, at the readers that wait, and at the workers.
    fn tick(&mut self, now: Instant) {
        for number in 0..self.imus.len() {
            let request = self.imus[number].take_accepted();
            self.keep(number, request);
            self.imus[number].flush();
            self.imus[number].note_session();
        }
        for (index, worker) in self.workers.iter().enumerate() {
            worker.announce(self.imus.iter().filter(|imu| imu.imu.worker == index).map(ImuState::is_awaited));
        }
        if self.reloading_until.is_some_and(|until| now >= until || self.imus.iter().all(|imu| !imu.awaits_load)) {
            self.reloading_until = None;
            self.manager.ready();
        }
        self.check_heartbeats(now);
    }

    /// Removes what dead peers have left, logs losses, and measures the workers.
    fn keep_house(&mut self) {
        nodes::clean(&self.node);
        let ports: Vec<_> = self.imus.iter().flat_map(ImuState::ports).collect();
        self.leftovers.sweep(&self.node, &ports);
        for imu in &mut self.imus {
            imu.windows.end_second(imu.counters.latency(), imu.counters.received(), unix_s());
            imu.log_news(self.domain, false);
        }
        for number in 0..self.imus.len() {
            let request = self.imus[number].take_anchor();
            self.keep(number, request);
        }
        self.log_silent_folders();
        self.logged.dropped_lines.report();
        if self.mark.as_mut().is_some_and(StartMark::remove_after_a_second) {
            self.mark = None;
        }
        for (index, (thread, logged)) in self.threads.iter_mut().zip(&mut self.logged.held_back).enumerate() {
            thread.measure();
            if let Some(time) = thread.held_back().filter(|_| !*logged) {
                *logged = true;
                warn!(
                    worker = index,
                    "held back for {} ms of the last second in spite of its real-time priority: another thread of at least its \
                     priority has its core, or the kernel's limit on real-time threads ({}); docs/operate.md tells what to do",
                    time.as_millis(),
                    threads::kernel_limit()
                );
            }
        }
        self.manager.status(&summary(&self.imus));
    }

    /// Logs each folder of tables whose disk does not answer, once until it does.
    fn log_silent_folders(&mut self) {
        let silent: Vec<_> = self.files.silent_folders().into_iter().map(Path::to_owned).collect();
        for folder in silent.iter().filter(|folder| !self.logged.silent_folders.contains(folder)) {
            warn!("the disk of {} does not answer: new tables there are not seen until it does", shown(folder));
        }
        self.logged.silent_folders = silent;
    }

    fn publish(&mut self) {
        let status = Arc::new(self.status());
        let result = self.publisher.publish(&status);
        if let Some(metrics) = &self.metrics {
            metrics.update(&status);
        }
        if let Err(cause) = &result
            && !self.logged.unpublished
        {
            error!("publishing the status: {cause}");
        }
        self.logged.unpublished = result.is_err();
    }

    /// Logs each worker that stops or resumes. While no worker stands still, feeds the service manager's watchdog.
    fn check_heartbeats(&mut self, now: Instant) {
        for (index, thread) in self.threads.iter_mut().enumerate() {
            match thread.check_heartbeat() {
                Some(HeartbeatChange::Stopped) => error!(
                    worker = index,
                    imus = thread.imus(),
                    "stands still: its loop has not turned for a second, its IMUs are not served; if it stays so, restart the service"
                ),
                Some(HeartbeatChange::Resumed) => info!(worker = index, imus = thread.imus(), "runs again"),
                None => {}
            }
        }
        if !self.threads.iter().any(WorkerThread::stands_still) {
            self.manager.feed_watchdog(now);
        }
    }

    fn status(&self) -> ServiceStatus {
        ServiceStatus {
            domain: self.domain.into(),
            pid: std::process::id(),
            pid_namespace: pid_namespace(),
            clock_offset_ns: clock_offset_ns(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            uptime_s: self.started.elapsed().as_secs_f64(),
            started_unix_s: self.started_unix_s,
            taken_ns: monotonic_ns(),
            wait: self.config.strategy.name().to_owned(),
            budget_us: self.config.budget_us,
            workers: self.threads.iter().map(WorkerThread::status).collect(),
            memory_locked_kb: process_kb("VmLck").unwrap_or(0),
            imus: self.imus.iter().map(imu_status).collect(),
        }
    }

    /// Ends because the shared memory of the streams was removed: those who are connected go on with what they have,
    /// and nobody else can connect. A supervisor starts the service again; without one it begins anew by itself.
    fn begin_anew(self, object: &Path) -> Result<Outcome, Failure> {
        let cause = format!(
            "{} was removed under the running service: by systemd-logind at a logout (RemoveIPC), or by somebody who tidied up; no other \
             process can connect",
            shown(object)
        );
        error!("{cause}: beginning anew");
        let lock = self.stop()?;
        if has_supervisor() {
            return Err(Failure::new(
                Exit::Io,
                format!("{cause}: ending, so that the supervisor starts the service anew"),
            ));
        }
        Ok(Outcome::BeginsAnew(lock))
    }

    /// Stops the workers and leaves the streams. Returns the lock, which is held until the process ends.
    fn stop(mut self) -> Result<DomainLock, Failure> {
        self.manager.stopping();
        stop_all(self.workers)?;
        self.keeper.finish(KEEP_LIMIT);
        for imu in &mut self.imus {
            imu.end_session();
            imu.log_news(self.domain, true);
            let counters = &imu.counters;
            let (received, compensated, missing) = (counters.received(), counters.compensated(), counters.missing());
            info!(imu = %imu.imu.id, received, compensated, missing, "stopped");
        }
        if let Some(mark) = &self.mark {
            mark.remove();
        }
        Ok(self.lock)
    }
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
             for some 50 ms of every second ({}); docs/operate.md tells how, status shows it as held back",
            threads::kernel_limit()
        );
    }
    Ok(Some(workers))
}

fn stop_all(workers: Vec<Worker>) -> Result<(), Failure> {
    workers.iter().for_each(Worker::request_stop);
    workers.into_iter().map(Worker::join).fold(Ok(()), Result::and)
}

fn threads_of(config: &Config, workers: &[Worker]) -> Vec<WorkerThread> {
    let thread_of = |(index, worker): (usize, &Worker)| {
        let imus = config.imus.iter().filter(|imu| imu.worker == index).map(|imu| imu.id.to_string());
        WorkerThread::new(worker.thread_id, imus.collect(), worker.heartbeat.clone())
    };
    workers.iter().enumerate().map(thread_of).collect()
}

/// A service needs some ten descriptors for each IMU and a few for each client. With many of them that is over the
/// usual soft limit.
fn raise_descriptor_limit() {
    let Rlimit { maximum, .. } = getrlimit(Resource::Nofile);
    // If this fails, the limit stays, and whatever runs out of descriptors reports it.
    let _ = setrlimit(Resource::Nofile, Rlimit { current: maximum, maximum });
}

/// The status line for the service manager.
fn summary(imus: &[ImuState]) -> String {
    let sum = |count: fn(&CounterReader) -> u64| imus.iter().map(|imu| count(&imu.counters)).sum::<u64>();
    let (compensated, missing) = (sum(CounterReader::compensated), sum(CounterReader::missing));
    let refused = imus.iter().filter(|imu| imu.last_error.is_some()).count();
    format!("{} IMUs, {compensated} increments, {missing} samples missing, {refused} table files refused", imus.len())
}

/// Passes signals on to the control thread. One that comes while the service starts ends it within
/// [`START_END_LIMIT`], whatever the start waits for.
fn forward_signals(events: &Arc<Events>) -> Result<(), Failure> {
    let failed = |error: std::io::Error| Failure::new(Exit::Failed, format!("handling signals: {error}"));
    crash::install_handlers().map_err(failed)?;
    let mut signals = Signals::new([SIGTERM, SIGINT, SIGHUP]).map_err(failed)?;
    let events = Arc::clone(events);
    let body = move || {
        for signal in signals.forever() {
            if signal == SIGHUP {
                events.load_all();
                continue;
            }
            events.stop(signal);
            if !events.has_started() {
                thread::sleep(START_END_LIMIT);
                // What is left half-created is removed by the next start.
                low_level::exit(0);
            }
        }
    };
    thread::Builder::new().name("signals".to_owned()).spawn(body).map(drop).map_err(failed)
}
