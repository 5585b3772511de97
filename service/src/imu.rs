//! One IMU in the control thread: the file of its table, the tables sent to the worker, and the losses that were
//! logged.

use crate::config::Imu;
use crate::events::{FileChange, FileReport, JudgedFile, KeepOutcome};
use crate::guard::{Guard, TableAdmission, is_accepted, remedy};
use crate::keeper::KeepRequest;
use crate::leftovers::{Port, ports_of, ports_of_event};
use crate::memory::KeptTables;
use crate::session::SessionNote;
use crate::windows::LatencyWindows;
use crate::worker::channel::ChannelLink;
use crate::worker::counters::{CounterReader, DeviceMismatch, counters};
use iceoryx2::prelude::PortFactory as _;
use iceoryx2::service::port_factory::event;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use isotherm_client::transport::stream::{self, Ipc, IpcNode};
use isotherm_client::{Domain, ImuId, last_closing, unix_s};
use isotherm_install::{Acceptance, TableJudgement, TableNote};
use isotherm_shared::status::ClosedStatus;
use isotherm_shared::table::{CoefficientTable, Digest};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::{CompensatedIncrement, Flags, RawSample};
use isotherm_support::failure::{Exit, Failure, shown};
use rtrb::{Producer, RingBuffer};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tracing::{error, info, warn};

/// Room for tables in the queue to the worker. The worker takes them at least every
/// [`BOUND_NS`](crate::worker::wait::BOUND_NS). If the queue is full, a table waits for the next tick.
const TABLE_QUEUE_DEPTH: usize = 16;
/// So often it is logged that a table's file is not in force.
const REFUSAL_LOG_INTERVAL: Duration = Duration::from_secs(60);
/// Further losses are logged at most once in this time.
const LOSS_LOG_INTERVAL: Duration = Duration::from_secs(60);

/// What an IMU is served with first.
#[derive(Debug)]
pub(crate) struct FirstTable {
    /// The guard, which has admitted the table if there is one.
    pub guard: Guard,
    /// The table, and why it may be taken.
    pub table: Option<(Arc<CoefficientTable>, TableAdmission)>,
    /// When the table's file was changed, Unix time \[s\].
    pub modified_unix_s: Option<f64>,
    /// The file as it was read; `None` if there is none.
    pub judged: Option<JudgedFile>,
    /// Why the file as it is now is not in force.
    pub refused: Option<TableRefusal>,
    /// Whether the IMU waits for its first table, as the command line allows.
    pub waits: bool,
    /// What was accepted, if the table is that of the file.
    pub accepted: Vec<Acceptance>,
}

/// One IMU before its streams exist.
pub(crate) struct PendingImu {
    imu: Imu,
    counters: CounterReader,
    session: SessionNote,
    judged: Option<JudgedFile>,
    last_error: Option<TableRefusal>,
    waits: bool,
    tables: TableQueue,
    guard: Guard,
    /// The first table, which is in force when the streams are open.
    first: Option<(Arc<CoefficientTable>, TableAdmission)>,
    /// What was accepted when the first table was chosen.
    accepted: Vec<Acceptance>,
}

impl PendingImu {
    /// Queues the first table for the worker. The result contains the worker's link to this IMU.
    pub(crate) fn new(domain: &Domain, imu: &Imu, first: FirstTable) -> (Self, ChannelLink) {
        let FirstTable { guard, table, modified_unix_s, judged, refused, waits, accepted } = first;
        let (queue, taken) = RingBuffer::new(TABLE_QUEUE_DEPTH);
        let mut tables = TableQueue { alive: Vec::new(), unsent: None, queue };
        if let Some((table, _)) = &table {
            tables.send(Arc::clone(table), modified_unix_s);
        }
        let (writer, counters) = counters();
        let session = SessionNote::take(domain, &imu.id);
        let table_before = guard.memory().in_force.clone();
        let before = session.before();
        let link = ChannelLink { imu: imu.clone(), tables: taken, counters: writer, before, table_before };
        let imu = imu.clone();
        let last_error = refused;
        (Self { imu, counters, session, judged, last_error, waits, tables, guard, first: table, accepted }, link)
    }

