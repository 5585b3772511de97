//! Start-up, shutdown, signals and kills.

use isotherm_client::transport::stream::CREATION_TIMEOUT;
use isotherm_client::{Acquisition, ConnectError, Options};
use isotherm_shared::compensate::answer;
use isotherm_tests::{Process, RUN, TABLE, TIMEOUT, TestDomain, id, recording, round_trip, table, text, wait_until};
use rustix::process::Signal;
use std::fs::{self, File, Permissions};
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::process::ExitStatusExt as _;
use std::thread;
use std::time::{Duration, SystemTime};

#[test]
fn a_second_service_is_refused_and_the_first_continues() {
    let domain = TestDomain::new();
    let first = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    let second = domain.run(&["serve", "--imu", "imu-a=imu-a.toml"]);
    let message = text(&second.stderr);
    assert_eq!(second.status.code(), Some(1), "{message}");
    assert!(
        message.contains(&format!(
            "another service is running in domain {:?}, pid {}",
            domain.client_domain().name(),
            first.pid()
        )),
        "{message}"
    );
    let other_imu = domain.run(&["serve", "--imu", "imu-b=imu-a.toml"]);
    assert_ne!(other_imu.status.code(), Some(0));
    round_trip(&mut acquisition, &recording()[0]);
    first.terminate();
}

#[test]
fn of_two_services_started_at_once_one_serves() {
    for _ in 0..10 {
        let domain = TestDomain::new();
        domain.write("imu-a.toml", TABLE);
        let both = [(); 2].map(|()| domain.spawn(&["serve", "--imu", "imu-a=imu-a.toml"]));
        wait_until("one ready, one refused", || {
            let count = |text: &str| both.iter().filter(|process| process.count_in_log(text) > 0).count();
            count("ready") == 1 && count("another service is running") == 1
        });
        round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
    }
}

#[test]
fn on_sigterm_and_sigint_the_service_drains_and_exits_with_0() {
    for signal in [Signal::TERM, Signal::INT] {
        let domain = TestDomain::new();
        let service = domain.serve_recording();
        let mut acquisition = domain.acquisition("imu-a");
        service.stop();
        for _ in 0..50 {
            let loan = acquisition.loan().unwrap();
            acquisition.send(loan).unwrap();
        }
        service.signal(signal);
        service.resume();
        let (status, log) = service.wait();
        assert!(status.success(), "{status}\n{log}");
        assert!(log.contains("received=50 compensated=50"), "{log}");
        for _ in 0..50 {
            assert!(acquisition.receive().unwrap().is_some(), "a sample that had arrived was not answered");
        }
    }
}

#[test]
fn a_service_killed_during_a_feed_loses_nothing() {
    let domain = TestDomain::new();
    let mut service = domain.serve_recording();
    let feed = domain.spawn(&["feed", "--imu", "imu-a", "--rate", "500", "--window", "32", RUN, "-o", "fed.csv"]);
    for received in [500, 300, 300] {
        wait_until("some samples", || domain.imu_status()["received"].as_u64().unwrap() > received);
        service.kill();
        service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    }
    let (status, log) = feed.wait();
    assert!(status.success(), "{log}");
    let replayed = domain.run_ok(&["replay", "--table", "imu-a.toml", RUN]);
    assert!(fs::read_to_string(domain.path("fed.csv")).unwrap() == replayed, "each once, in order");
    service.terminate();
}

#[test]
fn a_feed_without_a_service_gives_up_in_time() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let feed = domain.spawn(&["feed", "--imu", "imu-a", "--rate", "500", "--timeout", "0.5", RUN, "-o", "fed.csv"]);
    wait_until("some samples", || domain.imu_status()["received"].as_u64().unwrap() > 100);
    service.kill();
    let (status, log) = feed.wait();
    assert_eq!(status.code(), Some(69), "{log}");
    assert!(log.contains("no answer from the service for 0.5 s"), "{log}");
    assert!(!domain.path("fed.csv").exists());
}

