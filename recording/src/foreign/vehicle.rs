//! What the vehicle did by its own log.

use std::ops::Range;

/// When the vehicle was armed and when it flew, by its own log.
///
/// Times are those of the rows \[ns\]. The ranges are in order and do not touch each other. Where the log begins or
/// ends within one, it begins at 0 or ends at [`u64::MAX`]. There are none where the log does not say.
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

/// In order, and those that touch are joined.
#[must_use]
pub fn union(mut ranges: Vec<Range<u64>>) -> Vec<Range<u64>> {
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