    /// Opens the streams, which the worker must have created before. The first table is in force then, and is to be
    /// kept.
    ///
    /// # Errors
    /// If they cannot be opened.
    pub(crate) fn open_streams(self, node: &IpcNode) -> Result<(ImuState, Option<KeepRequest>), Failure> {
        let Self { imu, counters, session, judged, last_error, waits, tables, mut guard, first, accepted } = self;
        let failed =
            |error: String| Failure::new(Exit::Failed, format!("opening the streams of IMU {}: {error}", imu.id));
        let raw = stream::open_raw(node, &stream::raw_name(&imu.id)).map_err(|error| failed(error.to_string()))?;
        let increments = stream::open_increment(node, &stream::increment_name(&imu.id))
            .map_err(|error| failed(error.to_string()))?;
        let wake = stream::open_event(node, &stream::wake_name(&imu.id)).map_err(|error| failed(error.to_string()))?;
        let arrival =
            stream::open_event(node, &stream::arrival_name(&imu.id)).map_err(|error| failed(error.to_string()))?;
        let is_memory_pending = guard.memory().is_pending();
        let request = first.map(|(table, admission)| {
            guard.taken(&table, admission);
            KeepRequest { memory: guard.memory().clone(), accepted }
        });
        let request = request.filter(|_| !is_memory_pending);
        let refusals = u64::from(last_error.is_some());
        let state = ImuState {
            imu,
            counters,
            session,
            reloads: 0,
            refusals,
            judged,
            last_error,
            noted: None,
            is_note_missed: false,
            may_wait: waits,
            is_absent: waits,
            raw,
            increments,
            wake,
            arrival,
            windows: LatencyWindows::default(),
            tables,
            logged: LoggedLosses::default(),
            logged_device: LoggedDevice::default(),
            logged_gyroscopes: None,
            logged_refusal: Instant::now(),
            closed: None,
            guard,
            is_memory_pending,
            kept: None,
            awaits_load: false,
        };
        Ok((state, request))
    }
}

/// One IMU with its streams, in the control thread.
pub(crate) struct ImuState {
    /// Its configuration.
    pub imu: Imu,
    /// Written by the worker.
    pub counters: CounterReader,
    /// Which session was served last, for the next service.
    session: SessionNote,
    /// Tables sent to the worker after the first.
    pub reloads: u64,
    /// Refused files; a missing file counts too.
    pub refusals: u64,
    /// Its file as it was read last; `None` if there is none.
    judged: Option<JudgedFile>,
    /// What the note of its table says; `None` if there is none, or it could not be written.
    noted: Option<NotedTable>,
    /// Whether the log says that the note cannot be written.
    is_note_missed: bool,
    /// Why the current file is not in force.
    pub last_error: Option<TableRefusal>,
    /// Whether the service was started without its table, as the command line allows.
    may_wait: bool,
    /// Whether there was no file when that changed last.
    is_absent: bool,
    /// The open raw stream: to count the acquisition.
    pub raw: PortFactory<Ipc, RawSample, ()>,
    /// The open increment stream: to count the readers.
    pub increments: PortFactory<Ipc, CompensatedIncrement, ()>,
    /// The open wake stream: to find the ports of dead processes.
    pub wake: event::PortFactory<Ipc>,
    /// The open event of published increments: to count who waits, and to find the ports of dead processes.
    pub arrival: event::PortFactory<Ipc>,
    /// Latency in the last second and in the last minute.
    pub windows: LatencyWindows,
    tables: TableQueue,
    logged: LoggedLosses,
    logged_device: LoggedDevice,
    /// The sessions so far and the table when it was logged last that the table lacks the samples' gyroscopes.
    logged_gyroscopes: Option<(u64, u64)>,
    /// When a file that is not in force was last logged.
    logged_refusal: Instant,
    /// What the last acquisition that closed with a loss had lost.
    pub closed: Option<ClosedStatus>,
    /// Compares a new table with the one in force.
    pub guard: Guard,
    /// Whether it is not known yet what the state folder has. Until then nothing is kept: it would replace that.
    is_memory_pending: bool,
    /// How keeping the table in force has ended; `None` before it has.
    kept: Option<KeepOutcome>,
    /// Whether its file is to be loaded, as requested.
    pub awaits_load: bool,
}

