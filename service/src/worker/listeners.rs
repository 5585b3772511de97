//! Sleeping until the sender of any IMU of the worker notifies, or until a time has passed.
//!
//! A notification is a system call of the sender, unless the event is still raised by one before. A worker that is
//! awake for a sample raises the event itself, so the sender spends no time on it, and sees its answer earlier.

use crate::worker::wait::BOUND_NS;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use isotherm_client::descriptor;
use isotherm_client::transport::ports::{lower, notify};
use isotherm_client::transport::stream::Ipc;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use std::thread;
use std::time::Duration;

/// A worker's ports of the wake-up event of one IMU.
pub struct WakePorts {
    /// Is notified by senders.
    pub listener: Listener<Ipc>,
    /// Raises the event while the worker is awake.
    pub notifier: Notifier<Ipc>,
}

/// The wake-up events of a worker's IMUs.
pub(super) struct WakeListeners<'a> {
    ports: &'a [WakePorts],
    descriptors: Vec<PollFd<'a>>,
    /// Which events this worker has raised.
    raised: Vec<bool>,
    /// When all listeners were last drained \[ns\].
    drained: u64,
}

impl<'a> WakeListeners<'a> {
    /// Prepares the listeners for polling.
    pub(super) fn new(ports: &'a [WakePorts]) -> Self {
        let poll_fd = |ports: &'a WakePorts| PollFd::from_borrowed_fd(descriptor(&ports.listener), PollFlags::IN);
        Self { ports, descriptors: ports.iter().map(poll_fd).collect(), raised: vec![false; ports.len()], drained: 0 }
    }

    /// Raises the event of an IMU: until [`lower`](Self::lower) its senders notify without a system call.
    pub(super) fn raise(&mut self, imu: usize) {
        // If it fails, the sender makes the system call.
        notify(&self.ports[imu].notifier);
        self.raised[imu] = true;
    }

    /// Lowers what was raised, before a sleep; returns whether anything was. Then a sample may have come without a
    /// notification, and the caller looks for samples once more before it sleeps.
    pub(super) fn lower(&mut self) -> bool {
        let mut any = false;
        for (ports, raised) in self.ports.iter().zip(&mut self.raised) {
            if core::mem::take(raised) {
                lower(&ports.listener);
                any = true;
            }
        }
        any
    }

    /// Sleeps from `now` \[ns\] until a listener is notified, but at most for `time` \[ns\].
    ///
    /// Notified listeners are drained, so that they can be notified again. After a lost wake-up the transport takes a
    /// listener for notified, and its sender does not notify it again; therefore all listeners are drained once in
    /// [`BOUND_NS`].
    pub(super) fn sleep(&mut self, now: u64, time: u64) {
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
            for (ports, descriptor) in self.ports.iter().zip(&self.descriptors) {
                if all || !descriptor.revents().is_empty() {
                    lower(&ports.listener);
                }
            }
        }
    }
}
