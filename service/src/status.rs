//! What the service tells about itself: a JSON document, published ten times a second on `isotherm/status`.

use crate::create::{Trouble, create};
use crate::failure::{Exit, Failure};
use crate::served::Served;
use crate::worker::counters::{Counters, Distribution, Summary};
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{AllocationStrategy, PortFactory as _};
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use isotherm_client::{ConnectError, Options, join_existing, monotonic_ns, publisher_of};
use isotherm_shared::stream::{self, Domain, Ipc, IpcNode};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{AXES, Flags};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Room for the document before its memory has to grow.
const INITIAL_BYTES: usize = 16 * 1024;
/// A running service publishes ten times a second.
const PATIENCE: Duration = Duration::from_secs(2);

/// The running service.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Status {
    /// What another process needs to join.
    pub domain: DomainStatus,
    /// Process of the service.
    pub pid: u32,
    /// Version of the service.
    pub version: String,
    /// Seconds since it started.
    pub uptime_s: f64,
    /// When it started, Unix time \[s\].
    pub started_unix_s: f64,
    /// `CLOCK_MONOTONIC` when this was written \[ns\].
    pub taken_ns: u64,
    /// How the worker waits.
    pub wait: String,
    /// Latency budget \[us\].
    pub budget_us: f64,
    /// The worker threads.
    pub workers: Vec<WorkerStatus>,
    /// Memory that is kept resident \[kB\].
    pub memory_locked_kb: u64,
    /// Every IMU served.
    pub imus: Vec<ImuStatus>,
}

/// One worker thread, as the operating system sees it.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct WorkerStatus {
    /// Its thread's id.
    pub thread: i32,
    /// The IMUs that it serves.
    pub imus: Vec<String>,
    /// The cores that it may use, as in `0-1`.
    pub cores: String,
    /// `SCHED_FIFO` priority; null without one.
    pub priority: Option<u32>,
    /// How much later than asked a sleep may end \[ns\]; null where the kernel does not tell.
    pub timer_slack_ns: Option<u64>,
    /// Processor time in the last second, of one core \[%\].
    pub cpu_percent: f64,
    /// Processor time since it began \[s\].
    pub cpu_s: f64,
    /// Time since it began in which it could have run and did not \[s\].
    pub held_back_s: f64,
    /// Time in the last second in which it could have run and did not, since others did or the kernel held it back \[ms\].
    pub held_back_ms: f64,
    /// Whether its loop has not turned for a second: its IMUs are not served.
    pub stands_still: bool,
}

/// A domain, as iceoryx2's configuration wants it.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct DomainStatus {
    /// Name, as for `--domain`.
    pub name: String,
    /// `global.prefix`.
    pub prefix: String,
    /// `global.root-path`.
    pub root_path: String,
}

/// One IMU.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct ImuStatus {
    /// Name.
    pub id: String,
    /// Digest of the table in force; null without one.
    pub table: Option<String>,
    /// The watched file.
    pub table_file: String,
    /// When the table in force was taken over, Unix time \[s\]; null without one.
    pub table_taken_unix_s: Option<f64>,
    /// When its file was changed, Unix time \[s\].
    pub table_modified_unix_s: Option<f64>,
    /// What its polynomials were calibrated over; null without a table.
    pub ranges: Option<Ranges>,
    /// Head telemetry of the last sample, A1 to A3, in the table's unit; null where it is not finite or none has come.
    pub head_temperature: [Option<f64>; AXES],
    /// Board telemetry of the last sample, as the heads'.
    pub board_temperature: [Option<f64>; AXES],
    /// Raw samples received.
    pub received: u64,
    /// Increments published.
    pub compensated: u64,
    /// Samples before which others of their session were missing.
    pub gaps: u64,
    /// Samples missing in all.
    pub missing: u64,
    /// Samples that came again.
    pub repeats: u64,
    /// Acquisition sessions seen.
    pub sessions: u64,
    /// Failures of the transport.
    pub transport_errors: u64,
    /// Increments that carried each flag.
    pub flagged: BTreeMap<String, u64>,
    /// Tables taken over after the first.
    pub reloads: u64,
    /// Files refused, one that is away included.
    pub refusals: u64,
    /// Why the file as it is now is not in force; null if it is.
    pub last_reload_error: Option<String>,
    /// Since when it is not, Unix time \[s\].
    pub refused_unix_s: Option<f64>,
    /// Latency since the start; null before the first sample.
    pub latency_ns: Option<Summary>,
    /// Latency in the last second; null if nothing came in it.
    pub latency_second_ns: Option<Summary>,
    /// Latency in the last minute.
    pub latency_minute_ns: Option<Summary>,
    /// Latency since the start, by buckets.
    pub latency_distribution: Distribution,
    /// Whether an acquisition process is connected.
    pub acquisition_connected: bool,
    /// Processes that read the increments, the acquisition among them.
    pub readers: usize,
}

