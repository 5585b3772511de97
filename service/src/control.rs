//! The control thread: it starts the service, then reloads tables, publishes the status and does the housekeeping, and
//! stops the service.
//!
//! Start-up order: tables (all faults are reported together, before any stream is created) -> node -> status stream,
//! which keeps a second service out -> workers with the IMUs' streams -> file watch -> loop. The service stops in the
//! reverse order.

use crate::config::{Config, Strategy};
use crate::guard::{self, Guard};
use crate::imu::{FirstTable, ImuState, PendingImu, log_unlike_scale_factors};
use crate::leftovers::{self, Leftovers};
use crate::metrics::Metrics;
use crate::reload::{self, TICK, TableFile};
use crate::status::{StatusPublisher, imu_status};
use crate::systemd::ServiceManager;
use crate::threads::{self, HeartbeatChange, WorkerThread};
use crate::worker::Worker;
use crate::worker::channel::ChannelLink;
use crate::worker::counters::CounterReader;
use crate::{create, sigbus};
use isotherm_client::{
    Realtime, check_domain, check_owner, check_room, join, monotonic_ns, process_kb, reserve, unix_s,
};
use isotherm_failure::{Exit, Failure};
use isotherm_files::Trust;
use isotherm_shared::status::ServiceStatus;
use isotherm_shared::stream::{Domain, IpcNode};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::ffi::OsString;
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};
use tracing::{error, info, warn};

/// How often the status is published while it has a reader; without one it is published with the housekeeping.
const STATUS_INTERVAL: Duration = Duration::from_millis(100);
/// How often dead peers are cleaned up, and counters and worker threads inspected.
const HOUSEKEEPING_INTERVAL: Duration = Duration::from_secs(1);

/// An event that wakes the control thread.
enum ControlEvent {
    Signal(i32),
    /// The file of a table, given by its name, was renamed or closed after writing.
    File(OsString),
}

/// Runs the service until SIGTERM or SIGINT.
///
/// # Errors
/// Why it could not start or continue.
pub(crate) fn run(
    domain: &Domain,
    config: &Config,
    allow_uncalibrated: bool,
    trust: Trust,
) -> Result<(), Failure> {
    let started = Instant::now();
    let (events, inbox) = mpsc::channel();
    forward_signals(events.clone())?;
    raise_descriptor_limit();
    let mut manager = ServiceManager::from_environment();

    let state = guard::state_folder(domain);
    let first_tables = load_tables(domain, config, state.as_deref().ok(), allow_uncalibrated, trust)?;
    let metrics = config.metrics.map(Metrics::start).transpose()?;
    make_room(domain, config)?;
    let node = join(domain)?;
    let publisher = StatusPublisher::create(&node, domain)?;

    // The first tables are queued before the streams exist, so that no sample meets a channel without its table.
    let mut links: Vec<Vec<ChannelLink>> = (0..config.workers()).map(|_| Vec::new()).collect();
    let mut pending = Vec::new();
    for (imu, first) in config.imus.iter().zip(first_tables) {
        let (pending_imu, link) = PendingImu::new(imu, first);
        links[imu.worker].push(link);
        pending.push(pending_imu);
    }
    let stopped = || matches!(inbox.try_recv(), Ok(ControlEvent::Signal(SIGTERM | SIGINT)));
    let Some(workers) = start_workers(domain, config, links, stopped)? else {
        info!("stopped while starting");
        return Ok(());
    };
    let imus = pending.into_iter().map(|imu| imu.open_streams(&node)).collect::<Result<Vec<_>, _>>()?;
    guard::tell_if_not_kept(&state);
    reserve(domain)?;
    let _watcher = watch(config, events);
    let threads = threads_of(config, &workers);
    manager.ready();
    let leftovers = Leftovers::new(domain, &node);
    let service = Service {
        domain,
        config,
        started,
        started_unix_s: unix_s() - started.elapsed().as_secs_f64(),
        node,
        publisher,
        metrics,
        logged: Logged { held_back: vec![false; workers.len()], unpublished: false },
        threads,
        workers,
        manager,
        leftovers,
        imus,
    };
    info!(
        domain = domain.name(),
        imus = config.imus.len(),
        wait = config.strategy.name(),
        workers = config.workers(),
        pid = std::process::id(),
        "ready"
    );
    service.run(&inbox)
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

/// Watches the folders of the tables, as far as that is possible.
fn watch(config: &Config, events: mpsc::Sender<ControlEvent>) -> Option<impl Sized + use<>> {
    let paths: Vec<_> = config.imus.iter().map(|imu| imu.table.clone()).collect();
    let (watcher, failures) = reload::watch(&paths, move |name| {
        // Sending fails only after the control loop has ended.
        let _ = events.send(ControlEvent::File(name));
    });
    for cause in failures {
        warn!("watching a table's folder: {cause}; its files are checked every {} ms instead", TICK.as_millis());
    }
    watcher
}

/// What is logged once, until it changes.
struct Logged {
    /// Of each worker.
    held_back: Vec<bool>,
    /// Whether the last status could not be published.
    unpublished: bool,
}

struct Service<'a> {
    domain: &'a Domain,
    config: &'a Config,
    started: Instant,
    started_unix_s: f64,
    node: IpcNode,
    publisher: StatusPublisher,
    metrics: Option<Metrics>,
    workers: Vec<Worker>,
    threads: Vec<WorkerThread>,
    manager: ServiceManager,
    leftovers: Leftovers,
    imus: Vec<ImuState>,
    logged: Logged,
}