#[test]
fn a_killed_acquisition_is_replaced_at_once_and_a_living_one_never() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let options = Options { timeout: Duration::from_millis(300), ..domain.options() };
    for number in 0..5 {
        let fed = format!("fed-{number}.csv");
        let feed = domain.spawn(&["feed", "--imu", "imu-a", "--rate", "500", RUN, "-o", &fed]);
        wait_until("the feed", || domain.imu_status()["acquisition_connected"] == true);
        match Acquisition::connect(&id("imu-a"), &options) {
            Err(ConnectError::Occupied { pid, .. }) => assert_eq!(pid, Some(feed.pid().cast_signed())),
            other => panic!("{other:?}"),
        }
        feed.kill();
        let mut next = domain.acquisition("imu-a");
        let sample = recording()[3];
        assert_eq!(
            round_trip(&mut next, &sample).velocity_increment,
            answer(Some(&table(TABLE)), &sample).velocity_increment
        );
    }
    wait_until("nobody", || domain.imu_status()["acquisition_connected"] == false);
    service.terminate();
}

#[test]
fn an_imu_that_is_not_served_is_named() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let output = domain.run(&["feed", "--imu", "imu-z", RUN]);
    assert_eq!(output.status.code(), Some(69));
    assert!(text(&output.stderr).contains("does not serve IMU imu-z"), "{}", text(&output.stderr));
    service.terminate();
}

/// A process that is killed while it creates an object leaves it half created. Three ages are tested: old enough to be
/// recognised, brand-new, and a time in the future, as after the clock has been set back.
#[test]
fn half_created_leftovers_do_not_prevent_a_start() {
    let now = SystemTime::now();
    for modified in [now - Duration::from_secs(60), now, now + Duration::from_secs(3_600)] {
        let domain = TestDomain::new();
        domain.serve_recording().kill();
        let half_create = |path: &std::path::Path, mode: u32| {
            let file = File::options().write(true).create(true).truncate(mode == 0o200).open(path).unwrap();
            file.set_modified(modified).unwrap();
            fs::set_permissions(path, Permissions::from_mode(mode)).unwrap();
        };
        let services = domain.client_domain().root_path().to_owned() + "/services";
        for entry in fs::read_dir(services).unwrap() {
            let path = entry.unwrap().path();
            fs::set_permissions(&path, Permissions::from_mode(0o600)).unwrap();
            half_create(&path, 0o600);
        }
        half_create(format!("/dev/shm/{}half", domain.client_domain().prefix()).as_ref(), 0o200);
        let folder = fs::read_dir(domain.client_domain().root_path()).unwrap().map(|entry| entry.unwrap().path());
        let counters: Vec<_> =
            folder.filter(|path| path.extension().is_some_and(|ending| ending == "global_mgmt")).collect();
        assert_eq!(counters.len(), 1);
        half_create(&counters[0], 0o200);
        let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
        round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
        service.terminate();
    }
    assert!(CREATION_TIMEOUT < TIMEOUT / 4);
}

#[test]
fn after_a_kill_at_any_moment_of_its_start_the_next_service_starts() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    for attempt in 0..40 {
        let service = domain.spawn(&["serve", "--imu", "imu-a=imu-a.toml"]);
        thread::sleep(Duration::from_micros(attempt * 500));
        service.kill();
    }
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
    service.terminate();
}

#[test]
fn a_crash_has_a_last_line() {
    for (signal, words) in
        [(Signal::SEGV, "SIGSEGV: an access to memory that is not there"), (Signal::ABORT, "SIGABRT: ended")]
    {
        let domain = TestDomain::new();
        let service = domain.serve_recording();
        service.signal(signal);
        let (status, log) = service.wait();
        assert_eq!(status.signal(), Some(signal.as_raw()), "{log}");
        assert!(log.lines().last().unwrap().contains(words), "{log}");
    }
}

/// Memory that was damaged lets every service crash that finds it. The processes that use it must join again then.
#[test]
fn after_crashes_in_a_row_the_domain_is_cleared_beside_living_processes_but_never_after_kills() {
    const CLEARED: &str = "has died within a second of its start";
    let domain = TestDomain::new();
    let mut service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    round_trip(&mut acquisition, &recording()[0]);
    let again = |service: Process, signal| {
        service.signal(signal);
        service.wait();
        domain.serve(&["--imu", "imu-a=imu-a.toml"])
    };
    for _ in 0..4 {
        service = again(service, Signal::KILL);
        assert_eq!(service.count_in_log(CLEARED), 0, "{}", service.log());
    }
    round_trip(&mut acquisition, &recording()[1]);
    // Each of them must crash within a second of its start, and the machine may be slow.
    let mut crashes = 0;
    while service.count_in_log(CLEARED) == 0 {
        assert!(crashes < 20, "{}", service.log());
        service = again(service, Signal::SEGV);
        crashes += 1;
    }
    assert!(crashes >= 2);
    round_trip(&mut acquisition, &recording()[2]);
    service.terminate();
}