/// The telemetry that a table was calibrated over.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Ranges {
    /// Unit of the telemetry, a label.
    pub unit: String,
    /// Ends of the bias's range of head telemetry, A1 to A3.
    pub head: [[f64; 2]; AXES],
    /// Ends of what the ranges of K+ and K- have in common, board telemetry, A1 to A3.
    pub board: [[f64; 2]; AXES],
}

impl From<&CoefficientTable> for Ranges {
    fn from(table: &CoefficientTable) -> Self {
        let axes = &table.content().axes;
        let board = |axis: usize| {
            let [positive, negative] =
                [axes[axis].positive_scale_factor.range(), axes[axis].negative_scale_factor.range()];
            [positive[0].max(negative[0]), positive[1].min(negative[1])]
        };
        let head = |axis: usize| axes[axis].bias.range();
        let unit = table.content().temperature_unit.clone();
        Self { unit, head: core::array::from_fn(head), board: core::array::from_fn(board) }
    }
}

impl ImuStatus {
    /// From what is counted and known.
    pub fn new(served: &Served) -> Self {
        let counters: &Counters = &served.counters;
        let count = |counter: &AtomicU64| counter.load(Relaxed);
        let in_force = served.in_force();
        let latency = counters.latency.counts();
        let [head_temperature, board_temperature] = counters.telemetry();
        let refused = served.last_error.as_ref();
        let named = |(bit, name): (u32, &str)| (name.to_owned(), count(&counters.flagged[bit as usize]));
        Self {
            id: served.imu.id.to_string(),
            table: in_force.map(|sent| sent.table.digest().to_string()),
            table_file: served.file.path().display().to_string(),
            table_taken_unix_s: in_force.map(|sent| sent.taken_unix_s),
            table_modified_unix_s: in_force.and_then(|sent| sent.modified_unix_s),
            ranges: in_force.map(|sent| Ranges::from(&*sent.table)),
            head_temperature,
            board_temperature,
            received: count(&counters.received),
            compensated: count(&counters.compensated),
            gaps: count(&counters.gaps),
            missing: count(&counters.missing),
            repeats: count(&counters.repeats),
            sessions: count(&counters.sessions),
            transport_errors: count(&counters.transport_errors),
            flagged: Flags::NAMES.into_iter().map(named).collect(),
            reloads: served.reloads,
            refusals: served.refusals,
            last_reload_error: refused.map(|refused| refused.error.clone()),
            refused_unix_s: refused.map(|refused| refused.since_unix_s),
            latency_ns: counters.latency.summary_of(&latency),
            latency_second_ns: served.windows.second(),
            latency_minute_ns: served.windows.minute(),
            latency_distribution: Distribution::of(&latency),
            acquisition_connected: served.raw.dynamic_config().number_of_publishers() > 0,
            readers: served.increments.dynamic_config().number_of_subscribers(),
        }
    }
}

impl From<&Domain> for DomainStatus {
    fn from(domain: &Domain) -> Self {
        Self { name: domain.name().to_owned(), prefix: domain.prefix(), root_path: domain.root_path().to_owned() }
    }
}

/// The status stream's publisher. There can be only one: it is what keeps a second service out of a domain.
pub struct StatusPublisher {
    stream: PortFactory<Ipc, [u8], ()>,
    publisher: Publisher<Ipc, [u8], ()>,
}

