//! The relay: it forwards increments to another domain, where a tunnel sends them to other machines.

use iceoryx2::config::Config;
use iceoryx2::node::NodeBuilder;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::prelude::{FilePath, SemanticString as _};
use isotherm_client::transport::stream::{Ipc, IpcNode, configuration, increment_name};
use isotherm_client::{CompensatedIncrement, Domain, IncrementReader, Options, join};
use isotherm_shared::compensate::answer;
use isotherm_shared::wire::RawSample;
use isotherm_tests::{
    TIMEOUT, TestDomain, WHOLE_TABLE, completed, id, recording, round_trip, same, table, text, wait_until,
    whole_recording,
};
use std::fs;

/// The domain `net`, to which the relay publishes, in the test's folder. Dropping it removes its shared memory.
struct TargetDomain(Domain);

impl TargetDomain {
    fn beside(domain: &TestDomain) -> Self {
        Self(Domain::new("net", domain.path("net").to_str().unwrap()).unwrap())
    }

    fn reader(&self) -> IncrementReader {
        IncrementReader::connect(id("imu-a"), &Options::new(self.0.clone(), TIMEOUT)).unwrap()
    }

    /// A publisher of the stream, as a tunnel has one on each stream that it carries.
    fn publisher(&self) -> (Publisher<Ipc, CompensatedIncrement, ()>, IpcNode) {
        let node = join(&self.0).unwrap();
        let stream = node
            .service_builder(&increment_name(&id("imu-a")))
            .publish_subscribe::<CompensatedIncrement>()
            .open()
            .unwrap();
        (stream.publisher_builder().create().unwrap(), node)
    }

    fn remove_shared_memory(&self) {
        for entry in fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&self.0.prefix()) {
                let _ = fs::remove_file(entry.path());
            }
        }
    }
}

impl Drop for TargetDomain {
    fn drop(&mut self) {
        self.remove_shared_memory();
    }
}

#[test]
fn every_increment_is_forwarded_and_none_comes_back() {
    let domain = TestDomain::new();
    let target = TargetDomain::beside(&domain);
    // The relay starts before the service and continues when it is restarted.
    let relay = domain.spawn(&["relay", "--imu", "imu-a", "--to", "net"]);
    relay.wait_for_log("ready");
    let mut far = target.reader();
    let (tunnel, _node) = target.publisher();

    let whole = WHOLE_TABLE.replace("\"imu-g\"", "\"imu-a\"");
    domain.write("imu-a.toml", &whole);
    let serve = || domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let mut service = serve();
    let mut near = domain.reader("imu-a");
    let mut acquisition = domain.acquisition("imu-a");
    let (samples, exact) = (completed(&whole_recording(200), 240_000_000_000, ""), table(&whole));
    for run in 0..2 {
        relay.wait_for_log_lines("connected", 1);
        for sample in &samples {
            let increment = round_trip(&mut acquisition, sample);
            let raw = RawSample { session: increment.session, sequence: increment.sequence, ..*sample };
            let forwarded = far.receive_timeout(TIMEOUT).unwrap().unwrap();
            assert!(same(&forwarded, &answer(Some(&exact), &raw)), "run {run}");
            assert!(forwarded.angle_increment.iter().all(|angle| angle.is_finite()));
            assert_eq!(
                near.receive_timeout(TIMEOUT).unwrap().map(|increment| increment.sequence),
                Some(increment.sequence)
            );
        }
        // An increment that is published in the other domain does not come back.
        tunnel.send_copy(CompensatedIncrement { session: run, ..CompensatedIncrement::default() }).unwrap();
        assert_eq!(far.receive_timeout(TIMEOUT).unwrap().unwrap().session, run);
        assert_eq!(near.receive().unwrap(), None);
        service.kill();
        service = serve();
    }
    relay.terminate();
    service.terminate();
}

/// Either side may create the stream first, so the limits of the shipped configuration must be those of the relay.
#[test]
fn a_tunnel_with_the_shipped_configuration_may_create_the_stream_first() {
    let domain = TestDomain::new();
    let target = TargetDomain::beside(&domain);
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/network/config/iceoryx2.toml");
    let mut config = Config::from_file(&FilePath::new(shipped.as_bytes()).unwrap()).unwrap();
    config.global = configuration(&target.0).unwrap().global;
    fs::create_dir_all(target.0.root_path()).unwrap();
    let tunnel = NodeBuilder::new().config(&config).create::<Ipc>().unwrap();
    let stream = tunnel.service_builder(&increment_name(&id("imu-a"))).publish_subscribe::<CompensatedIncrement>();
    let _created = stream.create().unwrap();

    let relay = domain.spawn(&["relay", "--imu", "imu-a", "--to", "net"]);
    relay.wait_for_log("ready");
    let mut far = target.reader();
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    relay.wait_for_log("connected");
    let increment = round_trip(&mut acquisition, &recording()[0]);
    assert!(same(&far.receive_timeout(TIMEOUT).unwrap().unwrap(), &increment));
    relay.terminate();
    service.terminate();
}

#[test]
fn a_killed_relay_is_replaced_by_the_next() {
    let domain = TestDomain::new();
    let target = TargetDomain::beside(&domain);
    let service = domain.serve_recording();
    let mut acquisition = domain.acquisition("imu-a");
    let sample = recording()[0];
    let mut far = IncrementReader::new(id("imu-a"), &Options::new(target.0.clone(), TIMEOUT));
    for _ in 0..5 {
        let relay = domain.spawn(&["relay", "--imu", "imu-a", "--to", "net"]);
        wait_until("an increment at the far side", || {
            round_trip(&mut acquisition, &sample);
            far.receive().unwrap().is_some()
        });
        relay.kill();
    }
    service.terminate();
    drop(far);
    domain.run_ok(&["--domain", "net", "clean"]);
    assert!(
        !target.0.root_path().parse::<std::path::PathBuf>().unwrap().exists(),
        "the folder of the domain still exists"
    );
}

#[test]
fn a_relay_whose_shared_memory_was_removed_ends_so_that_it_is_started_anew() {
    let domain = TestDomain::new();
    let target = TargetDomain::beside(&domain);
    let relay = domain.spawn(&["relay", "--imu", "imu-a", "--to", "net"]);
    relay.wait_for_log("ready");
    target.remove_shared_memory();
    let (status, log) = relay.wait();
    assert_eq!(status.code(), Some(74), "{log}");
    assert!(log.contains("was removed under the relay"), "{log}");
    let relay = domain.spawn(&["relay", "--imu", "imu-a", "--to", "net"]);
    relay.wait_for_log("ready");
    drop(target.reader());
    relay.terminate();
}

#[test]
fn invalid_relays_are_refused() {
    let domain = TestDomain::new();
    let refused = |arguments: &[&str], code: i32, words: &str| {
        let output = domain.run(arguments);
        let stderr = text(&output.stderr);
        assert!(
            output.status.code() == Some(code) && stderr.contains(words),
            "{arguments:?}: {}\n{stderr}",
            output.status
        );
    };
    let name = domain.client_domain().name();
    refused(&["relay", "--imu", "imu-a", "--to", name], 64, "cannot go into it");
    refused(&["relay", "--imu", "imu-a", "--imu", "imu-a", "--to", "net"], 64, "given twice");
    refused(&["relay", "--imu", "imu-a", "--to", "No Name"], 64, "not a valid name");
    // A domain with a service does not accept a relay's increments.
    let service = domain.serve_recording();
    let output = domain.isotherm(&["--domain", "other", "relay", "--imu", "imu-a", "--to", name]).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("other settings"), "{}", text(&output.stderr));
    service.terminate();
}
