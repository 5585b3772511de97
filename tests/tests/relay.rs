//! Increments handed on into another domain, where a tunnel to other machines finds them.
#![allow(clippy::unwrap_used, reason = "in a test the panic is the report")]

use iceoryx2::port::publisher::Publisher;
use isotherm_client::{CompensatedIncrement, Domain, IncrementReader, Options, join};
use isotherm_shared::compensate::answer;
use isotherm_shared::stream::{Ipc, IpcNode};
use isotherm_shared::wire::RawSample;
use isotherm_tests::{PATIENCE, TABLE, World, id, recording, round_trip, same, table, text, wait_until};
use std::fs;

/// The domain `net` beside a world's own, in the same folder. Dropping it removes its shared memory.
struct Net(Domain);

impl Net {
    fn beside(world: &World) -> Self {
        Self(Domain::new("net", world.path("net").to_str().unwrap()).unwrap())
    }

    fn reader(&self) -> IncrementReader {
        IncrementReader::connect(id("imu-a"), &Options { domain: self.0.clone(), timeout: PATIENCE }).unwrap()
    }

    /// What a tunnel has on each stream that it carries: a publisher too.
    fn publisher(&self) -> (Publisher<Ipc, CompensatedIncrement, ()>, IpcNode) {
        let node = join(&self.0).unwrap();
        let stream =
            node.service_builder(&id("imu-a").increment()).publish_subscribe::<CompensatedIncrement>().open().unwrap();
        (stream.publisher_builder().create().unwrap(), node)
    }
}

impl Drop for Net {
    fn drop(&mut self) {
        for entry in fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&self.0.prefix()) {
                let _ = fs::remove_file(entry.path());
            }
        }
    }
}

#[test]
fn every_increment_is_handed_on_and_none_comes_back() {
    let world = World::new();
    let net = Net::beside(&world);
    // Before the service, and through its restart.
    let relay = world.spawn(&["relay", "--imu", "imu-a", "--to", "net"]);
    relay.wait_for_log("ready");
    let mut far = net.reader();
    let (tunnel, _node) = net.publisher();

    let mut service = world.serve_recording();
    let mut near = world.reader("imu-a");
    let mut acquisition = world.acquisition("imu-a");
    let (samples, exact) = (recording(), table(TABLE));
    for run in 0..2 {
        relay.wait_for_log_lines("connected", 1);
        for sample in &samples[..200] {
            let increment = round_trip(&mut acquisition, sample);
            let raw = RawSample { session: increment.session, sequence: increment.sequence, ..*sample };
            let handed_on = far.receive_timeout(PATIENCE).unwrap().unwrap();
            assert!(same(&handed_on, &answer(Some(&exact), &raw)), "run {run}");
            assert_eq!(near.receive_timeout(PATIENCE).unwrap().map(|seen| seen.sequence), Some(increment.sequence));
        }
        // Whatever is published over there is seen there alone.
        tunnel.send_copy(CompensatedIncrement { session: run, ..CompensatedIncrement::default() }).unwrap();
        assert_eq!(far.receive_timeout(PATIENCE).unwrap().unwrap().session, run);
        assert_eq!(near.receive().unwrap(), None);
        service.kill();
        service = world.serve_recording();
    }
    relay.terminate();
    service.terminate();
}

#[test]
fn a_killed_relay_gives_way_to_the_next() {
    let world = World::new();
    let net = Net::beside(&world);
    let service = world.serve_recording();
    let mut acquisition = world.acquisition("imu-a");
    let sample = recording()[0];
    let mut far = IncrementReader::new(id("imu-a"), &Options { domain: net.0.clone(), timeout: PATIENCE });
    for _ in 0..5 {
        let relay = world.spawn(&["relay", "--imu", "imu-a", "--to", "net"]);
        wait_until("an increment at the far side", || {
            round_trip(&mut acquisition, &sample);
            far.receive().unwrap().is_some()
        });
        relay.kill();
    }
    service.terminate();
    drop(far);
    world.run_well(&["--domain", "net", "clean"]);
    assert!(!net.0.root_path().parse::<std::path::PathBuf>().unwrap().exists(), "nothing is left of it");
}

#[test]
fn what_cannot_be_a_relay_is_refused() {
    let world = World::new();
    let refused = |arguments: &[&str], code: i32, words: &str| {
        let output = world.run(arguments);
        let said = text(&output.stderr);
        assert!(output.status.code() == Some(code) && said.contains(words), "{arguments:?}: {}\n{said}", output.status);
    };
    let name = world.domain().name();
    refused(&["relay", "--imu", "imu-a", "--to", name], 64, "cannot go into it");
    refused(&["relay", "--imu", "imu-a", "--imu", "imu-a", "--to", "net"], 64, "given twice");
    refused(&["relay", "--imu", "imu-a", "--to", "No Name"], 64, "no valid name");
    // A domain with a service of its own has no place for others' increments.
    let service = world.serve_recording();
    let output = world.isotherm(&["--domain", "other", "relay", "--imu", "imu-a", "--to", name]).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("other settings"), "{}", text(&output.stderr));
    service.terminate();
}
