//! A device that sends at another rate than the described one: refused before the first sample, and never after it.

use super::lag::note;
use super::pipeline::{end, read, received, serve_vn100};
use super::{Acquire, Device, ENDLESS, counts, describe, line, recorded, samples};
use isotherm_client::RawSample;
use isotherm_tests::emulator::Emulator;
use isotherm_tests::{TestDomain, metrics_page, text, wait_until};
use std::fs;
use std::net::TcpListener;

/// Half the rate, a tenth and twice of it, with a clock, with a counter that counts time, and with one of frames.
#[test]
fn another_rate_is_refused_before_the_first_sample() {
    for (emulator, ratio, said) in [
        (Emulator::Vn100, 0.5, "timing.interval_s is 0.002500000"),
        (Emulator::Vn100, 2.0, "give the interval that the device is set to"),
        (Emulator::Stim300, 0.5, "give interval_s and counter.step of the rate"),
        (Emulator::Stim300, 0.1, "timing.interval_s is 0.001000000"),
        (Emulator::Kvh1750, 0.5, "give the interval that the device is set to"),
        (Emulator::Mtdata2, 2.0, "timing.interval_s is 0.010000000"),
    ] {
        let domain = TestDomain::new();
        describe(&domain, emulator, &[]);
        let rate = format!("0:{}", emulator.rate() * ratio);
        let device = Device::start(&domain, emulator, &["--frames", ENDLESS, "--change-rate", &rate]);
        let output = domain.run(&["acquire", "source.toml", "--dry-run"]);
        let log = text(&output.stderr);
        assert_eq!(output.status.code(), Some(78), "{emulator:?} {ratio}: {log}");
        assert!(log.contains("the device sends ") && log.contains(said), "{emulator:?} {ratio}: {log}");
        assert_eq!(samples(&text(&output.stdout)), [], "{emulator:?} {ratio}");
        device.0.terminate();
    }
}

/// Over a network anybody may have sent it: the units of systemd try again, and the described device is acquired from.
#[test]
fn another_rate_over_a_network_is_a_failure_for_now() {
    // Free a moment ago; who does not get it says so.
    let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let (named, port) = (address.to_string(), address.port().to_string());
    for (source, words) in [
        (format!("tcp = \"{named}\""), ["--tcp", port.as_str()]),
        (format!("udp = \"{named}\"\npeer = \"127.0.0.1\""), ["--udp", named.as_str()]),
    ] {
        let domain = TestDomain::new();
        let serial = format!("serial = \"{}\"\nbaud = 921600", line(&domain).display());
        describe(&domain, Emulator::Vn100, &[(&serial, &source)]);
        let start = |more: &[&str]| {
            let device = domain.start(
                domain.program("isotherm-emulator", &[&["vn100", "--frames", ENDLESS], &words[..], more].concat()),
            );
            let hex = format!(":{:04X} ", address.port());
            wait_until("the port", || {
                words[0] == "--udp" || fs::read_to_string("/proc/net/tcp").unwrap().contains(&hex)
            });
            device
        };
        let device = start(&["--change-rate", "0:200"]);
        let output = domain.run(&["acquire", "source.toml", "--dry-run"]);
        let log = text(&output.stderr);
        assert!(output.status.code() == Some(75) && log.contains("the device sends "), "{}: {log}", output.status);
        device.terminate();
        let device = start(&[]);
        domain.run_ok(&["acquire", "source.toml", "--dry-run", "--rows", "50"]);
        device.terminate();
        // A mistake that is found without data stays one.
        describe(&domain, Emulator::Vn100, &[(&serial, &source), ("interval_s = 0.0025", "interval_s = 0")]);
        assert_eq!(domain.run(&["acquire", "source.toml", "--dry-run"]).status.code(), Some(78));
    }
    for unit in ["isotherm-acquire@", "isotherm-ros2"] {
        let path = format!("{}/../service/systemd/{unit}.service", env!("CARGO_MANIFEST_DIR"));
        let text = fs::read_to_string(path).unwrap();
        let for_good = text.lines().find_map(|line| line.strip_prefix("RestartPreventExitStatus=")).unwrap();
        assert!(
            text.contains("\nRestart=always\n") && for_good.split(' ').all(|code| code != "75"),
            "{unit}: {for_good}"
        );
    }
}

/// The number of a frame of a VN-100 that began at `first` and went to half its rate at frame `change`.
fn number(raw: &RawSample, change: u64) -> u64 {
    let periods = (raw.timestamp_ns - 1_000_000_000) / 2_500_000;
    if periods < change { periods } else { change + (periods - change) / 2 }
}

