//! The pieces of a recording, or of several: their files, in order.

use super::input::Input;
use super::order::{FirstRow, PieceOrder, in_order};
use super::pair;
use super::piece::{Piece, RowKind, WaitingPiece};
use isotherm_recording::{Progress, SequenceRule};
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::source::DataSource;
use std::path::{Path, PathBuf};

/// The pieces of one recording or of several, in order. A piece goes on with the recording of the piece before where
/// its time does ([`goes_on`](isotherm_recording::goes_on)).
pub struct Pieces {
    pub(super) kind: RowKind,
    pub(super) input: Input,
    /// Those that have not been opened, in reverse order.
    pub(super) waiting: Vec<WaitingPiece>,
    /// What is to be said of them.
    pub(super) notes: Vec<String>,
    /// Whether one of them is of another program; unknown of one file.
    pub(super) has_foreign: Option<bool>,
}

/// What is known of a piece after its first row.
#[derive(Default)]
struct PieceBeginning {
    first: Option<RawSample>,
    is_foreign: bool,
    /// The nominal interval, and the number of rows that it was found from.
    found: Option<(u64, u64)>,
    has_times: bool,
}

impl Pieces {
    /// Looks at pieces, which are named in any order. If there are several files, the beginning of each is read.
    ///
    /// # Errors
    /// If a piece cannot be opened, is named twice, or has an invalid beginning; if they are of several IMUs.
    pub fn new(sources: &[DataSource], kind: RowKind, input: impl Into<Input>) -> Result<Self, Failure> {
        let mut input = input.into();
        let mut sources = sources.to_vec();
        let mut notes = Vec::new();
        if let Some(paired) = pair::find(&sources, kind, &input)? {
            notes.push(paired.note());
            (sources, input) = (vec![paired.accelerometers.clone()], paired.input(input));
        }
        let is_given = input.foreign.as_ref().is_some_and(|foreign| foreign.settings.in_order);
        let mut seen: Vec<PieceBeginning> = Vec::new();
        let mut known: Option<(PathBuf, String)> = None;
        let first_row = |source: &DataSource| {
            let (path, (first, of_piece, imu)) = (source.name(), look_at(source, kind, &input, is_given)?);
            if let Some(imu) = imu {
                let (named, of) = known.get_or_insert_with(|| (path.to_owned(), imu.clone()));
                refuse_other_imu((path, &imu), (named, of))?;
            }
            seen.push(of_piece);
            Ok(first)
        };
        let PieceOrder { places, note } = in_order(&sources, is_given, first_row)?;
        notes.extend(note);
        let without_time = |seen: &PieceBeginning| seen.is_foreign && !seen.has_times;
        if seen.iter().any(without_time) && !is_given {
            notes.push(
                "the rows of a piece have no time: the pieces are in the order in which they are named, and each is \
                 a session of its own; with --in-order each continues where the one before ends"
                    .to_owned(),
            );
        }
        if let Some(foreign) = &mut input.foreign {
            // Of the pieces with the most rows the first.
            let most = |best: Option<(u64, u64)>, found: (u64, u64)| match best {
                Some(best) if best.1 >= found.1 => Some(best),
                _ => Some(found),
            };
            foreign.settings.of_pieces = seen.iter().filter_map(|seen| seen.found).fold(None, most);
        }
        let has_foreign = (!seen.is_empty()).then(|| seen.iter().any(|seen| seen.is_foreign));
        let waiting = places.iter().rev().map(|place| WaitingPiece {
            source: sources[*place].clone(),
            first: seen.get(*place).and_then(|seen| seen.first),
        });
        Ok(Self { kind, waiting: waiting.collect(), input, notes, has_foreign })
    }

    /// The files of the pieces that are left, in order.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.waiting.iter().rev().map(|piece| piece.source.name())
    }
}

/// The first row of a piece, what else is known then, and its IMU. With `whole` also the last times.
fn look_at(
    source: &DataSource,
    kind: RowKind,
    input: &Input,
    whole: bool,
) -> Result<(Option<FirstRow>, PieceBeginning, Option<String>), Failure> {
    let failed = |error: isotherm_recording::RecordingError| error.failure(source.name());
    let mut piece = Piece::open(source, kind, input, &Progress::default(), None)?;
    let conversion = piece.source.conversion();
    let mut seen = PieceBeginning {
        first: None,
        is_foreign: conversion.is_some(),
        found: conversion.and_then(|conversion| conversion.found_interval()),
        has_times: conversion.is_none_or(|conversion| conversion.has_times()),
    };
    let row = piece.next(SequenceRule::default()).map_err(failed)?;
    let imu = piece.source.imu().map(str::to_owned);
    let Some(row) = row else { return Ok((None, seen, imu)) };
    seen.first = Some(row.sample);
    let times =
        |piece: &Piece, sample: &RawSample| [piece.source.recorded_ns(), seen.has_times.then_some(sample.timestamp_ns)];
    let [recorded_ns, timestamp_ns] = times(&piece, &row.sample);
    let mut last_ns = [recorded_ns, timestamp_ns];
    while whole && let Some(row) = piece.next(piece.source.sequence_rule()).map_err(failed)? {
        last_ns = times(&piece, &row.sample);
    }
    let (session, sequence) = (row.sample.session, row.sample.sequence);
    Ok((Some(FirstRow { session, sequence, recorded_ns, timestamp_ns, last_ns }), seen, imu))
}

/// Refuses a piece of another IMU than that of the first piece.
fn refuse_other_imu((path, imu): (&Path, &str), (first, of): (&Path, &str)) -> Result<(), Failure> {
    if imu == of {
        return Ok(());
    }
    let (first, path, imu, of) = (shown(first), shown(path), imu.escape_debug(), of.escape_debug());
    Err(Failure::new(Exit::Data, format!("{path} is of {imu}, but {first} of {of}; give the pieces of one IMU")))
}
