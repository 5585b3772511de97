//! What the vehicle did by its own log: when it was armed, and when it flew.
//!
//! Sources: PX4's messages `vehicle_status`, `actuator_armed` and `vehicle_land_detected`; ArduPilot's pages of log
//! messages, for `EV`, `ARM` and `STAT`. Some messages say how it is, and come again and again. Others say that it
//! changed: before the first of those it was the contrary.

use std::collections::BTreeMap;
use std::ops::Range;

/// Most changes that are kept of each message.
const MAX_CHANGES: usize = 1 << 16;

/// When the vehicle was armed and when it flew, by its own log.
///
/// Times are those of the rows \[ns\]. The ranges are in order and do not touch each other. Where the log begins or ends
/// within one, it begins at 0 or ends at [`u64::MAX`]. There are none where the log does not say.
#[derive(Clone, Debug, Default, Eq, PartialEq)]
pub struct VehicleState {
    /// When the motors were armed.
    pub armed: Vec<Range<u64>>,
    /// When it was not landed.
    pub flying: Vec<Range<u64>>,
}

impl VehicleState {
    /// When it was armed or flew: no row of these times is known to be at rest.
    #[must_use]
    pub fn in_use(&self) -> Vec<Range<u64>> {
        union(self.armed.iter().chain(&self.flying).cloned().collect())
    }
}

/// What a message says of the vehicle.
#[derive(Clone, Copy, Debug, Eq, Hash, Ord, PartialEq, PartialOrd)]
pub(super) enum Aspect {
    Armed,
    Flying,
}

/// A message about the vehicle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Report {
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
    pub(super) fn take(&mut self, name: &'static str, report: Report) {
        let Report { aspect, time_us, holds, is_change } = report;
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

/// In order, and those that touch are joined.
fn union(mut ranges: Vec<Range<u64>>) -> Vec<Range<u64>> {
    ranges.retain(|range| range.start < range.end);
    ranges.sort_unstable_by_key(|range| range.start);
    let mut joined: Vec<Range<u64>> = Vec::new();
    for range in ranges {
        match joined.last_mut() {
            Some(last) if range.start <= last.end => last.end = last.end.max(range.end),
            _ => joined.push(range),
        }
    }
    joined
}
