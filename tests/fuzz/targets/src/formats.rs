//! Input: any bytes as a file of a recording, in whatever format its first bytes say. It is read, or refused as bad
//! data, within a budget of steps: never an error of the operating system, since there was none.

use crate::{memory_file, within_budget};
use isotherm_files::source;
use isotherm_recording::Progress;
use isotherm_recording_formats::read::{ImuChoice, Samples};
use isotherm_support::failure::{Exit, printable};
use std::fs::{self, File};
use std::path::PathBuf;
use std::sync::LazyLock;

/// The file, in memory, and a path that opens it.
static INPUT: LazyLock<(File, PathBuf)> = LazyLock::new(memory_file);

/// Runs the target.
pub fn run(bytes: &[u8]) {
    let path = &INPUT.1;
    fs::write(path, bytes).expect("memory takes all");
    let read = || {
        let samples = Samples::open(&[source(path)], ImuChoice::Any, &Progress::default());
        samples.map_or_else(Some, |mut samples| samples.find_map(Result::err))
    };
    if let Some(failure) = within_budget(bytes.len(), read) {
        assert_eq!(failure.exit, Exit::Data, "{failure}");
        assert_eq!(printable(&failure.message), failure.message);
    }
}
