//! `isothermd`, the program for a vehicle: it links only the listed crates, and refuses what it does not have.
#![allow(clippy::unwrap_used, reason = "in a test the panic is the report")]

use std::collections::BTreeSet;
use std::env;
use std::process::{Command, Output};

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// Adding a crate is a decision: add its name to the list.
#[test]
fn it_links_the_crates_of_this_list_and_no_other() {
    let list = include_str!("data/isothermd-crates.txt");
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
    for name in ["mcap", "serialport", "ratatui", "isotherm-statistics", "indicatif", "isotherm-fit"] {
        assert!(!linked.contains(name), "{name}");
    }
}

/// Runs `isothermd` in a domain of its own, of which nothing may be left.
fn isothermd(arguments: &[&str]) -> Output {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_isothermd"));
    command.args(arguments).env("ISOTHERM_DOMAIN", "daemon-test").env("ISOTHERM_ROOT", folder.path());
    let output = command.output().unwrap();
    assert_eq!(folder.path().read_dir().unwrap().count(), 0, "{arguments:?} left something behind");
    output
}

#[test]
fn laboratory_files_are_refused_with_a_hint_to_isotherm() {
    for name in ["campaign/campaign.toml", "plan.toml"] {
        let output = isothermd(&["check", &format!("{}/../examples/{name}", env!("CARGO_MANIFEST_DIR"))]);
        assert_eq!(output.status.code(), Some(64), "{name}");
        assert!(text(&output.stderr).contains("`isotherm check` reads it"), "{}", text(&output.stderr));
    }
}

#[test]
fn a_remedy_names_this_program() {
    let output = isothermd(&["status"]);
    assert_eq!(output.status.code(), Some(69));
    assert!(text(&output.stderr).contains("start one with `isothermd serve --domain"), "{}", text(&output.stderr));
}

#[test]
fn an_unknown_command_is_a_usage_error() {
    let output = isothermd(&["calibrate"]);
    assert_eq!(output.status.code(), Some(64));
    assert!(text(&output.stderr).contains("unrecognized subcommand"), "{}", text(&output.stderr));
}
