//! Careless and hostile peers: the service continues, serves the other clients exactly, and reports what is wrong.

use iceoryx2::port::subscriber::Subscriber;
use isotherm_client::transport::stream::{
    INCREMENT_SUBSCRIBERS, Ipc, IpcNode, RAW_SUBSCRIBERS, increment_name, raw_name, status_name, wake_name,
};
use isotherm_client::{Acquisition, ConnectError, Flags, Options, RawSample, join};
use isotherm_shared::compensate::answer;
use isotherm_shared::wire::Triad;
use isotherm_tests::{Needs, RUN, TABLE, TestDomain, binary, id, recording, round_trip, skip, table, text, wait_until};
use std::fs::{self, File, Permissions};
use std::os::unix::fs::{FileExt as _, PermissionsExt as _, chown};
use std::os::unix::process::CommandExt as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

/// Starts a service for `imu-a` and `imu-b`.
fn serve_two(domain: &TestDomain) -> isotherm_tests::Process {
    domain.write("imu-a.toml", TABLE);
    domain.write("imu-b.toml", &TABLE.replace("\"imu-a\"", "\"imu-b\""));
    domain.serve(&["--imu", "imu-a=imu-a.toml", "--imu", "imu-b=imu-b.toml"])
}

/// Sends samples and asserts that every increment is exact.
fn assert_served_exactly(acquisition: &mut Acquisition, samples: &[RawSample]) {
    let exact = table(TABLE);
    for sample in samples {
        let increment = round_trip(acquisition, sample);
        let raw = RawSample { session: increment.session, sequence: increment.sequence, ..*sample };
        let expected = answer(Some(&exact), &raw);
        assert_eq!(increment.velocity_increment.map(f64::to_bits), expected.velocity_increment.map(f64::to_bits));
    }
}

fn publisher(node: &IpcNode, imu: &str) -> iceoryx2::port::publisher::Publisher<Ipc, RawSample, ()> {
    let raw = node.service_builder(&raw_name(&id(imu))).publish_subscribe::<RawSample>().open().unwrap();
    let discard = iceoryx2::prelude::BackpressureStrategy::DiscardData;
    raw.publisher_builder().backpressure_strategy(discard).create().unwrap()
}

#[test]
fn a_flood_on_one_imu_does_not_starve_the_other() {
    let domain = TestDomain::new();
    let service = serve_two(&domain);
    let mut acquisition = domain.acquisition("imu-a");
    let finished = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            let node = join(domain.client_domain()).unwrap();
            let flood = publisher(&node, "imu-b");
            let mut sequence = 0_u64;
            for count in 0_u64.. {
                // Jumps of the sequence, repeats, and a rate far above that of any hardware.
                let jump = if count.is_multiple_of(7) { u64::MAX / 3 } else { 1 };
                sequence = sequence.wrapping_add(jump);
                let _ = flood.send_copy(RawSample { session: count / 1000, sequence, ..recording_at(count) });
                if finished.load(Ordering::Relaxed) {
                    break;
                }
            }
        });
        // Until enough samples of the flood have arrived.
        let mut sent = 0;
        loop {
            assert_served_exactly(&mut acquisition, &recording()[..500]);
            sent += 500;
            let status = domain.status();
            assert_eq!(status["imus"][0]["compensated"], sent);
            let flooded = &status["imus"][1];
            if flooded["received"].as_u64().unwrap() > 5000 && flooded["gaps"].as_u64().unwrap() > 0 {
                break;
            }
        }
        finished.store(true, Ordering::Relaxed);
    });
    service.wait_for_log("samples were missing");
    assert_eq!(service.count_in_log("samples were missing"), 1, "a flood does not fill the log");
    service.terminate();
}

fn recording_at(index: u64) -> RawSample {
    let triad = Triad { positive_pulses: [index as u32; 3], ..Triad::default() };
    RawSample { interval_ns: index, accelerometers: triad, gyroscopes: triad, ..RawSample::default() }
}

