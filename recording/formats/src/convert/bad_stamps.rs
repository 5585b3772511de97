//! The stamps that were bad: how many of each kind, where the first is, and what was done with them.

use super::rhythm::HANDFUL;
use isotherm_support::finding::{Finding, name};
use std::fmt;

/// What is wrong with a stamp.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum BadStamp {
    /// That of a neighbour.
    Repeated,
    Zero,
    Back,
    Ahead,
    /// Right, but the rows are not in order.
    Overtaken,
}

/// What was done with its row.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Remedy {
    /// It got a time between its neighbours'.
    Fixed,
    /// It was put in order.
    Sorted,
    LeftOut,
}

/// The kinds in the order of their counts, in words.
const KINDS: [(BadStamp, &str); 5] = [
    (BadStamp::Repeated, "the stamp of a neighbour"),
    (BadStamp::Zero, "the stamp 0"),
    (BadStamp::Back, "a stamp that goes back"),
    (BadStamp::Ahead, "a stamp that is ahead"),
    (BadStamp::Overtaken, "a stamp that is out of order"),
];
/// One of so many rows may have a bad stamp.
const ONE_OF: u64 = 100;

/// A stamp that does not follow another one, and where.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) struct Spot {
    /// Line, or number of a message.
    pub place: u64,
    pub stamp_ns: u64,
    /// Of the row before; `None` for the first row.
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

/// The counts of a series.
#[derive(Clone, Debug, Default)]
pub(super) struct StampTally {
    /// In the order of [`KINDS`].
    counts: [u64; KINDS.len()],
    fixed: u64,
    sorted: u64,
    left_out: u64,
    /// Rows with the stamp of a neighbour, where the step behind them has exactly their place. They do no harm.
    placed: u64,
    first: Option<Spot>,
    /// Rows that are there twice, and the place of the first.
    twice: u64,
    first_twice: u64,
    /// How often the clock started again, and where first.
    restarts: u64,
    first_restart: Option<Spot>,
}

impl StampTally {
    /// Counts a bad stamp.
    pub(super) fn take(&mut self, kind: BadStamp, remedy: Remedy, spot: Spot) {
        let index = KINDS.iter().position(|(of, _)| *of == kind).unwrap_or(0);
        self.counts[index] += 1;
        match remedy {
            Remedy::Fixed => self.fixed += 1,
            Remedy::Sorted => self.sorted += 1,
            Remedy::LeftOut => self.left_out += 1,
        }
        self.placed += u64::from((kind, remedy) == (BadStamp::Repeated, Remedy::Fixed));
        if self.first.is_none_or(|first| spot.place < first.place) {
            self.first = Some(spot);
        }
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

    fn bad(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// Whether more than one of `one_of` rows has a bad stamp that the rows around it do not fully show. A single one
    /// is none too many.
    pub(super) fn is_over(&self, rows: u64, one_of: u64) -> bool {
        // One in a shorter text, but not where a handful of rows says nothing about the others.
        let rows = if rows < HANDFUL as u64 { rows } else { rows.max(one_of) };
        (self.bad() - self.placed).saturating_mul(one_of) > rows
    }

    /// Why the rows cannot be used, and the place; `remedy` is what the user can do. `None` if they can.
    pub(super) fn refusal(&self, rows: u64, name: &PlaceName<'_>, remedy: &str) -> Option<(u64, String)> {
        let first = self.first.filter(|_| self.is_over(rows, ONE_OF))?;
        Some((first.place, format!("{}, over 1 %, so the times cannot be fixed; {remedy}", self.told(rows, name)?)))
    }

    /// The counts, and the first one, in a line.
    fn told(&self, rows: u64, name: &PlaceName<'_>) -> Option<String> {
        let first = self.first?;
        let kinds = KINDS.iter().zip(self.counts).filter(|(_, count)| *count > 0);
        let kinds = kinds.map(|((_, words), count)| format!("{count} {words}")).collect::<Vec<_>>().join(", ");
        let (bad, have) = (self.bad(), if self.bad() == 1 { "has a bad stamp" } else { "have bad stamps" });
        Some(format!("{bad} of {rows} rows {have}: {kinds}; the first is {}, {first}", name(first.place)))
    }

    /// What was done, for the user. `name` gives the name of a place.
    pub(super) fn findings(&self, rows: u64, name: &PlaceName<'_>, session: u64) -> Vec<Finding> {
        let done = [
            (
                self.fixed,
                ["gets a time between those of its neighbours", "get a time between those of their neighbours"],
            ),
            (self.sorted, ["is put in order", "are put in order"]),
            (self.left_out, ["is left out", "are left out"]),
        ];
        let done = done.iter().filter(|(count, _)| *count > 0);
        let done = done.map(|(count, [one, several])| format!("{count} {}", if *count == 1 { one } else { several }));
        let done = done.collect::<Vec<_>>().join(", ");
        let bad = self.told(rows, name).map(|told| format!("{told}; {done}"));
        let twice = (self.twice > 0).then(|| {
            let Self { twice, first_twice, .. } = self;
            format!(
                "{twice} of {rows} rows repeat the stamp and the values of an earlier one, the first is {}: \
                 repeated rows are left out",
                name(*first_twice)
            )
        });
        let stamps = bad.into_iter().chain(twice).collect::<Vec<_>>().join("; ");
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
