//! The source of the status: a service that may start, end and return.

use isotherm_client::{Domain, StatusReader, monotonic_ns};
use isotherm_shared::status::ServiceStatus;
use isotherm_support::failure::{Exit, Failure};
use std::time::{Duration, Instant};

/// A running service publishes its status ten times a second. Without a status for this time, the service is waited
/// for.
const STALE_AFTER: Duration = Duration::from_secs(2);
/// Pause between two attempts to connect.
const RETRY: Duration = Duration::from_secs(1);

/// A wait for the service.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(super) struct ServiceWait {
    /// Time since the last status.
    pub time: Duration,
    /// Why there is no status.
    pub cause: String,
}

/// The status of one domain's service.
pub(super) struct StatusSource {
    domain: Domain,
    reader: Option<StatusReader>,
    last_status: Instant,
    next_attempt: Instant,
    cause: String,
}

impl StatusSource {
    /// Connects to the service. One that is not there yet is waited for.
    ///
    /// # Errors
    /// If waiting does not help, for example with another user's domain.
    pub(super) fn connect(domain: Domain) -> Result<Self, Failure> {
        let now = Instant::now();
        let mut source = Self { domain, reader: None, last_status: now, next_attempt: now, cause: String::new() };
        match source.attempt(now).and_then(|()| source.read()) {
            Err(failure) if failure.exit == Exit::Unavailable => source.cause = failure.message,
            Err(failure) => return Err(failure),
            Ok(_) => {}
        }
        Ok(source)
    }

    /// The newest status since the last call, and the wait for the service if there is one.
    pub(super) fn poll(&mut self, now: Instant) -> (Option<ServiceStatus>, Option<ServiceWait>) {
        if self.reader.is_none()
            && now >= self.next_attempt
            && let Err(failure) = self.attempt(now)
        {
            self.cause = failure.message;
        }
        let newest = match self.read() {
            Ok(newest) => newest,
            Err(failure) => {
                self.cause = failure.message;
                self.reader = None;
                None
            }
        };
        if newest.is_some() {
            self.last_status = now;
            self.cause.clear();
            return (newest, None);
        }
        let time = now.duration_since(self.last_status);
        if self.reader.is_some() && time > STALE_AFTER && now >= self.next_attempt {
            // A service that returns uses the same streams, unless somebody has removed them. So connect again.
            self.reader = None;
            self.next_attempt = now + RETRY;
            self.cause = "the service does not publish its status: it has ended, is stopped, or hangs".to_owned();
        }
        let waiting = time > STALE_AFTER || !self.cause.is_empty();
        (None, waiting.then(|| ServiceWait { time, cause: self.cause.clone() }))
    }

    fn attempt(&mut self, now: Instant) -> Result<(), Failure> {
        self.next_attempt = now + RETRY;
        self.reader = Some(StatusReader::connect(&self.domain)?);
        Ok(())
    }

    /// The newest status. One older than [`STALE_AFTER`] is ignored: a dead service has left it behind.
    fn read(&self) -> Result<Option<ServiceStatus>, Failure> {
        let newest = self.reader.as_ref().map(StatusReader::latest).transpose()?.flatten();
        let oldest = monotonic_ns().saturating_sub(STALE_AFTER.as_nanos() as u64);
        Ok(newest.filter(|status| status.taken_ns > oldest))
    }
}
