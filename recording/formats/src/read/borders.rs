//! Where one piece of a recording ends and the next one begins.

use super::piece::WaitingPiece;
use isotherm_recording::{MOST_PERIODS, goes_on};
use isotherm_shared::sequence::Period;
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::{Exit, Failure, shown};
use std::path::{Path, PathBuf};

/// The borders so far, and what is known for the next one.
#[derive(Default)]
pub(super) struct Borders {
    /// What is said of the pieces before any is read.
    notes: Vec<String>,
    /// The last row.
    last: Option<Period>,
    /// The piece before and the piece itself, while its first row has not come; of a piece whose rows name no session.
    open: Option<[PathBuf; 2]>,
    /// The stamp of the row that the next piece begins with, if it has been read already \[ns\].
    is_twice: Option<u64>,
    /// Pieces that go on from each other, without breaks between.
    joined: Vec<PieceJoint>,
    apart: Vec<Apart>,
}

/// Pieces that go on from each other.
struct PieceJoint {
    first: PathBuf,
    last: PathBuf,
    pieces: usize,
    missing: u64,
}

/// A piece that does not go on.
struct Apart {
    before: PathBuf,
    piece: PathBuf,
    why: String,
}

impl Borders {
    pub(super) fn new(notes: Vec<String>) -> Self {
        Self { notes, ..Self::default() }
    }

    /// Takes a row.
    pub(super) fn take(&mut self, row: &RawSample) {
        let last = self.last.replace(row.into());
        let Some((last, [before, piece])) = last.zip(self.open.take()) else { return };
        if row.session != last.session {
            let why = match row.timestamp_ns.checked_sub(last.timestamp_ns) {
                None | Some(0) => "begins before that ends".to_owned(),
                Some(step_ns) if step_ns > row.interval_ns.saturating_mul(MOST_PERIODS) => {
                    format!("begins {} s after its end, over {MOST_PERIODS} intervals", step_ns as f64 / 1e9)
                }
                Some(_) => "has another interval".to_owned(),
            };
            self.apart.push(Apart { before, piece, why });
            return;
        }
        let missing = row.sequence.saturating_sub(last.sequence).saturating_sub(1);
        match self.joined.last_mut().filter(|joined| joined.last == before) {
            Some(joined) => {
                joined.last = piece;
                joined.pieces += 1;
                joined.missing += missing;
            }
            None => self.joined.push(PieceJoint { first: before, last: piece, pieces: 2, missing }),
        }
    }

    /// Looks whether a row is the one that the next piece begins with.
    pub(super) fn look_for(&mut self, row: &RawSample, next: Option<&WaitingPiece>) {
        let Some(first) = next.and_then(|next| next.first) else { return };
        let is_it = row.timestamp_ns == first.timestamp_ns
            && first.session == 0
            && (row.accelerometers, row.gyroscopes) == (first.accelerometers, first.gyroscopes);
        if is_it {
            self.is_twice = Some(row.timestamp_ns);
        }
    }

    /// Begins a piece behind the one `before`.
    ///
    /// # Errors
    /// If it overlaps that: a row is in both.
    pub(super) fn begin(&mut self, piece: &WaitingPiece, before: &Path) -> Result<(), Failure> {
        let is_unnamed = piece.first.is_some_and(|first| first.session == 0);
        self.open = is_unnamed.then(|| [before.to_owned(), piece.source.name().to_owned()]);
        let Some(stamp_ns) = self.is_twice.take() else { return Ok(()) };
        let (piece, before) = (shown(piece.source.name()), shown(before));
        let message = format!(
            "{piece}: its first row, of {stamp_ns} ns, is there twice; the piece before is {before}: leave out the \
             rows that are in both"
        );
        Err(Failure::new(Exit::Data, message))
    }

    /// Whether a piece goes on with the recording, after the last row.
    pub(super) fn goes_on(&self, next: &WaitingPiece) -> bool {
        let both = self.last.zip(next.first);
        both.is_some_and(|(last, first)| last.session == first.session && goes_on(last, &first).is_some())
    }

    /// The stamp of the last row \[ns\].
    pub(super) fn last_ns(&self) -> u64 {
        self.last.map_or(0, |last| last.timestamp_ns)
    }

    /// What the operator should know, a line each.
    pub(super) fn notes(&self) -> Vec<String> {
        let joined = self.joined.iter().map(|PieceJoint { first, last, pieces, missing }| {
            let (first, last) = (shown(first), shown(last));
            let missing = match missing {
                0 => String::new(),
                missing => format!("; {missing} rows are missing between them"),
            };
            format!(
                "{first} to {last}: {pieces} pieces are joined, since the time continues from each to the \
                 next{missing}"
            )
        });
        let apart = self.apart.iter().map(|Apart { before, piece, why }| {
            let (before, piece) = (shown(before), shown(piece));
            format!("{piece} is a session of its own: it does not continue {before}, since it {why}")
        });
        self.notes.iter().cloned().chain(joined).chain(apart).collect()
    }
}
