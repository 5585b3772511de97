//! The lock that allows one runner in a folder, and how other processes inspect and stop this runner.

use super::progress::{STATUS, Snapshot};
use isotherm_failure::{Exit, Failure, shown};
use isotherm_files::{check_own_folder, open_without_waiting};
use isotherm_shared::document::MAX_BYTES;
use rustix::fs::OFlags;
use rustix::process::{Pid, Signal, kill_process};
use std::fs::{File, OpenOptions, Permissions, TryLockError};
use std::io::{self, Read as _, Seek as _, Write as _};
use std::os::unix::fs::{OpenOptionsExt as _, PermissionsExt as _};
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

/// The lock file in the campaign's folder: locked while a runner lives, and contains the runner's process id.
const LOCK: &str = "runner.lock";
/// Permissions of the lock file: another user who could read it could lock it for ever.
const OWN: u32 = 0o600;
/// How long a new runner retries the lock: a process that inspects the folder holds it for a shorter time.
const LOCK_PATIENCE: Duration = Duration::from_millis(500);
/// Pause between two attempts.
const RETRY_PAUSE: Duration = Duration::from_millis(20);
/// The reason of the safe state that `campaign stop` brings about after a runner that ended without it.
pub const STOPPED_WITHOUT_RUNNER: &str = "requested after its runner had ended without";

/// Exclusive ownership of the campaign's folder, until this value is dropped or the process ends.
pub struct Lock {
    _file: File,
}

impl Lock {
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
        // Earlier versions let everybody read it.
        file.set_permissions(Permissions::from_mode(OWN)).map_err(failed)?;
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
            writeln!(file, "{}", std::process::id())
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

/// Asks the runner to end in the safe state and waits until it has ended. Returns whether there was a runner.
///
/// # Errors
/// If it does not end within `timeout`, or others may write into the folder: they could name any process there.
pub fn stop(folder: &Path, timeout: Duration) -> Result<bool, Failure> {
    if !folder.exists() {
        return Ok(false);
    }
    check_own_folder(folder).map_err(|error| Failure::io("looking into", folder, &error))?;
    let Some(pid) = runner_pid(folder)? else { return Ok(false) };
    // The signal fails if the runner has just ended by itself, which is fine.
    let _ = Pid::from_raw(pid).map(|pid| kill_process(pid, Signal::TERM));
    let begun = Instant::now();
    while runner_pid(folder)?.is_some() {
        if begun.elapsed() > timeout {
            let message = format!(
                "pid {pid} has not ended within {} s; look at the instruments, then kill -9 {pid}",
                timeout.as_secs()
            );
            return Err(Failure::new(Exit::Failed, message));
        }
        thread::sleep(RETRY_PAUSE);
    }
    Ok(true)
}
