//! The control thread: it starts the service, then reloads tables, publishes the status and does the housekeeping, and
//! stops the service in the reverse order of its start.
//!
//! It never waits for a disk, the log or a peer: what may take long has a thread that is allowed to, and what that has
//! to say comes as an event.

use crate::config::Config;
use crate::config_source::{ConfigFile, ConfigSource};
use crate::crash;
use crate::early_death::StartMark;
use crate::events::{EventQueue, EventSet};
use crate::imu::ImuState;
use crate::keeper::{KeepRequest, Keeper};
use crate::leftovers::Leftovers;
use crate::lock::DomainLock;
use crate::reload::{TICK, TableFiles};
use crate::startup::{ServiceParts, Startup, stop_all};
use crate::status::{StatusPublisher, imu_status};
use crate::systemd::{ServiceManager, has_supervisor};
use crate::threads::{self, HeartbeatChange, WorkerThread};
use crate::worker::Worker;
use crate::worker::counters::CounterReader;
use isotherm_client::transport::stream::IpcNode;
use isotherm_client::transport::{nodes, ports};
use isotherm_client::{UnixClock, clock_offset_ns, monotonic_ns, pid_namespace, process_kb, removed_object, unix_s};
use isotherm_shared::names::Domain;
use isotherm_shared::status::ServiceStatus;
use isotherm_support::failure::{Exit, Failure, shown};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use rustix::time::{ClockId, clock_gettime};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use std::{fs, thread};
use tracing::{error, info, warn};

/// How often the status is published while it has a reader; without one it is published with the housekeeping.
const STATUS_INTERVAL: Duration = Duration::from_millis(100);
/// How often dead peers are cleaned up, and counters and worker threads inspected.
const HOUSEKEEPING_INTERVAL: Duration = Duration::from_secs(1);
/// How long the end waits for the last table to be kept.
const KEEP_LIMIT: Duration = Duration::from_millis(300);
/// How long the end may take after a signal that comes while the service starts.
const START_END_LIMIT: Duration = Duration::from_millis(700);
/// How long the service manager is informed that tables are being reloaded, if a disk does not answer.
const RELOAD_LIMIT: Duration = Duration::from_secs(5);
/// So often it is logged that the configuration in use is not that of its file.
const CONFIGURATION_LOG_INTERVAL: Duration = Duration::from_secs(60);
/// How a service has ended.
#[derive(Debug)]
pub(crate) enum ServiceEnd {
    /// By a signal.
    Stopped,
    /// Its shared memory was removed: it has to begin anew, with this lock.
    BeginsAnew(DomainLock),
}

/// Runs the service until SIGTERM or SIGINT. If `allow_uncalibrated`, an IMU whose table does not exist yet is served
/// without one.
///
/// # Errors
/// Why it could not start or continue.
pub(crate) fn run(domain: &Domain, source: ConfigSource, allow_uncalibrated: bool) -> Result<ServiceEnd, Failure> {
    let events = Arc::<EventQueue>::default();
    forward_signals(&events)?;
    raise_descriptor_limit();
    let mut startup = Startup::new();
    match startup.start(domain, source, allow_uncalibrated, &events)? {
        Some((config, parts)) => Service::new(domain, &config, parts, startup, events)?.run(),
        None => {
            info!("stopped while starting");
            Ok(ServiceEnd::Stopped)
        }
    }
}

/// What is logged once, until it changes.
#[derive(Default)]
struct LogState {
    /// Of each worker.
    held_back: Vec<bool>,
    /// Whether the last status could not be published.
    unpublished: bool,
    /// Whether a reader could not be connected in the last second.
    unconnected: bool,
    /// Folders of tables whose disk does not answer.
    silent_folders: Vec<PathBuf>,
    /// When it was logged last that the file of the configuration is not in use.
    configuration: Option<Instant>,
}

struct Service<'a> {
    domain: &'a Domain,
    config: &'a Config,
    config_file: Option<ConfigFile>,
    started: Instant,
    started_unix_s: f64,
    unix_clock: UnixClock,
    events: Arc<EventQueue>,
    lock: DomainLock,
    /// `None` when it has been removed.
    mark: Option<StartMark>,
    publisher: StatusPublisher,
    workers: Vec<Worker>,
    threads: Vec<WorkerThread>,
    manager: ServiceManager,
    /// When the service manager is informed that the tables were reloaded as requested, at the latest.
    reloading_until: Option<Instant>,
    leftovers: Leftovers,
    files: TableFiles,
    keeper: Keeper,
    imus: Vec<ImuState>,
    logged: LogState,
    // The ports must be dropped before their node; fields are dropped in this order.
    node: IpcNode,
}