/// Why a file was refused, and when.
#[derive(Clone, Debug)]
pub(crate) struct TableRefusal {
    /// What is wrong with it.
    pub error: String,
    /// Its table, if that is a valid one that changes too much.
    pub table: Option<Arc<CoefficientTable>>,
    /// When the file was changed, Unix time \[s\].
    pub modified_unix_s: Option<f64>,
    /// Since when, Unix time \[s\].
    pub since_unix_s: f64,
}

impl TableRefusal {
    /// Refused now.
    pub(crate) fn now(error: String, table: Option<Arc<CoefficientTable>>, modified_unix_s: Option<f64>) -> Self {
        Self { error: truncate(error), table, modified_unix_s, since_unix_s: unix_s() }
    }

    /// The reason, and what to do about it if an operator can accept the table.
    pub(crate) fn text(&self, imu: &ImuId) -> String {
        let remedy = self.table.as_ref().map(|table| format!("; {}", remedy(imu, table.digest())));
        self.error.clone() + &remedy.unwrap_or_default()
    }

    /// The same in one line.
    fn line(&self, imu: &ImuId) -> String {
        self.text(imu).replace('\n', "; ")
    }

    /// Whether it is the same table, or the same fault.
    fn is_same(&self, other: &Self) -> bool {
        let digest = |refused: &Self| refused.table.as_ref().map(|table| *table.digest());
        self.error == other.error && digest(self) == digest(other)
    }
}

/// What a note of a table was made of.
#[derive(Clone, Copy, PartialEq)]
struct NotedTable {
    served: Option<Digest>,
    judged: Option<JudgedFile>,
    refused_unix_s: Option<f64>,
}

/// A table that the worker may still hold.
pub(crate) struct SentTable {
    /// The table.
    pub table: Arc<CoefficientTable>,
    /// When it was sent to the worker, Unix time \[s\].
    pub taken_unix_s: f64,
    /// When its file was last changed, Unix time \[s\].
    pub modified_unix_s: Option<f64>,
}

/// The queue to the worker, and all tables that the worker may still hold, the newest last. They are freed here, never
/// by the worker.
struct TableQueue {
    alive: Vec<SentTable>,
    unsent: Option<Arc<CoefficientTable>>,
    queue: Producer<Arc<CoefficientTable>>,
}

/// The counter values that were last logged, and when.
#[derive(Default)]
struct LoggedLosses {
    missing: u64,
    /// Changes of session, the control periods between in sum, and how often their number was unknown.
    changes: u64,
    between: u64,
    unknown: u64,
    transport_errors: u64,
    at: Option<Instant>,
}

/// Samples of another device than the table's: how many there were of which table, and the session and the unit with
/// its table of the last log line.
#[derive(Default)]
struct LoggedDevice {
    samples: u64,
    table: u64,
    last: Option<(u64, DeviceMismatch)>,
}

impl TableQueue {
    fn send(&mut self, table: Arc<CoefficientTable>, modified_unix_s: Option<f64>) {
        self.alive.push(SentTable { table: Arc::clone(&table), taken_unix_s: unix_s(), modified_unix_s });
        self.unsent = Some(table);
        self.flush();
    }

    fn flush(&mut self) {
        if let Some(table) = self.unsent.take()
            && let Err(rtrb::PushError::Full(table)) = self.queue.push(table)
        {
            self.unsent = Some(table);
        }
        // Keep the newest: it is in force or will be. Free an older one when the worker no longer holds it.
        let mut left = self.alive.len();
        self.alive.retain(|sent| {
            left -= 1;
            left == 0 || Arc::strong_count(&sent.table) > 1
        });
    }
}

impl ImuState {
    /// Sends the table for which the queue had no room, and frees the tables that the worker no longer holds.
    pub(crate) fn flush(&mut self) {
        self.tables.flush();
    }

    /// Notes which session was served last, if that is another one.
    pub(crate) fn note_session(&mut self) {
        self.session.keep(self.counters.last_session());
    }

