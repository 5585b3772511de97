//! One IMU as the control thread sees it: its table's file, the tables on their way to the worker, what has been told.

use crate::config::Imu;
use crate::failure::{Exit, Failure};
use crate::reload::{Look, TableFile};
use crate::status::unix_s;
use crate::windows::Windows;
use crate::worker::channel::Wiring;
use crate::worker::counters::Counters;
use iceoryx2::service::port_factory::event;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use isotherm_shared::stream::{self, Ipc, IpcNode};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{CompensatedIncrement, RawSample};
use rtrb::{Producer, RingBuffer};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};
use tracing::{error, info, warn};

/// Tables on their way to the worker. It takes them at least every few milliseconds; one that finds no room waits for
/// the next tick.
const TABLES: usize = 16;
/// How long losses that go on are not logged again.
const AGAIN: Duration = Duration::from_secs(60);

/// One IMU before its streams exist.
pub struct Preparation {
    imu: Imu,
    file: TableFile,
    counters: Arc<Counters>,
    last_error: Option<Refused>,
    tables: Tables,
}

impl Preparation {
    /// Sends the first table on its way; the worker's end comes along.
    pub fn new(imu: &Imu, file: TableFile, first: Look) -> (Self, Wiring) {
        let (queue, taken) = RingBuffer::new(TABLES);
        let mut tables = Tables { alive: Vec::new(), unsent: None, queue };
        let last_error = match first {
            Look::Loaded(table) => {
                tables.send(Arc::from(table), file.modified_unix_s());
                None
            }
            Look::Refused(error) => Some(Refused::now(cut(error.to_string()))),
            Look::Unchanged => None,
        };
        let counters = Arc::new(Counters::default());
        let wiring = Wiring { imu: imu.clone(), tables: taken, counters: Arc::clone(&counters) };
        (Self { imu: imu.clone(), file, counters, last_error, tables }, wiring)
    }

    /// Once the worker has created the streams.
    ///
    /// # Errors
    /// If they cannot be opened.
    pub fn served(self, node: &IpcNode) -> Result<Served, Failure> {
        let Self { imu, file, counters, last_error, tables } = self;
        let failed =
            |error: String| Failure::new(Exit::Failed, format!("opening the streams of IMU {}: {error}", imu.id));
        let raw = stream::raw(node, &imu.id).open().map_err(|error| failed(error.to_string()))?;
        let increments = stream::increment(node, &imu.id).open().map_err(|error| failed(error.to_string()))?;
        let wake = stream::wake(node, &imu.id).open().map_err(|error| failed(error.to_string()))?;
        let (reloads, windows, told) = (0, Windows::default(), Told::default());
        let refusals = u64::from(last_error.is_some());
        Ok(Served { imu, file, counters, reloads, refusals, last_error, raw, increments, wake, windows, tables, told })
    }
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
    /// Files refused, one that is away included.
    pub refusals: u64,
    /// Why the file as it is now is not in force.
    pub last_error: Option<Refused>,
    /// For counting who is connected.
    pub raw: PortFactory<Ipc, RawSample, ()>,
    /// For counting who is connected.
    pub increments: PortFactory<Ipc, CompensatedIncrement, ()>,
    /// For finding those that have died.
    pub wake: event::PortFactory<Ipc>,
    /// Latency of late.
    pub windows: Windows,
    tables: Tables,
    told: Told,
}

/// Why a file is not in force, and since when.
#[derive(Clone, Debug)]
pub struct Refused {
    /// What is wrong with it.
    pub error: String,
    /// Unix time \[s\].
    pub since_unix_s: f64,
}

impl Refused {
    fn now(error: String) -> Self {
        Self { error, since_unix_s: unix_s() }
    }
}

/// A table that the worker may still hold.
pub struct Sent {
    /// The table.
    pub table: Arc<CoefficientTable>,
    /// When it was taken over, Unix time \[s\].
    pub taken_unix_s: f64,
    /// When its file was changed, Unix time \[s\].
    pub modified_unix_s: Option<f64>,
}

/// Every table that the worker may still hold, the newest last. They are freed here, never by the worker.
struct Tables {
    alive: Vec<Sent>,
    unsent: Option<Arc<CoefficientTable>>,
    queue: Producer<Arc<CoefficientTable>>,
}

/// Counter values that have been logged, and when.
#[derive(Default)]
struct Told {
    missing: u64,
    transport_errors: u64,
    at: Option<Instant>,
}

impl Tables {
    fn send(&mut self, table: Arc<CoefficientTable>, modified_unix_s: Option<f64>) {
        self.alive.push(Sent { table: Arc::clone(&table), taken_unix_s: unix_s(), modified_unix_s });
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
        let mut left = self.alive.len();
        self.alive.retain(|sent| {
            left -= 1;
            left == 0 || Arc::strong_count(&sent.table) > 1
        });
    }
}

impl Served {
    /// Hands over what the worker's queue had no room for, and frees what it has let go of.
    pub fn flush(&mut self) {
        self.tables.flush();
    }

    /// The table that the worker used last or would use now.
    pub fn in_force(&self) -> Option<&Sent> {
        let id = self.counters.table.load(Relaxed);
        self.tables.alive.iter().rev().find(|sent| sent.table.id() == id)
    }

    /// Takes over what a look at the file has found; `forced` even if it is the table in force.
    pub fn take(&mut self, look: Look, forced: bool) {
        let id = &self.imu.id;
        match look {
            Look::Unchanged => {}
            Look::Loaded(table) => {
                let had_failed = self.last_error.take().is_some();
                let newest = self.tables.alive.last_mut().filter(|newest| newest.table.digest() == table.digest());
                if let Some(newest) = newest.filter(|_| !forced) {
                    newest.modified_unix_s = self.file.modified_unix_s();
                    if had_failed {
                        info!(imu = %id, table = %table.digest(), "table file is good again, and the same as in force");
                    }
                    return;
                }
                info!(imu = %id, table = %table.digest(), file = %self.file.path().display(), "table taken");
                self.reloads += u64::from(!self.tables.alive.is_empty());
                self.tables.send(Arc::from(table), self.file.modified_unix_s());
            }
            Look::Refused(error) => {
                let error = cut(error.to_string());
                if forced || self.last_error.as_ref().is_none_or(|refused| refused.error != error) {
                    warn!(imu = %id, "table refused, the one in force stays: {}", error.replace('\n', "; "));
                    self.refusals += 1;
                    self.last_error = Some(Refused::now(error));
                }
            }
        }
    }

    /// Logs what has been lost since the last time; at once, but then for a minute not again, unless this is the `last` time.
    pub fn tell(&mut self, last: bool) {
        if !last && self.told.at.is_some_and(|told| told.elapsed() < AGAIN) {
            return;
        }
        let missing = self.counters.missing.load(Relaxed);
        if missing > self.told.missing {
            warn!(imu = %self.imu.id, missing, "{} samples were missing in the raw stream", missing - self.told.missing);
            (self.told.missing, self.told.at) = (missing, Some(Instant::now()));
        }
        let errors = self.counters.transport_errors.load(Relaxed);
        if errors > self.told.transport_errors {
            error!(imu = %self.imu.id, errors, "the transport failed {} times", errors - self.told.transport_errors);
            (self.told.transport_errors, self.told.at) = (errors, Some(Instant::now()));
        }
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
