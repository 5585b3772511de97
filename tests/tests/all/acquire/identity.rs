//! Who the device is, and how it is set up: emulators that answer, other units at the port, and silence.

use super::pipeline::{received, serve_vn100};
use super::{Acquire, Device, ENDLESS, assert_frames, counts, describe, line, profile, recorded};
use isotherm_tests::emulator::Emulator;
use isotherm_tests::{TestDomain, metrics_page, text, wait_until};
use std::fs;
use std::net::TcpListener;

/// Another device's number.
const fn other(emulator: Emulator) -> &'static str {
    match emulator {
        Emulator::Stim300 | Emulator::Stim300Rate => "N25582405002999",
        Emulator::Mtdata2 => "03801FFF",
        _ => "0100061999",
    }
}

/// The change that gives a description a serial number.
fn of_unit(serial: &str) -> String {
    format!("imu = \"imu-a\"\nserial = \"{serial}\"")
}

/// Writes the description of a unit of this number.
fn describe_unit(domain: &TestDomain, emulator: Emulator, serial: &str) {
    describe(domain, emulator, &[("imu = \"imu-a\"", &of_unit(serial))]);
}

/// Devices that can be asked.
const THAT_ANSWER: [Emulator; 4] = [Emulator::Stim300, Emulator::Stim300Rate, Emulator::Vn100, Emulator::Mtdata2];

#[test]
fn two_units_on_each_other_s_port_are_refused_at_the_start() {
    for emulator in THAT_ANSWER {
        let domain = TestDomain::new();
        let (ours, theirs) = (emulator.serial(), other(emulator));
        let second = domain.path("second").display().to_string();
        let first = Device::start(&domain, emulator, &["--frames", ENDLESS]);
        let words = [emulator.profile(), "--link", &second, "--frames", ENDLESS, "--serial", theirs];
        let other = domain.start(domain.program("isotherm-emulator", &words));
        wait_until("the second line", || fs::read_link(&second).is_ok_and(|terminal| terminal.exists()));
        let of_line = profile(&domain, emulator, &[("imu = \"imu-a\"", &of_unit(ours))]);
        let of_second = of_line.replace(ours, theirs).replace(&line(&domain).display().to_string(), &second);
        domain.write("source.toml", &of_line);
        domain.write("second.toml", &of_second);
        for source in ["source.toml", "second.toml"] {
            let output = domain.run(&["acquire", source, "--dry-run", "--rows", "3"]);
            let log = text(&output.stderr);
            assert!(output.status.success() && log.contains("the device is "), "{emulator:?}: {log}");
            assert_eq!(text(&output.stdout).lines().count(), 4);
        }
        domain.write("source.toml", &of_line.replace(ours, theirs));
        domain.write("second.toml", &of_second.replace(theirs, ours));
        for (source, says, wanted) in [("source.toml", ours, theirs), ("second.toml", theirs, ours)] {
            for words in [&["acquire", source][..], &["acquire", source, "--dry-run"]] {
                let output = domain.run(words);
                let log = text(&output.stderr);
                assert_eq!(output.status.code(), Some(78), "{emulator:?}: {log}");
                let said = format!("says that it is {says}, and the description is of {wanted}");
                assert!(log.contains(&said) && log.contains("exchange the ports"), "{emulator:?}: {log}");
                // The header at most.
                assert!(text(&output.stdout).lines().count() <= 1, "{emulator:?}: {}", text(&output.stdout));
            }
        }
        // It was left sending.
        domain.write("source.toml", &of_line);
        domain.run_ok(&["acquire", "source.toml", "--dry-run", "--rows", "3"]);
        first.0.terminate();
        other.terminate();
    }
}

/// Replaces the unit at the port.
fn replug(domain: &TestDomain, acquire: &Acquire, device: Device, serial: &str, times: usize) -> Device {
    device.unplug(domain);
    acquire.process.wait_for_log_lines("went away", times);
    let device = Device::start(domain, Emulator::Vn100, &["--frames", ENDLESS, "--serial", serial]);
    acquire.process.wait_for_log_lines("is back", times);
    device
}

