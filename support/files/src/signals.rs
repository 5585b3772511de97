//! Signals that end a command, and what they do to files that are not complete.

use isotherm_support::failure::{Exit, Failure};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::{fs, io, thread};

/// What a signal that ends the command has to know.
struct SignalPlan {
    /// Names of files to remove.
    unfinished: Vec<PathBuf>,
    /// Set by the first signal instead of ending the process.
    flag: Option<Arc<AtomicBool>>,
}

fn ending() -> MutexGuard<'static, SignalPlan> {
    static ENDING: Mutex<SignalPlan> = Mutex::new(SignalPlan { unfinished: Vec::new(), flag: None });
    ENDING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// While this guard lives no signal ends a command that has called [`remove_unfinished_on_signals`].
pub(crate) fn hold_signals() -> MutexGuard<'static, ()> {
    static HELD: Mutex<()> = Mutex::new(());
    HELD.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A file that a signal removes while this value lives.
pub(crate) struct UnfinishedFile(PathBuf);

impl UnfinishedFile {
    /// Lists the file of this name.
    pub(crate) fn list(path: &Path) -> Self {
        ending().unfinished.push(path.to_owned());
        Self(path.to_owned())
    }
}

impl Drop for UnfinishedFile {
    fn drop(&mut self) {
        let mut ending = ending();
        if let Some(place) = ending.unfinished.iter().position(|listed| *listed == self.0) {
            ending.unfinished.swap_remove(place);
        }
    }
}

/// The signals that ask a command to end: SIGINT, SIGTERM, and SIGHUP unless the process was started with it ignored,
/// as `nohup` does.
#[must_use]
pub fn end_signals() -> Vec<i32> {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    let hangup = (ignored >> (SIGHUP - 1)) & 1 == 0;
    [SIGINT, SIGTERM].into_iter().chain(hangup.then_some(SIGHUP)).collect()
}

/// Makes the signals of [`end_signals`] remove the unfinished files before they end the process. For commands that do
/// not handle these signals themselves.
///
/// # Errors
/// If the operating system refuses the handlers.
pub fn remove_unfinished_on_signals() -> Result<(), Failure> {
    let failed = |error: io::Error| Failure::new(Exit::Failed, format!("handling signals: {error}"));
    let mut signals = signal_hook::iterator::Signals::new(end_signals()).map_err(failed)?;
    let body = move || {
        for signal in signals.forever() {
            let _held = hold_signals();
            let mut ending = ending();
            if ending.flag.take().is_some_and(|flag| !flag.swap(true, Ordering::Relaxed)) {
                continue;
            }
            for path in ending.unfinished.drain(..) {
                // Fails if the file was already renamed; then nothing must be removed.
                let _ = fs::remove_file(path);
            }
            // Ends the process as the signal would have.
            let _ = signal_hook::low_level::emulate_default_handler(signal);
        }
    };
    thread::Builder::new().name("signals".to_owned()).spawn(body).map(drop).map_err(failed)
}

/// After [`remove_unfinished_on_signals`]: the first signal from now on only sets the returned flag, so that the
/// command can end by itself. The second one ends the process.
#[must_use]
pub fn end_flag() -> Arc<AtomicBool> {
    Arc::clone(ending().flag.insert(Arc::default()))
}

/// Makes a write beyond the limit of a file's size (`ulimit -f`) fail with an error. Without this SIGXFSZ kills the
/// process.
pub fn report_file_limit() {
    // A handler that does nothing is enough: the write then returns the error. Fails only for signals that cannot be
    // handled.
    let _ = signal_hook::flag::register(SIGXFSZ, Arc::default());
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::{Output, StagedText, replace};

    /// How many of the files of this folder are listed. Other tests have theirs.
    fn listed(folder: &Path) -> usize {
        ending().unfinished.iter().filter(|path| path.starts_with(folder)).count()
    }

    #[test]
    fn only_unfinished_files_are_listed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let other = folder.path().join("b");
        for _ in 0..3 {
            replace(&path, "text").unwrap();
            let texts = [&path, &other].map(|path| StagedText::create(Some(path)).unwrap().write("text").unwrap());
            assert_eq!(listed(folder.path()), 2);
            StagedText::finish_all(texts.into()).unwrap();
            drop(Output::create(Some(&path)).unwrap());
            assert_eq!(listed(folder.path()), 0);
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }
}
