//! The queue of messages that another part of the program receives.

use isotherm_shared::wire::AXES;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Messages that may wait: 2 s at 2 kHz.
const QUEUE: usize = 4096;
/// One message of a device, or a part of one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceMessage {
    /// When it came, on `CLOCK_MONOTONIC` \[ns\].
    pub arrived_ns: u64,
    /// Its own stamp, on `CLOCK_MONOTONIC` \[ns\].
    pub stamp_ns: u64,
    /// Specific force \[m/s2\].
    pub specific_force: [f64; AXES],
    /// Angular rate \[rad/s\]; not used where the device has no gyroscopes.
    pub angular_rate: [f64; AXES],
    /// A temperature that has come since the message before, in the table's unit.
    pub temperature: Option<f64>,
}

/// What the stamps of messages are.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum MessageStamps {
    /// When the device sampled: they show how many periods have passed.
    Sample,
    /// When the driver received, which is late by what the line makes of it: a line through them is the time.
    Arrival,
}

/// Hands messages to an acquisition in another thread. A clone is the same queue.
#[derive(Clone, Debug, Default)]
pub struct MessageQueue(Arc<QueueState>);

#[derive(Debug, Default)]
struct QueueState {
    messages: Mutex<VecDeque<DeviceMessage>>,
    pushed: Condvar,
}

impl MessageQueue {
    /// Adds a message. Returns whether there was room: one without is lost.
    #[must_use]
    pub fn push(&self, message: DeviceMessage) -> bool {
        let mut messages = self.lock();
        let has_room = messages.len() < QUEUE;
        if has_room {
            messages.push_back(message);
            self.0.pushed.notify_one();
        }
        has_room
    }

    /// Waits up to `longest` until there is one.
    pub(crate) fn wait(&self, longest: Duration) {
        let messages = self.lock();
        // The result is not used: a read shows what there is.
        let _ = self.0.pushed.wait_timeout_while(messages, longest, |messages| messages.is_empty());
    }

    pub(crate) fn pop(&self) -> Option<DeviceMessage> {
        self.lock().pop_front()
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<DeviceMessage>> {
        self.0.messages.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