#[test]
fn samples_of_another_device_in_flight_go_out_under_its_own_number() {
    let domain = TestDomain::new();
    let (ours, theirs) = (Emulator::Vn100.serial(), other(Emulator::Vn100));
    describe_unit(&domain, Emulator::Vn100, ours);
    domain.run_ok(&["acquire", "source.toml", "--nominal", "imu-a.toml"]);
    let table = fs::read_to_string(domain.path("imu-a.toml")).unwrap();
    assert!(table.contains(ours), "{table}");
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", ENDLESS, "--serial", ours]);
    let acquire = Acquire::start(&domain, "acquire", &["--record", "acquired.csv"]);
    let flows = || {
        let before = received(&domain);
        wait_until("samples", || received(&domain) > before + 100);
    };
    flows();
    let flagged = || domain.imu_status()["flagged"]["other-device"].as_u64().unwrap_or(0);
    assert_eq!(flagged(), 0);
    let device = replug(&domain, &acquire, device, theirs, 1);
    acquire.process.wait_for_log(&format!("the device is {theirs}, and not {ours}: its samples go out under its own"));
    flows();
    let is_other = "isotherm_acquire_other_device{imu=\"imu-a\"} 1";
    let (_exporter, address) = domain.export();
    wait_until("the metric", || metrics_page(&address).is_some_and(|page| page.contains(is_other)));
    let device = replug(&domain, &acquire, device, ours, 2);
    acquire.process.wait_for_log(&format!("the device is {ours} again"));
    flows();
    let tally = acquire.end();
    device.0.terminate();
    let [samples, others, held] = counts(&tally, ["samples", "other_device", "held"]);
    assert_eq!((tally["is_other"].as_bool(), held, tally["device"].as_str()), (Some(false), 0, Some(ours)), "{tally}");
    assert!(others > 100, "{tally}");
    // Each sample of the other unit has its number, in one run, and no other sample has.
    let recorded = recorded(&domain, "acquired.csv");
    assert_eq!(recorded.len() as u64, samples);
    let number = recorded[0].device;
    let of_other: Vec<_> = (0..recorded.len()).filter(|at| recorded[*at].device != number).collect();
    assert_eq!(of_other.len() as u64, others, "{tally}");
    let (first, last) = (of_other[0], of_other[of_other.len() - 1]);
    assert_eq!((last + 1 - first) as u64, others);
    let sessions = |from: usize, to: usize| recorded[from..to].windows(2).all(|two| two[0].session == two[1].session);
    assert!(sessions(0, first) && sessions(first, last + 1) && sessions(last + 1, recorded.len()));
    // Nothing was lost, so the service has flagged as many.
    assert_eq!(counts(&tally, ["service/answered", "service/dropped"]), [samples, 0], "{tally}");
    assert_eq!(flagged(), others, "{tally}");
    service.terminate();
}

#[test]
fn samples_of_another_device_are_held_if_so_described() {
    let domain = TestDomain::new();
    let (ours, theirs) = (Emulator::Vn100.serial(), other(Emulator::Vn100));
    let hold = "[identity]\non_other = \"hold\"";
    describe(&domain, Emulator::Vn100, &[("imu = \"imu-a\"", &of_unit(ours)), ("[identity]", hold)]);
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", ENDLESS, "--serial", ours]);
    let acquire = Acquire::start(&domain, "acquire", &["--record", "acquired.csv"]);
    wait_until("samples", || fs::metadata(domain.path("acquired.csv")).is_ok_and(|file| file.len() > 10_000));
    let device = replug(&domain, &acquire, device, theirs, 1);
    acquire.process.wait_for_log(&format!("the device is {theirs}, and not {ours}: nothing of it is sent"));
    let device = replug(&domain, &acquire, device, ours, 2);
    acquire.process.wait_for_log(&format!("the device is {ours} again"));
    let tally = acquire.end();
    device.0.terminate();
    let [samples, others, held] = counts(&tally, ["samples", "other_device", "held"]);
    assert!(held > 0 && held == others, "{tally}");
    let recorded = recorded(&domain, "acquired.csv");
    assert_eq!(recorded.len() as u64, samples - held, "{tally}");
    assert!(recorded.iter().all(|raw| raw.device == recorded[0].device));
}

