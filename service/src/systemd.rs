//! Telling a service manager how the service does, as sd_notify(3) describes it. Without one nothing is told.

use sd_notify::NotifyState;
use std::env;
use std::io;
use std::os::linux::net::SocketAddrExt as _;
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::{Duration, Instant};
use tracing::{info, warn};

/// The service manager's end.
#[derive(Debug)]
pub struct Manager {
    /// How often it wants a sign of life; none if it does not watch.
    period: Option<Duration>,
    next: Instant,
    reported_failure: bool,
}

impl Manager {
    /// Whoever started this process, as its environment says.
    pub fn from_environment() -> Self {
        // Twice as often as asked, as the manual page advises.
        let period = sd_notify::watchdog_enabled().filter(|timeout| !timeout.is_zero()).map(|timeout| timeout / 2);
        if let Some(period) = period {
            info!("the service manager's watchdog is fed every {} ms while all workers move", period.as_millis());
        }
        Self { period, next: Instant::now(), reported_failure: false }
    }

    /// Everything is served.
    pub fn ready(&mut self) {
        self.notify(&[NotifyState::Ready]);
    }

    /// Tables are being loaded because it was asked for; [`ready`](Self::ready) follows.
    pub fn reloading(&mut self) {
        match NotifyState::monotonic_usec_now() {
            Ok(now) => self.notify(&[NotifyState::Reloading, now]),
            Err(_) => self.notify(&[NotifyState::Reloading]),
        }
    }

    /// The end has begun.
    pub fn stopping(&mut self) {
        self.notify(&[NotifyState::Stopping]);
    }

    /// One line for people.
    pub fn status(&mut self, line: &str) {
        self.notify(&[NotifyState::Status(line)]);
    }

    /// A sign of life, when one is due.
    pub fn alive(&mut self, now: Instant) {
        if let Some(period) = self.period
            && now >= self.next
        {
            self.next = now + period;
            self.notify(&[NotifyState::Watchdog]);
        }
    }

    fn notify(&mut self, states: &[NotifyState<'_>]) {
        if let Err(error) = send(states)
            && !self.reported_failure
        {
            self.reported_failure = true;
            warn!("telling the service manager: {error}; NOTIFY_SOCKET names its socket");
        }
    }
}

/// Sends without waiting: a manager that does not read its socket must not stop the control thread, so what finds no room is lost.
fn send(states: &[NotifyState<'_>]) -> io::Result<()> {
    let Some(name) = env::var_os("NOTIFY_SOCKET").filter(|name| !name.is_empty()) else { return Ok(()) };
    let address = match name.as_bytes().strip_prefix(b"@") {
        Some(name) => SocketAddr::from_abstract_name(name)?,
        None => SocketAddr::from_pathname(&name)?,
    };
    let message: String = states.iter().map(|state| format!("{state}\n")).collect();
    let socket = UnixDatagram::unbound()?;
    socket.set_nonblocking(true)?;
    match socket.send_to_addr(message.as_bytes(), &address) {
        Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(()),
        result => result.map(drop),
    }
}
