//! Where the status comes from: a service that may come, go and return.

use isotherm_client::StatusReader;
use isotherm_client::{Domain, monotonic_ns};
use isotherm_failure::{Exit, Failure};
use isotherm_shared::status::ServiceStatus;
use std::time::{Duration, Instant};

/// A service that runs tells ten times a second; one that has not for so long is waited for.
const PATIENCE: Duration = Duration::from_secs(2);
/// Pause between two attempts to connect.
const RETRY: Duration = Duration::from_secs(1);

/// What is waited for.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Waiting {
    /// How long already.
    pub time: Duration,
    /// Why.
    pub cause: String,
}

/// The status of one domain's service.
pub struct Source {
    domain: Domain,
    reader: Option<StatusReader>,
    heard: Instant,
    next_attempt: Instant,
    cause: String,
}

impl Source {
    /// Connects, or is going to: a service that is not there yet is waited for.
    ///
    /// # Errors
    /// What waiting will not change, another user's domain for example.
    pub fn connect(domain: Domain) -> Result<Self, Failure> {
        let now = Instant::now();
        let mut source = Self { domain, reader: None, heard: now, next_attempt: now, cause: String::new() };
        match source.attempt(now).and_then(|()| source.read()) {
            Err(failure) if failure.exit == Exit::Unavailable => source.cause = failure.message,
            Err(failure) => return Err(failure),
            Ok(_) => {}
        }
        Ok(source)
    }

    /// The newest status since the last look; and what is waited for, if it is.
    pub fn look(&mut self, now: Instant) -> (Option<ServiceStatus>, Option<Waiting>) {
        if self.reader.is_none()
            && now >= self.next_attempt
            && let Err(failure) = self.attempt(now)
        {
            self.cause = failure.message;
        }
        let news = match self.read() {
            Ok(news) => news,
            Err(failure) => {
                self.cause = failure.message;
                self.reader = None;
                None
            }
        };
        if news.is_some() {
            self.heard = now;
            self.cause.clear();
            return (news, None);
        }
        let time = now.duration_since(self.heard);
        if self.reader.is_some() && time > PATIENCE && now >= self.next_attempt {
            // A service that returns is met on the streams that are there, unless somebody has removed them.
            self.reader = None;
            self.next_attempt = now + RETRY;
            self.cause = "the service does not tell its status: it has ended, is stopped, or hangs".to_owned();
        }
        let waiting = time > PATIENCE || !self.cause.is_empty();
        (None, waiting.then(|| Waiting { time, cause: self.cause.clone() }))
    }

    fn attempt(&mut self, now: Instant) -> Result<(), Failure> {
        self.next_attempt = now + RETRY;
        self.reader = Some(StatusReader::connect(&self.domain)?);
        Ok(())
    }

    /// What a dead service has left behind is no news.
    fn read(&self) -> Result<Option<ServiceStatus>, Failure> {
        let news = self.reader.as_ref().map(StatusReader::latest).transpose()?.flatten();
        let oldest = monotonic_ns().saturating_sub(PATIENCE.as_nanos() as u64);
        Ok(news.filter(|status| status.taken_ns > oldest))
    }
}