impl Service<'_> {
    fn run(mut self, inbox: &Receiver<ControlEvent>) -> Result<(), Failure> {
        let (mut next_tick, mut next_status, mut next_housekeeping) = (self.started, self.started, self.started);
        loop {
            match inbox.recv_timeout(next_tick.saturating_duration_since(Instant::now())) {
                Ok(ControlEvent::Signal(SIGHUP)) => self.load_all(),
                Ok(ControlEvent::Signal(signal)) => {
                    info!("{}: stopping", if signal == SIGINT { "SIGINT" } else { "SIGTERM" });
                    return self.stop();
                }
                Ok(ControlEvent::File(name)) => {
                    for imu in self.imus.iter_mut().filter(|imu| imu.file.path().file_name() == Some(&name)) {
                        let change = imu.file.load_complete(Instant::now());
                        imu.apply(change, false);
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(Failure::new(Exit::Failed, "the signal thread ended; restart the service"));
                }
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
                self.keep_house();
            }
            if housekeeping || (now >= next_status && self.publisher.has_readers()) {
                next_status = now + STATUS_INTERVAL;
                self.publish();
            }
        }
    }

    fn load_all(&mut self) {
        info!("SIGHUP: loading all tables");
        self.manager.reloading();
        for imu in &mut self.imus {
            let change = imu.file.load().into();
            imu.apply(change, true);
        }
        self.manager.ready();
    }

    /// Looks at the files of the tables, at the readers that wait, and at the workers.
    fn tick(&mut self, now: Instant) {
        for imu in &mut self.imus {
            let change = imu.file.poll(Instant::now());
            imu.apply(change, false);
            imu.take_accepted();
            imu.flush();
        }
        for (index, worker) in self.workers.iter().enumerate() {
            worker.announce(self.imus.iter().filter(|imu| imu.imu.worker == index).map(ImuState::is_awaited));
        }
        self.check_heartbeats(now);
    }

    /// Removes what dead peers have left, logs losses, and measures the workers.
    fn keep_house(&mut self) {
        self.node.try_cleanup_dead_nodes();
        let ports: Vec<_> = self.imus.iter().flat_map(ImuState::ports).collect();
        self.leftovers.sweep(&self.node, &ports);
        for imu in &mut self.imus {
            imu.windows.end_second(imu.counters.latency());
            imu.log_news(self.domain, false);
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

    fn stop(mut self) -> Result<(), Failure> {
        self.manager.stopping();
        stop_all(self.workers)?;
        for imu in &mut self.imus {
            imu.log_news(self.domain, true);
            let counters = &imu.counters;
            let (received, compensated, missing) = (counters.received(), counters.compensated(), counters.missing());
            info!(imu = %imu.imu.id, received, compensated, missing, "stopped");
        }
        Ok(())
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

fn forward_signals(events: mpsc::Sender<ControlEvent>) -> Result<(), Failure> {
    let failed = |error: std::io::Error| Failure::new(Exit::Failed, format!("handling signals: {error}"));
    sigbus::install_handler().map_err(failed)?;
    let mut signals = Signals::new([SIGTERM, SIGINT, SIGHUP]).map_err(failed)?;
    let body = move || {
        for signal in signals.forever() {
            if events.send(ControlEvent::Signal(signal)).is_err() {
                return;
            }
        }
    };
    std::thread::Builder::new().name("signals".to_owned()).spawn(body).map(drop).map_err(failed)
}

/// Loads all tables, compares each with the one that was in force last, and reports the faults of all of them together.
fn load_tables(
    domain: &Domain,
    config: &Config,
    state: Option<&Path>,
    allow_uncalibrated: bool,
    trust: Trust,
) -> Result<Vec<FirstTable>, Failure> {
    let mut failures = Vec::new();
    let mut tables = Vec::new();
    for imu in &config.imus {
        let mut file = TableFile::new(imu.id.clone(), imu.table.clone(), trust);
        let guard = Guard::new(imu, domain, state);
        let table = match file.load() {
            Ok(table) => match guard.admit(&table) {
                Ok(admission) => {
                    let (file, digest) = (imu.table.display(), table.digest());
                    info!(imu = %imu.id, table = %digest, %file, "table loaded: {}", admission.words);
                    log_unlike_scale_factors(imu, &table);
                    Ok((table, admission))
                }
                Err(reason) => {
                    let message = format!("{}: {reason}", imu.table.display());
                    failures.push(Failure::new(Exit::Config, message).at(&imu.table, None));
                    continue;
                }
            },
            Err(error) if allow_uncalibrated && !imu.table.exists() => {
                warn!(imu = %imu.id, "no table yet, serving NaN: {error}");
                Err(error)
            }
            Err(error) => {
                failures.push(Failure::from(error));
                continue;
            }
        };
        tables.push(FirstTable { file, guard, table });
    }
    Failure::all(failures).map_or(Ok(tables), Err)
}