/// The files and offsets in shared memory at which `needle` is now.
fn find_in_shared_memory(domain: &TestDomain, needle: &[u8]) -> Vec<(File, u64)> {
    let mut found = Vec::new();
    for entry in fs::read_dir("/dev/shm").unwrap().flatten() {
        if !entry.file_name().to_string_lossy().starts_with(&domain.client_domain().prefix()) {
            continue;
        }
        let bytes = fs::read(entry.path()).unwrap_or_default();
        let places = bytes.windows(needle.len()).enumerate().filter(|(_, window)| *window == needle);
        for (offset, _) in places {
            found.push((File::options().write(true).open(entry.path()).unwrap(), offset as u64));
        }
    }
    found
}

/// A process of the same user can write to samples that it has sent already.
#[test]
fn a_sample_that_changes_after_it_was_sent_harms_only_its_own_increment() {
    let domain = TestDomain::new();
    let service = serve_two(&domain);
    let mut neighbour = domain.acquisition("imu-b");
    let mut acquisition = domain.acquisition("imu-a");
    let samples = recording();
    let marker = [0xDEAD_BEEF_u32, 0x0BAD_CAFE, 0xFEED_F00D];
    let accelerometers = Triad { positive_pulses: marker, ..samples[0].accelerometers };
    assert_served_exactly(&mut acquisition, &[RawSample { accelerometers, ..samples[0] }; 80]);
    // The marker is 64 bytes after the start of each sample that has been used.
    let places = find_in_shared_memory(&domain, marker.map(u32::to_ne_bytes).as_flattened());
    assert!(!places.is_empty());
    let (finished, id) = (AtomicBool::new(false), table(TABLE).id());
    thread::scope(|scope| {
        scope.spawn(|| {
            let mut state = 7_u64;
            while !finished.load(Ordering::Relaxed) {
                for (file, offset) in &places {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                    // Overwrite everything after session and sequence, which assign the answer to its sample.
                    let bytes = [state.to_ne_bytes(), (!state).to_ne_bytes()].concat();
                    file.write_all_at(&bytes.repeat(15), offset - 48).unwrap();
                }
            }
        });
        for sample in samples.iter().take(2_000) {
            let increment = round_trip(&mut acquisition, sample);
            // The result is arbitrary, but it names the table in force and has only defined flags.
            assert_eq!(increment.table, id);
            assert_eq!(increment.flags & !(Flags::SAMPLE.0 | Flags::DELIVERY.0), 0, "{:#x}", increment.flags);
        }
        assert_served_exactly(&mut neighbour, &samples[..200]);
        finished.store(true, Ordering::Relaxed);
    });
    assert_served_exactly(&mut acquisition, &samples[..80]);
    assert_eq!(domain.status()["imus"][0]["transport_errors"], 0);
    service.terminate();
}

#[test]
fn truncated_shared_memory_ends_the_service_with_a_message() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    for entry in fs::read_dir("/dev/shm").unwrap().flatten() {
        let name = entry.file_name().into_string().unwrap();
        if name.starts_with(&domain.client_domain().prefix()) && name.ends_with("__0.data") {
            // This is the memory of the status stream. The service writes to it at least once a second.
            File::options().write(true).open(entry.path()).unwrap().set_len(0).unwrap();
        }
    }
    let (status, log) = service.wait();
    assert_eq!(status.code(), Some(74), "{log}");
    assert!(log.contains("SIGBUS: shared memory that is in use has been taken away"), "{log}");
}

fn subscribe(node: &IpcNode, count: usize) -> Vec<Subscriber<Ipc, RawSample, ()>> {
    let raw = node.service_builder(&raw_name(&id("imu-a"))).publish_subscribe::<RawSample>().open().unwrap();
    (0..count).map_while(|_| raw.subscriber_builder().create().ok()).collect()
}