    /// Notes which file is read, and what is served and refused, if that has changed.
    pub(crate) fn note_table(&mut self, domain: &Domain) {
        let served = self.in_force().map(|sent| *sent.table.digest());
        let refused = self.last_error.as_ref();
        let news = NotedTable { served, judged: self.judged, refused_unix_s: refused.map(|it| it.since_unix_s) };
        if self.noted == Some(news) {
            return;
        }
        let judged = self.judged.map(|judged| TableJudgement {
            file: judged.state.to_string(),
            digest: judged.digest.map(|digest| digest.to_string()),
            refused: refused.map(|refused| refused.error.clone()),
        });
        let file = std::path::absolute(&self.imu.table).unwrap_or_else(|_| self.imu.table.clone());
        let (table_file, served) = (file.to_string_lossy().into_owned(), served.map(|digest| digest.to_string()));
        match (TableNote { table_file, served, judged }).write(domain, &self.imu.id) {
            Ok(()) => (self.noted, self.is_note_missed) = (Some(news), false),
            Err(error) => {
                if !self.is_note_missed {
                    warn!(imu = %self.imu.id, "noting which table is served: {error}; `install` does not learn it");
                }
                (self.noted, self.is_note_missed) = (None, true);
            }
        }
    }

    /// Notes the last session with its last sample, after the worker has ended.
    pub(crate) fn end_session(&mut self) {
        self.session.end(self.counters.last_session());
    }

    /// All ports of its streams.
    pub(crate) fn ports(&self) -> Vec<Port> {
        let events = [ports_of_event(&self.wake), ports_of_event(&self.arrival)].concat();
        [ports_of(&self.raw), ports_of(&self.increments), events].concat()
    }

    /// Whether a reader waits for its increments.
    pub(crate) fn is_awaited(&self) -> bool {
        self.arrival.dynamic_config().number_of_listeners() > 0
    }

    /// The table that the worker uses now.
    pub(crate) fn in_force(&self) -> Option<&SentTable> {
        let id = self.counters.table();
        self.tables.alive.iter().rev().find(|sent| sent.table.id() == id)
    }

    /// Whether it waits for its first table, as the command line allows. A file that is refused is no wait.
    pub(crate) fn waits_for_table(&self) -> bool {
        self.may_wait && self.is_absent && self.tables.alive.is_empty()
    }

    /// The unit of the last sample, if that was answered with the table in force and is of another device than this.
    pub(crate) fn other_device(&self) -> Option<u64> {
        let other = self.counters.last_other_device()?;
        (other.table == self.in_force()?.table.id()).then_some(other.device)
    }

    /// Applies what was found in the table's file. Returns what is to be kept, if another table is in force now. A
    /// report that was requested applies a table or an error that is already known again.
    pub(crate) fn apply(&mut self, report: FileReport) -> Option<KeepRequest> {
        let modified_unix_s = report.modified_unix_s();
        self.judged = report.judged();
        let FileReport { change, is_absent, is_requested, .. } = report;
        self.is_absent = is_absent;
        match change {
            FileChange::Unchanged => None,
            FileChange::Loaded(table) => self.apply_table(table, modified_unix_s, is_requested),
            FileChange::Refused(error) => {
                self.refuse(TableRefusal::now(error.to_string(), None, modified_unix_s), is_requested);
                None
            }
        }
    }

    fn apply_table(
        &mut self,
        table: Arc<CoefficientTable>,
        modified_unix_s: Option<f64>,
        is_requested: bool,
    ) -> Option<KeepRequest> {
        let id = &self.imu.id;
        let newest = self.tables.alive.last_mut().filter(|newest| newest.table.digest() == table.digest());
        if let Some(newest) = newest.filter(|_| !is_requested) {
            newest.modified_unix_s = modified_unix_s;
            if self.last_error.take().is_some() {
                info!(imu = %id, table = %table.digest(), "table file is good again, and the same as in force");
            }
            return None;
        }
        let accepted = self.guard.accepted();
        let admission = match self.guard.admit(&table, &accepted) {
            Ok(admission) => admission,
            Err(reason) => {
                self.refuse(TableRefusal::now(reason, Some(table), modified_unix_s), is_requested);
                return None;
            }
        };
        self.last_error = None;
        info!(imu = %id, table = %table.digest(), file = %shown(&self.imu.table), "table taken: {}", admission.words);
        log_unlike_scale_factors(&self.imu, &table);
        self.reloads += u64::from(!self.tables.alive.is_empty());
        self.guard.taken(&table, admission);
        self.tables.send(table, modified_unix_s);
        self.keep_request(accepted)
    }

    /// What is to be kept now; `None` while it is not known what is kept.
    fn keep_request(&mut self, accepted: Vec<Acceptance>) -> Option<KeepRequest> {
        self.kept = None;
        (!self.is_memory_pending).then(|| KeepRequest { memory: self.guard.memory().clone(), accepted })
    }

