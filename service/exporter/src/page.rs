//! The page: the newest status of the service and the tallies of the acquisitions, as text.

use crate::metric::MetricsText;
use crate::{service, tallies};
use isotherm_client::{Domain, monotonic_ns};
use isotherm_service::StatusSource;
use isotherm_shared::status::ServiceStatus;
use std::time::{Duration, Instant};
use tracing::{info, warn};

/// An older status is not shown: the service hangs or has ended, and the monitoring must notice that.
const MAX_AGE_NS: u64 = 5_000_000_000;
/// Time between two renderings at least: a flood of requests costs a copy of the page each, not its making.
const RENDER_INTERVAL: Duration = Duration::from_millis(500);

/// The page of one domain.
pub(crate) struct MetricsPage<'a> {
    domain: &'a Domain,
    source: StatusSource,
    status: Option<ServiceStatus>,
    /// Why there is no status, as it was logged.
    cause: String,
    /// What was rendered last, and when.
    rendered: Option<(Instant, String)>,
}

impl<'a> MetricsPage<'a> {
    pub(crate) fn new(domain: &'a Domain, source: StatusSource) -> Self {
        Self { domain, source, status: None, cause: String::new(), rendered: None }
    }

    /// Takes the newest status. Logs when the service goes and comes.
    pub(crate) fn update(&mut self) {
        match self.source.poll(Instant::now()) {
            (Some(status), _) => {
                if self.status.is_none() || !self.cause.is_empty() {
                    info!(domain = self.domain.name(), "showing the status of the service");
                }
                self.cause.clear();
                self.status = Some(status);
            }
            (None, Some(wait)) if wait.cause != self.cause => {
                warn!("waiting for the service: {}", wait.cause);
                self.cause = wait.cause;
            }
            (None, _) => {}
        }
    }

    /// The page, rendered twice a second at most; `None` without a status of the last five seconds.
    pub(crate) fn text(&mut self) -> Option<String> {
        self.update();
        let status =
            self.status.as_ref().filter(|status| monotonic_ns().saturating_sub(status.taken_ns) < MAX_AGE_NS)?;
        let now = Instant::now();
        let recent = self.rendered.as_ref().filter(|(at, _)| now.duration_since(*at) < RENDER_INTERVAL);
        if let Some((_, text)) = recent {
            return Some(text.clone());
        }
        let mut text = MetricsText(String::with_capacity(16 * 1024));
        service::render(&mut text, status);
        tallies::render(&mut text, &tallies::read(self.domain));
        self.rendered = Some((now, text.0.clone()));
        Some(text.0)
    }
}
