//! The account of the bad rows: how many of each kind, and when.

use core::ops::Range;

/// Bad rows that are reported one by one, at most.
const MOST: usize = 1 << 20;

/// Why a row is bad.
#[derive(Clone, Copy, Debug, Eq, Ord, PartialEq, PartialOrd)]
pub enum BadKind {
    /// A value that is no number, or a counter that is full.
    NoNumber,
    /// A temperature that no IMU has, or that jumps there and back.
    Temperature,
    /// A value that leaves its neighbours by far, and is the same in several places: what a program writes where it has
    /// no value.
    Marker,
    /// A value that leaves its neighbours by far.
    Spike,
    /// A value that stands still where the channel never repeats one.
    Stuck,
}

impl BadKind {
    /// All kinds.
    pub const ALL: [Self; 5] = [Self::NoNumber, Self::Temperature, Self::Marker, Self::Spike, Self::Stuck];

    /// A word for tables and JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NoNumber => "no-number",
            Self::Temperature => "impossible-temperature",
            Self::Marker => "marker",
            Self::Spike => "spike",
            Self::Stuck => "stuck-value",
        }
    }

    /// `1 spike`, `5 spikes`.
    #[must_use]
    pub fn counted(self, count: usize) -> String {
        let [one, many] = match self {
            Self::NoNumber => ["row without a number", "rows without a number"],
            Self::Temperature => ["impossible temperature", "impossible temperatures"],
            Self::Marker => ["marker", "markers"],
            Self::Spike => ["spike", "spikes"],
            Self::Stuck => ["stuck value", "stuck values"],
        };
        format!("{count} {}", if count == 1 { one } else { many })
    }
}

/// A bad row.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct BadRow {
    /// Its `timestamp_ns`.
    pub time_ns: u64,
    /// Why it is bad.
    pub kind: BadKind,
}

/// The bad rows of a recording, in order of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BadRows {
    rows: Vec<BadRow>,
    /// Bad rows that are not listed any more.
    more: usize,
}

impl BadRows {
    pub(super) fn add(&mut self, time_ns: u64, kind: BadKind) {
        match self.rows.len() {
            MOST => self.more += 1,
            _ => self.rows.push(BadRow { time_ns, kind }),
        }
    }

    /// The rows, in order of time.
    #[must_use]
    pub fn rows(&self) -> &[BadRow] {
        &self.rows
    }

    /// Number of bad rows.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.rows.len() + self.more
    }

    /// Whether no row is bad.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The bad rows within these times \[ns\], which are in order.
    #[must_use]
    pub fn within(&self, times: &[Range<u64>]) -> Self {
        let is_within = |row: &&BadRow| {
            let after = times.partition_point(|time| time.end <= row.time_ns);
            times.get(after).is_some_and(|time| time.contains(&row.time_ns))
        };
        Self { rows: self.rows.iter().filter(is_within).copied().collect(), more: self.more }
    }

    /// The bad rows that are not within these times \[ns\], which are in order.
    #[must_use]
    pub fn without(&self, times: &[Range<u64>]) -> Self {
        let within = self.within(times);
        let is_left = |row: &&BadRow| within.rows.binary_search_by_key(&row.time_ns, |row| row.time_ns).is_err();
        Self { rows: self.rows.iter().filter(is_left).copied().collect(), more: self.more }
    }

    /// The times in which so many rows are off that the IMU moved: `most` or more within `window_ns` \[ns\].
    #[must_use]
    pub fn dense(&self, most: usize, window_ns: u64) -> Vec<Range<u64>> {
        let off: Vec<u64> = self.rows.iter().filter(|row| row.kind == BadKind::Spike).map(|row| row.time_ns).collect();
        let mut dense: Vec<Range<u64>> = Vec::new();
        for ends in off.windows(most).filter(|rows| rows[most - 1] - rows[0] <= window_ns) {
            match dense.last_mut() {
                Some(last) if ends[0] <= last.end => last.end = ends[most - 1] + 1,
                _ => dense.push(ends[0]..ends[most - 1] + 1),
            }
        }
        dense
    }

    /// Number of rows of each kind that there is.
    #[must_use]
    pub fn counts(&self) -> Vec<(BadKind, usize)> {
        let count = |kind: BadKind| (kind, self.rows.iter().filter(|row| row.kind == kind).count());
        BadKind::ALL.into_iter().map(count).filter(|(_, count)| *count > 0).collect()
    }

    /// First and last time of each group of bad rows of a kind that follow each other within `gap_ns` \[ns\].
    #[must_use]
    pub fn groups(&self, kind: BadKind, gap_ns: u64) -> Vec<[u64; 2]> {
        let mut groups: Vec<[u64; 2]> = Vec::new();
        for row in self.rows.iter().filter(|row| row.kind == kind) {
            match groups.last_mut() {
                Some([_, last]) if row.time_ns - *last <= gap_ns => *last = row.time_ns,
                _ => groups.push([row.time_ns; 2]),
            }
        }
        groups
    }
}
