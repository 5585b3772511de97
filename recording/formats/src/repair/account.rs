//! The account of the rows that are taken and lost, stream by stream, and of the sessions that they get.

use super::report::{Hole, Loss, RecordingFormat, RepairReport, RowTime, StreamRows};
use std::collections::{BTreeMap, HashMap};
use std::fmt;

/// What becomes of a row.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Fate {
    /// It is taken.
    Taken,
    /// It is taken, in this session, which is not in the source.
    TakenIn(u64),
    /// It was there already.
    Repeated,
    /// It is not taken: it does not rise, and rows have no sessions.
    OutOfOrder,
}

/// What identifies a row of a stream.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Keys {
    /// Sequences rise within a session; each row comes once.
    Rising,
    /// As [`Rising`](Self::Rising), and rows have no session.
    RisingUnnamed,
    /// Each row comes once, in any order.
    Unordered,
    /// In no way.
    Absent,
}

/// The account of a recording.
#[derive(Default)]
pub(super) struct Account {
    streams: Vec<StreamAccount>,
    /// Their numbers by name.
    numbers: HashMap<String, usize>,
    holes: Vec<OpenHole>,
    /// Whether no row has been taken since the last hole.
    in_hole: bool,
    repeats: u64,
}

struct StreamAccount {
    name: String,
    keys: Keys,
    rows: u64,
    sessions: u64,
    /// The last row that was taken, as it is written.
    last: Option<RowTime>,
    /// The sequences that were taken of each session of the source, as runs: the first, and the last.
    taken: HashMap<u64, BTreeMap<u64, u64>>,
    /// The last sequence of each session that is written.
    ends: HashMap<u64, u64>,
    /// The session that is written for one of the source, where it is another.
    renamed: HashMap<u64, u64>,
    /// The hole behind which no row has come.
    hole: Option<usize>,
    /// How many rows there were, where the file says so.
    expected: Option<u64>,
}

struct OpenHole {
    places: Vec<(u64, String)>,
    cause: String,
    losses: Vec<Loss>,
    /// Rows that were in it, where the file says so.
    rows: Option<u64>,
}

impl Account {
    /// The number of a stream.
    pub(super) fn stream(&mut self, name: &str, keys: Keys) -> usize {
        if let Some(known) = self.numbers.get(name) {
            return *known;
        }
        self.numbers.insert(name.to_owned(), self.streams.len());
        self.streams.push(StreamAccount {
            name: name.to_owned(),
            keys,
            rows: 0,
            sessions: 0,
            last: None,
            taken: HashMap::new(),
            ends: HashMap::new(),
            renamed: HashMap::new(),
            hole: self.holes.len().checked_sub(1),
            expected: None,
        });
        self.streams.len() - 1
    }

    /// Notes damage. Places without a row between them are one hole. `number` is that of the line, row group or byte;
    /// `rows`, how many were there, if that is known.
    pub(super) fn hole(&mut self, unit: &str, number: u64, cause: impl fmt::Display, rows: Option<u64>) {
        if let Some(hole) = self.holes.last_mut().filter(|_| self.in_hole) {
            hole.places.push((number, unit.to_owned()));
            hole.rows = hole.rows.zip(rows).map(|(one, other)| one + other);
            return;
        }
        let places = vec![(number, unit.to_owned())];
        self.holes.push(OpenHole { places, cause: cause.to_string(), losses: Vec::new(), rows });
        self.in_hole = true;
        let number = self.holes.len() - 1;
        for stream in &mut self.streams {
            // A stream without a row since the hole before it lost all that it lost in that one.
            stream.hole = stream.hole.or(Some(number));
        }
    }

    /// What would become of a row.
    pub(super) fn fate(&self, stream: usize, row: RowTime) -> Fate {
        self.streams.get(stream).map_or(Fate::OutOfOrder, |stream| stream.fate(row))
    }

    /// Whether there are holes.
    pub(super) const fn is_whole(&self) -> bool {
        self.holes.is_empty()
    }

