//! The lock that allows one runner in a folder, and how other processes inspect and stop this runner.

use super::progress::{STATUS, Snapshot};
use isotherm_files::{check_own_folder, open_without_waiting, output_place};
use isotherm_shared::document::MAX_BYTES;
use isotherm_support::failure::{Exit, Failure, shown};
use rustix::fs::OFlags;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read as _, Seek as _, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::thread;
use std::time::{Duration, Instant};
use std::{fs, process};

/// The lock file in the campaign's folder: locked while a runner lives, and contains the runner's process id, which
/// only messages show: it means nothing in another container.
const LOCK: &str = "runner.lock";
/// Permissions of the lock file: another user who could read it could lock it for ever.
const OWN: u32 = 0o600;
/// How long a new runner retries the lock: a process that inspects the folder holds it for a shorter time.
const LOCK_PATIENCE: Duration = Duration::from_millis(500);
/// Pause between two attempts.
const RETRY_PAUSE: Duration = Duration::from_millis(20);
/// The file in the campaign's folder that asks the runner to end. The runner removes it: that is its answer.
const STOP: &str = "stop";
/// The number of a request to end where signals have theirs.
pub(crate) const REQUESTED: usize = 1 << 16;
/// How often the runner looks for a request.
const WATCH_PERIOD: Duration = Duration::from_millis(100);
/// Longest time until a runner answers a request.
const ANSWER: Duration = Duration::from_secs(5);

/// Exclusive ownership of the campaign's folder, until this value is dropped or the process ends.
pub struct CampaignLock {
    _file: File,
}

impl CampaignLock {
    /// Locks the folder.
    ///
    /// # Errors
    /// If another runner has locked it, or the file cannot be written.
    pub fn take(folder: &Path) -> Result<Self, Failure> {
        let path = folder.join(LOCK);
        let failed = |error: io::Error| Failure::io("locking", &path, &error);
        // All that is written there is written in its place.
        check_own_folder(folder).map_err(|error| Failure::io("locking", folder, &error))?;
        let mut options = OpenOptions::new();
        options
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .mode(OWN)
            .custom_flags(OFlags::NOFOLLOW.bits().cast_signed());
        let file = options.open(&path).map_err(failed)?;
        let begun = Instant::now();
        loop {
            match file.try_lock() {
                Ok(()) => break,
                Err(TryLockError::Error(error)) => return Err(failed(error)),
                Err(TryLockError::WouldBlock) if begun.elapsed() < LOCK_PATIENCE => thread::sleep(RETRY_PAUSE),
                Err(TryLockError::WouldBlock) => {
                    let message = format!(
                        "{}: pid {} runs this campaign; see `isotherm campaign status`",
                        shown(folder),
                        pid_in(&file).map_or_else(|| "?".to_owned(), |pid| pid.to_string())
                    );
                    return Err(Failure::new(Exit::Failed, message));
                }
            }
        }
        let write = |mut file: &File| {
            file.rewind()?;
            file.set_len(0)?;
            writeln!(file, "{}", process::id())
        };
        write(&file).map_err(failed)?;
        Ok(Self { _file: file })
    }
}

fn pid_in(mut file: &File) -> Option<i32> {
    const MOST: u64 = 32;
    let mut text = String::new();
    file.rewind().ok()?;
    file.take(MOST).read_to_string(&mut text).ok()?;
    text.trim().parse().ok()
}

/// The id of the process that runs the campaign in `folder`; `None` if no process does, or if its id cannot be read.
///
/// # Errors
/// If the lock cannot be inspected: only the user who runs the campaign may.
pub fn runner_pid(folder: &Path) -> Result<Option<i32>, Failure> {
    let path = folder.join(LOCK);
    let file = match open_without_waiting(&path) {
        Ok(file) => file,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(Failure::io("opening", &path, &error)),
    };
    match file.try_lock_shared() {
        Ok(()) => Ok(None),
        Err(TryLockError::WouldBlock) => Ok(pid_in(&file)),
        Err(TryLockError::Error(error)) => Err(Failure::io("looking at", &path, &error)),
    }
}

