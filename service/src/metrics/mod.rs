//! Prometheus metrics, from the same snapshot as the status. A separate thread answers requests; workers and control
//! thread never wait for it.

mod server;
mod text;

use isotherm_failure::{Exit, Failure};
use isotherm_shared::status::ServiceStatus;
use server::MetricsServer;
use std::net::{SocketAddr, TcpListener};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
pub(crate) use text::METRICS;
use tracing::{info, warn};

/// An older snapshot is not shown: the control thread hangs, and the monitoring must notice that.
const MAX_AGE: Duration = Duration::from_secs(5);

/// The last status from the control thread, and when it came.
type Latest = Mutex<Option<(Instant, Arc<ServiceStatus>)>>;

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
            server.run(
                || shown.strong_count() > 0,
                || {
                    let latest = shown.upgrade()?.lock().unwrap_or_else(PoisonError::into_inner).clone();
                    latest.filter(|(updated, _)| updated.elapsed() < MAX_AGE).map(|(_, status)| text::render(&status))
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
