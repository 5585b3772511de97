//! The program `isotherm-demo`, which `cargo run` starts: its help and version. CI and the README run the demonstration
//! itself.
#![allow(clippy::unwrap_used, reason = "in a test the panic is the report")]

use std::process::Command;

fn printed(arguments: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_isotherm-demo")).args(arguments).output().unwrap();
    (output.status.code(), String::from_utf8([output.stdout, output.stderr].concat()).unwrap())
}

#[test]
fn help_and_version_are_as_in_the_other_programs() {
    let (code, help) = printed(&["demo", "--help"]);
    assert!(
        code == Some(0) && help.contains("Exit codes: 0 done") && help.contains("  isotherm-demo demo\n"),
        "{help}"
    );
    let (code, version) = printed(&["--version"]);
    assert!(code == Some(0) && version.contains("\ncommit: ") && version.contains("\nbuilt: "), "{version}");
    assert_eq!(printed(&["calibrate"]).0, Some(64));
}