/// The runner's last snapshot; `None` if there is none, or if another version wrote it.
///
/// # Errors
/// If the status file cannot be read.
pub fn snapshot(folder: &Path) -> Result<Option<Snapshot>, Failure> {
    let path = folder.join(STATUS);
    let mut text = String::new();
    match open_without_waiting(&path).and_then(|file| file.take(MAX_BYTES).read_to_string(&mut text)) {
        // A file of another version counts as missing.
        Ok(_) => Ok(serde_json::from_str(&text).ok()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(Failure::io("reading", &path, &error)),
    }
}

/// Looks for a request to end from now on, and then sets the number that lines and runner look at. The caller has
/// locked the folder: a request to an earlier runner is forgotten.
///
/// # Errors
/// If a thread cannot be created, or an earlier request not removed.
pub fn watch_requests(folder: &Path, stop_signal: &Arc<AtomicUsize>) -> Result<(), Failure> {
    let path = folder.join(STOP);
    match fs::remove_file(&path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(Failure::io("removing", &path, &error)),
        _ => {}
    }
    let stop_signal = Arc::clone(stop_signal);
    let watch = move || {
        loop {
            if path.exists() {
                // A signal that came first has asked for the same.
                let _ = stop_signal.compare_exchange(0, REQUESTED, Relaxed, Relaxed);
            }
            thread::sleep(WATCH_PERIOD);
        }
    };
    let started = thread::Builder::new().name("stop".to_owned()).spawn(watch);
    started.map(drop).map_err(|error| Failure::new(Exit::Failed, format!("starting a thread: {error}")))
}

/// Answers a request to end: the runner is on its way into the safe state.
pub(crate) fn answer_stop(folder: &Path) {
    // The process that asks also waits for the end.
    let _ = fs::remove_file(folder.join(STOP));
}

/// What became of a request to end.
#[derive(Debug)]
pub enum StopOutcome {
    /// Nobody runs the campaign.
    Nobody,
    /// The runner has ended.
    Ended,
    /// Somebody has the lock, and has not answered in time.
    NoAnswer,
    /// What is in the folder shows nothing, since others may write there, or it takes no request. A runner that could
    /// be asked has been.
    Unknown(Failure),
}

/// Asks the runner to end in the safe state, by a file in the campaign's folder, and waits until it has ended. It may
/// run as another process of this user anywhere, in a container too. In a folder where others may write, it is waited
/// for a moment only: they can make it seem to live, or to have answered.
///
/// # Errors
/// If it has answered and does not end within `timeout`.
pub fn stop(folder: &Path, timeout: Duration) -> Result<StopOutcome, Failure> {
    if !folder.exists() {
        return Ok(StopOutcome::Nobody);
    }
    let mut trusted = check_own_folder(folder).map_err(|error| Failure::io("looking into", folder, &error));
    // If a lock cannot be inspected, it is not known whether a runner holds it: it is asked.
    let runs = || runner_pid(folder).map_or(true, |pid| pid.is_some());
    if !runs() {
        return Ok(trusted.map_or_else(StopOutcome::Unknown, |()| StopOutcome::Nobody));
    }
    let request = folder.join(STOP);
    let asked = write_request(folder).map_err(|error| Failure::io("writing", &request, &error));
    trusted = trusted.and(asked);
    let begun = Instant::now();
    while runs() {
        if trusted.is_err() && begun.elapsed() > ANSWER.min(timeout) {
            break;
        }
        let is_answered = !request.exists();
        if !is_answered && begun.elapsed() > ANSWER {
            return Ok(StopOutcome::NoAnswer);
        }
        if begun.elapsed() > timeout {
            let message = format!(
                "its runner is on its way into the safe state, but has not ended within {} s; look at the instruments, \
                 then end its process",
                timeout.as_secs()
            );
            return Err(Failure::new(Exit::Failed, message));
        }
        thread::sleep(RETRY_PAUSE);
    }
    if let Err(failure) = trusted {
        return Ok(StopOutcome::Unknown(failure));
    }
    answer_stop(folder);
    Ok(StopOutcome::Ended)
}

/// Writes the request, unless there is one already. A file of that name is never opened, since another user may have
/// made it.
fn write_request(folder: &Path) -> io::Result<()> {
    let path = output_place(&output_place(folder)?.join(STOP))?;
    match OpenOptions::new().write(true).create_new(true).mode(OWN).open(path) {
        Ok(mut file) => writeln!(file, "{}", process::id()),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(()),
        Err(error) => Err(error),
    }
}
