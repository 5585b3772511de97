//! Damaged places of a recording, which are left out and counted.

use isotherm_support::finding::{Finding, Severity, name};

/// One of so many rows may be damaged.
const ONE_OF: u64 = 20;

/// What is damaged in a recording. Rows behind a damaged place keep their own times.
#[derive(Clone, Debug, PartialEq)]
pub struct DamagedPlaces {
    /// What the recording has: rows or messages.
    of: &'static str,
    count: u64,
    first: Option<DamagedPlace>,
}

/// A damaged place.
#[derive(Clone, Debug, PartialEq)]
struct DamagedPlace {
    /// Its line or byte.
    place: String,
    before: RowsBefore,
    cause: String,
}

/// The rows of a recording up to a place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RowsBefore {
    count: u64,
    first_ns: u64,
    last_ns: u64,
}

impl RowsBefore {
    /// Counts a whole row of this time \[ns\].
    pub const fn take(&mut self, time_ns: u64) {
        if self.count == 0 {
            self.first_ns = time_ns;
        }
        self.last_ns = time_ns;
        self.count += 1;
    }

    /// Whether there is none.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.count == 0
    }
}

impl Default for DamagedPlaces {
    fn default() -> Self {
        Self::of("row")
    }
}

impl DamagedPlaces {
    /// Of a recording that has such rows, as messages name them.
    #[must_use]
    pub const fn of(of: &'static str) -> Self {
        Self { of, count: 0, first: None }
    }

    /// Whether nothing is damaged.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Counts a place: `place` names its line or byte, and `cause` says what is wrong there.
    pub fn take(&mut self, place: String, before: RowsBefore, cause: String) {
        self.count += 1;
        self.first.get_or_insert(DamagedPlace { place, before, cause });
    }

    /// What was left out of a recording with these rows; `None` if nothing is damaged. It is a fault where there is
    /// more than one damaged place in 20 rows.
    #[must_use]
    pub fn finding(&self, whole: RowsBefore) -> Option<Finding> {
        let DamagedPlace { place, before, cause } = self.first.as_ref()?;
        let places = if self.count == 1 { "1 damaged place is" } else { &format!("{} damaged places are", self.count) };
        let seconds = before.last_ns.saturating_sub(before.first_ns) as f64 * 1e-9;
        let behind = match before.count {
            0 => format!("before the first whole {}", self.of),
            count => format!("behind {} {count}, {seconds:.4} s after the first", self.of),
        };
        let message = format!("{places} left out; the first is {place}, {behind}: {cause}");
        let is_few = self.count <= (whole.count + self.count) / ONE_OF;
        let severity = if is_few || self.count == 1 { Severity::Warning } else { Severity::Fault };
        Some(Finding::whole(severity, name::BAD_ROWS, message))
    }
}
