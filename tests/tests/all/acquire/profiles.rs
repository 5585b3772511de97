//! Each profile, with its emulated device at its own rate: rows are what the frames say.

use super::{Device, ENDLESS, assert_frames, assert_frames_with, counts, describe, dry_run, rate};
use isotherm_tests::TestDomain;
use isotherm_tests::emulator::Emulator;
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
