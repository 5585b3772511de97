//! What cannot be acquired from is refused: with the exit code, the phase, the cause and a remedy.

use super::{Acquire, Device, ENDLESS, describe, line, profile};
use isotherm_tests::emulator::Emulator;
use isotherm_tests::{TestDomain, text, wait_until};
use std::fs;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt, symlink};
use std::os::unix::process::CommandExt as _;
use std::process::Command;

/// Runs a command that must fail with this code, and say all of this.
fn refused(domain: &TestDomain, command: Command, code: i32, said: &[&str]) {
    let output = domain.finish(command);
    let log = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{log}");
    for part in said {
        assert!(log.contains(part), "{part:?} is not in: {log}");
    }
}

/// The same of `isotherm acquire source.toml`.
fn acquire_refused(domain: &TestDomain, words: &[&str], code: i32, said: &[&str]) {
    refused(domain, domain.isotherm(&[&["acquire", "source.toml"], words].concat()), code, said);
}

#[test]
fn what_is_no_device_is_refused() {
    let domain = TestDomain::new();
    describe(&domain, Emulator::Vn100, &[]);
    let line = line(&domain);
    let named = line.display().to_string();
    let opening = format!("opening {named}: ");
    let is_absent = ["No such file or directory", "plug it in; `isotherm acquire --list`"];
    acquire_refused(&domain, &[], 74, &[&[opening.as_str()], &is_absent[..]].concat());
    acquire_refused(&domain, &["--dry-run"], 74, &is_absent);
    fs::create_dir(&line).unwrap();
    acquire_refused(&domain, &[], 74, &[&opening, "Is a directory", "it is not a serial line; give a device"]);
    fs::remove_dir(&line).unwrap();
    fs::write(&line, "text").unwrap();
    acquire_refused(&domain, &[], 74, &[&opening, "not a terminal device", "it is not a serial line; give a device"]);
    assert_eq!(fs::read_to_string(&line).unwrap(), "text");
    // The same of a device on the command line, and of a file of bytes that is not there.
    acquire_refused(&domain, &["--device", "/dev/null"], 74, &["opening /dev/null", "it is not a serial line"]);
    let serial = format!("serial = \"{named}\"\nbaud = 921600");
    describe(&domain, Emulator::Vn100, &[(serial.as_str(), "file = \"absent.bin\"")]);
    acquire_refused(&domain, &[], 74, &["opening absent.bin", "No such file", "give a file of bytes"]);
    describe(&domain, Emulator::Vn100, &[(serial.as_str(), "tcp = \"127.0.0.1:1\"")]);
    acquire_refused(&domain, &[], 74, &["opening tcp 127.0.0.1:1", "refused", "check host and port"]);
    acquire_refused(&domain, &["--device", "x"], 64, &["--device takes the place of a serial line"]);
}

#[test]
fn a_line_that_another_program_has_is_refused() {
    let domain = TestDomain::new();
    describe(&domain, Emulator::Vn100, &[]);
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", ENDLESS]);
    let acquire = Acquire::start(&domain, "acquire", &["--dry-run"]);
    wait_until("rows", || fs::metadata(domain.path("acquire.out")).is_ok_and(|file| file.size() > 1000));
    let said = ["another program has it", "end the program that has it (`fuser -v` names it"];
    acquire_refused(&domain, &[], 74, &said);
    refused(&domain, domain.isotherm(&["acquire", "--probe", "line"]), 74, &said);
    // The first has not noticed.
    let (samples, tally) = acquire.end_dry();
    assert!(samples.windows(2).all(|pair| pair[0].sequence + 1 == pair[1].sequence), "{tally}");
    device.0.terminate();
    // Its end lets the line go, and so does its kill.
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", ENDLESS]);
    let acquire = Acquire::start(&domain, "killed", &["--dry-run"]);
    wait_until("rows", || fs::metadata(domain.path("killed.out")).is_ok_and(|file| file.size() > 1000));
    acquire.process.kill();
    domain.run_ok(&["acquire", "source.toml", "--dry-run", "--rows", "10"]);
    device.0.terminate();
}

#[test]
fn a_line_of_another_user_is_refused() {
    let domain = TestDomain::new();
    describe(&domain, Emulator::Vn100, &[]);
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", ENDLESS]);
    let terminal = fs::read_link(line(&domain)).unwrap();
    fs::set_permissions(&terminal, PermissionsExt::from_mode(0o000)).unwrap();
    let mut command = domain.isotherm(&["acquire", "source.toml"]);
    if fs::metadata("/proc/self").unwrap().uid() == 0 {
        // Root may open anything; nobody may read the description, too, and run the program from elsewhere.
        for path in [domain.path(""), domain.path("source.toml")] {
            fs::set_permissions(path, PermissionsExt::from_mode(0o755)).unwrap();
        }
        let program = domain.path("isotherm");
        if fs::hard_link(command.get_program(), &program).is_err() {
            fs::copy(command.get_program(), &program).unwrap();
        }
        let variables: Vec<_> =
            command.get_envs().filter_map(|(name, value)| Some((name.to_owned(), value?.to_owned()))).collect();
        command = Command::new(program);
        command.args(["acquire", "source.toml"]).envs(variables).current_dir(domain.path(""));
        command.uid(65_534).gid(65_534);
    }
    let said = ["opening ", "Permission denied", "the device is another user's: add this user to its group"];
    refused(&domain, command, 74, &said);
    device.0.terminate();
}

