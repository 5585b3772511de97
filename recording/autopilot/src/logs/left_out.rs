//! Rows of a log that are left out, by what is wrong with them.

use isotherm_recording::foreign::LeftOutRows;
use isotherm_support::finding::{Finding, name};
use std::collections::BTreeMap;

/// More than one of so many rows of another device is a fault; fewer are damage.
const DEVICE_FAULT: u64 = 100;

/// What is wrong with a row.
#[derive(Clone, Copy, Debug, Eq, Ord, PartialEq, PartialOrd)]
pub(super) enum Flaw {
    /// Its time is not between those of the rows around it.
    Time,
    /// It repeats the time at which the row before was sampled.
    Repeated,
    /// A value is no number, or one that no sensor has.
    Value,
    Temperature,
    /// It is of another device.
    Device,
    /// No row of the gyroscopes is near.
    NoGyroscopes,
}

/// The rows of a sensor that are left out.
#[derive(Debug, Default)]
pub(super) struct Omissions {
    /// How many, and the place of the first.
    all: BTreeMap<Flaw, (u64, u64)>,
}

impl Omissions {
    /// Leaves out the row at this place.
    pub(super) fn take(&mut self, flaw: Flaw, place: u64) {
        self.all.entry(flaw).or_insert((0, place)).0 += 1;
    }

    /// How many rows have this flaw.
    pub(super) fn count(&self, flaw: Flaw) -> u64 {
        self.all.get(&flaw).map_or(0, |(count, _)| *count)
    }

    /// A line for each flaw. `of` is the sensor, `unit` what places count.
    pub(super) fn told(&self, of: &str, unit: &str) -> Vec<String> {
        self.all.keys().map(|flaw| self.line(*flaw, of, unit)).collect()
    }

    fn line(&self, flaw: Flaw, of: &str, unit: &str) -> String {
        let (count, place) = self.all.get(&flaw).copied().unwrap_or_default();
        let first = format!("the first is at {unit} {place}");
        let rows = format!("{count} rows of {of}");
        match flaw {
            Flaw::Time => format!("{rows} have times that do not follow those of the other rows, {first}"),
            Flaw::Repeated => {
                format!("{of} stalled: {count} rows repeat the sample of the row before, at the same time; {first}")
            }
            Flaw::Value => format!("{rows} have values that no sensor gives, {first}"),
            Flaw::Temperature => format!("{rows} have no temperature, {first}"),
            Flaw::Device => format!("{rows} are of another device than most rows, {first}"),
            Flaw::NoGyroscopes => format!("{rows} have no row of the gyroscopes near them, {first}"),
        }
    }

    /// How many rows there are of all flaws.
    pub(super) fn total(&self) -> u64 {
        self.all.values().map(|(count, _)| count).sum()
    }

    /// The rows that are left out by their times, next to so many rows that are used.
    pub(super) fn by_times(&self, rows: u64) -> LeftOutRows {
        let left_out = self.count(Flaw::Time);
        LeftOutRows { rows: left_out, of: rows + left_out }
    }

    /// As findings, compared with the number of rows that are used.
    pub(super) fn findings(&self, of: &str, unit: &str, rows: u64) -> Vec<Finding> {
        let finding = |(flaw, (count, _)): (&Flaw, &(u64, u64))| {
            let share = *count as f64 / (rows + count) as f64 * 100.0;
            let message = format!("{}; they are left out, {share:.2} % of all", self.line(*flaw, of, unit));
            match flaw {
                Flaw::Repeated => Finding::warning(name::STALLED, message),
                Flaw::Device if *count > rows / DEVICE_FAULT => Finding::fault(name::OTHER_DEVICE, message),
                _ => Finding::warning(name::ROWS_LEFT_OUT, message),
            }
        };
        self.all.iter().map(finding).collect()
    }
}