#[test]
fn clean_removes_what_is_left_but_not_under_a_running_service() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let refused = domain.run(&["clean"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(text(&refused.stderr).contains(&format!("pid {} is using it", service.pid())), "{}", text(&refused.stderr));
    service.kill();
    let left = || {
        let entries = fs::read_dir("/dev/shm").unwrap().map(|entry| entry.unwrap().file_name());
        entries.filter(|name| name.to_string_lossy().starts_with(&domain.client_domain().prefix())).count()
    };
    assert!(left() > 0 && fs::exists(domain.client_domain().root_path()).unwrap());
    domain.run_ok(&["clean"]);
    assert!(left() == 0 && !fs::exists(domain.client_domain().root_path()).unwrap());
    assert_eq!(domain.run(&["status"]).status.code(), Some(69));
}

/// A process that is killed while it writes a note leaves half of it under another name.
#[test]
fn notes_that_were_left_half_written_are_removed() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let (root, prefix) = (domain.client_domain().root_path(), domain.client_domain().prefix());
    let staged = |word: &str| std::path::PathBuf::from(format!("{root}/{prefix}tally-imu-a.json.{word}.staged"));
    let (old, young) = (staged("0123456789abcdef"), staged("fedcba9876543210"));
    fs::write(&young, "{").unwrap();
    let file = File::create(&old).unwrap();
    file.set_modified(SystemTime::now() - Duration::from_secs(3600)).unwrap();
    wait_until("the removal of the old one", || !old.exists());
    assert!(young.exists(), "it may still be written");
    service.terminate();
    let names = fs::read_dir(root).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    assert_eq!(names.filter(|name| name.ends_with(".staged")).count(), 1, "notes leave nothing else");
}

#[test]
fn logs_are_json_on_request_and_silent_about_samples() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml", "--log-format", "json"]);
    domain.run_ok(&["feed", "--imu", "imu-a", RUN]);
    service.signal(Signal::TERM);
    let (_, log) = service.wait();
    let lines: Vec<serde_json::Value> = log.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!((3..10).contains(&lines.len()), "{log}");
    assert_eq!(lines[0]["fields"]["imu"], "imu-a");
}

#[test]
fn a_log_that_cannot_be_written_does_not_stop_the_service() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let full = File::options().write(true).open("/dev/full").unwrap();
    let mut service = domain.isotherm(&["serve", "--imu", "imu-a=imu-a.toml"]).stderr(full).spawn().unwrap();
    let mut acquisition = domain.acquisition("imu-a");
    domain.replace("imu-a.toml", &isotherm_tests::variant(1));
    let next = table(&isotherm_tests::variant(1)).id();
    wait_until("the reload, which is logged", || round_trip(&mut acquisition, &recording()[0]).table == next);
    isotherm_tests::kill(service.id(), Signal::TERM);
    assert!(service.wait().unwrap().success());
}

#[test]
fn clean_touches_no_other_domain_and_nothing_that_is_not_ours() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let name = domain.client_domain().name();
    let (shorter, _) = name.split_at(name.len() - 1);
    for other in [shorter.to_owned(), format!("{name}x")] {
        domain.run_ok(&["--domain", &other, "clean"]);
    }
    // A domain of the same name in another folder, which has a user's data in it.
    let elsewhere = domain.path("elsewhere");
    fs::create_dir_all(elsewhere.join(name).join("precious")).unwrap();
    let cleaned = domain.isotherm(&["clean"]).env("ISOTHERM_ROOT", &elsewhere).output().unwrap();
    assert!(cleaned.status.success(), "{}", text(&cleaned.stderr));
    assert!(elsewhere.join(name).join("precious").exists());
    round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
    // Without the folder the transport cannot list the processes, but the service still has its memory mapped.
    service.stop();
    fs::remove_dir_all(domain.client_domain().root_path()).unwrap();
    let refused = domain.run(&["clean"]);
    assert_eq!(refused.status.code(), Some(1), "{}", text(&refused.stderr));
    service.resume();
    service.wait_for_log("was removed under the running service");
    service.wait_for_log_lines(" ready ", 2);
    service.terminate();
}