#[test]
fn a_device_that_does_not_answer_is_taken_as_it_comes() {
    let domain = TestDomain::new();
    describe_unit(&domain, Emulator::Vn100, Emulator::Vn100.serial());
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", ENDLESS, "--answers", "off"]);
    let output = domain.run(&["acquire", "source.toml", "--dry-run", "--rows", "200", "--json"]);
    let log = text(&output.stderr);
    assert!(output.status.success(), "{log}");
    let said = ["has not answered \"$VNRRG,03*70\" within 1 s", "it is unknown, and taken as it comes"];
    assert!(said.iter().all(|part| log.contains(part)), "{log}");
    let tally = super::tally_of(&log);
    assert_eq!(counts(&tally, ["unanswered", "missing", "other_device"]), [1, 0, 0], "{tally}");
    let samples = super::samples(&text(&output.stdout));
    assert_frames(Emulator::Vn100, &samples, |raw| (raw.timestamp_ns - 1_000_000_000) / 2_500_000);
    device.0.terminate();
    // What is not noticed is said.
    for (changes, said) in [
        (&[][..], "the description has no serial: the device is not asked"),
        (&[("[identity]", "#"), ("ask =", "# ask ="), ("message =", "# message =")], "has no [identity]"),
    ] {
        describe(&domain, Emulator::Vn100, changes);
        let device = Device::start(&domain, Emulator::Vn100, &["--frames", ENDLESS]);
        let output = domain.run(&["acquire", "source.toml", "--dry-run", "--rows", "3"]);
        assert!(output.status.success() && text(&output.stderr).contains(said), "{}", text(&output.stderr));
        device.0.terminate();
    }
}

#[test]
fn a_stim300_that_is_powered_says_who_it_is() {
    let domain = TestDomain::new();
    let ours = Emulator::Stim300.serial();
    let changes = [("imu = \"imu-a\"", of_unit(ours)), ("interval_s = 0.001", "interval_s = 0.005".to_owned())];
    let changes = changes.each_ref().map(|(from, to)| (*from, to.as_str()));
    describe(&domain, Emulator::Stim300, &changes);
    let orders = ["--frames", "400", "--rate", "200", "--reset", "200", "--reset-silence", "0.3"];
    let device = Device::start(&domain, Emulator::Stim300, &orders);
    let acquire = Acquire::start(&domain, "acquire", &["--dry-run"]);
    acquire.process.wait_for_log(&format!("the device is {ours}"));
    acquire.process.wait_for_log(&format!("was just powered: it says that it is {ours}"));
    acquire.process.wait_for_log("went away");
    assert!(device.0.wait().0.success());
    let (_, tally) = acquire.end_dry();
    assert_eq!(counts(&tally, ["power_ups", "other_device", "unanswered"]), [1, 0, 0], "{tally}");
    assert_eq!(tally["device"], ours);
}

/// The set-up that a profile has as a comment.
fn set_up(emulator: Emulator) -> String {
    let text =
        fs::read_to_string(format!("{}/../examples/acquire/{}.toml", env!("CARGO_MANIFEST_DIR"), emulator.profile()));
    let text = text.unwrap();
    let lines: Vec<_> = text.lines().skip_while(|line| *line != "# setup = [").collect();
    let end = lines.iter().position(|line| *line == "# ]").unwrap();
    lines[..=end].iter().map(|line| format!("{}\n", line.trim_start_matches("# "))).collect()
}

#[test]
fn devices_are_set_up_as_the_profiles_say_and_keep_nothing_for_good() {
    for emulator in THAT_ANSWER {
        let domain = TestDomain::new();
        let ours = emulator.serial();
        let unit = format!("{}\n{}", of_unit(ours), set_up(emulator));
        describe(&domain, emulator, &[("imu = \"imu-a\"", &unit)]);
        // A STIM300 that sends 500 Hz is set to 1000.
        let is_stim = matches!(emulator, Emulator::Stim300 | Emulator::Stim300Rate);
        let rate = if is_stim { ["--change-rate", "0:500"] } else { ["--first", "0"] };
        let orders = [&["--frames", ENDLESS, "--output", "new"], &rate[..]].concat();
        let device = Device::start(&domain, emulator, &orders);
        let output = domain.run(&["acquire", "source.toml", "--dry-run", "--rows", "150", "--json"]);
        let log = text(&output.stderr);
        assert!(output.status.success(), "{emulator:?}: {log}");
        let tally = super::tally_of(&log);
        assert_eq!(counts(&tally, ["unanswered", "gaps", "missing"]), [0; 3], "{emulator:?}: {log}");
        assert!(log.contains(&format!("the device is {ours}")), "{log}");
        assert!(!device.0.log().contains("kept for good"), "{}", device.0.log());
        device.0.terminate();
        // Another device is not set up.
        let orders = ["--frames", ENDLESS, "--output", "new", "--serial", other(emulator)];
        let device = Device::start(&domain, emulator, &orders);
        let output = domain.run(&["acquire", "source.toml", "--dry-run", "--rows", "1"]);
        assert_eq!(output.status.code(), Some(78), "{}", text(&output.stderr));
        device.0.terminate();
    }
}

