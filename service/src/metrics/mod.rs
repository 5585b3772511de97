//! Prometheus metrics, from the same snapshot as the status. A separate thread answers requests; workers and control
//! thread never wait for it.

mod server;
mod text;

use isotherm_failure::{Exit, Failure};
use isotherm_shared::status::ServiceStatus;
use server::MetricsServer;
use std::cell::{RefCell, RefMut};
use std::net::{SocketAddr, TcpListener};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
pub(crate) use text::METRICS;
use tracing::{info, warn};

/// An older snapshot is not shown: the control thread hangs, and the monitoring must notice that.
const MAX_AGE: Duration = Duration::from_secs(5);

/// Time between two renderings at least: a flood of requests costs a copy of the page each, not its making.
const RENDER_INTERVAL: Duration = Duration::from_millis(500);

/// The last status from the control thread, and when it came.
type Latest = Mutex<Option<(Instant, Arc<ServiceStatus>)>>;

/// What was rendered last, of which status, and when.
struct Page<T> {
    rendered: Option<(Instant, Arc<T>)>,
    text: String,
}

impl<T> Default for Page<T> {
    fn default() -> Self {
        Self { rendered: None, text: String::new() }
    }
}

impl<T> Page<T> {
    /// The page of a status; within [`RENDER_INTERVAL`] of the last rendering, that of the status before.
    fn of(&mut self, status: &Arc<T>, now: Instant, render: impl FnOnce(&T) -> String) -> &str {
        let is_good =
            |(at, of): &(Instant, Arc<T>)| Arc::ptr_eq(of, status) || now.duration_since(*at) < RENDER_INTERVAL;
        if !self.rendered.as_ref().is_some_and(is_good) {
            self.text = render(status);
            self.rendered = Some((now, Arc::clone(status)));
        }
        &self.text
    }
}

/// The control thread's handle to the metrics. Dropping it ends the server within a second.
pub(crate) struct Metrics {
    latest: Arc<Latest>,
}

impl Metrics {
    /// Listens on `address` and starts the thread that answers.
    ///
    /// # Errors
    /// If it cannot listen on the address.
    pub(crate) fn start(address: SocketAddr) -> Result<Self, Failure> {
        let failed = |error: std::io::Error| {
            Failure::new(
                Exit::Io,
                format!(
                    "metrics.listen = \"{address}\": {error}; `ss -ltnp` lists who listens where; give a free port of this machine, or remove [metrics]"
                ),
            )
        };
        let listener = TcpListener::bind(address).map_err(failed)?;
        let server = MetricsServer::new(listener).map_err(failed)?;
        let address = server.address().map_err(failed)?;
        if !address.ip().is_loopback() {
            warn!(
                "metrics.listen = \"{address}\": anybody who reaches this port can read the metrics; there is no encryption and no password"
            );
        }
        let latest = Arc::<Latest>::default();
        let shown = Arc::downgrade(&latest);
        let body = move || {
            let page = RefCell::default();
            server.run(
                || shown.strong_count() > 0,
                || {
                    let latest = shown.upgrade()?.lock().unwrap_or_else(PoisonError::into_inner).clone();
                    let (_, status) = latest.filter(|(updated, _)| updated.elapsed() < MAX_AGE)?;
                    let mut page: RefMut<'_, Page<_>> = page.borrow_mut();
                    Some(page.of(&status, Instant::now(), text::render).to_owned())
                },
            );
        };
        let thread = std::thread::Builder::new().name("metrics".to_owned()).spawn(body);
        thread.map_err(failed)?;
        info!("metrics at http://{address}/metrics");
        Ok(Self { latest })
    }

    /// Replaces the status that is shown.
    pub(crate) fn update(&self, status: &Arc<ServiceStatus>) {
        let latest = Some((Instant::now(), Arc::clone(status)));
        *self.latest.lock().unwrap_or_else(PoisonError::into_inner) = latest;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_rendered_twice_a_second_at_most_and_once_for_each_status() {
        let (mut page, begun, mut renderings) = (Page::default(), Instant::now(), 0);
        let mut shown = Vec::new();
        let mut status = Arc::new(0);
        // A request each millisecond for 4 s; a new status each 100 ms, and none in the last second.
        for ms in 0..4000 {
            if ms % 100 == 0 && ms < 3000 {
                status = Arc::new(ms);
            }
            let text = page.of(&status, begun + Duration::from_millis(ms), |status| {
                renderings += 1;
                status.to_string()
            });
            shown.push(text.parse::<u64>().unwrap());
        }
        assert_eq!(renderings, 7, "at 0, 500 .. 3000 ms");
        assert_eq!([shown[499], shown[500], shown[2999], shown[3000]], [0, 500, 2500, 2900]);
        assert_eq!(shown[3999], 2900);
    }
}
