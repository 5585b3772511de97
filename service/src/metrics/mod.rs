//! Prometheus metrics, from the same snapshot as the status. A thread of its own answers; workers and control thread never wait for it.

mod server;
mod text;

use isotherm_failure::{Exit, Failure};
use isotherm_shared::status::ServiceStatus;
use server::Server;
use std::net::{SocketAddr, TcpListener};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tracing::{info, warn};

/// An older snapshot is not shown: who made it hangs, and a monitor had better know.
const FRESH: Duration = Duration::from_secs(5);

/// What the control thread told last.
type Latest = Mutex<Option<(Instant, Arc<ServiceStatus>)>>;

/// The metrics' end in the control thread. Dropping it ends the server within a second.
pub struct Metrics {
    latest: Arc<Latest>,
}

impl Metrics {
    /// Listens on `address` and starts the thread that answers.
    ///
    /// # Errors
    /// If the address cannot be had.
    pub fn start(address: SocketAddr) -> Result<Self, Failure> {
        let failed = |error: std::io::Error| {
            Failure::new(
                Exit::Io,
                format!(
                    "metrics.listen = \"{address}\": {error}; `ss -ltnp` lists who listens where; give a free port of this machine, or remove [metrics]"
                ),
            )
        };
        let listener = TcpListener::bind(address).map_err(failed)?;
        let server = Server::new(listener).map_err(failed)?;
        let address = server.address().map_err(failed)?;
        if !address.ip().is_loopback() {
            warn!(
                "metrics.listen = \"{address}\": whoever reaches this port may read the metrics; they are neither encrypted nor asked for a password"
            );
        }
        let latest = Arc::<Latest>::default();
        let shown = Arc::downgrade(&latest);
        let body = move || {
            server.run(
                || shown.strong_count() > 0,
                || {
                    let latest = shown.upgrade()?.lock().unwrap_or_else(PoisonError::into_inner).clone();
                    latest.filter(|(told, _)| told.elapsed() < FRESH).map(|(_, status)| text::of(&status))
                },
            );
        };
        let thread = std::thread::Builder::new().name("metrics".to_owned()).spawn(body);
        thread.map_err(failed)?;
        info!("metrics at http://{address}/metrics");
        Ok(Self { latest })
    }

    /// Shows this from now on.
    pub fn update(&self, status: &Arc<ServiceStatus>) {
        let latest = Some((Instant::now(), Arc::clone(status)));
        *self.latest.lock().unwrap_or_else(PoisonError::into_inner) = latest;
    }
}