#[test]
fn a_slow_feed_gives_up_in_time_too() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let feed = domain.spawn(&["feed", "--imu", "imu-a", "--rate", "5", "--timeout", "1", RUN, "-o", "fed.csv"]);
    wait_until("a sample", || domain.imu_status()["received"].as_u64().unwrap() > 0);
    service.kill();
    let (status, log) = feed.wait();
    assert_eq!(status.code(), Some(69), "{log}");
    assert!(log.contains(" samples unanswered"), "{log}");
}

/// Resources of the service: descriptors, objects in shared memory, files of its domain, resident memory [kB].
fn resource_use(domain: &TestDomain, pid: u32) -> [usize; 4] {
    let count = |folder: &str| fs::read_dir(folder).map_or(0, Iterator::count);
    let prefix = domain.client_domain().prefix();
    let objects = fs::read_dir("/dev/shm").unwrap().flatten();
    let objects = objects.filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix)).count();
    let root = domain.client_domain().root_path();
    let files = ["", "/nodes", "/services"].iter().map(|folder| count(&format!("{root}{folder}"))).sum();
    let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:")?.trim().strip_suffix(" kB")).unwrap();
    [count(&format!("/proc/{pid}/fd")), objects, files, resident.trim().parse().unwrap()]
}

#[test]
fn a_service_that_is_stopped_while_it_starts_leaves_nothing() {
    let domain = TestDomain::new();
    let imus: Vec<_> = (0..32).map(|number| format!("imu-{number}")).collect();
    let arguments = imus.iter().flat_map(|imu| {
        domain.write(&format!("{imu}.toml"), &TABLE.replace("\"imu-a\"", &format!("\"{imu}\"")));
        ["--imu".to_owned(), format!("{imu}={imu}.toml")]
    });
    let arguments: Vec<_> = ["serve".to_owned()].into_iter().chain(arguments).collect();
    let arguments: Vec<_> = arguments.iter().map(String::as_str).collect();
    let objects = || {
        let prefix = domain.client_domain().prefix();
        let names = fs::read_dir("/dev/shm").unwrap().flatten();
        names.filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix)).count()
    };
    // On a loaded machine it may have started before this thread sees it.
    wait_until("a stop while it started", || {
        let service = domain.spawn(&arguments);
        wait_until("the first streams", || objects() > 10);
        service.signal(Signal::TERM);
        let (status, log) = service.wait();
        assert!(status.success(), "{log}");
        assert_eq!(objects(), 0, "{log}");
        log.contains("stopped while starting")
    });
}

#[test]
fn clients_that_come_and_go_or_are_killed_leave_nothing_with_the_service() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let sample = recording()[0];
    let come_and_go = |count: usize| {
        for number in 0..count {
            let mut reader = domain.reader("imu-a");
            let mut acquisition = domain.acquisition("imu-a");
            round_trip(&mut acquisition, &sample);
            assert!(reader.receive().unwrap().is_some());
            if number % 10 == 0 {
                drop(acquisition);
                let feed = domain.spawn(&["feed", "--imu", "imu-a", "--rate", "500", RUN, "-o", "/dev/null"]);
                wait_until("the feed", || reader.receive().unwrap().is_some());
                feed.kill();
            }
        }
        // The service removes dead peers. With the next answer it unmaps their memory.
        wait_until("nobody", || domain.imu_status()["acquisition_connected"] == false);
        round_trip(&mut domain.acquisition("imu-a"), &sample);
        wait_until("nobody", || domain.imu_status()["acquisition_connected"] == false);
        resource_use(&domain, service.pid())
    };
    let before = come_and_go(40);
    let after = come_and_go(160);
    // The service unmaps what it had of the last client at the next answer or rehearsal, which may not have come yet.
    assert!(after[0] < before[0] + 8 && after[1] < before[1] + 4 && after[2] <= before[2], "{before:?} -> {after:?}");
    assert!(after[3] < before[3] + 1024, "resident memory [kB]: {before:?} -> {after:?}");
    service.terminate();
}
