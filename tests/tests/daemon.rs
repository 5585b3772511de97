//! `isothermd`: what a vehicle runs. It links nothing else, and its commands are those of `isotherm`.
#![allow(clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_tests::{RUN, TABLE, World, recording, round_trip, text};
use std::collections::BTreeSet;
use std::env;
use std::fs;
use std::process::Command;

const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");

/// A crate more is a decision: who makes it adds its name here.
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
    let world = World::new();
    world.write("imu-a.toml", TABLE);
    let service = world.start(world.program("isothermd", &["serve", "--imu", "imu-a=imu-a.toml"]));
    service.wait_for_log("ready");
    let mut acquisition = world.acquisition("imu-a");
    round_trip(&mut acquisition, &recording()[0]);
    drop(acquisition);
    let replayed = world.run_well(&["replay", "--table", "imu-a.toml", RUN]);
    assert_eq!(world.run_well(&["feed", "--imu", "imu-a", RUN]), replayed);
    world.write("bad.toml", &TABLE.replace("gravity_reference", "gravity"));
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
            let output = world.finish(world.program(program, arguments));
            // The name of the program, and the time of `status`, are all that may differ.
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

/// The first status of a new user has late increments: it says what they are.
#[test]
fn status_explains_late_increments() {
    let world = World::new();
    world.write("imu-a.toml", TABLE);
    let config = "[latency]\nbudget_us = 0.001\n[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n";
    world.write("service.toml", config);
    let service = world.serve(&["--config", "service.toml"]);
    assert!(!world.run_well(&["status"]).contains("late:"), "nothing was late so far");
    world.run_well(&["feed", "--imu", "imu-a", RUN]);
    let status = world.run_well(&["status"]);
    assert!(status.contains("flagged      late 4000"), "{status}");
    assert!(
        status.contains("late: the increment is right, but it took longer than the budget of 0.001 us"),
        "{status}"
    );
    service.terminate();
}

#[test]
fn files_of_the_laboratory_are_left_to_isotherm() {
    let world = World::new();
    for name in ["campaign/campaign.toml", "plan.toml"] {
        let path = format!("{EXAMPLES}/{name}");
        let output = world.finish(world.program("isothermd", &["check", &path]));
        assert_eq!(output.status.code(), Some(64), "{name}");
        assert!(text(&output.stderr).contains("`isotherm check` reads it"), "{}", text(&output.stderr));
    }
    // What it does not have is a usage error with the commands that it has.
    let output = world.finish(world.program("isothermd", &["calibrate"]));
    assert_eq!(output.status.code(), Some(64));
    assert!(text(&output.stderr).contains("unrecognized subcommand"), "{}", text(&output.stderr));
    assert!(fs::read_dir(world.path("")).unwrap().next().is_none(), "nothing is left");
}