#[test]
fn a_process_that_takes_every_place_is_named_and_connected_clients_continue() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let node = join(domain.client_domain()).unwrap();
    let recorders = subscribe(&node, 100);
    assert_eq!(recorders.len(), RAW_SUBSCRIBERS - 1, "the service has one");
    assert_served_exactly(&mut domain.acquisition("imu-a"), &recording()[..100]);
    let readers: Vec<_> = (0..INCREMENT_SUBSCRIBERS).map(|_| domain.reader("imu-a")).collect();
    let options = Options { timeout: Duration::from_millis(200), ..domain.options() };
    match Acquisition::connect(&id("imu-a"), &options) {
        Err(error @ ConnectError::NoRoom { .. }) => {
            let pid = std::process::id();
            assert!(
                error.to_string().contains(&format!("all 16 reader places are taken, by processes [{pid}]")),
                "{error}"
            );
        }
        other => panic!("{other:?}"),
    }
    drop(readers);
    assert_served_exactly(&mut domain.acquisition("imu-a"), &recording()[..100]);

    // While the service is gone its own place is taken too.
    service.kill();
    let mut more = Vec::new();
    wait_until("the dead service's place", || {
        more.extend(subscribe(&node, 1));
        !more.is_empty() || node.try_cleanup_dead_nodes().cleanups > 100
    });
    let refused = domain.run(&["serve", "--imu", "imu-a=imu-a.toml"]);
    let message = text(&refused.stderr);
    assert_eq!(refused.status.code(), Some(1), "{message}");
    assert!(message.contains("all 8 places are taken, by processes ["), "{message}");
    drop((more, recorders));
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    assert_served_exactly(&mut domain.acquisition("imu-a"), &recording()[..10]);
    service.terminate();
}

#[test]
fn streams_created_by_another_process_are_named() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let node = join(domain.client_domain()).unwrap();
    let refused = |what: &str| {
        let output = domain.run(&["serve", "--imu", "imu-a=imu-a.toml"]);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{message}");
        assert!(
            message.contains(&format!("creating {what}: another process has created it with other settings")),
            "{message}"
        );
    };
    let raw = node.service_builder(&raw_name(&id("imu-a"))).publish_subscribe::<u64>().create().unwrap();
    refused("the raw stream of IMU imu-a");
    drop(raw);
    let increments = node.service_builder(&increment_name(&id("imu-a"))).publish_subscribe::<[u8]>().create().unwrap();
    refused("the increment stream of IMU imu-a");
    drop(increments);
    let wake = node.service_builder(&wake_name(&id("imu-a"))).event().max_notifiers(1).create().unwrap();
    refused("the wake-up event of IMU imu-a");
    drop(wake);
    let status = status_name();
    let status = node.service_builder(&status).publish_subscribe::<u32>().create().unwrap();
    refused("the status stream");
    drop(status);
    let service = domain.serve_recording();
    assert_served_exactly(&mut domain.acquisition("imu-a"), &recording()[..10]);
    service.terminate();
}

#[test]
fn stopped_peers_do_not_disturb_others_and_continue_later() {
    let domain = TestDomain::new();
    let service = serve_two(&domain);
    let feed = domain.spawn(&["feed", "--imu", "imu-b", "--rate", "1000", "--window", "16", RUN, "-o", "fed.csv"]);
    let status = |imu: usize| domain.status()["imus"][imu].clone();
    wait_until("samples", || status(1)["received"].as_u64().unwrap() > 200);
    let reader = domain.reader("imu-a");
    feed.stop();
    let before = status(1)["received"].as_u64().unwrap();
    assert_served_exactly(&mut domain.acquisition("imu-a"), &recording());
    assert!(status(1)["received"].as_u64().unwrap() <= before + 16);
    assert_eq!((status(0)["gaps"].clone(), status(1)["gaps"].clone()), (0.into(), 0.into()));
    feed.resume();
    let (ended, log) = feed.wait();
    assert!(ended.success(), "{log}");
    let replayed = domain.run_ok(&["replay", "--table", "imu-b.toml", RUN]);
    assert!(fs::read_to_string(domain.path("fed.csv")).unwrap() == replayed);
    drop(reader);
    service.terminate();
}