#[test]
fn a_device_at_another_rate_is_refused_after_some_seconds() {
    let domain = TestDomain::new();
    for (rate, measured) in [("180", "the device sends 1"), ("220", "the device sends 2")] {
        describe(&domain, Emulator::Arduino, &[("time = { column = \"micros\", unit = \"us\", bits = 32 }\n", "")]);
        let device = Device::start(&domain, Emulator::Arduino, &["--frames", ENDLESS, "--rate", rate]);
        let said = [measured, "and timing.interval_s is 0.005000000", "give the interval that the device is set to"];
        acquire_refused(&domain, &["--dry-run", "--record", &format!("{rate}.csv")], 78, &said);
        // What was received until then is kept.
        assert!(super::recorded(&domain, &format!("{rate}.csv")).len() > 100);
        device.0.terminate();
    }
    // A counter that does not rise as described.
    describe(&domain, Emulator::Vn100, &[("unit = \"ns\"", "unit = \"us\"")]);
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", ENDLESS]);
    let said = ["new sessions within", "the counter or the clock does not rise as described", "with the data sheet"];
    acquire_refused(&domain, &["--dry-run"], 78, &said);
    device.0.terminate();
}

#[test]
fn a_wrong_description_is_refused_with_all_faults_at_once() {
    let domain = TestDomain::new();
    let text = profile(&domain, Emulator::Stim300, &[]);
    let wrong = text.replace("baud =", "bauds =").replace("length = 42", "length = 10").replace("step = 2", "step = 3");
    domain.write("source.toml", &wrong);
    let line = |key: &str| {
        let number = wrong.lines().position(|line| line.contains(key)).unwrap() + 1;
        format!("source.toml:{number}: ")
    };
    let said = [
        &format!("{}source.bauds: unknown key", line("bauds =")),
        "source.baud: missing; give the rate of the line in Bd",
        &format!("{}timing.counter.step: ", line("step = 3")),
        "are not within the 10",
    ];
    acquire_refused(&domain, &["--dry-run"], 78, &said);
    refused(&domain, domain.isotherm(&["check", "source.toml"]), 78, &said);
    // No file of output is begun.
    acquire_refused(&domain, &["--record", "x.csv"], 78, &said);
    assert!(!domain.path("x.csv").exists());
    acquire_refused(&domain, &["--rows", "3"], 64, &["--dry-run"]);
    refused(&domain, domain.isotherm(&["acquire", "absent.toml"]), 74, &["absent.toml", "No such file"]);
    refused(&domain, domain.isotherm(&["acquire"]), 64, &["SOURCE.toml"]);
    // A record that exists is not replaced, and its name determines its format.
    domain.write("source.toml", &text);
    domain.write("there.csv", "mine");
    acquire_refused(&domain, &["--record", "there.csv"], 74, &["there.csv"]);
    assert_eq!(fs::read_to_string(domain.path("there.csv")).unwrap(), "mine");
    acquire_refused(&domain, &["--record", "x.txt"], 64, &["x.txt: name the recording .csv or .mcap"]);
    symlink("absent", super::line(&domain)).unwrap();
    acquire_refused(&domain, &["--dry-run"], 74, &["plug it in"]);
}

#[test]
fn a_service_that_does_not_come_is_given_up_if_told_so() {
    let domain = TestDomain::new();
    describe(&domain, Emulator::Vn100, &[]);
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", ENDLESS]);
    acquire_refused(&domain, &["--timeout", "0.5"], 69, &["no service", "missing in 0 gaps"]);
    device.0.terminate();
    // A service without this IMU will not have it later.
    domain.write("imu-b.toml", &isotherm_tests::TABLE.replace("imu-a", "imu-b"));
    let service = domain.serve(&["--imu", "imu-b=imu-b.toml"]);
    let device = Device::start(&domain, Emulator::Vn100, &["--frames", ENDLESS]);
    acquire_refused(&domain, &["--timeout", "0.5"], 69, &["imu-a"]);
    // Another acquisition of the same IMU.
    let _other = domain.acquisition("imu-b");
    acquire_refused(&domain, &["--imu", "imu-b", "--timeout", "0.5"], 1, &["imu-b"]);
    device.0.terminate();
    service.terminate();
}
