//! Notifies the service manager of the service's state, as in sd_notify(3). Without a service manager nothing is sent.

use sd_notify::NotifyState;
use std::os::linux::net::SocketAddrExt as _;
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::{Duration, Instant};
use std::{env, io};
use tracing::{info, warn};

/// Whether a service manager starts this process again when it ends. A shell that systemd has started hands
/// `INVOCATION_ID` on to its programs; from systemd 248 on, `SYSTEMD_EXEC_PID` says which process it was meant for.
pub(crate) fn has_supervisor() -> bool {
    let is_meant = || env::var("SYSTEMD_EXEC_PID").map_or(true, |pid| pid == std::process::id().to_string());
    env::var_os("NOTIFY_SOCKET").is_some() || env::var_os("INVOCATION_ID").is_some() && is_meant()
}

/// The connection to the service manager.
#[derive(Debug)]
pub(crate) struct ServiceManager {
    /// How often its watchdog is fed; `None` if it has no watchdog for this service.
    period: Option<Duration>,
    next: Instant,
    reported_failure: bool,
}

impl ServiceManager {
    /// The service manager that the environment of this process names.
    pub(crate) fn from_environment() -> Self {
        // Twice as often as sd_watchdog_enabled(3) recommends, so that one delay does not end the service.
        let period = sd_notify::watchdog_enabled().filter(|timeout| !timeout.is_zero()).map(|timeout| timeout / 4);
        if let Some(period) = period {
            info!("the service manager's watchdog is fed every {} ms while all workers run", period.as_millis());
        }
        Self { period, next: Instant::now(), reported_failure: false }
    }

    /// Reports that all IMUs are served.
    pub(crate) fn ready(&mut self) {
        self.notify(&[NotifyState::Ready]);
    }

    /// Reports that tables are reloaded on request; [`ready`](Self::ready) follows.
    pub(crate) fn reloading(&mut self) {
        match NotifyState::monotonic_usec_now() {
            Ok(now) => self.notify(&[NotifyState::Reloading, now]),
            Err(_) => self.notify(&[NotifyState::Reloading]),
        }
    }

    /// Reports that the service is stopping.
    pub(crate) fn stopping(&mut self) {
        self.notify(&[NotifyState::Stopping]);
    }

    /// Asks for this much more time until [`ready`](Self::ready).
    pub(crate) fn extend_start(&mut self, time: Duration) {
        self.notify(&[NotifyState::ExtendTimeoutUsec(time.as_micros() as u32)]);
    }

    /// Sends one line of status text for people.
    pub(crate) fn status(&mut self, line: &str) {
        self.notify(&[NotifyState::Status(line)]);
    }

    /// Feeds the watchdog, if that is due.
    pub(crate) fn feed_watchdog(&mut self, now: Instant) {
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
            warn!("notifying the service manager: {error}; NOTIFY_SOCKET names its socket");
        }
    }
}

/// Sends without waiting: a manager that does not read its socket must not block the control thread. A message for
/// which the socket has no room is lost.
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
