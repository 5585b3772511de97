//! The lag of the temperatures over restarts of the acquisition and of the device.

use super::pipeline::{end, received};
use super::{Acquire, Device, ENDLESS, describe, recorded};
use isotherm_client::{Lag, LaggedReading, RawSample};
use isotherm_tests::emulator::Emulator;
use isotherm_tests::{Process, TestDomain, wait_until};
use std::fs;
use std::path::PathBuf;

/// The first frame of a VN-100 that has been on for 101 s.
const LONG_ON: &str = "40000";

/// Describes a VN-100, whose clock begins 1 s before its first frame, and starts a service whose table has a transient
/// term with this time constant \[s\].
fn serve(domain: &TestDomain, seconds: f64) -> Process {
    describe(domain, Emulator::Vn100, &[]);
    let table = domain.run_ok(&["acquire", "source.toml", "--nominal", "/dev/stdout"]);
    let table: String =
        table.lines().filter(|line| !line.starts_with("digest")).map(|line| format!("{line}\n")).collect();
    let table = table.replacen("[[axis]]", &format!("[lag]\ntime_constant_s = {seconds:?}\n[[axis]]"), 1);
    let bias = table.lines().find(|line| line.starts_with("bias = ")).unwrap();
    let with = bias.replace(" }", ", transient = 100.0 }");
    domain.write("imu-a.toml", &table.replacen(bias, &with, 1));
    domain.serve(&["--imu", "imu-a=imu-a.toml"])
}

fn device(domain: &TestDomain, first: &str) -> Device {
    Device::start(domain, Emulator::Vn100, &["--first", first, "--frames", ENDLESS])
}

/// Waits for so many samples more.
fn flows(domain: &TestDomain, more: u64) {
    let before = received(domain);
    wait_until("samples", || received(domain) >= before + more);
}

fn flagged(domain: &TestDomain) -> u64 {
    domain.imu_status()["flagged"]["lag-unknown"].as_u64().unwrap()
}

/// The note for the next acquisition.
pub(super) fn note(domain: &TestDomain) -> PathBuf {
    let client = domain.client_domain();
    PathBuf::from(client.root_path()).join(format!("{}acquired-imu-a.json", client.prefix()))
}

/// Killed again and again, and nothing of its lag is lost: it is that of an acquisition which was never killed.
#[test]
fn a_killed_acquisition_goes_on_with_its_lag() {
    const TAU_S: f64 = 20.0;
    /// The temperature is a staircase of these steps \[degC\], and straight only in the gaps.
    const STEP: f64 = 1.0 / 256.0;
    let domain = TestDomain::new();
    let service = serve(&domain, TAU_S);
    let reader = domain.spawn(&["record", "--imu", "imu-a", "--stream", "raw", "--flush", "0.1", "-o", "raw.csv"]);
    reader.wait_for_log("recording imu-a");
    // It has just been powered.
    let device = device(&domain, "0");
    for round in 0..3 {
        let acquire =
            Acquire::start(&domain, &format!("acquire{round}"), &["--record", &format!("acquired{round}.csv")]);
        acquire.process.wait_for_log("connected to the service");
        flows(&domain, 800);
        match round {
            2 => drop(acquire.end()),
            _ => acquire.process.kill(),
        }
    }
    assert_eq!(flagged(&domain), 0);
    end(reader);
    let all = recorded(&domain, "raw.csv");
    let number = |raw: &RawSample| (raw.timestamp_ns - 1_000_000_000) / 2_500_000;
    let mut reference = Lag::new((TAU_S * 1e9) as u64);
    let mut frames = 0..;
    for raw in &all {
        for frame in frames.by_ref().take_while(|frame| *frame < number(raw)).chain([number(raw)]) {
            let values = Emulator::Vn100.expected(frame);
            let [time, temperature] =
                ["time", "temperature"].map(|name| values.iter().find(|of| of.0 == name).unwrap().1);
            (0..6).for_each(|sensor| reference.read(sensor, temperature, time as u64));
        }
        frames = number(raw) + 1..;
        let LaggedReading { temperature, lagged, .. } = reference.sensors[0].unwrap();
        let own = raw.accelerometers.head_lagged[0];
        assert_eq!(raw.accelerometers.head_temperature[0], temperature);
        assert!((own - lagged).abs() < STEP, "{own}, not {lagged} at {raw:?}");
    }
    // A restart that took it to be soaked would be seen.
    let behind = reference.sensors[0].map(|last| last.temperature - last.lagged).unwrap();
    assert!(behind > 10.0 * STEP, "{behind}");
    // What it records itself replays to the same.
    let own = recorded(&domain, "acquired2.csv");
    let same = all.iter().filter(|raw| raw.session == own[0].session);
    assert!(
        own.len() >= 800
            && own.iter().zip(same).all(|(own, raw)| {
                (own.sequence, own.lag_ns, own.accelerometers, own.gyroscopes)
                    == (raw.sequence, raw.lag_ns, raw.accelerometers, raw.gyroscopes)
            })
    );
    device.0.terminate();
    service.terminate();
}

