//! What the library says by itself: no call fails while a program that was cut off from the service joins it again, but
//! whoever operates the program should know.

use core::fmt::Display;
use isotherm_shared::names::ImuId;
use isotherm_support::failure::tell;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::stdio::stderr;
use tracing::dispatcher;
use tracing::subscriber::NoSubscriber;

/// Warns through `tracing`. A program that has no subscriber, as one in C or Python, gets the warning on stderr. If
/// nobody reads that, the warning is lost: it never waits.
pub(crate) fn warn(imu: &ImuId, message: impl Display) {
    tracing::warn!(imu = %imu, "{message}");
    if !dispatcher::get_default(|subscriber| subscriber.is::<NoSubscriber>()) {
        return;
    }
    let mut ready = [PollFd::from_borrowed_fd(stderr(), PollFlags::OUT)];
    if poll(&mut ready, Some(&Timespec::default())).is_ok_and(|ready| ready > 0) {
        tell("isotherm", format_args!("warning: IMU {imu}: {message}"));
    }
}
