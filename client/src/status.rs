//! Reading the status of the running service.

use crate::clock::{clock_offset_ns, monotonic_ns};
use crate::connect::{Options, join_existing};
use crate::error::ConnectError;
use crate::objects::{Note, removed_memory};
use crate::peers::{named, pid_of, publisher_of};
use crate::resources::lacks_room;
use crate::transport::stream::{self, Ipc, IpcNode};
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use isotherm_shared::names::Domain;
use isotherm_shared::status::ServiceStatus;
#[cfg(feature = "failure")]
use isotherm_support::failure::{Exit, Failure};
use std::time::{Duration, Instant};
use std::{io, thread};

/// Time limit for a status; a running service publishes ten times a second.
const STATUS_LIMIT: Duration = Duration::from_secs(2);
/// Pause between two polls.
const PAUSE: Duration = Duration::from_millis(2);
/// Polls for a status, at least, however long they take: a machine that stood still for a while has run neither this
/// process nor the service.
const LEAST_POLLS: u32 = 250;
/// Time between two looks whether clients have room, at least.
const NOTE_INTERVAL: Duration = Duration::from_millis(500);

/// The status in a file of the domain's folder: while shared memory has no room for a client, nobody can join to read
/// it from the stream. The service writes it then, and removes it when there is room again.
#[derive(Debug)]
pub struct StatusNote {
    note: Note,
    next: Instant,
    /// A service that was killed may have left one.
    exists: bool,
}

impl StatusNote {
    /// That of a domain.
    #[must_use]
    pub fn new(domain: &Domain) -> Self {
        Self { note: note(domain), next: Instant::now(), exists: true }
    }

    /// Writes the status, as JSON, or removes the file; twice a second at most.
    ///
    /// # Errors
    /// The operating system's.
    pub fn update(&mut self, document: &[u8]) -> io::Result<()> {
        let now = Instant::now();
        if now < self.next {
            return Ok(());
        }
        self.next = now + NOTE_INTERVAL;
        if lacks_room() {
            self.exists = true;
            return self.note.write(document);
        }
        if self.exists {
            self.note.remove();
            self.exists = false;
        }
        Ok(())
    }
}

/// The polls for a status.
struct Polls {
    deadline: Instant,
    count: u32,
}

impl Polls {
    fn until(deadline: Instant) -> Self {
        Self { deadline, count: 0 }
    }

    /// Whether there is time for another one.
    fn goes_on(&mut self) -> bool {
        self.count += 1;
        self.count <= LEAST_POLLS || Instant::now() < self.deadline
    }
}

fn note(domain: &Domain) -> Note {
    Note::new(domain, "status.json")
}

/// Waits for a status that the service writes into the domain's folder after the time `called_ns`. `None` if none
/// comes, or shared memory has room.
fn noted(domain: &Domain, called_ns: u64) -> Option<ServiceStatus> {
    let mut polls = Polls::until(Instant::now() + STATUS_LIMIT);
    while lacks_room() && polls.goes_on() {
        let status = note(domain).read().and_then(|text| serde_json::from_slice::<ServiceStatus>(&text).ok());
        // One of the time before the machine was started anew may lie in the future.
        if status.as_ref().is_some_and(|status| (called_ns..=monotonic_ns()).contains(&status.taken_ns)) {
            return status;
        }
        thread::sleep(PAUSE);
    }
    None
}

/// Why there is no status.
#[derive(Debug, thiserror::Error)]
pub enum StatusError {
    /// The domain cannot be joined, or has no service.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The transport failed.
    #[error("{phase} the status: {cause}")]
    Transport {
        /// The operation, for example "receiving".
        phase: &'static str,
        /// The message of iceoryx2.
        cause: String,
    },
    /// The status is of another version of the service, with another layout.
    #[error("reading the status: {0}; use the `isotherm` of the service's version")]
    Version(#[from] serde_json::Error),
    /// A service exists, but publishes no status. Its process id as this process sees it; `None` if it is in another
    /// pid namespace.
    #[error("the service ({}) does not publish its status; it is stopped, or hangs: continue or restart it", named(*.0))]
    Silent(Option<i32>),
}

impl StatusError {
    /// The same as an error of connecting.
    pub(crate) fn connecting(self, domain: &Domain) -> ConnectError {
        match self {
            Self::Connect(error) => error,
            Self::Transport { phase, cause } => ConnectError::Transport { phase, cause },
            Self::Silent(_) => ConnectError::NoService(domain.name().to_owned()),
            Self::Version(_) => ConnectError::OtherVersion {
                stream: stream::STATUS.to_owned(),
                domain: domain.name().to_owned(),
                payload: "status of another layout".to_owned(),
            },
        }
    }
}

#[cfg(feature = "failure")]
impl From<StatusError> for Failure {
    fn from(error: StatusError) -> Self {
        match error {
            StatusError::Connect(error) => error.into(),
            StatusError::Silent(_) => Self::new(Exit::Unavailable, error.to_string()),
            StatusError::Transport { .. } | StatusError::Version(_) => Self::new(Exit::Failed, error.to_string()),
        }
    }
}

/// Reads the status of a domain's service.
#[derive(Debug)]
pub struct StatusReader {
    // The subscriber must be dropped before its node; fields are dropped in this order.
    subscriber: Subscriber<Ipc, [u8], ()>,
    stream: PortFactory<Ipc, [u8], ()>,
    /// Its own node; `None` if it is part of something that has one.
    _node: Option<IpcNode>,
}

impl StatusReader {
    /// Connects; does not wait.
    ///
    /// # Errors
    /// If no service has used the domain, or the domain cannot be joined.
    pub fn connect(domain: &Domain) -> Result<Self, StatusError> {
        let node = join_existing(domain)?;
        let reader = Self::with(&node, domain)?;
        Ok(Self { _node: Some(node), ..reader })
    }