    /// Decides what becomes of a row that is whole.
    pub(super) fn take(&mut self, stream: usize, row: RowTime) -> Fate {
        let Some(stream) = self.streams.get_mut(stream) else { return Fate::OutOfOrder };
        let fate = stream.take(row);
        match fate {
            Fate::Repeated => self.repeats += 1,
            Fate::OutOfOrder => {}
            Fate::Taken | Fate::TakenIn(_) => {
                let session = if let Fate::TakenIn(session) = fate { session } else { row.session };
                let written = RowTime { session, ..row };
                if let Some(hole) = stream.hole.take().and_then(|hole| self.holes.get_mut(hole)) {
                    hole.losses.push(stream.loss(hole.rows, Some(row), written));
                }
                let begins = stream.last.is_none_or(|last| last.session != session);
                stream.sessions += u64::from(begins && stream.keys != Keys::Absent);
                stream.rows += 1;
                stream.last = Some(written);
                self.in_hole = false;
            }
        }
        fate
    }

    /// Takes rows that are written as they are.
    pub(super) fn take_all(&mut self, stream: usize, rows: &[RowTime]) {
        for row in rows {
            self.take(stream, *row);
        }
    }

    /// Says how many rows of a stream there were.
    pub(super) fn expect(&mut self, stream: usize, rows: u64) {
        if let Some(stream) = self.streams.get_mut(stream) {
            stream.expected = Some(stream.expected.unwrap_or(0).saturating_add(rows));
        }
    }

    /// The result, after the last row. A stream without a row behind a hole lost everything behind it.
    pub(super) fn end(mut self, format: RecordingFormat, has_checks: bool, notes: Vec<String>) -> RepairReport {
        for stream in &mut self.streams {
            let Some(hole) = stream.hole.take() else { continue };
            let lost = |hole: &OpenHole| -> Option<u64> {
                let own = hole.losses.iter().filter(|loss| loss.stream == stream.name);
                own.map(|loss| loss.rows).sum()
            };
            let before: Option<u64> = self.holes.iter().map(lost).sum();
            let left = stream.expected.zip(before).and_then(|(all, lost)| all.checked_sub(stream.rows + lost));
            if let Some(hole) = self.holes.get_mut(hole) {
                let loss = stream.loss(hole.rows.or(left), None, RowTime::default());
                hole.losses.push(loss);
            }
        }
        let rows = |stream: &StreamAccount| StreamRows {
            name: stream.name.clone(),
            rows: stream.rows,
            sessions: stream.sessions,
        };
        RepairReport {
            format,
            has_checks,
            streams: self.streams.iter().map(rows).collect(),
            holes: self.holes.into_iter().map(OpenHole::close).collect(),
            repeats: self.repeats,
            notes,
        }
    }
}

impl StreamAccount {
    /// The run of sequences that were taken, and in which this one is, or behind which it comes.
    fn run(&self, row: RowTime) -> Option<(u64, u64)> {
        let run = self.taken.get(&row.session)?.range(..=row.sequence).next_back()?;
        Some((*run.0, *run.1))
    }

    fn fate(&self, row: RowTime) -> Fate {
        let RowTime { session, sequence, .. } = row;
        if self.keys == Keys::Absent {
            return Fate::Taken;
        }
        if self.run(row).is_some_and(|(_, last)| sequence <= last) {
            return Fate::Repeated;
        }
        let written = self.renamed.get(&session).copied().unwrap_or(session);
        let rises = self.ends.get(&written).is_none_or(|end| sequence > *end);
        match (self.keys, rises) {
            (Keys::RisingUnnamed, false) => Fate::OutOfOrder,
            (Keys::Rising, false) => {
                // Sessions of a source are numbers at random, or small ones; 0 is none.
                let is_free = |number: &u64| *number != 0 && !self.ends.contains_key(number);
                let new = (1..).map(|step: u64| written.wrapping_add(step << 48)).find(is_free);
                new.map_or(Fate::OutOfOrder, Fate::TakenIn)
            }
            _ if written != session => Fate::TakenIn(written),
            _ => Fate::Taken,
        }
    }

    fn take(&mut self, row: RowTime) -> Fate {
        let fate = self.fate(row);
        let RowTime { session, sequence, .. } = row;
        let written = match fate {
            Fate::Taken => session,
            Fate::TakenIn(written) => written,
            Fate::Repeated | Fate::OutOfOrder => return fate,
        };
        if self.keys == Keys::Absent {
            return fate;
        }
        if written != session {
            self.renamed.insert(session, written);
        }
        // The run before it grows, or a new one begins.
        let run = self.run(row).filter(|(_, last)| last.checked_add(1) == Some(sequence));
        self.taken.entry(session).or_default().insert(run.map_or(sequence, |(first, _)| first), sequence);
        let end = self.ends.entry(written).or_default();
        *end = sequence.max(*end);
        fate
    }

