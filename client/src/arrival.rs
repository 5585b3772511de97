//! Waiting for increments without polling.
//!
//! The service notifies the event `isotherm/<imu>/arrival` when it has published an increment, as long as anybody
//! listens to it. While nobody does, it makes no system call for it. A notification can be lost (the transport
//! suppresses it while it takes the event for raised), so every wait is bounded.
#![expect(unsafe_code, reason = "iceoryx2 gives a listener's descriptor as a number")]

use crate::error::ConnectError;
use crate::transport::stream::{INCREMENT_SUBSCRIBERS, Ipc, IpcNode, arrival_name, open_event};
use iceoryx2::port::listener::{Listener, ListenerCreateError};
use iceoryx2::prelude::FileDescriptorBased as _;
use iceoryx2::service::builder::event::EventOpenError;
use isotherm_shared::names::ImuId;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::os::fd::BorrowedFd;
use std::time::Duration;

/// Longest wait: for a notification that is lost, and until the service has seen that somebody listens.
const BOUND: Duration = Duration::from_millis(20);

/// Listens to the event of an IMU.
#[derive(Debug)]
pub(crate) struct ArrivalEvent {
    listener: Listener<Ipc>,
}

impl ArrivalEvent {
    /// Begins to listen. `None` if there is no event, as in the domain of a relay, where no service is.
    pub(crate) fn open(node: &IpcNode, imu: &ImuId) -> Result<Option<Self>, ConnectError> {
        let failed = |error: String| ConnectError::transport("opening the event of the increments", error);
        let event = match open_event(node, &arrival_name(imu)) {
            Ok(event) => event,
            Err(EventOpenError::DoesNotExist) => return Ok(None),
            Err(error) => return Err(failed(error.to_string())),
        };
        let listener = event.listener_builder().create().map_err(|error| match error {
            ListenerCreateError::ExceedsMaxSupportedListeners => {
                failed(format!("{INCREMENT_SUBSCRIBERS} processes wait for the increments of {imu} already"))
            }
            other => failed(other.to_string()),
        })?;
        Ok(Some(Self { listener }))
    }

    /// Readable while the event is raised.
    pub(crate) fn descriptor(&self) -> BorrowedFd<'_> {
        descriptor(&self.listener)
    }

    /// Waits until the event is raised, at most for `time` and at most for [`BOUND`].
    pub(crate) fn wait(&self, time: Duration) {
        let nanoseconds = time.min(BOUND).subsec_nanos();
        let timeout = Timespec { tv_sec: 0, tv_nsec: nanoseconds.into() };
        // An error, as by a signal, is as good as a notification: the caller looks for increments in any case.
        let _ = poll(&mut [PollFd::from_borrowed_fd(self.descriptor(), PollFlags::IN)], Some(&timeout));
        self.lower();
    }

    /// Lowers the event, before the caller looks for increments.
    pub(crate) fn lower(&self) {
        let _ = self.listener.try_wait(|_| {});
    }
}

/// The descriptor of a listener. It may only be polled.
#[must_use]
pub fn descriptor(listener: &Listener<Ipc>) -> BorrowedFd<'_> {
    // SAFETY: the descriptor stays open as long as the listener, which is borrowed.
    unsafe { BorrowedFd::borrow_raw(listener.file_descriptor().native_handle()) }
}