/// Increments over the true interval, none of the wrong one, and no flag but for time that may be missing.
#[test]
fn another_rate_in_flight_is_taken_where_the_values_allow_it() {
    const CHANGE: u64 = 800;
    let domain = TestDomain::new();
    let service = serve_vn100(&domain);
    let reader = read(&domain, "read.csv");
    let orders = ["--frames", ENDLESS, "--change-rate", "800:200"];
    let device = Device::start(&domain, Emulator::Vn100, &orders);
    let acquire = Acquire::start(&domain, "acquire", &["--record", "acquired.csv"]);
    acquire.process.wait_for_log("the samples have that interval from now on");
    let before = received(&domain);
    wait_until("samples", || received(&domain) > before + 200);
    let adopted = "isotherm_acquire_adopted_interval_seconds{imu=\"imu-a\"} 0.005\n";
    let (_exporter, address) = domain.export();
    wait_until("the metric", || metrics_page(&address).is_some_and(|page| page.contains(adopted)));
    let flagged = domain.imu_status()["flagged"].clone();
    assert_eq!(flagged["interval-not-nominal"], 0, "{flagged}");
    let tally = acquire.end();
    assert_eq!(counts(&tally, ["adopted", "adopted_interval_ns", "sessions"]), [1, 5_000_000, 1], "{tally}");
    let [invalid, answered_invalid] = counts(&tally, ["other_rate", "service/invalid"]);
    assert_eq!(invalid, answered_invalid, "{tally}");
    let all = recorded(&domain, "acquired.csv");
    for raw in &all {
        let interval = if number(raw, CHANGE) <= CHANGE { 2_500_000 } else { 5_000_000 };
        let is_invalid = raw.accelerometers.head_temperature[0].is_nan();
        assert!(raw.interval_ns == interval || is_invalid, "{raw:?}");
    }
    assert!(all.iter().filter(|raw| raw.interval_ns == 5_000_000).count() > 200, "{tally}");
    super::assert_frames(Emulator::Vn100, &all, |raw| number(raw, CHANGE));
    device.0.terminate();
    end(reader);
    service.terminate();
}

/// Counts of a reading have scale factors for one interval: they are invalid, and the acquisition goes on.
#[test]
fn counts_at_another_rate_are_invalid() {
    const CHANGE: u64 = 400;
    let domain = TestDomain::new();
    describe(&domain, Emulator::Arduino, &[]);
    domain.run_ok(&["acquire", "source.toml", "--nominal", "imu-a.toml"]);
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let orders = ["--frames", ENDLESS, "--change-rate", "400:100"];
    let device = Device::start(&domain, Emulator::Arduino, &orders);
    let acquire = Acquire::start(&domain, "acquire", &["--record", "acquired.csv"]);
    acquire.process.wait_for_log("the samples are invalid");
    let before = received(&domain);
    wait_until("samples", || received(&domain) > before + 100);
    let tally = acquire.end();
    device.0.terminate();
    let [invalid, sent_invalid] = counts(&tally, ["other_rate", "service/invalid"]);
    assert!(invalid > 100 && invalid == sent_invalid, "{tally}");
    let all = recorded(&domain, "acquired.csv");
    let is_invalid = |raw: &RawSample| raw.accelerometers.head_temperature[0].is_nan();
    let valid = all.iter().filter(|raw| !is_invalid(raw)).count() as u64;
    assert_eq!((valid + invalid, all.len() as u64), (all.len() as u64, counts(&tally, ["samples"])[0]));
    // After the change, at most what is seen within 20 frames or 0.1 s.
    assert!(valid <= CHANGE + 21 && all.iter().rev().take(100).all(is_invalid), "{valid} of {}", all.len());
    service.terminate();
}

/// Killed in flight, it waits for a device that is away and takes one at another rate.
#[test]
fn a_restart_in_flight_ends_by_a_signal_alone() {
    let domain = TestDomain::new();
    let service = serve_vn100(&domain);
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", ENDLESS]);
    let record = ["--record", "acquired.csv"];
    let acquire = Acquire::start(&domain, "first", &record);
    wait_until("samples", || received(&domain) > 50);
    wait_until("the note", || note(&domain).exists());
    wait_until("rows", || fs::metadata(domain.path("acquired.csv")).is_ok_and(|file| file.len() > 1000));
    acquire.process.kill();
    device.unplug(&domain);
    let acquire = Acquire::start(&domain, "second", &record);
    acquire.process.wait_for_log("this IMU has sent before, so it is waited for");
    acquire.process.wait_for_log("has rows of before: the recording continues in a numbered file");
    let orders = ["--frames", ENDLESS, "--change-rate", "0:100"];
    let device = Device::start(&domain, Emulator::Vn100, &orders);
    acquire.process.wait_for_log("is back");
    acquire.process.wait_for_log("the samples have that interval from now on");
    let before = received(&domain);
    wait_until("samples", || received(&domain) > before + 50);
    let tally = acquire.end();
    assert_eq!(counts(&tally, ["adopted", "other_rate", "not_recorded"]), [1, 0, 0], "{tally}");
    device.0.terminate();
    service.terminate();
}
