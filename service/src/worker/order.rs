//! What a worker is to do in addition to serving. The control thread writes it, the worker reads it.

use isotherm_client::sync::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;

/// The order to answer what has arrived, and to end. All others are a bit for each IMU whose readers are to be
/// notified.
pub(super) const STOP: u64 = 1 << 63;

/// It hands over no data, so its accesses need no order. An order is seen in the end, and what the worker has done is
/// visible when its thread was joined.
#[derive(Debug, Default)]
pub(super) struct WorkerOrder(AtomicU64);

impl WorkerOrder {
    pub(super) fn give(&self, order: u64) {
        self.0.store(order, Relaxed);
    }

    #[inline]
    pub(super) fn present(&self) -> u64 {
        self.0.load(Relaxed)
    }
}

#[cfg(test)]
#[cfg(isotherm_loom)]
mod explored {
    use super::*;
    use crate::worker::counters::{counters, heartbeat};
    use isotherm_client::sync::{explore, thread};
    use std::sync::Arc;

    /// A worker that announces while it is asked to, then stops. The thread that joins it knows all that it has
    /// counted.
    #[test]
    fn explored_orders_are_seen_and_what_was_done_is_visible_after_the_end() {
        explore(|| {
            let order = Arc::<WorkerOrder>::default();
            let ((mut writer, reader), (mut beat, heart)) = (counters(), heartbeat());
            let worker = {
                let order = Arc::clone(&order);
                thread::spawn(move || {
                    loop {
                        beat.beat();
                        match order.present() {
                            STOP => break,
                            0 => {}
                            awaited => assert_eq!(awaited, 0b10),
                        }
                        thread::yield_now();
                    }
                    writer.transport_failed();
                })
            };
            order.give(0b10);
            let first = heart.count();
            order.give(STOP);
            assert!(heart.count() >= first, "a heart does not beat backwards");
            worker.join().unwrap();
            assert!(heart.count() > 0);
            assert_eq!(reader.transport_errors(), 1);
        });
    }
}
