//! What goes away: the device, the acquisition, the service, a reader.

use super::pipeline::{end, kept, read, received, replayed, rows, serve_vn100};
use super::{Acquire, Device, ENDLESS, assert_frames, counts, describe, recorded};
use isotherm_client::RawSample;
use isotherm_tests::emulator::Emulator;
use isotherm_tests::{TestDomain, wait_until};
use std::collections::BTreeSet;

/// The number of a frame of a VN-100 by its time.
fn of_vn100(raw: &RawSample) -> u64 {
    (raw.timestamp_ns - 1_000_000_000) / 2_500_000
}

/// A device that sends so many frames and is unplugged then; and comes back, as if it had gone on meanwhile.
fn unplug_and_replug(domain: &TestDomain, emulator: Emulator, [frames, missing]: [u64; 2], acquire: &Acquire) {
    acquire.process.wait_for_log("went away");
    let first = (frames + missing).to_string();
    let device = Device::start(domain, emulator, &["--first", &first, "--frames", &frames.to_string()]);
    acquire.process.wait_for_log("is back");
    acquire.process.wait_for_log_lines("went away", 2);
    assert!(device.0.wait().0.success());
}

#[test]
fn a_device_that_was_away_shortly_leaves_a_gap_of_its_length() {
    /// Half a second at 200 Hz. The counter turns within the first frames, and not again for five minutes.
    const MISSING: u64 = 100;
    const FRAMES: u64 = 150;
    let domain = TestDomain::new();
    describe(&domain, Emulator::Arduino, &[("time = { column = \"micros\", unit = \"us\", bits = 32 }\n", "")]);
    let device = Device::start(&domain, Emulator::Arduino, &["--frames", &FRAMES.to_string()]);
    let acquire = Acquire::start(&domain, "acquire", &["--record", "acquired.csv", "--dry-run"]);
    unplug_and_replug(&domain, Emulator::Arduino, [FRAMES, MISSING], &acquire);
    assert!(device.0.wait().0.success());
    let log = acquire.process.log();
    let (printed, tally) = acquire.end_dry();
    let names = ["sessions", "outages", "gaps", "missing", "samples", "ambiguous", "not_recorded"];
    assert_eq!(counts(&tally, names), [1, 2, 1, MISSING, 2 * FRAMES, 0, 0], "{log}");
    assert!(log.contains(&format!("gap: {MISSING} missing before sequence {}", FRAMES + MISSING)), "{log}");
    let samples = recorded(&domain, "acquired.csv");
    assert!(samples == printed);
    let sequences: Vec<_> = samples.iter().map(|raw| raw.sequence).collect();
    assert_eq!(sequences, (0..FRAMES).chain(FRAMES + MISSING..2 * FRAMES + MISSING).collect::<Vec<_>>());
    assert!(samples.iter().all(|raw| raw.session == samples[0].session));
    assert_frames(Emulator::Arduino, &samples, |raw| raw.sequence);
}

#[test]
fn a_device_that_was_away_for_over_a_turn_or_started_again_begins_a_session() {
    // 128 counts of the KVH are 0.13 s, which is shorter than any look for the line; the clock of the VN-100 begins
    // again.
    for (emulator, first) in [(Emulator::Kvh1750, 1000), (Emulator::Vn100, 0)] {
        const FRAMES: u64 = 200;
        let domain = TestDomain::new();
        describe(&domain, emulator, &[]);
        let frames = FRAMES.to_string();
        let device = Device::start(&domain, emulator, &["--frames", &frames]);
        let acquire = Acquire::start(&domain, "acquire", &["--record", "acquired.csv"]);
        acquire.process.wait_for_log("went away");
        assert!(device.0.wait().0.success());
        let device = Device::start(&domain, emulator, &["--first", &first.to_string(), "--frames", &frames]);
        acquire.process.wait_for_log("a new session");
        acquire.process.wait_for_log_lines("went away", 2);
        assert!(device.0.wait().0.success());
        let tally = acquire.end();
        let names = ["sessions", "outages", "gaps", "missing", "samples"];
        assert_eq!(counts(&tally, names), [2, 2, 0, 0, 2 * FRAMES], "{emulator:?}: {tally}");
        // Without a service nothing is sent; what is recorded is all.
        let samples = recorded(&domain, "acquired.csv");
        let sequences: Vec<_> = samples.iter().map(|raw| raw.sequence).collect();
        assert_eq!(sequences, (0..FRAMES).chain(0..FRAMES).collect::<Vec<_>>());
        let (before, after) = samples.split_at(FRAMES as usize);
        assert_ne!(before[0].session, after[0].session, "{emulator:?}: a replay must know the sessions apart");
        assert_frames(emulator, before, |raw| raw.sequence);
        assert_frames(emulator, after, |raw| first + raw.sequence);
    }
}

/// A device that stands still in its first second, and does not count meanwhile, is not one of another rate.
#[test]
fn a_device_that_pauses_goes_on() {
    const FRAMES: u64 = 1600;
    let domain = TestDomain::new();
    describe(&domain, Emulator::Arduino, &[("time = { column = \"micros\", unit = \"us\", bits = 32 }\n", "")]);
    let orders = ["--frames", &FRAMES.to_string(), "--pause", "100:1.5"];
    let device = Device::start(&domain, Emulator::Arduino, &orders);
    let acquire = Acquire::start(&domain, "acquire", &["--dry-run"]);
    acquire.process.wait_for_log("went away");
    assert!(device.0.wait().0.success());
    let (samples, tally) = acquire.end_dry();
    assert_eq!(counts(&tally, ["samples", "missing", "sessions", "outages"]), [FRAMES, 0, 1, 1], "{tally}");
    assert_frames(Emulator::Arduino, &samples, |raw| raw.sequence);
}

