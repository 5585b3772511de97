//! `isothermd`, the program for a vehicle: it links only the listed crates, and its commands behave as those of `isotherm`.
#![allow(clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_tests::{RUN, TABLE, TestDomain, recording, round_trip, text};
use std::collections::BTreeSet;
use std::env;
use std::fs;
use std::process::Command;

const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");

/// Adding a crate is a decision: add its name to the list.
#[test]
fn it_links_the_crates_of_this_list_and_no_other() {
    let list = include_str!("../data/isothermd-crates.txt");
    let wanted: BTreeSet<_> = list.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect();
    let mut tree = Command::new(env::var_os("CARGO").unwrap());
    tree.args(["tree", "--offline", "--locked", "-p", "isotherm-service", "-e", "normal", "--prefix", "none"]);
    let output = tree.args(["--format", "{p}"]).current_dir(env!("CARGO_MANIFEST_DIR")).output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    let tree = text(&output.stdout);
    let linked: BTreeSet<_> = tree.lines().filter_map(|line| line.split(' ').next()).map(str::to_owned).collect();
    let more: Vec<_> = linked.difference(&wanted).collect();
    let fewer: Vec<_> = wanted.difference(&linked).collect();
    assert!(more.is_empty() && fewer.is_empty(), "in the tree and not in the list: {more:?}; the reverse: {fewer:?}");
    for name in ["parquet", "mcap", "serialport", "ratatui", "statrs", "indicatif", "isotherm-calibration"] {
        assert!(!linked.contains(name), "{name}");
    }
}

#[test]
fn serve_check_and_status_are_those_of_isotherm() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let service = domain.start(domain.program("isothermd", &["serve", "--imu", "imu-a=imu-a.toml"]));
    service.wait_for_log("ready");
    let mut acquisition = domain.acquisition("imu-a");
    round_trip(&mut acquisition, &recording()[0]);
    drop(acquisition);
    let replayed = domain.run_ok(&["replay", "--table", "imu-a.toml", RUN]);
    assert_eq!(domain.run_ok(&["feed", "--imu", "imu-a", RUN]), replayed);
    domain.write("bad.toml", &TABLE.replace("gravity_reference", "gravity"));
    for arguments in [
        &["status"][..],
        &["status", "--iceoryx2"],
        &["check", "imu-a.toml"],
        &["check", "bad.toml"],
        &["check", "nothing.toml"],
        &["serve", "--imu", "imu-b=bad.toml"],
        &["serve", "--config", "nothing.toml"],
        &["serve", "--help"],
        &["status", "--help"],
        &["check", "--help"],
    ] {
        let [daemon, isotherm] = ["isothermd", "isotherm"].map(|program| {
            let output = domain.finish(domain.program(program, arguments));
            // Only the program's name and the uptime in `status` may differ.
            let said = [output.stdout, output.stderr].map(|printed| text(&printed).replace("isothermd", "isotherm"));
            let lines = said.iter().flat_map(|printed| printed.lines()).filter(|line| !line.contains(", up "));
            let words: Vec<_> = lines.flat_map(str::split_whitespace).map(str::to_owned).collect();
            (output.status.code(), words)
        });
        assert_eq!(daemon, isotherm, "{arguments:?}");
        assert!(!daemon.1.is_empty(), "{arguments:?}");
    }
    service.terminate();
}

/// A new user's first status often shows late increments, so it explains them.
#[test]
fn status_explains_late_increments() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let config = "[latency]\nbudget_us = 0.001\n[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n";
    domain.write("service.toml", config);
    let service = domain.serve(&["--config", "service.toml"]);
    assert!(!domain.run_ok(&["status"]).contains("late:"), "nothing was late so far");
    domain.run_ok(&["feed", "--imu", "imu-a", RUN]);
    let status = domain.run_ok(&["status"]);
    assert!(status.contains("flagged      late 4000"), "{status}");
    assert!(
        status.contains("late: the increment is right, but it took longer than the budget of 0.001 us"),
        "{status}"
    );
    service.terminate();
}

#[test]
fn laboratory_files_are_refused_with_a_hint_to_isotherm() {
    let domain = TestDomain::new();
    for name in ["campaign/campaign.toml", "plan.toml"] {
        let path = format!("{EXAMPLES}/{name}");
        let output = domain.finish(domain.program("isothermd", &["check", &path]));
        assert_eq!(output.status.code(), Some(64), "{name}");
        assert!(text(&output.stderr).contains("`isotherm check` reads it"), "{}", text(&output.stderr));
    }
    // An unknown command is a usage error.
    let output = domain.finish(domain.program("isothermd", &["calibrate"]));
    assert_eq!(output.status.code(), Some(64));
    assert!(text(&output.stderr).contains("unrecognized subcommand"), "{}", text(&output.stderr));
    assert!(fs::read_dir(domain.path("")).unwrap().next().is_none(), "nothing is left");
}
