//! Rows of a text that are cut or spoilt. A few are left out; more are a wrong mapping, or a text that is no table.

use isotherm_recording::RecordingError;
use isotherm_support::finding::{Finding, name};
use std::collections::BTreeMap;

/// One of so many rows may be left out, and one in a text with fewer.
const ONE_OF: u64 = 100;
/// A text with fewer good rows than this has no bad one.
const FEWEST_GOOD: u64 = 10;
/// So many bad rows are no longer a spoilt piece, if they are more than one of [`HOPELESS_OF`] of the rows so far.
const HOPELESS: u64 = 100;
const HOPELESS_OF: u64 = 10;

/// Why a row is no reading.
pub(super) enum RowRefusal {
    /// It is bad; others are not.
    Row(Fault, String),
    /// The whole text is not as the mapping says.
    Text(RecordingError),
}

/// What is wrong with a row.
#[derive(Clone, Copy, Debug, Eq, Ord, PartialEq, PartialOrd)]
pub(in super::super) enum Fault {
    /// It has another number of fields than the others.
    Fields,
    /// A field that is used is no number, or no time.
    Number,
    /// A field that is used is empty, or says that there is no number.
    Missing,
    /// A number is over what pulses can count.
    Range,
    /// It does not fit its checksum, or has none.
    Checksum,
    /// Its fields cannot be separated: a quotation mark is not closed, a line is far too long.
    Line,
}

/// The rows of a text, or of a log as text, that are left out.
#[derive(Debug, Default)]
pub(in super::super) struct BadRows {
    counts: BTreeMap<Fault, u64>,
    /// Line and fault of the first.
    first: Option<(u64, String)>,
}

impl BadRows {
    /// Leaves out a row, the last of `rows` so far.
    ///
    /// # Errors
    /// Why the text is refused, if that is certain by now.
    pub(in super::super) fn take(
        &mut self,
        fault: Fault,
        line: u64,
        message: String,
        rows: u64,
    ) -> Result<(), RecordingError> {
        *self.counts.entry(fault).or_default() += 1;
        self.first.get_or_insert((line, message));
        let is_hopeless = self.count() > HOPELESS.max(rows / HOPELESS_OF);
        if is_hopeless { Err(self.refusal(rows, "first ")) } else { Ok(()) }
    }

    /// How many there are.
    pub(in super::super) fn count(&self) -> u64 {
        self.counts.values().sum()
    }

    /// Refuses a text of which too many of all `rows` are bad.
    pub(in super::super) fn check(&self, rows: u64) -> Result<(), RecordingError> {
        let count = self.count();
        let is_few = count <= (rows / ONE_OF).max(1) && rows - count >= FEWEST_GOOD;
        if count == 0 || is_few { Ok(()) } else { Err(self.refusal(rows, "")) }
    }

    fn refusal(&self, rows: u64, which: &str) -> RecordingError {
        let (line, message) = self.first.clone().unwrap_or_default();
        let count = self.count();
        let message = match rows - count {
            // There is no table around the first one.
            0..FEWEST_GOOD => message,
            _ => format!(
                "{message}; {count} of the {which}{rows} rows are bad ({}), and at most 1 % are left out: correct \
                 the mapping if it does not fit them, otherwise take them out of the text",
                self.kinds()
            ),
        };
        RecordingError::Data { line, message }
    }

    fn kinds(&self) -> String {
        let kind = |(fault, count): (&Fault, &u64)| {
            let what = match fault {
                Fault::Fields => "with another number of fields",
                Fault::Number => "with a field that is not a number",
                Fault::Missing => "with a missing value",
                Fault::Range => "with a number over the range",
                Fault::Checksum => "with a wrong checksum",
                Fault::Line => "in a line that is not a whole row",
            };
            format!("{count} {what}")
        };
        self.counts.iter().map(kind).collect::<Vec<_>>().join(", ")
    }

    /// What was left out of so many rows. `name` gives the name of a line.
    pub(in super::super) fn finding(&self, rows: u64, name: impl Fn(u64) -> String) -> Option<Finding> {
        let (line, message) = self.first.as_ref()?;
        let (count, kinds) = (self.count(), self.kinds());
        let left_out = if count == 1 { "1 row is" } else { &format!("{count} rows are") };
        let message = format!("{left_out} left out of {rows}: {kinds}; the first is {}: {message}", name(*line));
        Some(Finding::warning(name::BAD_ROWS, message))
    }
}
