//! What the vehicle did by its own log: when it was armed, and when it flew.
//!
//! Sources: PX4's messages `vehicle_status`, `actuator_armed` and `vehicle_land_detected`; ArduPilot's pages of log
//! messages, for `EV`, `ARM` and `STAT`. Some messages say how it is, and come again and again. Others say that it
//! changed: before the first of those it was the contrary.

use isotherm_recording::foreign::{VehicleState, union};
use std::collections::BTreeMap;
use std::ops::Range;

/// Most changes that are kept of each message.
const MAX_CHANGES: usize = 1 << 16;

/// What a message says of the vehicle.
#[derive(Clone, Copy, Debug, Eq, Hash, Ord, PartialEq, PartialOrd)]
pub(super) enum Aspect {
    Armed,
    Flying,
}

/// A message about the vehicle.
#[derive(Clone, Copy, Debug)]
pub(super) struct VehicleReport {
    pub(super) aspect: Aspect,
    pub(super) time_us: u64,
    pub(super) holds: bool,
    /// Whether it did not hold, or held, before.
    pub(super) is_change: bool,
}

/// What all messages say.
#[derive(Debug, Default)]
pub(super) struct Reports {
    /// By aspect and message.
    changes: BTreeMap<(Aspect, &'static str), Vec<(u64, bool)>>,
}

impl Reports {
    /// Takes what the message `name` says.
    pub(super) fn take(&mut self, name: &'static str, report: VehicleReport) {
        let VehicleReport { aspect, time_us, holds, is_change } = report;
        let changes = self.changes.entry((aspect, name)).or_default();
        if changes.is_empty() {
            changes.push((0, holds != is_change));
        }
        if changes.len() < MAX_CHANGES && changes.last().is_some_and(|(_, before)| *before != holds) {
            changes.push((time_us, holds));
        }
    }

    /// The state, of a log whose last row is at this time.
    pub(super) fn state(&self, last_us: u64) -> VehicleState {
        let of = |wanted: Aspect| {
            let all = self.changes.iter().filter(|((aspect, _), _)| *aspect == wanted);
            union(all.flat_map(|(_, changes)| ranges(changes, last_us)).collect())
        };
        VehicleState { armed: of(Aspect::Armed), flying: of(Aspect::Flying) }
    }
}

/// The times \[ns\] at which changes say that something holds. A time that falls, or is behind the last row, is that of
/// the change before, or of the row: the message is damaged.
fn ranges(changes: &[(u64, bool)], last_us: u64) -> Vec<Range<u64>> {
    let mut ranges: Vec<Range<u64>> = Vec::new();
    let mut latest_us = 0;
    for (time_us, holds) in changes {
        latest_us = latest_us.max((*time_us).min(last_us));
        let time_ns = latest_us.saturating_mul(1000);
        match (holds, ranges.last_mut()) {
            (true, _) => ranges.push(time_ns..u64::MAX),
            (false, Some(range)) => range.end = time_ns,
            (false, None) => {}
        }
    }
    ranges
}
