//! Sleeping until the sender of any IMU of the worker notifies, or until a time has passed.
#![expect(unsafe_code, reason = "iceoryx2 gives a listener's descriptor as a number")]

use crate::worker::wait::BOUND_NS;
use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::FileDescriptorBased as _;
use isotherm_shared::stream::Ipc;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::BorrowedFd;
use rustix::io::Errno;
use std::thread;
use std::time::Duration;

/// The wake-up listeners of a worker's IMUs.
pub struct WakeListeners<'a> {
    listeners: &'a [Listener<Ipc>],
    descriptors: Vec<PollFd<'a>>,
    /// When all listeners were last drained \[ns\].
    drained: u64,
}

impl<'a> WakeListeners<'a> {
    /// Prepares the listeners for polling.
    pub fn new(listeners: &'a [Listener<Ipc>]) -> Self {
        let poll_fd = |listener: &'a Listener<Ipc>| {
            // SAFETY: the descriptor stays open as long as the listener, which is borrowed for 'a, and is only polled.
            let descriptor = unsafe { BorrowedFd::borrow_raw(listener.file_descriptor().native_handle()) };
            PollFd::from_borrowed_fd(descriptor, PollFlags::IN)
        };
        Self { listeners, descriptors: listeners.iter().map(poll_fd).collect(), drained: 0 }
    }

    /// Sleeps from `now` \[ns\] until a listener is notified, but at most for `time` \[ns\].
    ///
    /// Notified listeners are drained, so that they can be notified again. After a lost wake-up the transport takes a listener
    /// for notified, and its sender does not notify it again; therefore all listeners are drained once in [`BOUND_NS`].
    pub fn sleep(&mut self, now: u64, time: u64) {
        let timeout = Timespec { tv_sec: (time / 1_000_000_000) as i64, tv_nsec: (time % 1_000_000_000) as i64 };
        let notified = match poll(&mut self.descriptors, Some(&timeout)) {
            Ok(notified) => notified,
            Err(Errno::INTR) => return,
            // The error cannot be handled here; a pause keeps the loop from spinning.
            Err(_) => {
                thread::sleep(Duration::from_millis(1));
                return;
            }
        };
        let all = now.saturating_sub(self.drained) >= BOUND_NS;
        if all {
            self.drained = now;
        }
        if all || notified > 0 {
            for (listener, descriptor) in self.listeners.iter().zip(&self.descriptors) {
                if all || !descriptor.revents().is_empty() {
                    let _ = listener.try_wait(|_| {});
                }
            }
        }
    }
}
