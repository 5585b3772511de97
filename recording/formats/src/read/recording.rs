//! Reads the pieces of a recording as one, in every format.
//!
//! Over 400 lines: sorting the pieces, reading them one after the other and locating errors in them form one reader.

use super::mcap::McapReader;
use super::parquet::ParquetReader;
use super::places::Places;
use super::table::{ImuChoice, TableReader, WantedColumn, sample_columns};
use indicatif::ProgressBar;
use isotherm_failure::{Exit, Failure, tell};
use isotherm_files::open_recording;
use isotherm_finding::{Finding, Location, name};
use isotherm_recording::columns::{ColumnSet, GYROSCOPES, LAG_NS, MCAP_MAGIC, PARQUET_MAGIC, RAW, store};
use isotherm_recording::{CampaignCsvReader, CampaignRow, POSITION, RecordingError, SET_POINT, SequenceRule};
use isotherm_shared::lag::LagCompletion;
use isotherm_shared::wire::{RawSample, Triad};
use sha2::{Digest as _, Sha256};
use std::cell::RefCell;
use std::fs::{self, File};
use std::io::{self, Cursor, Read};
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// The kind of rows that are read from a recording.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum RowKind {
    /// Raw samples. Set points are 0, and there are no positions.
    Sample,
    /// Raw samples of a campaign, with set point and position.
    Campaign,
}

/// An iterator over the rows of a recording that ends at the first error. [`failure`](Self::failure) turns that error
/// into a [`Failure`] with file and place.
///
/// The `line` of a row counts over all pieces; [`places`](Self::places) gives its file and the line or row in it.
pub struct Recording {
    kind: RowKind,
    choice: ImuChoice,
    bar: ProgressBar,
    /// Pieces that are not open yet, in reverse order.
    waiting: Vec<PathBuf>,
    current: Piece,
    places: Places,
    hash: Option<SharedHash>,
    lag: LagCompletion,
    /// Number of pieces that have been opened.
    opened: u64,
    ended: bool,
}

type SharedHash = Rc<RefCell<Sha256>>;

/// The piece that is being read.
struct Piece {
    path: PathBuf,
    source: PieceSource,
}

enum PieceSource {
    Csv(Box<CampaignCsvReader<Box<dyn Read>>>),
    Table(Box<dyn TableReader>, Box<SequenceRule>, Vec<Option<u64>>),
}

impl Recording {
    /// Opens the pieces of a recording, named in any order. `-` is stdin, which must be the only piece. A piece of raw
    /// samples that names no session, and begins its sequences anew, is a session of its own. `bar` advances by the
    /// bytes read.
    ///
    /// # Errors
    /// If a piece cannot be opened, is named twice, or has an invalid beginning.
    pub fn open(paths: &[PathBuf], kind: RowKind, choice: ImuChoice, bar: &ProgressBar) -> Result<Self, Failure> {
        Self::open_with(paths, kind, choice, bar, None)
    }