    /// What is lost before the row `behind`, which is written as `written`.
    fn loss(&self, rows: Option<u64>, behind: Option<RowTime>, written: RowTime) -> Loss {
        let between = self.last.zip(behind).filter(|(last, _)| last.session == written.session);
        let by_sequence = between.and_then(|(last, behind)| behind.sequence.checked_sub(last.sequence)?.checked_sub(1));
        Loss {
            stream: self.name.clone(),
            rows: by_sequence.or(rows).filter(|_| self.keys != Keys::Absent || rows.is_some()),
            before: self.last,
            behind: behind.map(|behind| RowTime { session: written.session, ..behind }),
            begins_session: behind.is_some_and(|behind| behind.session != written.session)
                && self.last.is_some_and(|last| last.session != written.session),
        }
    }
}

impl OpenHole {
    fn close(self) -> Hole {
        let place = match &self.places[..] {
            [] => String::new(),
            [(number, unit)] => format!("{unit} {number}"),
            [(first, unit), .., (last, _)] if first < last => format!("{unit}s {first} to {last}"),
            [(number, unit), ..] => format!("{unit} {number}"),
        };
        Hole { place, cause: self.cause, losses: self.losses }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(session: u64, sequence: u64) -> RowTime {
        RowTime { session, sequence, timestamp_ns: sequence.wrapping_mul(1000) }
    }

    fn lost(account: Account) -> Vec<(Option<u64>, bool)> {
        let repaired = account.end(RecordingFormat::Csv, true, Vec::new());
        let losses = repaired.holes.iter().flat_map(|hole| &hole.losses);
        losses.map(|loss| (loss.rows, loss.begins_session)).collect()
    }

    #[test]
    fn a_hole_within_a_session_has_its_length_by_the_sequences() {
        let mut account = Account::default();
        let raw = account.stream("raw", Keys::Rising);
        assert!((0..5).all(|sequence| account.take(raw, row(7, sequence)) == Fate::Taken));
        account.hole("line", 7, "x", None);
        account.hole("line", 8, "x", None);
        assert_eq!(account.take(raw, row(7, 7)), Fate::Taken);
        account.hole("line", 10, "x", None);
        // A session of the source begins in the hole.
        assert_eq!(account.take(raw, row(9, 3)), Fate::Taken);
        account.hole("line", 12, "x", Some(4));
        assert_eq!(lost(account), [(Some(2), false), (None, false), (Some(4), false)]);
    }

    /// As when a part of another file of the same flight has been put between.
    #[test]
    fn where_the_sequence_does_not_rise_a_new_session_begins_and_nothing_is_taken_twice() {
        let mut account = Account::default();
        let raw = account.stream("raw", Keys::Rising);
        assert_eq!(account.take(raw, row(7, 10)), Fate::Taken);
        account.hole("line", 3, "x", None);
        assert_eq!(account.take(raw, row(7, 500)), Fate::Taken);
        account.hole("line", 5, "x", None);
        let new = 7 + (1 << 48);
        assert_eq!([12, 13].map(|sequence| account.take(raw, row(7, sequence))), [Fate::TakenIn(new); 2]);
        assert_eq!(account.take(raw, row(7, 500)), Fate::Repeated);
        assert_eq!(account.take(raw, row(new, 1)), Fate::TakenIn(7 + (2 << 48)), "the number is taken");
        assert_eq!(lost(account), [(Some(489), false), (None, true)]);

        let mut unnamed = Account::default();
        let raw = unnamed.stream("raw", Keys::RisingUnnamed);
        assert_eq!([3, 9, 4].map(|n| unnamed.take(raw, row(0, n))), [Fate::Taken, Fate::Taken, Fate::OutOfOrder]);
        let increments = unnamed.stream("increment", Keys::Unordered);
        assert_eq!([3, 9, 4, 9].map(|n| unnamed.take(increments, row(1, n)))[2..], [Fate::Taken, Fate::Repeated]);
    }

    #[test]
    fn runs_of_sequences_grow_and_hold_what_was_taken() {
        let mut account = Account::default();
        let stream = account.stream("increment", Keys::Unordered);
        for sequence in [5, 6, 9, 7, 8, u64::MAX, 0] {
            assert_eq!(account.take(stream, row(1, sequence)), Fate::Taken, "{sequence}");
        }
        for sequence in [5, 6, 7, 8, 9, u64::MAX, 0] {
            assert_eq!(account.take(stream, row(1, sequence)), Fate::Repeated, "{sequence}");
        }
    }
}
