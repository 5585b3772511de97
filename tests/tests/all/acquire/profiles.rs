//! Each profile, with its emulated device at its own rate: rows are what the frames say.

use super::pipeline::received;
use super::{
    Acquire, Device, ENDLESS, assert_frames, assert_frames_with, counts, describe, dry_run, rate, recorded, resolution,
};
use isotherm_tests::emulator::Emulator;
use isotherm_tests::{TestDomain, text, wait_until};
use std::thread;

#[test]
fn rows_of_each_profile_are_what_its_device_sends() {
    // At the same time, since they wait for their devices.
    let check = |emulator: Emulator| {
        let domain = TestDomain::new();
        let (rate, changes) = rate(emulator);
        describe(&domain, emulator, changes);
        let device = Device::start(&domain, emulator, &["--frames", ENDLESS, "--rate", &rate.to_string()]);
        let rows = 300;
        let (samples, tally) = dry_run(&domain, &["--rows", &rows.to_string()]);
        device.0.terminate();
        // Without a gap; counters turn.
        let sequences: Vec<_> = samples.iter().map(|raw| raw.sequence).collect();
        assert_eq!(sequences, (0..rows).collect::<Vec<_>>(), "{emulator:?}");
        assert_frames(emulator, &samples, |raw| raw.sequence);
        assert!(samples.windows(2).all(|pair| pair[0].timestamp_ns < pair[1].timestamp_ns));
        assert!(samples.iter().all(|raw| raw.interval_ns == (1e9 / rate) as u64));
        let names = ["missing", "gaps", "repeated", "unhealthy", "incomplete", "skipped/damaged"];
        assert_eq!(counts(&tally, names), [0; 6], "{emulator:?}: {tally}");
        // The device's own clock, where it has one.
        if matches!(emulator, Emulator::Vn100 | Emulator::Mtdata2 | Emulator::Arduino) {
            let passed: Vec<_> = samples.windows(2).map(|pair| pair[1].timestamp_ns - pair[0].timestamp_ns).collect();
            assert_eq!(passed, vec![samples[0].interval_ns; passed.len()], "{emulator:?}");
        }
    };
    thread::scope(|scope| {
        for emulator in Emulator::ALL {
            scope.spawn(move || check(emulator));
        }
    });
}

#[test]
fn signs_resolutions_and_another_imu_are_those_that_are_told() {
    let domain = TestDomain::new();
    let changes = [
        ("interval_s = 0.001", "interval_s = 0.005"),
        ("resolution = 1.9073486328125e-6", "resolution = 3e-6\nsign = [-1, 1, -1]"),
        ("resolution = 6.103515625e-5", "resolution = 1e-4\nsign = [1, -1, -1]"),
    ];
    describe(&domain, Emulator::Stim300Rate, &changes);
    // The device's path on the command line comes before that of the file.
    let line = super::line(&domain).display().to_string();
    let text = std::fs::read_to_string(domain.path("source.toml")).unwrap();
    domain.write("source.toml", &text.replace(&line, "/dev/not-there"));
    let device = Device::start(&domain, Emulator::Stim300Rate, &["--frames", ENDLESS, "--rate", "200"]);
    let (samples, tally) = dry_run(&domain, &["--rows", "200", "--device", &line, "--imu", "imu-z"]);
    device.0.terminate();
    assert_eq!((samples.len(), &tally["imu"]), (200, &"imu-z".into()));
    let sign = [-1.0, 1.0, -1.0, 1.0, -1.0, -1.0];
    assert_frames_with(Emulator::Stim300Rate, &samples, |raw| raw.sequence, [3e-6, 1e-4], sign);
}

/// Readings become pulses of the table, increments stay as they are, and counts of another rate do not join.
#[test]
fn the_table_of_each_profile_serves_half_and_twice_the_rate() {
    let check = |emulator: Emulator, factor: f64| {
        let domain = TestDomain::new();
        let (own, changes) = rate(emulator);
        describe(&domain, emulator, changes);
        domain.run_ok(&["acquire", "source.toml", "--nominal", "imu-a.toml"]);
        let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
        let rate = own * factor;
        let described = domain.path("source.toml");
        let text_of_rate = std::fs::read_to_string(&described)
            .unwrap()
            .replace(&format!("interval_s = {}", 1.0 / own), &format!("interval_s = {}", 1.0 / rate));
        domain.write("source.toml", &text_of_rate);
        // The clock of a device goes on at its own rate.
        let has_clock = matches!(emulator, Emulator::Vn100 | Emulator::Mtdata2 | Emulator::Arduino);
        let (option, rate_word) = match has_clock {
            true => ("--change-rate", format!("0:{rate}")),
            false => ("--rate", rate.to_string()),
        };
        let device = Device::start(&domain, emulator, &["--frames", ENDLESS, option, &rate_word]);
        if emulator == Emulator::Arduino {
            let output = domain.run(&["acquire", "source.toml"]);
            let log = text(&output.stderr);
            assert_eq!(output.status.code(), Some(78), "{emulator:?} {factor}: {log}");
            assert!(log.contains("the counts are of an interval of"), "{log}");
        } else {
            let acquire = Acquire::start(&domain, "acquire", &["--record", "acquired.csv"]);
            wait_until("samples", || received(&domain) > 200);
            let flagged = domain.imu_status()["flagged"].clone();
            let tally = acquire.end();
            assert_eq!(counts(&tally, ["service/invalid"]), [0], "{emulator:?} {factor}: {tally} {flagged}");
            let samples = recorded(&domain, "acquired.csv");
            assert!(samples.iter().all(|raw| raw.interval_ns == (1e9 / rate) as u64), "{emulator:?} {factor}");
            let of_readings = match emulator {
                Emulator::Stim300Rate | Emulator::Mtdata2 => [factor; 2],
                // The accelerometers are readings, the gyroscopes increments.
                Emulator::Kvh1750 => [factor, 1.0],
                Emulator::Stim300 | Emulator::Vn100 | Emulator::Arduino => [1.0; 2],
            };
            let [a, g] = resolution(emulator);
            let pulse = [a * of_readings[0], g * of_readings[1]];
            assert_frames_with(emulator, &samples, |raw| raw.sequence, pulse, [1.0; 6]);
        }
        device.0.terminate();
        service.terminate();
    };
    for factor in [0.5, 2.0] {
        thread::scope(|scope| {
            for emulator in Emulator::ALL {
                scope.spawn(move || check(emulator, factor));
            }
        });
    }
}