    /// As [`open`](Self::open), and computes the SHA-256 of all bytes.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_hashed(
        paths: &[PathBuf],
        kind: RowKind,
        choice: ImuChoice,
        bar: &ProgressBar,
    ) -> Result<Self, Failure> {
        Self::open_with(paths, kind, choice, bar, Some(SharedHash::default()))
    }

    fn open_with(
        paths: &[PathBuf],
        kind: RowKind,
        choice: ImuChoice,
        bar: &ProgressBar,
        hash: Option<SharedHash>,
    ) -> Result<Self, Failure> {
        let mut known: Option<(PathBuf, String)> = None;
        let first_time = |path: &Path| {
            let mut piece = Piece::open(path, kind, &choice, &ProgressBar::hidden(), None)?;
            let row = piece.next(SequenceRule::default());
            let row = row.map_err(|error| error.failure(path))?;
            if let Some(imu) = piece.source.imu() {
                let (first, of) = known.get_or_insert_with(|| (path.to_owned(), imu.to_owned()));
                refuse_other_imu((path, imu), (first, of))?;
            }
            Ok(row.map(|row| (piece.source.recorded_ns(), row.sample.timestamp_ns)))
        };
        let mut waiting = in_order(paths, first_time, |times: &[Option<(Option<u64>, u64)>]| {
            // The recorder's clock continues when the acquisition restarts, so it is preferred if all pieces have it.
            let recorded = times.iter().flatten().all(|(recorded_ns, _)| recorded_ns.is_some());
            times
                .iter()
                .map(|time| time.map(|(unix, timestamp)| if recorded { unix.unwrap_or(0) } else { timestamp }))
                .collect()
        })?;
        waiting.reverse();
        let Some(first) = waiting.pop() else {
            return Err(Failure::new(Exit::Usage, "no recording is named"));
        };
        let current = Piece::open(&first, kind, &choice, bar, hash.as_ref())?;
        let mut places = Places::default();
        places.begin(&current.path, current.source.unit(), 0);
        let lag = LagCompletion::default();
        Ok(Self { kind, choice, bar: bar.clone(), waiting, current, places, hash, lag, opened: 1, ended: false })
    }

    /// Sets the time constant \[ns\] of the lagged telemetry of all further rows, 0 for none. It is computed for pieces
    /// that have no lagged telemetry; those that have are read as they are. Each session begins soaked.
    pub const fn set_lag(&mut self, lag_ns: u64) {
        self.lag.set_lag(lag_ns);
    }

    /// The next row. At the end of a piece, opens the next one.
    fn advance(&mut self) -> Result<Option<CampaignRow>, RecordingError> {
        let mut rule = self.current.source.sequence_rule();
        // The piece before the current one, while no row of the current one has been read.
        let mut previous: Option<PathBuf> = None;
        loop {
            let row = self.current.next(rule).map_err(|error| match (error, &previous) {
                (RecordingError::Data { line, message }, Some(previous)) => {
                    let message = format!("{message}; the piece before is {}", previous.display());
                    RecordingError::Data { line, message }
                }
                (error, _) => error,
            });
            if let Some(mut row) = row? {
                self.lag.complete(&mut row.sample, self.current.source.has_lag());
                return Ok(Some(CampaignRow { line: self.places.before() + row.line, ..row }));
            }
            rule = self.current.source.sequence_rule();
            if let Some(warning) = self.current.source.truncation() {
                let place = Location::Recording(self.current.path.display().to_string());
                let finding = Finding::warning(name::TRUNCATED, warning).at(place);
                tell("isotherm", finding.tagged(|line| line.to_string()));
            }
            let Some(next) = self.waiting.pop() else { return Ok(None) };
            let before = self.places.before() + self.current.source.place();
            let opened = Piece::open(&next, self.kind, &self.choice, &self.bar, self.hash.as_ref());
            // An error is unlikely: the beginning was already read to sort the pieces.
            let opened = opened.map_err(RecordingError::Piece)?;
            previous = Some(std::mem::replace(&mut self.current, opened).path);
            self.opened += 1;
            if self.kind == RowKind::Sample {
                rule.begin_piece(self.opened);
            }
            self.places.begin(&self.current.path, self.current.source.unit(), before);
        }
    }

    /// The failure of a program that reads this recording: `error`, with file and place.
    #[must_use]
    pub fn failure(&self, error: &RecordingError) -> Failure {
        match error {
            RecordingError::Data { line, message } => {
                let (path, within) =
                    (self.places.path(*line).unwrap_or(&self.current.path), self.places.within_piece(*line));
                Failure::new(Exit::Data, format!("{}: {message}", self.places.locate(*line))).at(path, Some(within))
            }
            _ => error.failure(&self.current.path),
        }
    }

    /// The places of the rows that have been read, to find the file and line of a row's `line`.
    #[must_use]
    pub const fn places(&self) -> &Places {
        &self.places
    }

    /// SHA-256 of the bytes of all pieces, in order, as hexadecimal digits; empty unless opened by
    /// [`open_hashed`](Self::open_hashed). Call it after the last row.
    ///
    /// # Errors
    /// If the bytes after the last row cannot be hashed.
    pub fn sha256(self) -> Result<String, Failure> {
        let path = self.current.path.clone();
        let Some(hash) = self.hash else { return Ok(String::new()) };
        drop(self.current);
        let digest = hash.try_borrow_mut().map(|mut hash| hash.finalize_reset());
        let digest = digest.map_err(|_| Failure::new(Exit::Failed, format!("hashing {}", path.display())))?;
        Ok(digest.iter().map(|byte| format!("{byte:02x}")).collect())
    }
}

