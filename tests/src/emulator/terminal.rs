//! The device's end of a pseudo-terminal.

use super::time::{FULL, LOOK, now_ns, sleep_until, wait, wait_to_hear};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, open};
use rustix::io::{Errno, ioctl_fionbio, ioctl_fionread};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::ffi::OsString;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStringExt as _;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;
use std::{fs, io};

/// How long a reader may take to set the line up after it has opened it \[s\].
const SET_UP_S: f64 = 1.0;
/// The rate of a line that no reader has set up \[Bd\].
const UNUSUAL: u32 = 50;

/// The device's end of a pseudo-terminal.
pub(super) struct Terminal {
    controller: OwnedFd,
    path: PathBuf,
    link: Option<PathBuf>,
}

impl Terminal {
    pub(super) fn new(link: Option<PathBuf>) -> io::Result<Self> {
        let controller = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&controller)?;
        unlockpt(&controller)?;
        ioctl_fionbio(&controller, true)?;
        let path = PathBuf::from(OsString::from_vec(ptsname(&controller, Vec::new())?.into_bytes()));
        // Closed at once: from then on the controller shows whether a reader has the other end open.
        let user_side = open_user_side(&path)?;
        let mut settings = tcgetattr(&user_side)?;
        settings.make_raw();
        settings.set_speed(UNUSUAL)?;
        tcsetattr(&user_side, OptionalActions::Now, &settings)?;
        if let Some(link) = &link {
            let _ = fs::remove_file(link);
            symlink(&path, link)?;
        }
        Ok(Self { controller, path, link })
    }

    pub(super) fn name(&self) -> String {
        self.link.as_deref().unwrap_or(&self.path).display().to_string()
    }

    fn has_reader(&self) -> bool {
        !self.poll(PollFlags::empty(), Duration::ZERO).contains(PollFlags::HUP)
    }

    fn poll(&self, events: PollFlags, patience: Duration) -> PollFlags {
        let mut polled = [PollFd::new(&self.controller, events)];
        let patience = Timespec { tv_sec: patience.as_secs() as i64, tv_nsec: patience.subsec_nanos().into() };
        match poll(&mut polled, Some(&patience)) {
            Ok(_) => polled[0].revents(),
            Err(_) => PollFlags::empty(),
        }
    }

    pub(super) fn wait_for_reader(&self, seconds: f64, ended: &AtomicBool) -> bool {
        // What comes while a line is set up is discarded. A reader that sets no rate has nothing to set up.
        wait(seconds, ended, || self.has_reader()) && {
            wait(SET_UP_S, ended, || self.is_set_up());
            true
        }
    }

    /// Whether the reader has given the line its rate.
    fn is_set_up(&self) -> bool {
        tcgetattr(&self.controller).is_ok_and(|settings| settings.output_speed() != UNUSUAL)
    }

    /// What the reader has said, for which it is waited until this moment and a little at most.
    pub(super) fn hear(&self, moment_ns: u64) -> Vec<u8> {
        let mut bytes = vec![0; 1024];
        let is_heard = wait_to_hear(&self.controller, moment_ns);
        let count = if is_heard { rustix::io::read(&self.controller, &mut bytes).unwrap_or(0) } else { 0 };
        bytes.truncate(count);
        bytes
    }

    pub(super) fn write(&self, bytes: &[u8], ended: &AtomicBool) -> usize {
        let (mut taken, deadline) = (0, now_ns() + FULL.as_nanos() as u64);
        while taken < bytes.len() && self.has_reader() && !ended.load(Ordering::Relaxed) {
            match rustix::io::write(&self.controller, &bytes[taken..]) {
                Ok(count) => taken += count,
                Err(Errno::AGAIN) if now_ns() < deadline => {
                    self.poll(PollFlags::OUT, LOOK);
                }
                Err(Errno::INTR) => {}
                Err(_) => break,
            }
        }
        taken
    }

    /// Waits until the reader has taken what was written: what it has not is lost when the controller closes.
    pub(super) fn drain(&self, ended: &AtomicBool) {
        let deadline = now_ns() + FULL.as_nanos() as u64;
        let Ok(user_side) = open_user_side(&self.path) else {
            // Only a reader may have it.
            sleep_until(now_ns() + 100_000_000, ended);
            return;
        };
        let mut empty = 0;
        // Between the terminal's ends is another buffer, which nothing shows.
        while empty < 100 && now_ns() < deadline && !ended.load(Ordering::Relaxed) {
            thread::sleep(Duration::from_millis(5));
            empty = if ioctl_fionread(&user_side).unwrap_or(0) == 0 { empty + 1 } else { 0 };
        }
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        if let Some(link) = &self.link
            && fs::read_link(link).is_ok_and(|target| target == self.path)
        {
            let _ = fs::remove_file(link);
        }
    }
}

fn open_user_side(path: &Path) -> io::Result<OwnedFd> {
    Ok(open(path, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?)
}
