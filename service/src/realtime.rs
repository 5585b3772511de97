//! What the worker asks of the operating system: a core, a priority, resident memory, precise and interruptible sleep.
//!
//! The only unsafe code of the service. Each setting is optional and fails with the reason and the remedy.
#![expect(
    unsafe_code,
    reason = "SCHED_FIFO has no safe binding, and iceoryx2 gives a listener's descriptor as a number"
)]

use crate::config::Realtime;
use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::{FileDescriptorBased as _, ipc};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::BorrowedFd;
use rustix::io::Errno;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::thread::{CpuSet, sched_setaffinity, set_current_timer_slack};
use std::io;
use std::num::NonZeroU64;

/// Applies the settings to the calling thread (the memory lock to the process). Timer slack is always made small, so
/// that a sleep ends when it should.
///
/// # Errors
/// Which setting failed, why, and what would help.
pub fn apply(settings: &Realtime) -> Result<(), String> {
    // 50 us by default; a kernel that refuses only makes sleeps end later.
    let _ = set_current_timer_slack(NonZeroU64::new(1));
    if let Some(core) = settings.core {
        let mut set = CpuSet::new();
        set.set(core);
        sched_setaffinity(None, &set).map_err(|error| {
            format!(
                "realtime.core: binding to core {core}: {error}; give a core that exists and that this process may use"
            )
        })?;
    }
    if let Some(priority) = settings.priority {
        set_fifo(priority).map_err(|error| {
            format!(
                "realtime.priority: SCHED_FIFO {priority}: {error}; grant CAP_SYS_NICE (systemd: AmbientCapabilities=CAP_SYS_NICE) or LimitRTPRIO={priority}"
            )
        })?;
    }
    if settings.lock_memory {
        mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE)
            .map_err(|error| format!("realtime.lock_memory: {error}; grant CAP_IPC_LOCK or LimitMEMLOCK=infinity"))?;
    }
    Ok(())
}

fn set_fifo(priority: i32) -> io::Result<()> {
    let parameters = libc::sched_param { sched_priority: priority };
    // SAFETY: a plain system call on the calling thread (0) that reads one structure, which lives through the call.
    let result = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameters) };
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Several listeners to sleep on at once.
pub struct Bells<'a>(Vec<PollFd<'a>>);

impl<'a> Bells<'a> {
    /// Borrows the listeners.
    pub fn new(listeners: &'a [Listener<ipc::Service>]) -> Self {
        let poll_fd = |listener: &'a Listener<ipc::Service>| {
            // SAFETY: the descriptor stays open as long as the listener, which is borrowed for 'a, and is only polled.
            let descriptor = unsafe { BorrowedFd::borrow_raw(listener.file_descriptor().native_handle()) };
            PollFd::from_borrowed_fd(descriptor, PollFlags::IN)
        };
        Self(listeners.iter().map(poll_fd).collect())
    }

    /// Sleeps until one of them is notified, but at most `time` \[ns\]. Whether the time ran out.
    pub fn sleep(&mut self, time: u64) -> bool {
        let time = Timespec { tv_sec: (time / 1_000_000_000) as i64, tv_nsec: (time % 1_000_000_000) as i64 };
        match poll(&mut self.0, Some(&time)) {
            Ok(ready) => ready == 0,
            Err(Errno::INTR) => false,
            // Nothing that anybody could do here; only do not turn it into a busy loop.
            Err(_) => {
                std::thread::sleep(std::time::Duration::from_millis(1));
                false
            }
        }
    }
}
