//! What can be seen without a service: which profile a stream is of, metrics, and what is connected.

use super::endings::Terminal;
use super::{Acquire, Device, ENDLESS, counts, describe, line, rate};
use isotherm_tests::emulator::Emulator;
use isotherm_tests::{TestDomain, metrics_page, text, wait_until};
use serde_json::Value;
use std::fs;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

#[test]
fn a_stream_is_known_by_its_frames() {
    let check = |emulator: Emulator| {
        let domain = TestDomain::new();
        let device = Device::start(&domain, emulator, &["--frames", ENDLESS]);
        let link = line(&domain).display().to_string();
        let printed = domain.run_ok(&["acquire", "--probe", &link]);
        // Both profiles of the STIM300 have the same frames; that with increments comes first.
        let name = if emulator == Emulator::Stim300Rate { "stim300" } else { emulator.profile() };
        assert!(printed.starts_with(&format!("{name} at ")), "{emulator:?}: {printed}");
        assert!(printed.ends_with(&format!("isotherm acquire --profile {name} > {name}.toml\n")), "{printed}");
        let baud = if emulator == Emulator::Arduino { "115200" } else { "921600" };
        let json = domain.run_ok(&["acquire", "--probe", &link, "--baud", baud, "--json"]);
        let all: Value = serde_json::from_str(&json).unwrap();
        let best = &all[0];
        assert_eq!((&best["profile"], &best["has_checksum"]), (&name.into(), &true.into()), "{json}");
        assert_eq!(best["baud"].to_string(), baud);
        assert!(best["frames"].as_u64() >= Some(100), "{json}");
        device.0.terminate();
    };
    thread::scope(|scope| {
        for emulator in Emulator::ALL {
            scope.spawn(move || check(emulator));
        }
    });
}

#[test]
fn noise_is_of_no_profile_and_neither_is_silence() {
    let domain = TestDomain::new();
    let terminal = Terminal::new(&domain);
    let ended = AtomicBool::new(false);
    let mut state = 88_172_645_463_325_252_u64;
    let noise: Vec<_> = (0..100_000)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 40) as u8
        })
        .collect();
    // A file of it is read at once.
    fs::write(domain.path("noise"), &noise).unwrap();
    let probe = |device: &str, said: &str| {
        let output = domain.run(&["acquire", "--probe", device, "--baud", "921600"]);
        let log = text(&output.stderr);
        assert_eq!(output.status.code(), Some(65), "{device}: {log}");
        assert!(log.contains(said), "{log}");
        assert!(!text(&output.stdout).contains("--profile"), "{}", text(&output.stdout));
    };
    probe("noise", "no profile decodes the 100000 bytes");
    probe("line", "no byte has come: is the device on");
    thread::scope(|scope| {
        scope.spawn(|| {
            while !ended.load(Ordering::Relaxed) {
                noise.chunks(4096).take_while(|_| !ended.load(Ordering::Relaxed)).for_each(|part| {
                    terminal.write(part);
                });
            }
        });
        probe("line", "no profile decodes the ");
        ended.store(true, Ordering::Relaxed);
    });
}

/// Whether a line is one of Prometheus' text format: a comment, or a name with labels and a finite number.
fn is_metric(line: &str) -> bool {
    let is_name = |name: &str| {
        let is_letter = |byte: u8| byte.is_ascii_alphabetic() || byte == b'_' || byte == b':';
        name.bytes().next().is_some_and(is_letter) && name.bytes().all(|byte| is_letter(byte) || byte.is_ascii_digit())
    };
    if let Some(rest) = line.strip_prefix("# HELP ") {
        return rest.split_once(' ').is_some_and(|(name, help)| is_name(name) && !help.is_empty());
    }
    if let Some(rest) = line.strip_prefix("# TYPE ") {
        return rest.split_once(' ').is_some_and(|(name, kind)| is_name(name) && ["gauge", "counter"].contains(&kind));
    }
    let Some((name, value)) = line.rsplit_once(' ') else { return false };
    let Some((name, labels)) = name.strip_suffix('}').and_then(|name| name.split_once('{')) else { return false };
    let is_label = |label: &str| {
        let quoted = label.split_once('=').map(|(name, value)| (is_name(name), value.trim_matches('"')));
        quoted.is_some_and(|(is_name, value)| is_name && label.ends_with(&format!("\"{value}\"")))
    };
    is_name(name) && labels.split(',').all(is_label) && value.parse().is_ok_and(f64::is_finite)
}

