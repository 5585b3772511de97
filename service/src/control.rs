//! The control thread: start-up in order, then reloading, telling, housekeeping, and an orderly end.
//!
//! Start-up: tables (all faults at once, before anything is touched) -> node -> status stream, which keeps a second
//! service out -> worker with the IMUs' streams -> file watch -> loop. The order of the end is the reverse.

use crate::config::{Config, Imu};
use crate::failure::{Exit, Failure};
use crate::reload::{self, Look, TICK, TableFile};
use crate::status::{ImuStatus, Status, StatusPublisher};
use crate::worker::Worker;
use crate::worker::channel::Wiring;
use crate::worker::counters::Counters;
use iceoryx2::prelude::ipc;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use isotherm_client::{join, monotonic_ns};
use isotherm_shared::stream::{self, Domain, IpcNode};
use isotherm_shared::table::{CoefficientTable, Digest};
use isotherm_shared::wire::{CompensatedIncrement, RawSample};
use rtrb::{Producer, RingBuffer};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::ffi::OsString;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};
use tracing::{error, info, warn};

/// Tables on their way to the worker. It takes them at least every few milliseconds; one that finds no room waits for
/// the next tick.
const TABLES: usize = 16;
/// How often the status is published.
const STATUS: Duration = Duration::from_millis(100);
/// How often dead peers are cleaned away and counters looked at.
const HOUSEKEEPING: Duration = Duration::from_secs(1);

/// What the control thread is woken for.
enum Event {
    Signal(i32),
    /// A table's file, by its name, was renamed or closed.
    File(OsString),
}

/// One IMU as the control thread sees it.
pub struct Served {
    /// Name and file.
    pub imu: Imu,
    /// The watched file.
    pub file: TableFile,
    /// Filled by the worker.
    pub counters: Arc<Counters>,
    /// Tables taken over after the first.
    pub reloads: u64,
    /// Why the file as it is now is not in force.
    pub last_error: Option<String>,
    /// For counting who is connected.
    pub raw: PortFactory<ipc::Service, RawSample, ()>,
    /// For counting who is connected.
    pub increments: PortFactory<ipc::Service, CompensatedIncrement, ()>,
    tables: Tables,
    told: Told,
}

/// Every table that the worker may still hold, the newest last. They are freed here, never by the worker.
struct Tables {
    alive: Vec<Arc<CoefficientTable>>,
    unsent: Option<Arc<CoefficientTable>>,
    queue: Producer<Arc<CoefficientTable>>,
}

/// Counter values that have been logged.
#[derive(Default)]
struct Told {
    missing: u64,
    transport_errors: u64,
}

impl Tables {
    fn send(&mut self, table: Arc<CoefficientTable>) {
        self.alive.push(Arc::clone(&table));
        self.unsent = Some(table);
        self.flush();
    }

    fn flush(&mut self) {
        if let Some(table) = self.unsent.take()
            && let Err(rtrb::PushError::Full(table)) = self.queue.push(table)
        {
            self.unsent = Some(table);
        }
        // The newest is in force, or will be; older ones go when the worker has let go of them.
        let newest = self.alive.last().map(Arc::clone);
        self.alive.retain(|table| {
            Arc::strong_count(table) > 1 || newest.as_ref().is_some_and(|newest| Arc::ptr_eq(table, newest))
        });
    }

    fn newest(&self) -> Option<&Arc<CoefficientTable>> {
        self.alive.last()
    }
}

impl Served {
    /// Digest of the table that the worker used last or would use now.
    pub fn digest_in_force(&self) -> Option<&Digest> {
        let id = self.counters.table.load(Relaxed);
        self.tables.alive.iter().map(|table| table.digest()).find(|digest| digest.id() == id)
    }

    fn take(&mut self, look: Look, forced: bool) {
        let id = &self.imu.id;
        match look {
            Look::Unchanged => {}
            Look::Loaded(table) => {
                let had_failed = self.last_error.take().is_some();
                let known = self.tables.newest().is_some_and(|newest| newest.digest() == table.digest());
                if known && !forced {
                    if had_failed {
                        info!(imu = %id, table = %table.digest(), "table file is good again, and the same as in force");
                    }
                    return;
                }
                info!(imu = %id, table = %table.digest(), file = %self.file.path().display(), "table taken");
                self.reloads += u64::from(self.tables.newest().is_some());
                self.tables.send(Arc::from(table));
            }
            Look::Refused(error) => {
                let error = cut(error.to_string());
                if self.last_error.as_ref() != Some(&error) {
                    warn!(imu = %id, "table refused, the one in force stays: {}", error.replace('\n', "; "));
                    self.last_error = Some(error);
                }
            }
        }
    }

