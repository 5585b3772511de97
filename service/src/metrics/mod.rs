//! Prometheus metrics, from the same snapshot as the status. A separate thread answers requests; workers and control
//! thread never wait for it.

mod server;
mod text;

use isotherm_failure::{Exit, Failure};
use isotherm_shared::status::ServiceStatus;
use server::MetricsServer;
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

/// The last status from the control thread, and when it came.
type Latest = Mutex<Option<(Instant, Arc<ServiceStatus>)>>;

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
            server.run(wanted, || {
                let latest = shown.upgrade()?.lock().unwrap_or_else(PoisonError::into_inner).clone();
                latest.filter(|(updated, _)| updated.elapsed() < MAX_AGE).map(|(_, status)| text::render(&status))
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