const NOBODY: u32 = 65_534;

/// Runs `isotherm` in this domain as the user nobody; `None` if this process may not change its user.
fn as_nobody(domain: &TestDomain, arguments: &[&str]) -> Option<(Option<i32>, String)> {
    if !rustix::process::geteuid().is_root() {
        skip("only root can be another user", Needs::Machine);
        return None;
    }
    fs::set_permissions(domain.path(""), Permissions::from_mode(0o755)).unwrap();
    let program = domain.path("isotherm");
    if !program.exists() {
        fs::copy(binary("isotherm"), &program).unwrap();
        fs::set_permissions(&program, Permissions::from_mode(0o755)).unwrap();
    }
    let mut command = domain.isotherm(arguments);
    let environment: Vec<_> =
        command.get_envs().map(|(name, value)| (name.to_owned(), value.map(ToOwned::to_owned))).collect();
    command = std::process::Command::new(&program);
    command.args(arguments).uid(NOBODY).gid(NOBODY).current_dir(domain.path(""));
    command.envs(environment.into_iter().filter_map(|(name, value)| Some((name, value?))));
    let output = domain.finish(command);
    Some((output.status.code(), text(&output.stderr)))
}

/// As the packages lay it out: root owns the folder of the domains, and has given this one to the service's user.
#[test]
fn clean_leaves_a_folder_that_only_another_user_may_remove() {
    let domain = TestDomain::new();
    let folder = domain.client_domain().root_path().to_owned();
    let left = format!("{folder}/{}left.event", domain.client_domain().prefix());
    fs::create_dir_all(&folder).unwrap();
    fs::write(&left, "").unwrap();
    for path in [&folder, &left] {
        // Only root may, and only then the test goes on.
        let _ = chown(path, Some(NOBODY), Some(NOBODY));
    }
    for _ in 0..2 {
        let Some((code, message)) = as_nobody(&domain, &["clean"]) else { return };
        assert_eq!(code, Some(0), "{message}");
        assert!(fs::read_dir(&folder).unwrap().next().is_none());
    }
}

#[test]
fn another_user_gets_the_reason_for_its_refusal_and_so_does_root() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    for arguments in
        [&["status"][..], &["feed", "--imu", "imu-a", RUN], &["clean"], &["serve", "--imu", "imu-a=imu-a.toml"]]
    {
        let Some((code, message)) = as_nobody(&domain, arguments) else { return };
        assert_eq!(code, Some(77), "{arguments:?}: {message}");
        assert!(
            message.contains("belongs to another user") && message.contains("run as the service's user"),
            "{message}"
        );
    }
    assert_served_exactly(&mut domain.acquisition("imu-a"), &recording()[..10]);
    service.terminate();
    domain.run_ok(&["clean"]);

    // A folder that everybody may write is refused.
    fs::create_dir(domain.client_domain().root_path()).unwrap();
    fs::set_permissions(domain.client_domain().root_path(), Permissions::from_mode(0o777)).unwrap();
    let output = domain.run(&["serve", "--imu", "imu-a=imu-a.toml"]);
    assert_eq!(output.status.code(), Some(77));
    assert!(text(&output.stderr).contains("everybody may write "), "{}", text(&output.stderr));
    fs::remove_dir(domain.client_domain().root_path()).unwrap();

    // A domain of the user nobody: root could open its files but would receive nothing.
    fs::create_dir(domain.client_domain().root_path()).unwrap();
    chown(domain.client_domain().root_path(), Some(65_534), Some(65_534)).unwrap();
    for arguments in [&["status"][..], &["feed", "--imu", "imu-a", RUN]] {
        let output = domain.run(arguments);
        assert_eq!(output.status.code(), Some(77));
        assert!(text(&output.stderr).contains("run as the service's user"), "{}", text(&output.stderr));
    }
}