    /// Logs what has been lost since the last time.
    fn tell(&mut self) {
        let missing = self.counters.missing.load(Relaxed);
        if missing > self.told.missing {
            warn!(imu = %self.imu.id, missing, "{} samples were missing in the raw stream", missing - self.told.missing);
            self.told.missing = missing;
        }
        let errors = self.counters.transport_errors.load(Relaxed);
        if errors > self.told.transport_errors {
            error!(imu = %self.imu.id, errors, "the transport failed {} times", errors - self.told.transport_errors);
            self.told.transport_errors = errors;
        }
    }
}

/// Runs the service until SIGTERM or SIGINT.
///
/// # Errors
/// Why it could not start or go on.
pub fn run(domain: &Domain, config: &Config, allow_uncalibrated: bool) -> Result<(), Failure> {
    let started = Instant::now();
    let (events, inbox) = mpsc::channel();
    forward_signals(events.clone())?;

    let (mut files, first_tables) = load_tables(config, allow_uncalibrated)?;
    let node = join(domain)?;
    let publisher = StatusPublisher::create(&node, domain)?;

    let mut queues = Vec::new();
    let mut wirings = Vec::new();
    for imu in &config.imus {
        let (queue, tables) = RingBuffer::new(TABLES);
        let counters = Arc::new(Counters::default());
        queues.push((queue, Arc::clone(&counters)));
        wirings.push(Wiring { imu: imu.clone(), tables, counters });
    }
    // The first tables are on their way before the streams exist, so that no sample meets an empty channel.
    let tables: Vec<_> = queues
        .into_iter()
        .zip(first_tables)
        .map(|((queue, counters), look)| {
            let mut tables = Tables { alive: Vec::new(), unsent: None, queue };
            if let Look::Loaded(table) = look {
                tables.send(Arc::from(table));
                return (tables, counters, None);
            }
            let error = match look {
                Look::Refused(error) => Some(error.to_string()),
                _ => None,
            };
            (tables, counters, error)
        })
        .collect();
    let stopped = || matches!(inbox.try_recv(), Ok(Event::Signal(SIGTERM | SIGINT)));
    let Some(worker) = Worker::start(domain, config, wirings, stopped)? else {
        info!("stopped while starting");
        return Ok(());
    };
    if let Some(address) = config.metrics {
        warn!("metrics.listen = {address}: this version serves no metrics");
    }

    let mut served = Vec::new();
    for ((imu, file), (tables, counters, last_error)) in config.imus.iter().zip(files.drain(..)).zip(tables) {
        let (raw, increments) = open_for_counting(&node, imu)?;
        let (reloads, told) = (0, Told::default());
        served.push(Served { imu: imu.clone(), file, counters, reloads, last_error, raw, increments, tables, told });
    }
    let paths: Vec<_> = config.imus.iter().map(|imu| imu.table.clone()).collect();
    let (_watcher, failures) = reload::watch(&paths, move |name| {
        // The loop has ended when nobody listens any more.
        let _ = events.send(Event::File(name));
    });
    for cause in failures {
        warn!("watching a table's folder: {cause}; its files are looked at every {} ms instead", TICK.as_millis());
    }

    let service = Service { domain, config, started, node, publisher, worker };
    info!(
        domain = domain.name(),
        imus = config.imus.len(),
        wait = config.strategy.name(),
        pid = std::process::id(),
        "ready"
    );
    service.run(&mut served, &inbox)
}

struct Service<'a> {
    domain: &'a Domain,
    config: &'a Config,
    started: Instant,
    node: IpcNode,
    publisher: StatusPublisher,
    worker: Worker,
}

