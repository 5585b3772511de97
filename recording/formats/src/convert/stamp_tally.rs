//! What was done by the stamps of rows: how many rows are left out, and where clocks start again.

use isotherm_support::finding::{Finding, name};
use std::fmt;

/// If more than one of so many rows is left out, the stamps are in no order.
const ONE_OF: u64 = 2;

/// A stamp that does not follow another one, and where.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) struct Spot {
    /// Line, or number of a message.
    pub place: u64,
    pub stamp_ns: u64,
    /// Of the last row that is used; `None` for the first row.
    pub before_ns: Option<u64>,
}

impl fmt::Display for Spot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ns", self.stamp_ns)?;
        self.before_ns.map_or(Ok(()), |before_ns| write!(f, " after {before_ns} ns"))
    }
}

/// Gives the name of a place.
pub(super) type PlaceName<'a> = dyn Fn(u64) -> String + 'a;

/// The counts of a series, and where each begins.
#[derive(Clone, Debug, Default)]
pub(super) struct StampTally {
    left_out: u64,
    first: Option<Spot>,
    /// Rows that are there twice, and the place of the first.
    twice: u64,
    first_twice: u64,
    /// How often the clock started again, and where first.
    restarts: u64,
    first_restart: Option<Spot>,
}

impl StampTally {
    /// Counts a row that is left out by its stamp.
    pub(super) fn leave_out(&mut self, spot: Spot) {
        self.left_out += 1;
        self.first.get_or_insert(spot);
    }

    /// Counts a row that is there twice.
    pub(super) fn take_twice(&mut self, place: u64) {
        if self.twice == 0 {
            self.first_twice = place;
        }
        self.twice += 1;
    }

    /// Counts a clock that starts again.
    pub(super) fn take_restart(&mut self, spot: Spot) {
        self.restarts += 1;
        self.first_restart.get_or_insert(spot);
    }

    /// Number of rows that are left out by their stamps. Repeated rows are not among them.
    pub(super) const fn left_out(&self) -> u64 {
        self.left_out
    }

    /// Why the rows cannot be used, and the place; `remedy` is what the user can do. `None` if they can.
    pub(super) fn refusal(&self, rows: u64, name: &PlaceName<'_>, remedy: &str) -> Option<(u64, String)> {
        let first = self.first.filter(|_| self.left_out.saturating_mul(ONE_OF) > rows)?;
        Some((first.place, format!("{}: the stamps are in no order; {remedy}", self.words(rows, name)?)))
    }

    /// The rows that are left out, and the first one, in a line.
    fn words(&self, rows: u64, name: &PlaceName<'_>) -> Option<String> {
        let (first, left_out) = (self.first?, self.left_out);
        let share = left_out as f64 / rows as f64 * 100.0;
        let have = if left_out == 1 { "row has a stamp" } else { "rows have stamps" };
        Some(format!(
            "{left_out} {have} that cannot be right, {share:.2} % of {rows}; the first is {}, {first}",
            name(first.place)
        ))
    }

    /// What was done, for the user. `name` gives the name of a place.
    pub(super) fn findings(&self, rows: u64, name: &PlaceName<'_>, session: u64) -> Vec<Finding> {
        let left_out = self.words(rows, name).map(|words| format!("{words}; what is left out is missing"));
        let twice = (self.twice > 0).then(|| {
            let Self { twice, first_twice, .. } = self;
            format!(
                "{twice} of {rows} rows repeat the stamp and the values of an earlier one, the first is {}: \
                 repeated rows are left out",
                name(*first_twice)
            )
        });
        let stamps = left_out.into_iter().chain(twice).collect::<Vec<_>>().join("; ");
        let stamps = (!stamps.is_empty()).then(|| Finding::warning(name::STAMPS, stamps));
        let restart = self.first_restart.map(|spot| {
            let again =
                if self.restarts > 1 { format!(", and {} times more", self.restarts - 1) } else { String::new() };
            let message = format!(
                "the clock starts again at {}, at {spot}{again}: the rows from there on are session {}",
                name(spot.place),
                session + 1
            );
            Finding::warning(name::NEW_SESSION, message)
        });
        stamps.into_iter().chain(restart).collect()
    }
}
