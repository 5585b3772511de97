//! Every input of `tests/fuzz/corpus` passes its target. libFuzzer is not needed for this.
#![allow(clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_fuzz_targets::{acquire, campaign, config, convert, formats, recording, sample, table};
use std::fs;
use std::path::PathBuf;

fn run(target: &str, function: fn(&[u8])) {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../corpus").join(target);
    let mut files: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(files.len() >= 5, "{} has {} inputs", folder.display(), files.len());
    for file in files {
        // A panic of the target says why; this says with what.
        let result = std::panic::catch_unwind(|| function(&fs::read(&file).unwrap()));
        assert!(result.is_ok(), "{}", file.display());
    }
}

#[test]
fn tables() {
    run("table", table::run);
}

#[test]
fn configurations() {
    run("config", config::run);
}

#[test]
fn recordings() {
    run("recording", recording::run);
}

#[test]
fn files_of_recordings() {
    run("formats", formats::run);
}

#[test]
fn foreign_data() {
    run("convert", convert::run);
}

#[test]
fn campaigns() {
    run("campaign", campaign::run);
}

#[test]
fn samples() {
    run("sample", sample::run);
}

#[test]
fn sources() {
    run("acquire", acquire::run);
}
