//! The order of the pieces of a recording.

use super::table::WantedColumn;
use isotherm_recording::SequenceRule;
use isotherm_recording::columns::{ColumnSet, RAW, RECORDED_NS, SEQUENCE, SESSION, TIMESTAMP_NS};
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::source::DataSource;
use std::collections::{HashMap, HashSet};

/// The first row of a piece, by which it finds its place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct FirstRow {
    /// 0 if rows name none.
    pub(super) session: u64,
    pub(super) sequence: u64,
    pub(super) recorded_ns: Option<u64>,
    pub(super) timestamp_ns: Option<u64>,
    /// The same two times of the last row, where they are asked for.
    pub(super) last_ns: [Option<u64>; 2],
}

/// The order of pieces.
#[derive(Debug, Default, PartialEq)]
pub(super) struct PieceOrder {
    /// Their places among those that are named.
    pub(super) places: Vec<usize>,
    /// What came of the wish to keep the given order.
    pub(super) note: Option<String>,
}

impl FirstRow {
    const fn times(&self) -> [Option<u64>; 2] {
        [self.recorded_ns, self.timestamp_ns]
    }
}

/// The columns of a [`FirstRow`], in this order; a file may lack each.
pub(super) fn first_row_columns() -> [WantedColumn; 4] {
    [SESSION, SEQUENCE, RECORDED_NS, TIMESTAMP_NS]
        .map(|index| WantedColumn { set: ColumnSet::Recorder, ..WantedColumn::number(RAW[index].name) })
}

/// The order of the pieces of a recording. `first` reads the first row of a piece, `None` if it is empty. Those of a
/// session are sorted by sequence, whatever the clocks say. Sessions, and pieces that name none, are sorted by the time
/// when they began: by the recorder's clock, which goes on when the acquisition is started anew, if all pieces have it,
/// otherwise by the acquisition's. Pieces without rows come first; if no piece has a time, the given order is kept.
///
/// With `is_given`, sessions and pieces keep the given order where no clock shows theirs: where a piece has no time, or
/// begins before another one has ended, as with clocks that begin anew. `first` then needs the last times, too.
pub(super) fn in_order(
    sources: &[DataSource],
    is_given: bool,
    mut first: impl FnMut(&DataSource) -> Result<Option<FirstRow>, Failure>,
) -> Result<PieceOrder, Failure> {
    if sources.len() < 2 {
        let note = is_given.then(|| format!("{IN_ORDER} has no effect: there is one file"));
        return Ok(PieceOrder { places: (0..sources.len()).collect(), note });
    }
    let usage = |message: String| Err(Failure::new(Exit::Usage, message));
    let mut names = HashSet::new();
    for source in sources {
        let path = source.name();
        let Some(identity) = source.identity().map_err(|error| Failure::io("opening", path, &error))? else {
            return usage(format!("{}: pieces of a recording must be files; a pipe is read by itself", shown(path)));
        };
        if !names.insert(identity) {
            return usage(format!("{} is named twice; name every piece once", shown(path)));
        }
    }
    let firsts: Vec<_> = sources.iter().map(&mut first).collect::<Result<_, _>>()?;
    Ok(order(&firsts, is_given))
}

/// The option, for messages.
const IN_ORDER: &str = "--in-order";

/// The order of pieces with these first rows.
fn order(firsts: &[Option<FirstRow>], is_given: bool) -> PieceOrder {
    let all_have = |clock: &usize| firsts.iter().flatten().all(|row| row.times()[*clock].is_some());
    let clock = [0, 1].into_iter().find(all_have);
    let time = |row: &FirstRow| clock.and_then(|clock| row.times()[clock]);
    // When a session began: the time of its first piece; and the first place where it is named.
    let mut begins: HashMap<u64, (FirstRow, usize)> = HashMap::new();
    for (place, row) in firsts.iter().enumerate().filter_map(|(place, row)| Some((place, row.as_ref()?))) {
        if row.session == 0 {
            continue;
        }
        let (begin, _) = begins.entry(row.session).or_insert((*row, place));
        if row.sequence < begin.sequence {
            *begin = *row;
        }
    }
    let is_decided = !is_given || clock.is_some_and(|clock| !overlap(firsts, clock));
    let key = |place: &usize| {
        let Some(row) = &firsts[*place] else { return (None, 0, 0) };
        let rank = |row: &FirstRow, place: usize| if is_decided { time(row) } else { Some(place as u64) };
        match begins.get(&row.session) {
            // Two sessions that began at the same time must not be mixed.
            Some((begin, named)) => (rank(begin, *named), row.session, row.sequence),
            None => (rank(row, *place), 0, 0),
        }
    };
    let mut places: Vec<_> = (0..firsts.len()).collect();
    // The sort is stable, and `None` is less than any time.
    places.sort_by_key(key);
    let is_one_session = begins.len() == 1 && firsts.iter().flatten().all(|row| row.session != 0);
    let note = match (is_one_session, is_decided) {
        (true, _) => {
            format!("{IN_ORDER} has no effect: the pieces are of one session, and its sequences show their order")
        }
        (_, true) => format!("{IN_ORDER} has no effect: the times of the pieces do not overlap, and show their order"),
        (_, false) => "the pieces are in the order in which they are named: no clock shows theirs".to_owned(),
    };
    PieceOrder { places, note: is_given.then_some(note) }
}

