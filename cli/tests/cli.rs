//! The command line's own behaviour: exit codes, where words and data go.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

use std::process::{Command, Output};

fn isotherm(arguments: &[&str]) -> Output {
    // No service runs in this domain, and none of these commands leaves anything in it.
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_isotherm"));
    command.args(arguments).env("ISOTHERM_DOMAIN", "cli-test").env("ISOTHERM_ROOT", folder.path());
    let output = command.output().unwrap();
    assert_eq!(folder.path().read_dir().unwrap().count(), 0, "{arguments:?} left something behind");
    output
}

#[test]
fn exit_codes_are_those_of_sysexits() {
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data");
    let (run, table) = (format!("{data}/run.csv"), format!("{data}/imu-a.toml"));
    let cases: [(&[&str], i32); 14] = [
        (&["--help"], 0),
        (&["--version"], 0),
        (&[], 64),
        (&["frobnicate"], 64),
        (&["feed", "--imu", "IMU", &run], 64),
        (&["feed", "--imu", "imu-a", "--rate", "0", &run], 64),
        (&["--domain", "No Domain", "status"], 64),
        (&["serve"], 64),
        (&["status"], 69),
        (&["feed", "--imu", "imu-a", "--timeout", "0.1", &run], 69),
        (&["replay", "--table", &table, "/nowhere/run.csv"], 74),
        (&["replay", "--table", &table, &table], 65),
        (&["replay", "--table", &run, &run], 78),
        (&["serve", "--config", &table], 78),
    ];
    for (arguments, code) in cases {
        let output = isotherm(arguments);
        let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert_eq!(output.status.code(), Some(code), "{arguments:?}\n{out}\n{err}");
        assert_eq!(
            code == 0,
            err.is_empty(),
            "{arguments:?}: words go to stderr, and only if something is wrong\n{err}"
        );
        assert_eq!(code == 0, !out.is_empty(), "{arguments:?}: nothing but data goes to stdout\n{out}");
    }
}

#[test]
fn every_command_helps_with_examples() {
    for command in ["serve", "feed", "replay", "check", "status", "calibrate", "regress", "verify"] {
        let output = isotherm(&[command, "--help"]);
        assert!(String::from_utf8_lossy(&output.stdout).contains("Examples:"), "{command}");
    }
}