#[test]
fn a_device_behind_tcp_is_asked_too() {
    let domain = TestDomain::new();
    // Free a moment ago; the emulator says if it no longer is.
    let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let words = ["vn100", "--frames", ENDLESS, "--tcp", &address.port().to_string()];
    let device = domain.start(domain.program("isotherm-emulator", &words));
    let hex = format!(":{:04X} ", address.port());
    wait_until("the port", || fs::read_to_string("/proc/net/tcp").unwrap().contains(&hex));
    let serial = format!("serial = \"{}\"\nbaud = 921600", line(&domain).display());
    let tcp = format!("tcp = \"{address}\"");
    let changes = [(serial.as_str(), tcp.as_str()), ("imu = \"imu-a\"", &of_unit(other(Emulator::Vn100)))];
    describe(&domain, Emulator::Vn100, &changes);
    let output = domain.run(&["acquire", "source.toml", "--dry-run"]);
    let log = text(&output.stderr);
    assert_eq!(output.status.code(), Some(75), "{log}");
    assert!(log.contains("says that it is 0100061897, and the description is of 0100061999"), "{log}");
    device.terminate();
}

/// Frames of two devices in turn, as anybody in the network can send them.
#[test]
fn a_device_that_is_another_one_all_the_time_does_not_fill_the_log() {
    let domain = TestDomain::new();
    let (ours, theirs) = ("$VNRRG,03,0100061897*5C\r\n", "$VNRRG,03,0100061999*53\r\n");
    // Ours until the first samples are there: a file is read 64 KiB at a time.
    let messages = (0..3000).map(|number| if number < 1000 || number % 2 == 0 { ours } else { theirs });
    let both = messages.zip(0..).map(|(says, number)| [says.as_bytes(), &Emulator::Vn100.frame(number)].concat());
    let bytes: Vec<_> = both.flatten().collect();
    fs::write(domain.path("bytes"), bytes).unwrap();
    describe_unit(&domain, Emulator::Vn100, Emulator::Vn100.serial());
    let output = domain.run(&["acquire", "source.toml", "--dry-run", "--json", "--device", "bytes"]);
    let log = text(&output.stderr);
    assert!(output.status.success(), "{log}");
    let tally = super::tally_of(&log);
    assert_eq!(counts(&tally, ["frames", "power_ups"]), [3000; 2], "{tally}");
    for part in ["was just powered", "the device is 0100061897 again"] {
        assert_eq!(log.lines().filter(|line| line.contains(part)).count(), 1, "{part}: {log}");
    }
    assert!(log.lines().count() < 20, "{log}");
}

#[test]
fn a_field_of_a_frame_says_who_it_is() {
    let domain = TestDomain::new();
    // What is no number of a unit in truth, but a field that never changes.
    let field = "[identity]\nfield = \"status\"\n";
    let text_of = |serial: &str| {
        let text = profile(&domain, Emulator::Mtdata2, &[("imu = \"imu-a\"", &of_unit(serial))]);
        let (begin, rest) = text.split_once("[identity]").unwrap();
        let (_, end) = rest.split_once("[timing]").unwrap();
        format!("{begin}{field}[timing]{end}")
    };
    for (serial, code) in [("5", 0), ("6", 78)] {
        domain.write("source.toml", &text_of(serial));
        let device = Device::start(&domain, Emulator::Mtdata2, &["--frames", ENDLESS]);
        let output = domain.run(&["acquire", "source.toml", "--dry-run", "--rows", "3"]);
        let log = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{log}");
        assert!(code == 0 || log.contains("says that it is 5, and the description is of 6"), "{log}");
        device.0.terminate();
    }
}

#[test]
fn a_service_without_identity_is_as_before() {
    let domain = TestDomain::new();
    let service = serve_vn100(&domain);
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", ENDLESS, "--serial", "7"]);
    let acquire = Acquire::start(&domain, "acquire", &[]);
    wait_until("samples", || received(&domain) > 50);
    let tally = acquire.end();
    assert_eq!((counts(&tally, ["other_device", "unanswered"]), tally["device"].as_str()), ([0, 0], Some("")));
    device.0.terminate();
    service.terminate();
}