/// Whether a session, or a piece that names none, begins before another one has ended, by this clock.
fn overlap(firsts: &[Option<FirstRow>], clock: usize) -> bool {
    let mut sessions: HashMap<u64, [u64; 2]> = HashMap::new();
    let mut spans = Vec::new();
    for row in firsts.iter().flatten() {
        let begin = row.times()[clock].unwrap_or(0);
        let end = row.last_ns[clock].unwrap_or(begin);
        match row.session {
            0 => spans.push([begin, end]),
            session => {
                let span = sessions.entry(session).or_insert([begin, end]);
                *span = [span[0].min(begin), span[1].max(end)];
            }
        }
    }
    spans.extend(sessions.into_values());
    spans.sort_unstable();
    spans.windows(2).any(|pair| pair[1][0] <= pair[0][1])
}

/// The sessions of the rows that have been read, in order.
#[derive(Debug, Default)]
pub(super) struct SessionOrder {
    current: Option<(u64, u64)>,
    /// The last sequence of each session before.
    ended: HashMap<u64, u64>,
}

impl SessionOrder {
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

/// The order of rows that are in memory: what [`Recording`](super::Recording) demands of those of one file.
///
/// ```
/// use isotherm_recording_formats::read::RowOrder;
/// use isotherm_shared::wire::RawSample;
///
/// let row = |sequence| RawSample { sequence, ..RawSample::default() };
/// let mut order = RowOrder::default();
/// assert!(order.check(&row(7)).is_ok() && order.check(&row(9)).is_ok());
/// assert!(order.check(&row(8)).is_err_and(|message| message.starts_with("sequence 8 after 9")));
/// ```
#[derive(Debug, Default)]
pub struct RowOrder {
    sequences: SequenceRule,
    sessions: SessionOrder,
}

impl RowOrder {
    /// Checks the next row.
    ///
    /// # Errors
    /// If its sequence does not rise in its session, or if its session has ended, and comes again with sequences that
    /// were there already.
    pub fn check(&mut self, sample: &RawSample) -> Result<(), String> {
        self.sequences.check(sample)?;
        self.sessions.take(sample.session, sample.sequence)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(session: u64, sequence: u64, recorded_ns: u64) -> Option<FirstRow> {
        Some(FirstRow {
            session,
            sequence,
            recorded_ns: Some(recorded_ns),
            timestamp_ns: Some(1),
            ..FirstRow::default()
        })
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
        let mut sessions = SessionOrder::default();
        assert!([(1, 5), (1, 6), (2, 0), (1, 7), (2, 1)].iter().all(|(s, n)| sessions.take(*s, *n).is_ok()));
        assert!(
            sessions
                .take(1, 7)
                .is_err_and(|message| message.starts_with("sequence 7 of session 1, whose rows up to 7"))
        );
        assert!([(0, 5), (9, 1), (0, 5)].iter().all(|(s, n)| sessions.take(*s, *n).is_ok()));
    }

    #[test]
    fn the_given_order_is_kept_where_no_clock_tells_it() {
        let piece = |begin: u64, end: u64| {
            let times = |time| [None, Some(time)];
            Some(FirstRow { timestamp_ns: Some(begin), last_ns: times(end), ..FirstRow::default() })
        };
        let kept = |firsts: &[Option<FirstRow>]| {
            let PieceOrder { places, note } = super::order(firsts, true);
            (places, note.unwrap().contains("no effect"))
        };
        // Clocks that begin anew, and rows without a time.
        assert_eq!(kept(&[piece(7, 90), piece(5, 95), piece(6, 50)]), (vec![0, 1, 2], false));
        assert_eq!(kept(&[Some(FirstRow::default()), Some(FirstRow::default())]), (vec![0, 1], false));
        assert_eq!(kept(&[piece(100, 199), piece(200, 300), piece(5, 99)]), (vec![2, 0, 1], true));
        // The sequences decide within a session, and where it is the only one.
        let of_session = |row: Option<FirstRow>| row.map(|row| FirstRow { last_ns: [Some(999), Some(999)], ..row });
        let session = [row(7, 100, 600), row(7, 0, 500)].map(of_session);
        assert_eq!(kept(&session), (vec![1, 0], true));
        let two = [row(7, 100, 600), row(3, 5, 400), row(7, 0, 500)].map(of_session);
        assert_eq!(kept(&two), (vec![2, 0, 1], false));
        let one = in_order(&[DataSource::of_stream("a.csv")], true, |_| Ok(None)).unwrap();
        assert!(one.places == [0] && one.note.unwrap().contains("no effect: there is one file"));
    }

    fn order(firsts: &[Option<FirstRow>]) -> Vec<usize> {
        super::order(firsts, false).places
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