impl Recording {
    /// SHA-256 of the bytes that were read so far, as [`sha256`](Self::sha256). After the last row they are all, except
    /// of a binary file whose rows end before its bytes.
    #[must_use]
    pub fn sha256_so_far(&self) -> String {
        let digest = self.hash.as_ref().map(|hash| hash.borrow().clone().finalize());
        digest.map_or_else(String::new, |digest| digest.iter().map(|byte| format!("{byte:02x}")).collect())
    }
}

impl Iterator for Recording {
    type Item = Result<CampaignRow, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let item = self.advance().map_err(|error| match error {
            // The line in the piece becomes the line over all pieces.
            RecordingError::Data { line, message } => {
                RecordingError::Data { line: self.places.before() + line, message }
            }
            other => other,
        });
        let item = item.transpose();
        self.ended = !matches!(item, Some(Ok(_)));
        item
    }
}

/// An iterator over the raw samples of a recording that ends at the first error.
pub struct Samples(Recording);

impl Samples {
    /// Opens the pieces of a recording; as [`Recording::open`].
    ///
    /// # Errors
    /// As [`Recording::open`].
    pub fn open(paths: &[PathBuf], choice: ImuChoice, bar: &ProgressBar) -> Result<Self, Failure> {
        Recording::open(paths, RowKind::Sample, choice, bar).map(Self)
    }

    /// As [`Recording::open_hashed`].
    ///
    /// # Errors
    /// As [`Recording::open`].
    pub fn open_hashed(paths: &[PathBuf], choice: ImuChoice, bar: &ProgressBar) -> Result<Self, Failure> {
        Recording::open_hashed(paths, RowKind::Sample, choice, bar).map(Self)
    }

    /// As [`Recording::sha256_so_far`].
    #[must_use]
    pub fn sha256_so_far(&self) -> String {
        self.0.sha256_so_far()
    }

    /// As [`Recording::set_lag`].
    pub const fn set_lag(&mut self, lag_ns: u64) {
        self.0.set_lag(lag_ns);
    }

    /// The IMU of the rows, where the recording names it: Parquet and MCAP. Valid after the first row.
    #[must_use]
    pub fn imu(&self) -> Option<&str> {
        self.0.current.source.imu()
    }
}

impl Iterator for Samples {
    type Item = Result<RawSample, Failure>;

    fn next(&mut self) -> Option<Self::Item> {
        let item = self.0.next()?;
        Some(item.map(|row| row.sample).map_err(|error| self.0.failure(&error)))
    }
}

impl Piece {
    fn open(
        path: &Path,
        kind: RowKind,
        choice: &ImuChoice,
        bar: &ProgressBar,
        hash: Option<&SharedHash>,
    ) -> Result<Self, Failure> {
        let failed = |error: RecordingError| error.failure(path);
        let columns = || sample_columns(kind == RowKind::Campaign);
        let source = match open_source(path, bar, hash)? {
            Opened::Csv(source) => {
                let reader = match kind {
                    RowKind::Sample => CampaignCsvReader::of_samples(source),
                    RowKind::Campaign => CampaignCsvReader::new(source),
                };
                PieceSource::Csv(Box::new(reader.map_err(failed)?))
            }
            Opened::Mcap(source) => table_source(McapReader::new(source, columns(), choice.clone(), true)),
            Opened::Parquet(file) => {
                table_source(ParquetReader::open(file, |_| Ok(columns()), choice, bar).map_err(failed)?)
            }
        };
        Ok(Self { path: path.to_owned(), source })
    }

    /// The next row, with its line or row number in this piece. `rule` has the state after the previous sample.
    fn next(&mut self, rule: SequenceRule) -> Result<Option<CampaignRow>, RecordingError> {
        match &mut self.source {
            PieceSource::Csv(reader) => {
                reader.set_sequence_rule(rule);
                reader.next().transpose()
            }
            PieceSource::Table(reader, own_rule, values) => {
                if !reader.read(values)? {
                    return Ok(None);
                }
                **own_rule = rule;
                row_of(values, reader.row(), own_rule).map(Some).map_err(|message| reader.error(message))
            }
        }
    }
}

