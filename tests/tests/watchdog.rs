//! What a service manager is told, and what a worker that stands still looks like.
#![allow(clippy::panic, clippy::print_stderr, clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_tests::{Needs, PATIENCE, TABLE, World, recording, round_trip, skip, thread_of, wait_until};
use nix::sys::ptrace;
use nix::sys::wait::{WaitPidFlag, waitpid};
use nix::unistd::Pid;
use rustix::process::Signal;
use std::os::unix::net::UnixDatagram;
use std::time::{Duration, Instant};

/// The service manager's end of the socket.
struct Manager(UnixDatagram);

impl Manager {
    /// Waits for a message with a line that begins with `text`, and gives the whole message.
    fn wait_for(&self, text: &str) -> String {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let mut buffer = [0; 4096];
            let length = self.0.recv(&mut buffer).unwrap_or_default();
            let message = String::from_utf8_lossy(&buffer[..length]).into_owned();
            if message.lines().any(|line| line.starts_with(text)) {
                return message;
            }
            assert!(Instant::now() < deadline, "{text:?} was not told");
        }
    }

    /// How many messages of this kind come within a time.
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
fn the_service_manager_is_told_and_fed_as_long_as_all_workers_move() {
    let world = World::new();
    world.write("imu-a.toml", TABLE);
    let path = world.path("notify");
    let manager = Manager(UnixDatagram::bind(&path).unwrap());
    manager.0.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
    let mut command = world.isotherm(&["serve", "--imu", "imu-a=imu-a.toml"]);
    command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "200000");
    let service = world.start(command);
    manager.wait_for("READY=1");
    manager.wait_for("WATCHDOG=1");
    manager.wait_for("STATUS=1 IMUs, 0 increments");
    round_trip(&mut world.acquisition("imu-a"), &recording()[0]);
    manager.wait_for("STATUS=1 IMUs, 1 increments, 0 samples missing, 0 table files refused");

    service.signal(Signal::HUP);
    assert!(manager.wait_for("RELOADING=1").contains("MONOTONIC_USEC="));
    manager.wait_for("READY=1");

    let worker = Pid::from_raw(thread_of(service.pid(), "worker-0"));
    if ptrace::seize(worker, ptrace::Options::empty()).is_ok() {
        ptrace::interrupt(worker).unwrap();
        waitpid(worker, Some(WaitPidFlag::__WALL)).unwrap();
        service.wait_for_log("stands still: its loop has not turned for a second, its IMUs are not served");
        assert!(service.log().contains("worker=0 imus=\"imu-a\""), "{}", service.log());
        assert_eq!(world.status()["workers"][0]["stands_still"], true);
        // What was fed before it was seen to stand still.
        manager.wait_for("STATUS=");
        assert_eq!(manager.count("WATCHDOG=1", Duration::from_millis(600)), 0, "it is not fed any more");
        ptrace::detach(worker, None).unwrap();
        service.wait_for_log("moves again");
        manager.wait_for("WATCHDOG=1");
        wait_until("the status", || world.status()["workers"][0]["stands_still"] == false);
    } else {
        skip("this user may not trace a process", Needs::Machine);
    }
    round_trip(&mut world.acquisition("imu-a"), &recording()[0]);
    service.signal(Signal::TERM);
    manager.wait_for("STOPPING=1");
    let (status, log) = service.wait();
    assert!(status.success(), "{log}");
}

#[test]
fn a_manager_that_does_not_listen_is_told_of_once() {
    let world = World::new();
    world.write("imu-a.toml", TABLE);
    let mut command = world.isotherm(&["serve", "--imu", "imu-a=imu-a.toml"]);
    command.env("NOTIFY_SOCKET", world.path("nobody")).env("WATCHDOG_USEC", "100000");
    let service = world.start(command);
    service.wait_for_log("telling the service manager: ");
    service.wait_for_log("ready");
    round_trip(&mut world.acquisition("imu-a"), &recording()[0]);
    service.signal(Signal::TERM);
    let (status, log) = service.wait();
    assert!(status.success(), "{log}");
    assert_eq!(log.matches("telling the service manager: ").count(), 1, "{log}");
}

/// Its socket takes some ten messages, and then no more.
#[test]
fn a_manager_that_does_not_read_stops_nobody() {
    let world = World::new();
    world.write("imu-a.toml", TABLE);
    let path = world.path("notify");
    let manager = Manager(UnixDatagram::bind(&path).unwrap());
    manager.0.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
    let mut command = world.isotherm(&["serve", "--imu", "imu-a=imu-a.toml"]);
    command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "2000");
    let service = world.start(command);
    service.wait_for_log("ready");
    let sender = UnixDatagram::unbound().unwrap();
    sender.set_nonblocking(true).unwrap();
    wait_until("the socket is full", || sender.send_to(b"", &path).is_err());
    let uptime = |status: serde_json::Value| status["uptime_s"].as_f64().unwrap();
    let full = uptime(world.status());
    wait_until("the control thread goes on", || uptime(world.status()) > full + 0.5);
    round_trip(&mut world.acquisition("imu-a"), &recording()[0]);
    service.terminate();
}
