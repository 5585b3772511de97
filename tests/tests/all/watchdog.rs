//! Messages to the service manager, and the detection of a worker that stands still.

use isotherm_tests::{Needs, Process, TABLE, TIMEOUT, TestDomain, recording, round_trip, skip, thread_of, wait_until};
use nix::sys::ptrace;
use nix::sys::wait::{WaitPidFlag, waitpid};
use nix::unistd::Pid;
use rustix::process::Signal;
use std::os::unix::net::UnixDatagram;
use std::time::{Duration, Instant};

/// The service manager's end of the socket.
struct NotifySocket(UnixDatagram);

impl NotifySocket {
    /// Creates the socket and starts a service that notifies it.
    fn of_service(domain: &TestDomain, watchdog_usec: &str) -> (Self, Process) {
        domain.write("imu-a.toml", TABLE);
        let path = domain.path("notify");
        let socket = UnixDatagram::bind(&path).unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
        let mut command = domain.isotherm(&["serve", "--imu", "imu-a=imu-a.toml"]);
        command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", watchdog_usec);
        (Self(socket), domain.start(command))
    }

    /// Waits for a message with a line that begins with `text`, and gives the whole message.
    fn wait_for(&self, text: &str) -> String {
        let deadline = Instant::now() + TIMEOUT;
        loop {
            let mut buffer = [0; 4096];
            let length = self.0.recv(&mut buffer).unwrap_or_default();
            let message = String::from_utf8_lossy(&buffer[..length]).into_owned();
            if message.lines().any(|line| line.starts_with(text)) {
                return message;
            }
            assert!(Instant::now() < deadline, "{text:?} was not received");
        }
    }

    /// Reads messages until none has come for 50 ms.
    fn read_what_has_come(&self) {
        while self.0.recv(&mut [0; 4096]).is_ok() {}
    }

    /// The number of messages that begin with `text` within a time.
    fn count(&self, text: &str, time: Duration) -> usize {
        let deadline = Instant::now() + time;
        let mut count = 0;
        while Instant::now() < deadline {
            let mut buffer = [0; 4096];
            let length = self.0.recv(&mut buffer).unwrap_or_default();
            count += usize::from(buffer[..length].starts_with(text.as_bytes()));
        }
        count
    }
}

#[test]
fn the_service_manager_gets_states_and_watchdog_messages_while_all_workers_run() {
    let domain = TestDomain::new();
    let (notify_socket, service) = NotifySocket::of_service(&domain, "200000");
    notify_socket.wait_for("READY=1");
    notify_socket.wait_for("WATCHDOG=1");
    notify_socket.wait_for("STATUS=1 IMUs, 0 increments");
    round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
    notify_socket.wait_for("STATUS=1 IMUs, 1 increments, 0 samples missing, 0 table files refused");

    service.signal(Signal::HUP);
    assert!(notify_socket.wait_for("RELOADING=1").contains("MONOTONIC_USEC="));
    notify_socket.wait_for("READY=1");

    let worker = Pid::from_raw(thread_of(service.pid(), "worker-0"));
    if ptrace::seize(worker, ptrace::Options::empty()).is_ok() {
        ptrace::interrupt(worker).unwrap();
        waitpid(worker, Some(WaitPidFlag::__WALL)).unwrap();
        service.wait_for_log("stands still: its loop has not turned for a second, its IMUs are not served");
        assert!(service.log().contains("worker=0 imus=\"imu-a\""), "{}", service.log());
        assert_eq!(domain.status()["workers"][0]["stands_still"], true);
        // What it sent before it noticed.
        notify_socket.read_what_has_come();
        assert_eq!(notify_socket.count("WATCHDOG=1", Duration::from_millis(600)), 0, "the watchdog is still fed");
        notify_socket.wait_for("STATUS=");
        ptrace::detach(worker, None).unwrap();
        service.wait_for_log("runs again");
        notify_socket.wait_for("WATCHDOG=1");
        wait_until("the status", || domain.status()["workers"][0]["stands_still"] == false);
    } else {
        skip("this user may not trace a process", Needs::Machine);
    }
    round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
    service.signal(Signal::TERM);
    notify_socket.wait_for("STOPPING=1");
    let (status, log) = service.wait();
    assert!(status.success(), "{log}");
}

#[test]
fn a_missing_notify_socket_is_logged_once() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let mut command = domain.isotherm(&["serve", "--imu", "imu-a=imu-a.toml"]);
    command.env("NOTIFY_SOCKET", domain.path("nobody")).env("WATCHDOG_USEC", "100000");
    let service = domain.start(command);
    service.wait_for_log("notifying the service manager: ");
    service.wait_for_log("ready");
    round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
    service.signal(Signal::TERM);
    let (status, log) = service.wait();
    assert!(status.success(), "{log}");
    assert_eq!(log.matches("notifying the service manager: ").count(), 1, "{log}");
}

/// The socket's queue holds some ten messages; then sending fails.
#[test]
fn a_full_notify_socket_blocks_nothing() {
    let domain = TestDomain::new();
    let (_notify_socket, service) = NotifySocket::of_service(&domain, "2000");
    service.wait_for_log("ready");
    let sender = UnixDatagram::unbound().unwrap();
    sender.set_nonblocking(true).unwrap();
    let path = domain.path("notify");
    wait_until("the socket is full", || sender.send_to(b"", &path).is_err());
    let uptime = |status: serde_json::Value| status["uptime_s"].as_f64().unwrap();
    let full = uptime(domain.status());
    wait_until("the control thread goes on", || uptime(domain.status()) > full + 0.5);
    round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
    service.terminate();
}
