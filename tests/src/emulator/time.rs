//! The clock by which an emulator writes.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::time::{ClockId, clock_gettime};
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

/// The longest sleep before a signal is looked for.
pub(super) const LOOK: Duration = Duration::from_millis(20);
/// How long a line that is full is waited for before bytes are lost, and how long for the last bytes to be read.
pub(super) const FULL: Duration = Duration::from_secs(10);

/// The time \[ns, `CLOCK_MONOTONIC`\].
pub fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

/// Sleeps until this moment, or the end.
pub fn sleep_until(moment_ns: u64, ended: &AtomicBool) {
    loop {
        let left = Duration::from_nanos(moment_ns.saturating_sub(now_ns()));
        if left.is_zero() || ended.load(Ordering::Relaxed) {
            return;
        }
        thread::sleep(left.min(LOOK));
    }
}

/// Waits for something to be heard on a descriptor, at most until this moment and [`LOOK`].
pub(super) fn wait_to_hear(descriptor: impl AsFd, moment_ns: u64) -> bool {
    let left = Duration::from_nanos(moment_ns.saturating_sub(now_ns())).min(LOOK);
    let Ok(patience) = Timespec::try_from(left) else { return false };
    let mut polled = [PollFd::new(&descriptor, PollFlags::IN)];
    let is_heard = poll(&mut polled, Some(&patience)).is_ok() && polled[0].revents().contains(PollFlags::IN);
    // Without a reader poll returns at once.
    if !is_heard && polled[0].revents().contains(PollFlags::HUP) {
        thread::sleep(left);
    }
    is_heard
}

/// Waits until this is so, at most for so many seconds. Returns whether it was.
pub(super) fn wait(seconds: f64, ended: &AtomicBool, mut is_so: impl FnMut() -> bool) -> bool {
    let deadline = now_ns() + (seconds * 1e9) as u64;
    while !is_so() {
        if now_ns() >= deadline || ended.load(Ordering::Relaxed) {
            return false;
        }
        thread::sleep(Duration::from_millis(1));
    }
    true
}