#[test]
fn metrics_say_what_the_tally_says() {
    let domain = TestDomain::new();
    let (rate, changes) = rate(Emulator::Stim300);
    describe(&domain, Emulator::Stim300, changes);
    domain.run_ok(&["acquire", "source.toml", "--nominal", "imu-a.toml"]);
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let (exporter, address) = domain.export();
    let orders = ["--frames", "300", "--rate", &rate.to_string(), "--drop", "7", "--wrong", "9", "--noise", "50@20"];
    let device = Device::start(&domain, Emulator::Stim300, &orders);
    let acquire = Acquire::start(&domain, "acquire", &[]);
    acquire.process.wait_for_log("went away");
    assert!(device.0.wait().0.success());
    let mut page = String::new();
    let value = |page: &str, name: &str| {
        let line = page.lines().find_map(|line| line.strip_prefix(&format!("isotherm_acquire_{name} ")));
        line.map(|value| value.parse::<f64>().unwrap() as u64)
    };
    wait_until("the last figures", || {
        page = metrics_page(&address).unwrap_or_default();
        let shown = |name: &str| value(&page, &format!("{name}{{imu=\"imu-a\"}}"));
        shown("device_present") == Some(0) && shown("answered_total") == Some(298)
    });
    for line in page.lines().filter(|line| line.contains("isotherm_acquire_")) {
        assert!(is_metric(line), "{line}");
    }
    let tally = acquire.end();
    let names = ["frames", "samples", "missing", "gaps", "bytes"];
    let of_metrics = names.map(|name| value(&page, &format!("{name}_total{{imu=\"imu-a\"}}")).unwrap());
    assert_eq!(of_metrics, counts(&tally, names), "{tally}");
    assert_eq!(of_metrics[..4], [298, 298, 2, 2], "{tally}");
    let causes = ["noise", "checksum"];
    let skipped = causes.map(|cause| value(&page, &format!("skipped_bytes_total{{imu=\"imu-a\",cause=\"{cause}\"}}")));
    assert_eq!(skipped.into_iter().flatten().sum::<u64>(), 50 + 42, "{tally}");
    // After an end that was asked for there are none.
    wait_until("no figures", || {
        metrics_page(&address).is_some_and(|page| !page.contains("isotherm_acquire_bytes_total{"))
    });
    exporter.terminate();
    service.terminate();
}

#[test]
fn devices_and_ports_are_listed() {
    let domain = TestDomain::new();
    super::ports::tree(&domain);
    let root = domain.path("root");
    for name in ["ttyUSB0", "ttyACM1", "tty7", "ttyS0", "null"] {
        fs::write(root.join("dev").join(name), "").unwrap();
    }
    fs::create_dir_all(root.join("dev/serial/by-id")).unwrap();
    std::os::unix::fs::symlink("../../ttyUSB0", root.join("dev/serial/by-id/usb-maker_imu-if00")).unwrap();
    let json = domain.run_ok(&["acquire", "--list", "--json", "--sysfs", root.to_str().unwrap()]);
    let all: Value = serde_json::from_str(&json).unwrap();
    let device = &all["iio"][0];
    assert_eq!((&device["name"], &device["index"]), (&"bmi270".into(), &0.into()), "{json}");
    let channels: Vec<_> = device["channels"].as_array().unwrap().iter().map(|channel| &channel["name"]).collect();
    let names = ["accel_x", "accel_y", "accel_z", "anglvel_x", "anglvel_y", "anglvel_z", "temp"];
    assert_eq!(channels, names, "{json}");
    assert_eq!(device["channels"][0]["scale"], 0.000_598, "{json}");
    assert_eq!(device["channels"][6]["scan"], Value::Null, "{json}");
    assert_eq!(device["rates"][0]["now"], "100", "{json}");
    let ports: Vec<_> = all["serial"].as_array().unwrap().iter().map(|port| port.as_str().unwrap()).collect();
    let ends: Vec<_> = ports.iter().map(|port| port.rsplit('/').next().unwrap()).collect();
    assert_eq!(ends, ["usb-maker_imu-if00", "ttyACM1"], "{json}");
    let profiles: Vec<_> = all["profiles"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    for emulator in Emulator::ALL {
        assert!(profiles.contains(&emulator.profile()), "{json}");
        // Each is printed as it is in the repository, and is valid.
        let printed = domain.run_ok(&["acquire", "--profile", emulator.profile()]);
        let file = format!("{}/../examples/acquire/{}.toml", env!("CARGO_MANIFEST_DIR"), emulator.profile());
        assert_eq!(printed, fs::read_to_string(file).unwrap());
        domain.write("source.toml", &printed);
        domain.run_ok(&["check", "source.toml"]);
    }
    // For people: the same, and where there is nothing, that.
    let told = domain.run_ok(&["acquire", "--list", "--sysfs", root.to_str().unwrap()]);
    assert!(told.starts_with("iio:device0 bmi270\n") && told.contains("usb-maker_imu-if00\n"), "{told}");
    let told = domain.run_ok(&["acquire", "--list", "--sysfs", "nothing"]);
    assert!(told.starts_with("no IIO device and no serial port\n"), "{told}");
}