    /// Takes in what the state folder has, whose disk has answered late. Without a table in force, the file is judged
    /// again, and the table that was in force last is served if the file is not taken. Returns what is to be kept.
    pub(crate) fn recall(&mut self, memory: KeptTables) -> Option<KeepRequest> {
        self.is_memory_pending = false;
        let accepted = self.guard.accepted();
        self.guard.recall(memory, &accepted);
        if !self.tables.alive.is_empty() {
            return self.keep_request(accepted);
        }
        let refused = self.last_error.clone();
        let of_file = refused.as_ref().and_then(|refused| Some((refused.table.clone()?, refused.modified_unix_s)));
        if let Some(request) = of_file.and_then(|(table, modified)| self.apply_table(table, modified, false)) {
            return Some(request);
        }
        let reference = self.guard.memory().reference().cloned()?;
        let request = self.apply_table(reference, None, false);
        // The file is still not taken.
        self.last_error = self.last_error.take().or(refused);
        request
    }

    /// Notes why the table file as it is now is not in force.
    fn refuse(&mut self, refused: TableRefusal, is_requested: bool) {
        if is_requested || self.last_error.as_ref().is_none_or(|last| !last.is_same(&refused)) {
            let stays = if self.tables.alive.is_empty() { "there is none in force" } else { "the one in force stays" };
            warn!(imu = %self.imu.id, "table refused, {stays}: {}", refused.line(&self.imu.id));
            self.refusals += 1;
            self.logged_refusal = Instant::now();
            self.last_error = Some(refused);
        }
    }

    /// Takes the table that was refused, if the operator has accepted it. Returns what is to be kept then.
    pub(crate) fn take_accepted(&mut self) -> Option<KeepRequest> {
        let refused = self.last_error.as_ref()?;
        let (table, modified_unix_s) = (refused.table.clone()?, refused.modified_unix_s);
        let is_accepted = is_accepted(table.digest(), &self.guard.accepted());
        is_accepted.then(|| self.apply_table(table, modified_unix_s, false))?
    }

    /// Makes the table in force the anchor, if the operator has accepted that. Returns what is to be kept then.
    pub(crate) fn take_anchor(&mut self) -> Option<KeepRequest> {
        let accepted = self.guard.accepted();
        self.guard.take_anchor(&accepted).then(|| {
            info!(imu = %self.imu.id, "the table in force is the anchor now, accepted by its digest");
            self.keep_request(accepted)
        })?
    }

    /// Notes how keeping a table has ended.
    pub(crate) fn note_kept(&mut self, outcome: KeepOutcome) {
        self.kept = Some(outcome);
    }

    /// How keeping the table in force has ended; `None` if it has not.
    pub(crate) fn kept(&self) -> Option<&KeepOutcome> {
        let in_force = self.guard.memory().in_force.as_ref()?.digest().to_string();
        self.kept.as_ref().filter(|kept| kept.table == in_force)
    }

    /// Logs what was lost, came from another unit or was left by an acquisition that closed; `last` as in
    /// [`log_losses`](Self::log_losses).
    pub(crate) fn log_news(&mut self, domain: &Domain, last: bool) {
        self.log_losses(last);
        self.log_refusal();
        self.log_other_device();
        self.log_unused_gyroscopes();
        self.note_closing(domain);
    }

    /// Logs the losses since the last log line. After a log line there is none for [`LOSS_LOG_INTERVAL`], except at the
    /// `last` call.
    fn log_losses(&mut self, last: bool) {
        if !last && self.logged.at.is_some_and(|logged| logged.elapsed() < LOSS_LOG_INTERVAL) {
            return;
        }
        let changes = self.counters.flagged(Flags::SESSION.0.trailing_zeros());
        if changes > self.logged.changes {
            let (between, unknown) = (self.counters.session_missing(), self.counters.session_unknown());
            let (periods, times) = (between - self.logged.between, unknown - self.logged.unknown);
            warn!(
                imu = %self.imu.id,
                changes,
                "another session followed {} times, after {periods} control periods in sum; {times} times their number is unknown",
                changes - self.logged.changes
            );
            (self.logged.changes, self.logged.between, self.logged.unknown) = (changes, between, unknown);
            self.logged.at = Some(Instant::now());
        }
        let missing = self.counters.missing();
        if missing > self.logged.missing {
            warn!(imu = %self.imu.id, missing, "{} samples were missing in the raw stream", missing - self.logged.missing);
            (self.logged.missing, self.logged.at) = (missing, Some(Instant::now()));
        }
        let errors = self.counters.transport_errors();
        if errors > self.logged.transport_errors {
            error!(imu = %self.imu.id, errors, "the transport failed {} times", errors - self.logged.transport_errors);
            (self.logged.transport_errors, self.logged.at) = (errors, Some(Instant::now()));
        }
    }