    /// A reader with the node of its owner, which the owner drops after the reader.
    pub(crate) fn with(node: &IpcNode, domain: &Domain) -> Result<Self, StatusError> {
        let stream = stream::open_status(node);
        let stream = stream.map_err(|error| match error {
            PublishSubscribeOpenError::DoesNotExist => absent(domain),
            other => {
                let cause = removed_memory(domain).unwrap_or_else(|| other.to_string());
                StatusError::Transport { phase: "opening", cause }
            }
        })?;
        let subscriber = stream.subscriber_builder().history_request(1).create();
        let subscriber =
            subscriber.map_err(|error| StatusError::Transport { phase: "subscribing to", cause: error.to_string() })?;
        Ok(Self { subscriber, stream, _node: None })
    }

    /// The newest status since the last call, if one has come.
    ///
    /// # Errors
    /// If the transport fails, or the status has the layout of another version; if its times are of another clock.
    pub fn latest(&self) -> Result<Option<ServiceStatus>, StatusError> {
        let mut latest = None;
        let failed = |cause: String| StatusError::Transport { phase: "receiving", cause };
        while let Some(sample) = self.subscriber.receive().map_err(|error| failed(error.to_string()))? {
            latest = Some(sample);
        }
        // Copied out of shared memory before it is looked at: another process could change it meanwhile.
        let document = latest.map(|sample| sample.to_vec());
        let status = document.map(|document| serde_json::from_slice::<ServiceStatus>(&document)).transpose()?;
        // A heartbeat of another clock may lie in the future for ever, or be older than this process.
        let ahead_ns = status.as_ref().map_or(0, |status| status.clock_offset_ns.saturating_sub(clock_offset_ns()));
        if ahead_ns == 0 { Ok(status) } else { Err(ConnectError::OtherClock { ahead_ns }.into()) }
    }
}

/// Waits for a status of the running service that is newer than this call. Where this process cannot join because
/// shared memory is full, it reads the file that the service then writes.
///
/// ```no_run
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_client::{Options, fetch_status};
///
/// let status = fetch_status(&Options::from_environment()?)?;
/// for imu in &status.imus {
///     println!("{}: {} readers, {} missing", imu.id, imu.readers, imu.missing);
/// }
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// If no service answers within two seconds in which this process is run. The time-out of `options` is not used.
pub fn fetch_status(options: &Options) -> Result<ServiceStatus, StatusError> {
    let called_ns = monotonic_ns();
    let mut polls = Polls::until(Instant::now() + STATUS_LIMIT);
    let reader = match StatusReader::connect(&options.domain) {
        Err(StatusError::Connect(ConnectError::Exhausted(cause))) => {
            let exhausted = || StatusError::Connect(ConnectError::Exhausted(cause));
            return noted(&options.domain, called_ns).ok_or_else(exhausted);
        }
        reader => reader?,
    };
    while polls.goes_on() {
        match reader.latest()? {
            Some(status) if status.taken_ns >= called_ns => return Ok(status),
            _ => thread::sleep(PAUSE),
        }
    }
    match publisher_of(&reader.stream) {
        Some((_, node)) => Err(StatusError::Silent(pid_of(&options.domain, node))),
        None => Err(absent(&options.domain)),
    }
}

fn absent(domain: &Domain) -> StatusError {
    ConnectError::NoService(domain.name().to_owned()).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_that_was_not_run_until_the_limit_was_over_polls_all_the_same() {
        let mut polls = Polls::until(Instant::now());
        let count = core::iter::from_fn(|| polls.goes_on().then_some(())).count();
        assert_eq!(count, LEAST_POLLS as usize);
        let mut polls = Polls::until(Instant::now() + Duration::from_secs(3600));
        assert!((0..2 * LEAST_POLLS).all(|_| polls.goes_on()));
    }
}
