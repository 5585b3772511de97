//! Programs of a domain in different namespaces, as of containers that share its folder and shared memory: another
//! clock, and numbers of processes that mean nothing elsewhere, are named.

use isotherm_client::{ConnectError, Options};
use isotherm_tests::{
    Needs, Process, RUN, TABLE, TestDomain, may_mount, recording, round_trip, skip, text, wait_until,
};
use std::collections::BTreeSet;
use std::fs;
use std::process::Command;
use std::time::Duration;

/// Of the time namespace, how far its clock is ahead \[s\].
const TIME: [&str; 4] = ["-T", "--monotonic", "100000", "-f"];
const PID: [&str; 3] = ["-p", "-f", "--kill-child"];
/// As in containers: every program is process 1, and sees no others.
const CONTAINER: [&str; 4] = ["-p", "-f", "--kill-child", "--mount-proc"];

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

/// The objects of the domain in shared memory, and its nodes.
fn objects(domain: &TestDomain) -> (BTreeSet<String>, usize) {
    let (root, prefix) = (domain.client_domain().root_path(), domain.client_domain().prefix());
    let names = |folder: &str| {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten();
        let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
        names.filter(|name| name.starts_with(&prefix)).collect::<BTreeSet<_>>()
    };
    let nodes = names(&format!("{root}/nodes")).into_iter().filter(|name| name.ends_with(".node_monitor")).count();
    (names("/dev/shm"), nodes)
}

#[test]
fn early_deaths_of_a_service_leave_living_clients_their_memory_where_all_are_process_1() {
    if !may_unshare(&CONTAINER) {
        return;
    }
    let domain = TestDomain::new();
    domain.write("no-such-core.toml", "[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n[realtime]\ncore = 1000\n");
    let mut service = serve_in(&domain, &CONTAINER);
    let out = domain.path("increments.csv");
    let record = ["record", "--imu", "imu-a", "--stream", "increment", "-o", out.to_str().unwrap()];
    let recorder = domain.start(domain.isotherm_after(&CONTAINER, "true", &record));
    recorder.wait_for_log("recording imu-a");
    let feed = domain.start(domain.isotherm_after(
        &CONTAINER,
        "true",
        &[
            "feed",
            "--imu",
            "imu-a",
            "--rate",
            "1000",
            "--timeout",
            "60",
            RUN,
            "-o",
            domain.path("fed.csv").to_str().unwrap(),
        ],
    ));
    wait_until("samples", || domain.imu_status()["compensated"].as_u64().unwrap() > 100);
    for _ in 0..4 {
        // It dies within its first second.
        service.kill();
        // A start that fails after it has begun.
        let failed =
            domain.isotherm_after(&CONTAINER, "true", &["serve", "--config", "no-such-core.toml"]).output().unwrap();
        assert!(!failed.status.success());
        service = serve_in(&domain, &CONTAINER);
    }
    let (status, log) = feed.wait();
    assert!(status.success(), "{log}");
    let rows = |name: &str| {
        let text = fs::read_to_string(domain.path(name)).unwrap_or_default();
        text.lines().filter(|line| line.starts_with(|first: char| first.is_ascii_digit())).count()
    };
    wait_until("all increments", || rows("increments.csv") == rows("fed.csv"));
    recorder.kill();
    service.kill();
}

#[test]
fn what_killed_clients_leave_is_removed_where_all_are_process_1() {
    if !may_unshare(&CONTAINER) {
        return;
    }
    let domain = TestDomain::new();
    let service = serve_in(&domain, &CONTAINER);
    let (_, nodes) = objects(&domain);
    for _ in 0..12 {
        let client =
            domain.start(domain.isotherm_after(&CONTAINER, "true", &["record", "--imu", "imu-a", "-o", "r.csv"]));
        client.wait_for_log("recording imu-a");
        client.kill();
        let _ = fs::remove_file(domain.path("r.csv"));
    }
    wait_until("the nodes of the dead to be removed", || objects(&domain).1 == nodes);
    // A living member of another namespace keeps `clean` away, and a dead one does not.
    let refused = domain.isotherm_after(&CONTAINER, "true", &["clean"]).output().unwrap();
    assert!(text(&refused.stderr).contains("is using it"), "{}", text(&refused.stderr));
    let seen = child_of(&service);
    service.kill();
    wait_until("the end of the service", || !fs::exists(format!("/proc/{seen}")).unwrap());
    let cleaned = domain.isotherm_after(&CONTAINER, "true", &["clean"]).output().unwrap();
    assert!(cleaned.status.success(), "{}", text(&cleaned.stderr));
    assert_eq!(objects(&domain), (BTreeSet::new(), 0));
}

/// A client that shares the domain's folder and not the shared memory, as in a container.
#[test]
fn a_client_with_another_shared_memory_is_told_so() {
    if !may_mount() {
        return;
    }
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let run = |arguments: &[&str]| {
        let command = domain.isotherm_after(&["-m"], "mount -t tmpfs tmpfs /dev/shm", arguments);
        let output = domain.finish(command);
        (output.status.code(), text(&output.stderr))
    };
    for command in [&["status"][..], &["feed", "--imu", "imu-a", RUN]] {
        let (code, words) = run(command);
        assert_eq!(code, Some(69), "{command:?}: {words}");
        assert!(words.contains("another /dev/shm") && !words.contains("logind"), "{command:?}: {words}");
    }
    let (code, words) = run(&["serve", "--imu", "imu-a=imu-a.toml"]);
    assert!(code == Some(1) && words.contains("another service is running"), "{words}");
    let (code, words) = run(&["clean"]);
    assert!(code == Some(1) && words.contains("is using it"), "{words}");
    domain.run_ok(&["feed", "--imu", "imu-a", RUN]);
    service.terminate();
    // A service of the container takes the domain over.
    let service = domain.start(domain.isotherm_after(
        &["-m"],
        "mount -t tmpfs tmpfs /dev/shm",
        &["serve", "--imu", "imu-a=imu-a.toml"],
    ));
    service.wait_for_log(" ready ");
    let output = domain.run(&["status"]);
    assert!(output.status.code() == Some(69) && text(&output.stderr).contains("another /dev/shm"));
    service.terminate();
}
