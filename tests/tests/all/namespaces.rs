//! Programs of a domain in different namespaces, as of containers that share its folder and shared memory: another
//! clock, and numbers of processes that mean nothing elsewhere, are named.

use isotherm_client::{ConnectError, Options};
use isotherm_tests::{Needs, Process, RUN, TABLE, TestDomain, recording, round_trip, skip, text, wait_until};
use std::fs;
use std::process::Command;
use std::time::Duration;

/// Of the time namespace, how far its clock is ahead \[s\].
const TIME: [&str; 4] = ["-T", "--monotonic", "100000", "-f"];
const PID: [&str; 3] = ["-p", "-f", "--kill-child"];

/// Whether this user may have such a namespace. If not, the test is reported as skipped.
fn may_unshare(options: &[&str]) -> bool {
    let may = Command::new("unshare").args(options).arg("true").output().is_ok_and(|output| output.status.success());
    if !may {
        skip(&format!("this user may not have a namespace ({})", options[0]), Needs::Machine);
    }
    may
}

/// Starts a service in a namespace of its own.
fn serve_in(domain: &TestDomain, options: &[&str]) -> Process {
    domain.write("imu-a.toml", TABLE);
    let service = domain.start(domain.isotherm_after(options, "true", &["serve", "--imu", "imu-a=imu-a.toml"]));
    service.wait_for_log("ready");
    service
}

/// The only child of a process.
fn child_of(process: &Process) -> u32 {
    let children = format!("/proc/{0}/task/{0}/children", process.pid());
    fs::read_to_string(children).unwrap().trim().parse().unwrap()
}

#[test]
fn a_client_of_another_time_namespace_is_told_so() {
    if !may_unshare(&TIME) {
        return;
    }
    for (service_options, client_options, words) in [
        (&[][..], &TIME[..], "is 100000 s behind this process's: they are in different time namespaces"),
        (&TIME[..], &[][..], "is 100000 s ahead of this process's: they are in different time namespaces"),
    ] {
        let domain = TestDomain::new();
        let service = serve_in(&domain, service_options);
        for client in [&["status"][..], &["feed", "--imu", "imu-a", RUN]] {
            let output = domain.isotherm_after(client_options, "true", client).output().unwrap();
            let message = text(&output.stderr);
            assert_eq!(output.status.code(), Some(69), "{client:?}: {message}");
            assert!(message.contains(words), "{client:?}: {message}");
        }
        service.kill();
    }
    // A reader gets increments, and no age of the heartbeat that would never rise.
    let domain = TestDomain::new();
    let service = serve_in(&domain, &TIME);
    let mut reader = domain.reader("imu-a");
    round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
    wait_until("the increment", || reader.receive().unwrap().is_some());
    let mut error = None;
    wait_until("an error", || {
        error = reader.heartbeat_age().err();
        error.is_some()
    });
    assert_eq!(error, Some(ConnectError::OtherClock { ahead_ns: 100_000_000_000_000 }));
    service.kill();
}

#[test]
fn processes_of_another_pid_namespace_are_named_as_they_are_seen() {
    if !may_unshare(&PID) {
        return;
    }
    let domain = TestDomain::new();
    let service = serve_in(&domain, &PID);
    let seen = child_of(&service);
    // Its status has the number of its own namespace.
    let printed = domain.run_ok(&["status"]);
    assert!(printed.lines().next().unwrap().contains("pid 1 of another pid namespace"), "{printed}");
    let told = |options: &[&str], arguments: &[&str], words: &str| {
        let output = domain.isotherm_after(options, "true", arguments).output().unwrap();
        let message = text(&output.stderr);
        assert!(!output.status.success() && message.contains(words), "{arguments:?}: {message}");
    };
    let serve = &["serve", "--imu", "imu-a=imu-a.toml"];
    told(&[], serve, &format!(", pid {seen}; stop it, or give this one another --domain"));
    told(&PID, serve, ", in another pid namespace; stop it, or give this one another --domain");
    told(&[], &["clean"], &format!("pid {seen} is using it"));
    let acquisition = domain.acquisition("imu-a");
    let feed = &["feed", "--imu", "imu-a", "--timeout", "1", RUN];
    let own = std::process::id();
    told(&[], feed, &format!("already has an acquisition process, pid {own};"));
    told(&PID, feed, "already has an acquisition process, in another pid namespace;");
    // Of this very process, whose locks must stay.
    let options = Options { timeout: Duration::ZERO, ..domain.options() };
    for _ in 0..2 {
        match isotherm_client::Acquisition::connect(&"imu-a".parse().unwrap(), &options) {
            Err(ConnectError::Occupied { pid, .. }) => assert_eq!(pid, Some(own.cast_signed())),
            other => panic!("{other:?}"),
        }
    }
    drop(acquisition);
    service.kill();
    wait_until("the end of the service", || !fs::exists(format!("/proc/{seen}")).unwrap());
    told(&PID, &["status"], "no service is running");
}