    /// Logs once a minute that the file of the table is not in force.
    fn log_refusal(&mut self) {
        if let Some(refused) = &self.last_error
            && self.logged_refusal.elapsed() >= REFUSAL_LOG_INTERVAL
        {
            self.logged_refusal = Instant::now();
            let instead = match self.in_force() {
                Some(sent) => format!("{} is", sent.table.digest()),
                None => "none is, and the increments are NaN".to_owned(),
            };
            error!(
                imu = %self.imu.id,
                "the table of {} is still not in force, {instead}: {}",
                shown(&self.imu.table),
                refused.line(&self.imu.id)
            );
        }
    }

    /// Looks for what an acquisition had lost when it closed, and logs it once.
    fn note_closing(&mut self, domain: &Domain) {
        let closed = last_closing(domain, &self.imu.id);
        if closed.is_none() || closed == self.closed {
            return;
        }
        if let Some(ClosedStatus { session, lost, unanswered, .. }) = &closed {
            warn!(
                imu = %self.imu.id, session, lost, unanswered,
                "an acquisition closed: since it connected {lost} control periods had not been sent, and {unanswered} samples were unanswered"
            );
        }
        self.closed = closed;
    }

    /// Logs that samples came from another unit than the table's: once for each session, table and unit.
    fn log_other_device(&mut self) {
        let Some(other) = self.counters.other_device() else { return };
        let samples = self.counters.flagged(Flags::OTHER_DEVICE.0.trailing_zeros());
        let LoggedDevice { samples: before, table, last } = &mut self.logged_device;
        if *table != other.table {
            (*before, *table) = (0, other.table);
        }
        let now = Some((self.counters.sessions(), other));
        if samples != *before && now != *last {
            let of_table = self.tables.alive.iter().find(|sent| sent.table.id() == other.table);
            let serial = of_table.and_then(|sent| sent.table.content().serial.as_deref()).unwrap_or_default();
            warn!(
                imu = %self.imu.id,
                device = format!("{:016x}", other.device),
                "the samples are of another device than the table, which is of serial number {serial:?}: the increments are computed with \
                 it and flagged other-device; give this device its own table, or correct the acquisition's serial number"
            );
            *last = now;
        }
        *before = samples;
    }

    /// Logs that samples have gyroscopes and the table has none: once for each session and table.
    fn log_unused_gyroscopes(&mut self) {
        let temperature = self.counters.temperature(SensorKind::Gyroscope);
        let sent = temperature.as_flattened().iter().flatten().any(|temperature| *temperature != 0.0);
        let now = Some((self.counters.sessions(), self.counters.table()));
        let unused = sent && self.in_force().is_some_and(|sent| sent.table.content().gyroscopes.is_none());
        if unused && now != self.logged_gyroscopes {
            warn!(
                imu = %self.imu.id,
                "the samples have gyroscopes, but the table has none: the angle increments are NaN; give a table of the whole IMU"
            );
            self.logged_gyroscopes = now;
        }
    }
}

/// Warns of scale factors that a lost digit may have made.
pub(crate) fn log_unlike_scale_factors(imu: &Imu, table: &CoefficientTable) {
    for warning in table.content().unlike_scale_factors() {
        warn!(imu = %imu.id, "{warning}; look for a lost digit");
    }
}

/// Shortens a message to 4096 bytes, to keep the status small: a file can have many faults.
fn truncate(mut text: String) -> String {
    const MAX: usize = 4096;
    if text.len() > MAX {
        let end = (0..=MAX).rev().find(|&end| text.is_char_boundary(end)).unwrap_or(0);
        text.truncate(end);
        text.push_str(" ..");
    }
    text
}
