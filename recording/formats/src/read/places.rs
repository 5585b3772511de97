//! Converts the row count over all pieces of a recording back to file and line.

use isotherm_support::failure::shown;
use std::path::{Path, PathBuf};

/// The pieces of a recording as far as they have been opened, in order.
#[derive(Clone, Debug, Default)]
pub struct Places(Vec<PiecePlace>);

#[derive(Clone, Debug)]
struct PiecePlace {
    path: PathBuf,
    /// What is counted in this piece, for messages; `None` for lines.
    unit: Option<&'static str>,
    /// Lines or rows of all previous pieces.
    before: u64,
}

impl Places {
    /// Begins a piece after `before` lines or rows of the previous pieces.
    pub fn begin(&mut self, path: &Path, unit: Option<&'static str>, before: u64) {
        self.0.push(PiecePlace { path: path.to_owned(), unit, before });
    }

    /// Appends the pieces of another recording, after `before` lines or rows.
    pub fn append(&mut self, other: &Self, before: u64) {
        let pieces = other.0.iter().map(|piece| PiecePlace { before: piece.before + before, ..piece.clone() });
        self.0.extend(pieces);
    }

    /// Lines or rows of all pieces before the current one.
    pub fn before(&self) -> u64 {
        self.0.last().map_or(0, |piece| piece.before)
    }

    /// File and line, or file and row, of `place`, a line or row number over all pieces.
    #[must_use]
    pub fn locate(&self, place: u64) -> String {
        let Some(PiecePlace { path, unit, .. }) = self.piece(place) else { return place.to_string() };
        let (path, place) = (shown(path), self.within_piece(place));
        match unit {
            None => format!("{path}:{place}"),
            Some(unit) => format!("{path}: {unit} {place}"),
        }
    }

    /// Line or row within its piece of `place`, a line or row number over all pieces.
    #[must_use]
    pub fn within_piece(&self, place: u64) -> u64 {
        place.saturating_sub(self.piece(place).map_or(0, |piece| piece.before))
    }

    /// File of `place`, a line or row number over all pieces.
    pub fn path(&self, place: u64) -> Option<&Path> {
        self.piece(place).map(|piece| piece.path.as_path())
    }

    fn piece(&self, place: u64) -> Option<&PiecePlace> {
        self.0.iter().rfind(|piece| piece.before < place).or(self.0.first())
    }
}
