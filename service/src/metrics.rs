//! Prometheus metrics, from the same snapshot as the status. A separate thread answers requests; workers and control
//! thread never wait for it.

mod server;
mod text;

use isotherm_shared::status::ServiceStatus;
use isotherm_support::failure::{Exit, Failure};
use server::MetricsServer;
use std::cell::{RefCell, RefMut};
use std::net::{SocketAddr, TcpListener};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};
pub(crate) use text::METRICS;
use tracing::{info, warn};

/// Pause before a port that is taken is tried again.
const RETRY: Duration = Duration::from_secs(1);
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
    /// Starts the thread that listens on `address` and answers. A port that is taken is no reason to give no
    /// increments: it is tried again until it is free.
    ///
    /// # Errors
    /// If the operating system refuses the thread.
    pub(crate) fn start(address: SocketAddr) -> Result<Self, Failure> {
        let latest = Arc::<Latest>::default();
        let shown = Arc::downgrade(&latest);
        let body = move || {
            let wanted = || shown.strong_count() > 0;
            let Some(server) = listen(address, wanted) else { return };
            let page = RefCell::default();
            server.run(wanted, || {
                let latest = shown.upgrade()?.lock().unwrap_or_else(PoisonError::into_inner).clone();
                let (_, status) = latest.filter(|(updated, _)| updated.elapsed() < MAX_AGE)?;
                let mut page: RefMut<'_, Page<_>> = page.borrow_mut();
                Some(page.of(&status, Instant::now(), text::render).to_owned())
            });
        };
        let thread = thread::Builder::new().name("metrics".to_owned()).spawn(body);
        thread.map_err(|error| Failure::new(Exit::Failed, format!("starting the metrics: {error}")))?;
        Ok(Self { latest })
    }

    /// Replaces the status that is shown.
    pub(crate) fn update(&self, status: &Arc<ServiceStatus>) {
        let latest = Some((Instant::now(), Arc::clone(status)));
        *self.latest.lock().unwrap_or_else(PoisonError::into_inner) = latest;
    }
}

/// Listens on the address, as soon as that is possible; `None` if it is not wanted any more.
fn listen(address: SocketAddr, wanted: impl Fn() -> bool) -> Option<MetricsServer> {
    let mut is_told = false;
    while wanted() {
        let server = TcpListener::bind(address).and_then(MetricsServer::new);
        match server.and_then(|server| Ok((server.address()?, server))) {
            Ok((address, server)) => {
                if !address.ip().is_loopback() {
                    warn!(
                        "metrics.listen = \"{address}\": anybody who reaches this port can read the metrics; there is no encryption and no password"
                    );
                }
                info!("metrics at http://{address}/metrics");
                return Some(server);
            }
            Err(error) => {
                if !is_told {
                    warn!(
                        "no metrics yet: metrics.listen = \"{address}\": {error}; it is tried again every second; `ss -ltnp` lists who listens \
                         where; give a free port of this machine, or remove [metrics]"
                    );
                }
                is_told = true;
            }
        }
        thread::sleep(RETRY);
    }
    None
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