impl StatusPublisher {
    /// Takes the place.
    ///
    /// # Errors
    /// If another service has it, or the stream cannot be created.
    pub fn create(node: &IpcNode, domain: &Domain) -> Result<Self, Failure> {
        let name = "the status stream";
        let untaken = || Failure::new(Exit::Failed, format!("creating {name}: it is taken"));
        let service = create(node, domain, name, Some(&stream::status_name()), untaken, || {
            Ok(stream::status(node).open_or_create()?)
        })?;
        let taken = || {
            let pid = publisher_of(&service).and_then(|(_, pid)| pid);
            let pid = pid.map(|pid| format!(", pid {pid}")).unwrap_or_default();
            Failure::new(
                Exit::Failed,
                format!(
                    "another service is running in domain {:?}{pid}; stop it, or give this one another --domain",
                    domain.name()
                ),
            )
        };
        let publisher = create(node, domain, name, None, taken, || {
            let publisher = service.publisher_builder().initial_max_slice_len(INITIAL_BYTES);
            let publisher = publisher.allocation_strategy(AllocationStrategy::PowerOfTwo).create();
            publisher.map_err(|error| Trouble::of_publisher(error, &service))
        })?;
        Ok(Self { stream: service, publisher })
    }

    /// Whether anybody has subscribed.
    pub fn has_readers(&self) -> bool {
        self.stream.dynamic_config().number_of_subscribers() > 0
    }

    /// Publishes a status.
    ///
    /// # Errors
    /// What the transport says.
    pub fn publish(&self, status: &Status) -> Result<(), String> {
        let document = serde_json::to_vec(status).map_err(|error| error.to_string())?;
        let sample = self.publisher.loan_slice_uninit(document.len()).map_err(|error| error.to_string())?;
        sample.write_from_slice(&document).send().map(|_| ()).map_err(|error| error.to_string())
    }
}

/// Reads what the running service of a domain tells.
pub struct StatusReader {
    // The subscriber before its node: fields are dropped in this order.
    subscriber: Subscriber<Ipc, [u8], ()>,
    stream: PortFactory<Ipc, [u8], ()>,
    _node: IpcNode,
}

impl StatusReader {
    /// Connects; does not wait.
    ///
    /// # Errors
    /// If no service has been there, or it cannot be joined.
    pub fn connect(domain: &Domain) -> Result<Self, Failure> {
        let node = join_existing(domain)?;
        let stream = node.service_builder(&stream::status_name()).publish_subscribe::<[u8]>().open();
        let stream = stream.map_err(|error| match error {
            PublishSubscribeOpenError::DoesNotExist => absent(domain),
            other => Failure::new(Exit::Failed, format!("opening the status stream: {other}")),
        })?;
        let subscriber = stream.subscriber_builder().history_request(1).create();
        let subscriber =
            subscriber.map_err(|error| Failure::new(Exit::Failed, format!("subscribing to the status: {error}")))?;
        Ok(Self { subscriber, stream, _node: node })
    }

    /// The newest status that has come since the last call.
    ///
    /// # Errors
    /// If the transport fails, or a service of another version tells something else.
    pub fn latest(&self) -> Result<Option<Status>, Failure> {
        let mut latest = None;
        loop {
            let sample = self.subscriber.receive();
            let sample =
                sample.map_err(|error| Failure::new(Exit::Failed, format!("receiving the status: {error}")))?;
            match sample {
                Some(sample) => latest = Some(sample),
                None => break,
            }
        }
        let read = |bytes: &[u8]| {
            serde_json::from_slice(bytes).map_err(|error| {
                Failure::new(
                    Exit::Failed,
                    format!("reading the status: {error}; use the `isotherm` of the service's version"),
                )
            })
        };
        latest.map(|sample| read(&sample)).transpose()
    }
}

/// Asks the running service of a domain for a status that is newer than this call.
///
/// # Errors
/// If no service answers within two seconds.
pub fn fetch(options: &Options) -> Result<Status, Failure> {
    let asked_ns = monotonic_ns();
    let reader = StatusReader::connect(&options.domain)?;
    let deadline = Instant::now() + PATIENCE;
    while Instant::now() < deadline {
        match reader.latest()? {
            Some(status) if status.taken_ns >= asked_ns => return Ok(status),
            _ => std::thread::sleep(Duration::from_millis(2)),
        }
    }
    match publisher_of(&reader.stream) {
        Some((_, pid)) => {
            let pid = pid.map(|pid| format!(" (pid {pid})")).unwrap_or_default();
            let message =
                format!("the service{pid} does not tell its status; it is stopped, or hangs: continue or restart it");
            Err(Failure::new(Exit::Unavailable, message))
        }
        None => Err(absent(&options.domain)),
    }
}

/// The time now, in seconds of Unix time.
pub fn unix_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}

fn absent(domain: &Domain) -> Failure {
    ConnectError::NoService(domain.name().to_owned()).into()
}