/// The row that the values of a binary format are; `number` is its own. `Err` says what is wrong with it.
fn row_of(values: &[Option<u64>], number: u64, rule: &mut SequenceRule) -> Result<CampaignRow, String> {
    let mut sample = RawSample::default();
    for (index, value) in values.iter().enumerate().take(RAW.len()) {
        value.iter().for_each(|value| store(&mut sample, index, *value));
    }
    // Without gyroscopes the file may still have columns for their lagged telemetry.
    if values[GYROSCOPES].is_none() {
        sample.gyroscopes = Triad::ABSENT;
    }
    rule.take(&mut sample)?;
    let campaign = |index: usize| values.get(RAW.len() + index).copied().flatten().map(f64::from_bits);
    let set_point_c = campaign(0).unwrap_or(0.0);
    if !set_point_c.is_finite() {
        return Err(format!("set_point_c is {set_point_c}, give {SET_POINT}"));
    }
    // Programs that cannot write a missing integer write NaN.
    let position = campaign(1).filter(|position| !position.is_nan());
    let is_number = |position: &f64| position.fract() == 0.0 && (0.0..4_294_967_296.0).contains(position);
    match position {
        Some(position) if !is_number(&position) => Err(format!("position is {position}, give {POSITION}")),
        _ => Ok(CampaignRow { line: number, set_point_c, position: position.map(|number| number as u32), sample }),
    }
}

fn table_source(reader: impl TableReader + 'static) -> PieceSource {
    PieceSource::Table(Box::new(reader), Box::default(), Vec::new())
}

impl PieceSource {
    fn sequence_rule(&self) -> SequenceRule {
        match self {
            Self::Csv(reader) => reader.samples().sequence_rule(),
            Self::Table(_, rule, _) => **rule,
        }
    }

    /// Line or number of the last row.
    fn place(&self) -> u64 {
        match self {
            Self::Csv(reader) => reader.samples().line(),
            Self::Table(reader, ..) => reader.row(),
        }
    }

    /// The unit that [`place`](Self::place) counts; `None` for lines.
    fn unit(&self) -> Option<&'static str> {
        match self {
            Self::Csv(_) => None,
            Self::Table(reader, ..) => Some(reader.unit()),
        }
    }

    /// The IMU of the rows, where the piece names it. Valid after the first row.
    fn imu(&self) -> Option<&str> {
        match self {
            Self::Csv(_) => None,
            Self::Table(reader, ..) => reader.imu(),
        }
    }

    /// When the recorder received the last row, Unix time \[ns\].
    fn recorded_ns(&self) -> Option<u64> {
        match self {
            Self::Csv(reader) => reader.samples().recorded_ns(),
            Self::Table(_, _, values) => values.first().copied().flatten().filter(|ns| *ns > 0),
        }
    }

    /// Whether the last row has lagged telemetry.
    fn has_lag(&self) -> bool {
        match self {
            Self::Csv(reader) => reader.samples().has_lag(),
            Self::Table(_, _, values) => values.get(LAG_NS).is_some_and(Option::is_some),
        }
    }

    /// A warning if the end of the piece is missing.
    fn truncation(&self) -> Option<String> {
        match self {
            Self::Csv(reader) => reader.samples().truncation(),
            Self::Table(reader, ..) => reader.truncation(),
        }
    }
}

/// An open file, by format.
pub(super) enum Opened {
    Csv(Box<dyn Read>),
    Mcap(Box<dyn Read>),
    Parquet(File),
}