impl Service<'_> {
    fn run(self, served: &mut [Served], inbox: &Receiver<Event>) -> Result<(), Failure> {
        let (mut next_tick, mut next_status, mut next_housekeeping) = (self.started, self.started, self.started);
        let mut unpublished = false;
        loop {
            match inbox.recv_timeout(next_tick.saturating_duration_since(Instant::now())) {
                Ok(Event::Signal(SIGHUP)) => {
                    info!("SIGHUP: loading all tables");
                    for imu in served.iter_mut() {
                        let look = imu.file.load();
                        imu.take(look, true);
                    }
                }
                Ok(Event::Signal(signal)) => {
                    info!("{}: stopping", if signal == SIGINT { "SIGINT" } else { "SIGTERM" });
                    return self.stop(served);
                }
                Ok(Event::File(name)) => {
                    for imu in served.iter_mut().filter(|imu| imu.file.path().file_name() == Some(&name)) {
                        let look = imu.file.load_complete(Instant::now());
                        imu.take(look, false);
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
                look_at_all(served);
            }
            if self.worker.is_finished() {
                return self.worker.stop().and(Err(Failure::new(Exit::Failed, "the worker thread ended by itself")));
            }
            if now >= next_status {
                next_status = now + STATUS;
                let result = self.publisher.publish(&self.status(served));
                if let Err(cause) = &result
                    && !unpublished
                {
                    error!("publishing the status: {cause}");
                }
                unpublished = result.is_err();
            }
            if now >= next_housekeeping {
                next_housekeeping = now + HOUSEKEEPING;
                self.node.try_cleanup_dead_nodes();
                served.iter_mut().for_each(Served::tell);
            }
        }
    }

    fn status(&self, served: &[Served]) -> Status {
        Status {
            domain: self.domain.into(),
            pid: std::process::id(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            uptime_s: self.started.elapsed().as_secs_f64(),
            taken_ns: monotonic_ns(),
            wait: self.config.strategy.name().to_owned(),
            budget_us: self.config.budget_us,
            imus: served.iter().map(ImuStatus::new).collect(),
        }
    }

    fn stop(self, served: &mut [Served]) -> Result<(), Failure> {
        self.worker.stop()?;
        for imu in served {
            imu.tell();
            let count = |counter: &std::sync::atomic::AtomicU64| counter.load(Relaxed);
            let counters = &imu.counters;
            info!(imu = %imu.imu.id, received = count(&counters.received), compensated = count(&counters.compensated), missing = count(&counters.missing), "stopped");
        }
        Ok(())
    }
}

fn look_at_all(served: &mut [Served]) {
    for imu in served {
        let look = imu.file.look(Instant::now());
        imu.take(look, false);
        imu.tables.flush();
    }
}

/// What the status has room for; a file can be wrong in many places.
fn cut(mut text: String) -> String {
    const MAX: usize = 4096;
    if text.len() > MAX {
        let end = (0..=MAX).rev().find(|&end| text.is_char_boundary(end)).unwrap_or(0);
        text.truncate(end);
        text.push_str(" ..");
    }
    text
}

fn forward_signals(events: mpsc::Sender<Event>) -> Result<(), Failure> {
    let failed = |error: std::io::Error| Failure::new(Exit::Failed, format!("handling signals: {error}"));
    let mut signals = Signals::new([SIGTERM, SIGINT, SIGHUP]).map_err(failed)?;
    let body = move || {
        for signal in signals.forever() {
            if events.send(Event::Signal(signal)).is_err() {
                return;
            }
        }
    };
    std::thread::Builder::new().name("signals".to_owned()).spawn(body).map(drop).map_err(failed)
}

/// Loads every table, and reports the faults of all of them together.
fn load_tables(config: &Config, allow_uncalibrated: bool) -> Result<(Vec<TableFile>, Vec<Look>), Failure> {
    let mut files: Vec<_> = config.imus.iter().map(|imu| TableFile::new(imu.id.clone(), imu.table.clone())).collect();
    let looks: Vec<_> = files.iter_mut().map(TableFile::load).collect();
    let mut failures = Vec::new();
    for (imu, look) in config.imus.iter().zip(&looks) {
        match look {
            Look::Refused(error) if allow_uncalibrated && !imu.table.exists() => {
                warn!(imu = %imu.id, "no table yet, serving NaN: {error}");
            }
            Look::Refused(error) => failures.push(Failure::from(error.clone())),
            Look::Loaded(table) => {
                info!(imu = %imu.id, table = %table.digest(), file = %imu.table.display(), "table loaded");
            }
            Look::Unchanged => {}
        }
    }
    let Some(worst) = failures.iter().map(|failure| failure.exit).max_by_key(|exit| *exit as u8) else {
        return Ok((files, looks));
    };
    let messages: Vec<_> = failures.iter().map(|failure| failure.message.as_str()).collect();
    Err(Failure::new(worst, messages.join("\n")))
}

type Streams = (PortFactory<ipc::Service, RawSample, ()>, PortFactory<ipc::Service, CompensatedIncrement, ()>);

/// The streams of an IMU, which the worker has just created, for counting who is on them.
fn open_for_counting(node: &IpcNode, imu: &Imu) -> Result<Streams, Failure> {
    let failed = |error: String| Failure::new(Exit::Failed, format!("opening the streams of IMU {}: {error}", imu.id));
    let raw = stream::raw(node, &imu.id).open().map_err(|error| failed(error.to_string()))?;
    let increments = stream::increment(node, &imu.id).open().map_err(|error| failed(error.to_string()))?;
    Ok((raw, increments))
}
