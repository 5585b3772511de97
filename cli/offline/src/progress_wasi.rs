//! Progress where there is no terminal: who runs the program counts the bytes that it reads.

use isotherm_recording::{Observer, Progress};
use isotherm_support::failure::tell;
use std::path::PathBuf;

struct Unseen;

impl Observer for Unseen {
    fn advance(&self, _: u64) {}

    fn restart(&self) {}

    fn finish(&self) {}

    fn warn(&self, message: &str) {
        tell("isotherm", message);
    }
}

/// No bar, whose warnings are printed.
pub fn bytes_bar(_: &[PathBuf], _: &'static str) -> Progress {
    Progress::new(Unseen)
}

/// Long work whose duration is unknown.
pub struct Spinner;

impl Spinner {
    /// The work is done.
    pub fn finish_and_clear(&self) {}
}

/// Begins long work.
#[must_use]
pub fn spinner(_: &'static str) -> Spinner {
    Spinner
}