impl<'a> Service<'a> {
    /// The service that was started. It is ready.
    fn new(
        domain: &'a Domain,
        config: &'a Config,
        parts: ServiceParts,
        startup: Startup,
        events: Arc<EventQueue>,
    ) -> Result<Self, Failure> {
        let ServiceParts { lock, mark, node, publisher, workers, mut imus, files, keeper, config_file } = parts;
        let Startup { started, mut manager, .. } = startup;
        events.start();
        imus.iter_mut().for_each(|imu| imu.note_table(domain));
        manager.ready();
        info!(
            domain = domain.name(),
            imus = config.imus.len(),
            wait = config.strategy.name(),
            workers = config.workers(),
            pid = std::process::id(),
            "ready"
        );
        if let Some(file) = config_file.clone().filter(|file| file.refused.is_none()) {
            keeper.keep_configuration(file);
        }
        Ok(Self {
            domain,
            config,
            config_file,
            started,
            started_unix_s: unix_s() - started.elapsed().as_secs_f64(),
            unix_clock: UnixClock::new(),
            events,
            lock,
            mark: Some(mark),
            leftovers: Leftovers::new(domain),
            node,
            publisher,
            logged: LogState { held_back: vec![false; workers.len()], ..LogState::default() },
            threads: threads_of(config, &workers),
            workers,
            manager,
            reloading_until: None,
            files,
            keeper,
            imus,
        })
    }

    fn run(mut self) -> Result<ServiceEnd, Failure> {
        let (mut next_tick, mut next_status, mut next_housekeeping) = (self.started, self.started, self.started);
        loop {
            let EventSet { stop, load_all, files, memories, kept } = self.events.wait(next_tick);
            if let Some(signal) = stop {
                info!("{}: stopping", if signal == SIGINT { "SIGINT" } else { "SIGTERM" });
                return self.stop().map(|_| ServiceEnd::Stopped);
            }
            if load_all {
                self.load_all();
            }
            for (imu, memory) in memories {
                let request = self.imus[imu].recall(memory);
                self.keep(imu, request);
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

    /// Orders to load all tables. The service manager is informed when that is done, or when a disk does not answer.
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
            self.imus[number].note_table(self.domain);
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
        self.connect_readers();
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
        if let Some(step_ns) = self.unix_clock.look() {
            info!("Unix time was set by {:+.6} s; increments do not follow it", step_ns as f64 / 1e9);
        }
        self.log_configuration();
        self.log_silent_folders();
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
                     priority has its core, or the kernel's limit on real-time threads ({}); docs/operate.md explains what to do",
                    time.as_millis(),
                    threads::kernel_limit()
                );
            }
        }
        self.manager.status(&summary(&self.imus));
    }

    /// A reader that could not be connected, since the service had no descriptors or memory left, gets another attempt
    /// with the next increment, once a second until there is room.
    fn connect_readers(&mut self) {
        let failed = ports::take_unconnected();
        if failed && !self.logged.unconnected {
            error!(
                "a reader of increments could not be connected and receives nothing; is the limit on descriptors \
                 (LimitNOFILE) reached, or shared memory full? It is connected as soon as there is room"
            );
        }
        if failed || self.logged.unconnected {
            let refused = self.imus.iter().filter(|imu| ports::reconnect(&imu.increments).is_err()).count();
            self.logged.unconnected = failed || refused > 0;
        }
    }

    /// Logs once a minute that the configuration in use is not that of its file.
    fn log_configuration(&mut self) {
        if let Some(warning) = self.config_file.as_ref().and_then(ConfigFile::warning)
            && self.logged.configuration.is_none_or(|logged| logged.elapsed() >= CONFIGURATION_LOG_INTERVAL)
        {
            self.logged.configuration = Some(Instant::now());
            error!("{warning}");
        }
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
        let result = self.publisher.publish(&self.status());
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
            configuration_file: self.config_file.as_ref().map(|file| file.path.display().to_string()),
            configuration_error: self.config_file.as_ref().and_then(|file| file.refused.clone()),
            pid: std::process::id(),
            pid_namespace: pid_namespace(),
            clock_offset_ns: clock_offset_ns(),
            unix_offset_ns: self.unix_clock.offset().offset_ns,
            unix_offset_uncertainty_ns: self.unix_clock.offset().uncertainty_ns,
            unix_steps: self.unix_clock.steps(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            uptime_s: self.started.elapsed().as_secs_f64(),
            started_unix_s: self.started_unix_s,
            taken_ns: monotonic_ns(),
            wait: self.config.strategy.name().to_owned(),
            budget_us: self.config.budget_us,
            workers: self.threads.iter().map(WorkerThread::status).collect(),
            memory_locked_kb: process_kb("VmLck").unwrap_or(0),
            cpu_s: Duration::try_from(clock_gettime(ClockId::ProcessCPUTime)).unwrap_or_default().as_secs_f64(),
            memory_resident_kb: process_kb("VmRSS").unwrap_or(0),
            open_descriptors: fs::read_dir("/proc/self/fd").ok().map(|open| open.count() as u64),
            max_descriptors: getrlimit(Resource::Nofile).current,
            imus: self.imus.iter().map(imu_status).collect(),
        }
    }

    /// Ends because the shared memory of the streams was removed: those who are connected go on with what they have,
    /// and nobody else can connect. A supervisor starts the service again; without one it begins anew by itself.
    fn begin_anew(self, object: &Path) -> Result<ServiceEnd, Failure> {
        let cause = format!(
            "{} was removed under the running service: by systemd-logind at a logout (RemoveIPC), or by another \
             process that cleaned up; no other process can connect",
            shown(object)
        );
        error!("{cause}: restarting");
        let lock = self.stop()?;
        if has_supervisor() {
            return Err(Failure::new(
                Exit::Io,
                format!("{cause}: ending, so that the supervisor restarts the service"),
            ));
        }
        Ok(ServiceEnd::BeginsAnew(lock))
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
fn forward_signals(events: &Arc<EventQueue>) -> Result<(), Failure> {
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