/// Where nobody knows what the temperatures were, increments say so; where somebody does, they do not.
#[test]
fn an_unknown_lag_is_flagged() {
    const TAU_S: f64 = 0.4;
    /// Three time constants at 400 Hz, and one frame.
    const UNKNOWN: u64 = (3.0 * TAU_S * 400.0) as u64 + 1;
    let domain = TestDomain::new();
    let service = serve(&domain, TAU_S);
    let of_long = device(&domain, LONG_ON);
    let known = |acquire: &Acquire, before: u64| {
        flows(&domain, 2 * UNKNOWN);
        let all = flagged(&domain);
        assert!(acquire.process.log().contains("connected to the service"));
        flows(&domain, 50);
        assert_eq!(flagged(&domain), all, "it is known after three time constants");
        all - before
    };
    // Nobody has acquired it since the machine was started, and it has been on for long.
    let acquire = Acquire::start(&domain, "first", &[]);
    let first = known(&acquire, 0);
    assert!((UNKNOWN / 2..=UNKNOWN).contains(&first), "{first}");
    acquire.process.wait_for_log("what the temperatures were before is not known");
    wait_until("the note", || note(&domain).exists());
    acquire.process.kill();
    let acquire = Acquire::start(&domain, "second", &[]);
    assert_eq!(known(&acquire, first), 0, "it goes on");
    acquire.process.kill();
    let text = fs::read_to_string(note(&domain)).unwrap();
    fs::write(note(&domain), text.replacen("\"boot\":", "\"boot\":1", 1)).unwrap();
    let acquire = Acquire::start(&domain, "third", &[]);
    let third = known(&acquire, first);
    assert!(third > UNKNOWN / 2, "the note is of another start of the machine: {third}");
    // Its clock begins anew, or jumps: the lag goes on by the clock of this machine.
    let mut unplugged = of_long;
    for (count, next) in [(1, "0"), (2, "90000")] {
        unplugged.unplug(&domain);
        acquire.process.wait_for_log_lines("went away", count);
        unplugged = device(&domain, next);
        acquire.process.wait_for_log_lines("is back", count);
        assert_eq!(known(&acquire, first + third), 0, "{next}");
    }
    let tally = acquire.end();
    assert_eq!(super::counts(&tally, ["sessions"]), [3], "{tally}");
    // It was just powered, and nothing is known: it is soaked, as a device that was off for long.
    unplugged.unplug(&domain);
    fs::remove_file(note(&domain)).unwrap();
    let just_powered = device(&domain, "0");
    let acquire = Acquire::start(&domain, "last", &[]);
    assert_eq!(known(&acquire, first + third), 0, "it was just powered");
    assert!(note(&domain).exists());
    acquire.end();
    just_powered.0.terminate();
    service.terminate();
    domain.run_ok(&["clean"]);
    assert!(!note(&domain).exists());
}
