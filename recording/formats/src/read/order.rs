//! The order of the pieces of a recording.

use super::table::WantedColumn;
use isotherm_failure::{Exit, Failure, shown};
use isotherm_recording::columns::{ColumnSet, RAW, RECORDED_NS, SEQUENCE, SESSION, TIMESTAMP_NS};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::{fs, io};

/// The first row of a piece, by which it finds its place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct FirstRow {
    /// 0 if rows name none.
    pub(super) session: u64,
    pub(super) sequence: u64,
    pub(super) recorded_ns: Option<u64>,
    pub(super) timestamp_ns: Option<u64>,
}

/// The columns of a [`FirstRow`], in this order; a file may lack each.
pub(super) fn first_row_columns() -> [WantedColumn; 4] {
    [SESSION, SEQUENCE, RECORDED_NS, TIMESTAMP_NS]
        .map(|index| WantedColumn { set: ColumnSet::Recorder, ..WantedColumn::number(RAW[index].name) })
}

/// Puts the pieces of a recording in order. `first` reads the first row of a piece, `None` if it is empty. Those of a
/// session are sorted by sequence, whatever the clocks say. Sessions, and pieces that name none, are sorted by the time
/// when they began: by the recorder's clock, which goes on when the acquisition is started anew, if all pieces have it,
/// else by the acquisition's. Pieces without rows come first; if no piece has a time, the given order is kept.
pub(super) fn in_order(
    paths: &[PathBuf],
    mut first: impl FnMut(&Path) -> Result<Option<FirstRow>, Failure>,
) -> Result<Vec<PathBuf>, Failure> {
    if paths.len() < 2 {
        return Ok(paths.to_vec());
    }
    let usage = |message: String| Err(Failure::new(Exit::Usage, message));
    let mut names = Vec::new();
    for path in paths {
        let io = |error: &io::Error| Failure::io("opening", path, error);
        if path == Path::new("-") || !fs::metadata(path).map_err(|error| io(&error))?.is_file() {
            return usage(format!("{}: pieces of a recording must be files; a pipe is read alone", shown(path)));
        }
        let name = fs::canonicalize(path).map_err(|error| io(&error))?;
        if names.contains(&name) {
            return usage(format!("{} is named twice; name every piece once", shown(path)));
        }
        names.push(name);
    }
    let firsts: Vec<_> = paths.iter().map(|path| first(path)).collect::<Result<_, _>>()?;
    Ok(order(&firsts).into_iter().map(|place| paths[place].clone()).collect())
}

/// The places of pieces with these first rows, in order.
fn order(firsts: &[Option<FirstRow>]) -> Vec<usize> {
    let all_have = |time: fn(&FirstRow) -> Option<u64>| firsts.iter().flatten().all(|row| time(row).is_some());
    let clocks: [fn(&FirstRow) -> Option<u64>; 2] = [|row| row.recorded_ns, |row| row.timestamp_ns];
    let clock = clocks.into_iter().find(|clock| all_have(*clock));
    let time = |row: &FirstRow| clock.and_then(|clock| clock(row));
    // When a session began: the time of its first piece.
    let mut begins: HashMap<u64, FirstRow> = HashMap::new();
    for row in firsts.iter().flatten().filter(|row| row.session != 0) {
        let begin = begins.entry(row.session).or_insert(*row);
        if row.sequence < begin.sequence {
            *begin = *row;
        }
    }
    let key = |place: &usize| {
        let Some(row) = &firsts[*place] else { return (None, 0, 0) };
        match begins.get(&row.session) {
            // Two sessions that began at the same time must not be mixed.
            Some(begin) => (time(begin), row.session, row.sequence),
            None => (time(row), 0, 0),
        }
    };
    let mut places: Vec<_> = (0..firsts.len()).collect();
    // The sort is stable, and `None` is less than any time.
    places.sort_by_key(key);
    places
}

/// The sessions of the rows that have been read, in order.
#[derive(Debug, Default)]
pub(super) struct Sessions {
    current: Option<(u64, u64)>,
    /// The last sequence of each session before.
    ended: HashMap<u64, u64>,
}

impl Sessions {
    /// Takes the next row.
    ///
    /// # Errors
    /// If its session has ended, and comes again with sequences that were there already.
    pub(super) fn take(&mut self, session: u64, sequence: u64) -> Result<(), String> {
        let before = self.current.replace((session, sequence)).filter(|(current, _)| *current != session);
        let Some((ended, last)) = before else { return Ok(()) };
        self.ended.insert(ended, last);
        match self.ended.get(&session) {
            Some(last) if session != 0 && sequence <= *last => Err(format!(
                "sequence {sequence} of session {session}, whose rows up to {last} came before another session; \
                 leave out what is there twice"
            )),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(session: u64, sequence: u64, recorded_ns: u64) -> Option<FirstRow> {
        Some(FirstRow { session, sequence, recorded_ns: Some(recorded_ns), timestamp_ns: Some(1) })
    }

    #[test]
    fn pieces_of_a_session_are_in_order_of_their_sequences_whatever_the_clocks_say() {
        // The wall clock was set back in the second piece, and the acquisition was started anew before the fourth.
        let flight = [row(7, 0, 500), row(7, 100, 600), row(7, 200, 300), row(3, 0, 700), row(3, 50, 100)];
        assert_eq!(order(&flight), [0, 1, 2, 3, 4]);
        let shuffled = [4, 2, 0, 3, 1].map(|place: usize| flight[place]);
        assert_eq!(order(&shuffled).map_places(&[4, 2, 0, 3, 1]), [0, 1, 2, 3, 4]);
        // Sessions are in order of the time at which they began.
        assert_eq!(order(&[row(3, 0, 900), row(7, 0, 500), row(3, 50, 100)]), [1, 0, 2]);
        // Two that began at the same time are not mixed.
        assert_eq!(order(&[row(2, 0, 5), row(1, 9, 9), row(2, 4, 6), row(1, 0, 5)]), [3, 1, 0, 2]);
    }

    #[test]
    fn pieces_without_sessions_are_in_order_of_their_time() {
        let stamped = |timestamp_ns| Some(FirstRow { timestamp_ns, ..FirstRow::default() });
        assert_eq!(order(&[row(0, 9, 30), None, row(0, 0, 10), row(0, 5, 20)]), [1, 2, 3, 0]);
        assert_eq!(order(&[stamped(Some(5)), stamped(Some(2)), row(4, 0, 1)]), [2, 1, 0]);
        assert_eq!(order(&[stamped(None), stamped(Some(2)), stamped(None)]), [0, 1, 2], "no common clock");
    }

    #[test]
    fn a_session_that_comes_again_may_go_on_and_may_not_begin_again() {
        let mut sessions = Sessions::default();
        assert!([(1, 5), (1, 6), (2, 0), (1, 7), (2, 1)].iter().all(|(s, n)| sessions.take(*s, *n).is_ok()));
        assert!(
            sessions
                .take(1, 7)
                .is_err_and(|message| message.starts_with("sequence 7 of session 1, whose rows up to 7"))
        );
        assert!([(0, 5), (9, 1), (0, 5)].iter().all(|(s, n)| sessions.take(*s, *n).is_ok()));
    }

    /// What places are called in the order before.
    trait MapPlaces {
        fn map_places(&self, names: &[usize]) -> Vec<usize>;
    }

    impl MapPlaces for Vec<usize> {
        fn map_places(&self, names: &[usize]) -> Vec<usize> {
            self.iter().map(|place| names[*place]).collect()
        }
    }
}