#[test]
fn a_device_that_is_killed_is_waited_for() {
    let domain = TestDomain::new();
    let service = serve_vn100(&domain);
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", ENDLESS]);
    let acquire = Acquire::start(&domain, "acquire", &[]);
    for round in 1..=3 {
        let before = received(&domain);
        wait_until("samples", || received(&domain) > before + 50);
        if round < 3 {
            continue;
        }
        device.unplug(&domain);
        acquire.process.wait_for_log("went away");
        break;
    }
    // Its clock begins again.
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", ENDLESS]);
    acquire.process.wait_for_log("is back");
    acquire.process.wait_for_log("a new session");
    let before = received(&domain);
    wait_until("samples", || received(&domain) > before + 50);
    let tally = acquire.end();
    assert_eq!(counts(&tally, ["sessions", "outages", "missing", "service/dropped"]), [2, 1, 0, 0], "{tally}");
    assert_eq!(domain.imu_status()["sessions"], 2);
    device.0.terminate();
    service.terminate();
}

/// Each is killed in turn, and everything flows again.
#[test]
fn kills_of_acquisition_service_and_reader_lose_nothing_silently() {
    let domain = TestDomain::new();
    let service = serve_vn100(&domain);
    let reader = read(&domain, "first.csv");
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", ENDLESS]);
    let flows = |more: u64| {
        let before = received(&domain);
        wait_until(&format!("{more} samples after {before}"), || received(&domain) > before + more);
    };
    let acquire = Acquire::start(&domain, "killed", &[]);
    flows(200);
    acquire.process.kill();
    let acquire = Acquire::start(&domain, "acquire", &["--record", "acquired.csv"]);
    acquire.process.wait_for_log("connected to the service");
    flows(200);
    // The service knows two sessions, or three if an old frame had one of its own.
    let of_both = domain.imu_status();
    assert!(of_both["sessions"].as_u64() >= Some(2), "{of_both}");

    service.kill();
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    flows(200);
    reader.kill();
    flows(50);
    let reader = read(&domain, "second.csv");
    flows(200);
    device.unplug(&domain);
    acquire.process.wait_for_log("went away");
    let tally = acquire.end();
    end(reader);
    assert_eq!(counts(&tally, ["service/invalid", "not_recorded", "repeated"]), [0; 3], "{tally}");
    let [samples, sent, answered, missing] = counts(&tally, ["samples", "service/sent", "service/answered", "missing"]);
    // A service that takes over a second to come again costs what is counted.
    let [dropped] = counts(&tally, ["service/dropped"]);
    assert_eq!((sent + dropped, answered), (samples, sent), "{tally}");
    let status = domain.imu_status();
    assert!(status["sessions"] == 1 && status["missing"].as_u64() <= Some(dropped), "{status}");
    service.terminate();

    // The second session has all frames from its first on. Only that may be an old one, from before: a pseudo-terminal
    // keeps what its last reader had not read.
    let all = recorded(&domain, "acquired.csv");
    assert_frames(Emulator::Vn100, &all, of_vn100);
    let is_next = |pair: &[RawSample]| (pair[0].session, pair[0].sequence + 1) == (pair[1].session, pair[1].sequence);
    assert!(all.windows(2).skip(100).all(is_next));
    let inside = all.windows(2).filter(|pair| pair[0].session == pair[1].session);
    assert_eq!(inside.map(|pair| pair[1].sequence - pair[0].sequence - 1).sum::<u64>(), missing, "{tally}");
    // What is missing within a session the service counts; what is missing between two it does not.
    assert_eq!(of_both["missing"], missing, "{of_both}");
    // Both readers have the increments of the record, and no other gap.
    let exact = replayed(&domain, &all, "acquired.csv");
    let mut of_acquired = 0;
    for file in ["first.increments.csv", "second.increments.csv"] {
        let sessions: BTreeSet<_> = all.iter().map(|raw| raw.session).collect();
        for (key, increment) in kept(&domain, file).iter().filter(|(key, _)| sessions.contains(&key.0)) {
            assert_eq!(exact.get(key), Some(increment), "{key:?}");
            of_acquired += 1;
        }
        let rows = rows(&domain, file);
        // Each once, and in order but for those that were sent again to the new service.
        let keys: BTreeSet<_> = rows.iter().map(|(session, sequence, _)| (*session, *sequence)).collect();
        assert_eq!(keys.len(), rows.len(), "{file}");
        let (keys, next) = (keys.iter(), keys.iter().skip(1));
        let of_gaps: u64 = keys.zip(next).filter(|(a, b)| a.0 == b.0).map(|(a, b)| b.1 - a.1 - 1).sum();
        assert_eq!(of_gaps, if file.starts_with("first") { missing + dropped } else { 0 }, "{file}");
    }
    assert!(of_acquired > 600);
    // What was lost between the sessions is in the times.
    let seen = recorded(&domain, "first.csv");
    assert_frames(Emulator::Vn100, &seen, of_vn100);
    let change = seen.windows(2).find(|pair| pair[0].session != pair[1].session).unwrap();
    let between = (change[1].timestamp_ns - change[0].timestamp_ns) as f64 / change[1].interval_ns as f64 - 1.0;
    println!("{between} periods are missing between the sessions, {missing} in the second");
    assert!(between >= 0.0 && (between - between.round()).abs() < 0.1, "{between}");
    assert_eq!(between.round() as u64, of_vn100(&change[1]) - of_vn100(&change[0]) - 1);
    assert!(between + missing as f64 > 0.0);
}