/// Opens a file and detects its format by the first bytes. `-` is stdin.
pub(super) fn open_source(path: &Path, bar: &ProgressBar, hash: Option<&SharedHash>) -> Result<Opened, Failure> {
    let io = |error: &io::Error| Failure::io("opening", path, error);
    let mut source = open_recording(path).map_err(|error| io(&error))?;
    let mut magic = Vec::new();
    (&mut source).take(MCAP_MAGIC.len() as u64).read_to_end(&mut magic).map_err(|error| io(&error))?;
    if magic.starts_with(PARQUET_MAGIC) {
        let message = "a Parquet file cannot be read from a pipe: its footer is at its end; name the file";
        let file = File::open(path).ok().filter(|file| file.metadata().is_ok_and(|metadata| metadata.is_file()));
        let file = file.ok_or_else(|| Failure::new(Exit::Usage, message))?;
        if let Some(hash) = hash {
            // The reader does not read the pages in order, so the hash needs a pass of its own.
            let mut source = HashingReader {
                source: Box::new(File::open(path).map_err(|error| io(&error))?),
                hash: Rc::clone(hash),
            };
            io::copy(&mut source, &mut io::sink()).map_err(|error| io(&error))?;
        }
        return Ok(Opened::Parquet(file));
    }
    let is_mcap = magic == MCAP_MAGIC;
    let source = Box::new(bar.wrap_read(Cursor::new(magic).chain(source)));
    let source: Box<dyn Read> = match hash {
        Some(hash) => Box::new(HashingReader { source, hash: Rc::clone(hash) }),
        None => source,
    };
    Ok(if is_mcap { Opened::Mcap(source) } else { Opened::Csv(source) })
}

/// Hashes the bytes of a source as they are read. The rest of the source is hashed when this is dropped.
struct HashingReader {
    source: Box<dyn Read>,
    hash: SharedHash,
}

impl Read for HashingReader {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.source.read(buffer)?;
        self.hash.borrow_mut().update(&buffer[..read]);
        Ok(read)
    }
}

impl Drop for HashingReader {
    fn drop(&mut self) {
        let mut rest = [0; 1 << 13];
        while self.read(&mut rest).is_ok_and(|read| read > 0) {}
    }
}

/// Sorts the pieces of a recording by time. `first` reads the times of a piece's first row, `None` if the piece is
/// empty. `times` chooses one time for each piece, by the same rule for all. Pieces without a time come first; if no
/// piece has one, the given order is kept.
pub(super) fn in_order<T>(
    paths: &[PathBuf],
    mut first: impl FnMut(&Path) -> Result<Option<T>, Failure>,
    times: impl FnOnce(&[Option<T>]) -> Vec<Option<u64>>,
) -> Result<Vec<PathBuf>, Failure> {
    if paths.len() < 2 {
        return Ok(paths.to_vec());
    }
    let usage = |message: String| Err(Failure::new(Exit::Usage, message));
    let mut names = Vec::new();
    for path in paths {
        let io = |error: &io::Error| Failure::io("opening", path, error);
        if path == Path::new("-") || !fs::metadata(path).map_err(|error| io(&error))?.is_file() {
            return usage(format!("{}: pieces of a recording must be files; a pipe is read alone", path.display()));
        }
        let name = fs::canonicalize(path).map_err(|error| io(&error))?;
        if names.contains(&name) {
            return usage(format!("{} is named twice; name every piece once", path.display()));
        }
        names.push(name);
    }
    let firsts: Vec<_> = paths.iter().map(|path| first(path)).collect::<Result<_, _>>()?;
    let mut pieces: Vec<_> = times(&firsts).into_iter().zip(paths).collect();
    // The sort is stable, and `None` is less than any time.
    pieces.sort_by_key(|(time, _)| *time);
    Ok(pieces.into_iter().map(|(_, path)| path.clone()).collect())
}

/// Refuses a piece of another IMU than that of the first piece.
fn refuse_other_imu((path, imu): (&Path, &str), (first, of): (&Path, &str)) -> Result<(), Failure> {
    if imu == of {
        return Ok(());
    }
    let (first, path, imu, of) = (first.display(), path.display(), imu.escape_debug(), of.escape_debug());
    Err(Failure::new(Exit::Data, format!("{path} is of {imu}, but {first} of {of}; give the pieces of one IMU")))
}

/// An optional column with a time by which pieces are sorted.
pub(super) fn time_column(name: &str) -> WantedColumn {
    WantedColumn { set: ColumnSet::Recorder, ..WantedColumn::number(name) }
}
