//! A recording as one, in whatever format and however many pieces it is.

use super::mcap::McapReader;
use super::parquet::ParquetReader;
use super::places::Places;
use super::table::{ImuChoice, TableReader, WantedColumn, sample_columns};
use indicatif::ProgressBar;
use isotherm_failure::{Exit, Failure};
use isotherm_files::open_recording;
use isotherm_recording::columns::{MCAP_MAGIC, PARQUET_MAGIC, RAW, store};
use isotherm_recording::{CampaignCsvReader, CampaignRow, RawCsvReader, RecordingError, SequenceRule};
use isotherm_shared::wire::RawSample;
use sha2::{Digest as _, Sha256};
use std::cell::RefCell;
use std::fs::{self, File};
use std::io::{self, Cursor, Read, Write as _};
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// Which rows a recording is read as.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum RowKind {
    /// Raw samples. Set points are then 0, and there are no positions.
    Sample,
    /// Raw samples of a campaign, with set point and position.
    Campaign,
}

/// An iterator over the rows of a recording that ends at the first error. [`failure`](Self::failure) makes that error a [`Failure`] with file
/// and place.
///
/// The `line` of a row counts over all pieces; [`places`](Self::places) tells file and place of it.
pub struct Recording {
    kind: RowKind,
    choice: ImuChoice,
    bar: ProgressBar,
    /// Pieces that are not open yet, the next one last.
    waiting: Vec<PathBuf>,
    current: Piece,
    places: Places,
    hash: Option<SharedHash>,
    ended: bool,
}

type SharedHash = Rc<RefCell<Sha256>>;

/// A piece that is being read.
struct Piece {
    path: PathBuf,
    source: PieceSource,
}

enum PieceSource {
    Csv(Box<RawCsvReader<Box<dyn Read>>>),
    CampaignCsv(Box<CampaignCsvReader<Box<dyn Read>>>),
    Table(Box<dyn TableReader>, SequenceRule, Vec<Option<u64>>),
}

impl Recording {
    /// Opens the pieces of a recording, given in any order; `-` is stdin, and then the only one. `bar` is moved by the bytes that are read.
    ///
    /// # Errors
    /// If a piece cannot be opened, is named twice, or its beginning is wrong.
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
        let first_time = |path: &Path| {
            let mut piece = Piece::open(path, kind, &choice, &ProgressBar::hidden(), None)?;
            let row = piece.next(SequenceRule::default());
            let row = row.map_err(|error| error.failure(path))?;
            Ok(row.map(|row| (piece.source.recorded_ns(), row.sample.timestamp_ns)))
        };
        let mut waiting = in_order(paths, first_time, |times: &[Option<(Option<u64>, u64)>]| {
            // The recorder's clock goes on when the acquisition starts anew, so it is used if all pieces have it.
            let recorded = times.iter().flatten().all(|(recorded_ns, _)| recorded_ns.is_some());
            times.iter().map(|time| time.map(|(unix, own)| if recorded { unix.unwrap_or(0) } else { own })).collect()
        })?;
        waiting.reverse();
        let Some(first) = waiting.pop() else {
            return Err(Failure::new(Exit::Usage, "no recording is named"));
        };
        let current = Piece::open(&first, kind, &choice, bar, hash.as_ref())?;
        let mut places = Places::default();
        places.begin(&current.path, current.source.unit(), 0);
        Ok(Self { kind, choice, bar: bar.clone(), waiting, current, places, hash, ended: false })
    }

    /// The next row. Opens the next piece where one has ended.
    fn advance(&mut self) -> Result<Option<CampaignRow>, RecordingError> {
        let mut order = self.current.source.order();
        loop {
            if let Some(row) = self.current.next(order)? {
                return Ok(Some(CampaignRow { line: self.places.before() + row.line, ..row }));
            }
            order = self.current.source.order();
            if let (Some(cut), false) = (self.current.source.cut(), cfg!(test)) {
                let path = self.current.path.display();
                let _ = writeln!(io::stderr(), "isotherm: warning: {path}: {cut}");
            }
            let Some(next) = self.waiting.pop() else { return Ok(None) };
            let before = self.places.before() + self.current.source.place();
            let opened = Piece::open(&next, self.kind, &self.choice, &self.bar, self.hash.as_ref());
            // Its beginning has been read before, when the pieces were put in order.
            let opened = opened.map_err(|failure| RecordingError::Io(io::Error::other(failure.message)))?;
            self.current = opened;
            self.places.begin(&self.current.path, self.current.source.unit(), before);
        }
    }

    /// The failure of a program that reads this recording: `error` with file and place.
    #[must_use]
    pub fn failure(&self, error: &RecordingError) -> Failure {
        match error {
            RecordingError::Data { line, message } => {
                Failure::new(Exit::Data, format!("{}: {message}", self.places.locate(*line)))
            }
            _ => error.failure(&self.current.path),
        }
    }

    /// Where the rows that have been read are: file and line of a row's `line`.
    #[must_use]
    pub const fn places(&self) -> &Places {
        &self.places
    }

    /// SHA-256 of the bytes of all pieces, in order, as hexadecimal digits; empty unless opened by [`open_hashed`](Self::open_hashed).
    /// To be called at the end.
    ///
    /// # Errors
    /// If what follows the last row cannot be read.
    pub fn sha256(self) -> Result<String, Failure> {
        let path = self.current.path.clone();
        let Some(hash) = self.hash else { return Ok(String::new()) };
        drop(self.current);
        let digest = hash.try_borrow_mut().map(|mut hash| hash.finalize_reset());
        let digest = digest.map_err(|_| Failure::new(Exit::Failed, format!("hashing {}", path.display())))?;
        Ok(digest.iter().map(|byte| format!("{byte:02x}")).collect())
    }
}

impl Iterator for Recording {
    type Item = Result<CampaignRow, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let item = self.advance().map_err(|error| match error {
            // From now on a line counts over all pieces.
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
            Opened::Csv(source) if kind == RowKind::Campaign => {
                PieceSource::CampaignCsv(Box::new(CampaignCsvReader::new(source).map_err(failed)?))
            }
            Opened::Csv(source) => PieceSource::Csv(Box::new(RawCsvReader::new(source).map_err(failed)?)),
            Opened::Mcap(source) => table(McapReader::new(source, columns(), choice.clone(), true)),
            Opened::Parquet(file) => table(ParquetReader::open(file, columns(), choice, bar).map_err(failed)?),
        };
        Ok(Self { path: path.to_owned(), source })
    }

    /// The next row, with its place in this piece; `order` is the rule as it stands.
    fn next(&mut self, order: SequenceRule) -> Result<Option<CampaignRow>, RecordingError> {
        match &mut self.source {
            PieceSource::Csv(reader) => {
                reader.set_order(order);
                let sample = reader.next().transpose()?;
                let line = reader.line();
                Ok(sample.map(|sample| CampaignRow { line, set_point_c: 0.0, position: None, sample }))
            }
            PieceSource::CampaignCsv(reader) => {
                reader.set_order(order);
                reader.next().transpose()
            }
            PieceSource::Table(reader, rule, values) => {
                if !reader.read(values)? {
                    return Ok(None);
                }
                let mut sample = RawSample::default();
                for (place, value) in values.iter().enumerate().take(RAW.len()) {
                    value.iter().for_each(|value| store(&mut sample, place, *value));
                }
                *rule = order;
                rule.check(&sample).map_err(|message| reader.error(message))?;
                let number = |place: usize| values.get(RAW.len() + place).copied().flatten().map(f64::from_bits);
                let set_point_c = number(0).unwrap_or(0.0);
                if !set_point_c.is_finite() {
                    return Err(
                        reader.error(format!("set_point_c is {set_point_c}, give the chamber's set point in degC"))
                    );
                }
                // Programs that have no missing whole numbers write NaN.
                let position = number(1).filter(|position| !position.is_nan());
                let whole = |number: f64| {
                    (number.fract() == 0.0 && (0.0..4_294_967_296.0).contains(&number)).then_some(number as u32)
                };
                let position = match position.map(|number| whole(number).ok_or(number)).transpose() {
                    Ok(position) => position,
                    Err(number) => {
                        let right = "the number of a position, or nothing while the table moves";
                        return Err(reader.error(format!("position is {number}, give {right}")));
                    }
                };
                Ok(Some(CampaignRow { line: reader.row(), set_point_c, position, sample }))
            }
        }
    }
}

fn table(reader: impl TableReader + 'static) -> PieceSource {
    PieceSource::Table(Box::new(reader), SequenceRule::default(), Vec::new())
}

impl PieceSource {
    fn order(&self) -> SequenceRule {
        match self {
            Self::Csv(reader) => reader.order(),
            Self::CampaignCsv(reader) => reader.order(),
            Self::Table(_, order, _) => *order,
        }
    }

    /// Place of the last row.
    fn place(&self) -> u64 {
        match self {
            Self::Csv(reader) => reader.line(),
            Self::CampaignCsv(reader) => reader.line(),
            Self::Table(reader, ..) => reader.row(),
        }
    }

    /// What places count: `None` for lines.
    fn unit(&self) -> Option<&'static str> {
        match self {
            Self::Csv(_) | Self::CampaignCsv(_) => None,
            Self::Table(reader, ..) => Some(reader.unit()),
        }
    }

    /// When the recorder received the last row, Unix time \[ns\].
    fn recorded_ns(&self) -> Option<u64> {
        match self {
            Self::Csv(reader) => reader.recorded_ns(),
            Self::CampaignCsv(_) => None,
            Self::Table(_, _, values) => values.first().copied().flatten().filter(|ns| *ns > 0),
        }
    }

    fn cut(&self) -> Option<String> {
        match self {
            Self::Csv(reader) => reader.cut(),
            Self::CampaignCsv(reader) => reader.cut(),
            Self::Table(reader, ..) => reader.cut(),
        }
    }
}

/// An open file, its format told by its first bytes.
pub enum Opened {
    Csv(Box<dyn Read>),
    Mcap(Box<dyn Read>),
    Parquet(File),
}

/// Opens a file; `-` is stdin.
pub fn open_source(path: &Path, bar: &ProgressBar, hash: Option<&SharedHash>) -> Result<Opened, Failure> {
    let io = |error: &io::Error| Failure::io("opening", path, error);
    let mut source = open_recording(path).map_err(|error| io(&error))?;
    let mut head = Vec::new();
    (&mut source).take(MCAP_MAGIC.len() as u64).read_to_end(&mut head).map_err(|error| io(&error))?;
    if head.starts_with(PARQUET_MAGIC) {
        let what = "a Parquet file cannot be read from a pipe: its footer is at its end; name the file";
        let file = File::open(path).ok().filter(|file| file.metadata().is_ok_and(|metadata| metadata.is_file()));
        let file = file.ok_or_else(|| Failure::new(Exit::Usage, what))?;
        if let Some(hash) = hash {
            // Its pages are not read one after the other, so this is a pass of its own.
            let mut source =
                Hashing { source: Box::new(File::open(path).map_err(|error| io(&error))?), hash: Rc::clone(hash) };
            io::copy(&mut source, &mut io::sink()).map_err(|error| io(&error))?;
        }
        return Ok(Opened::Parquet(file));
    }
    let is_mcap = head == MCAP_MAGIC;
    let whole = Box::new(bar.wrap_read(Cursor::new(head).chain(source)));
    let source: Box<dyn Read> = match hash {
        Some(hash) => Box::new(Hashing { source: whole, hash: Rc::clone(hash) }),
        None => whole,
    };
    Ok(if is_mcap { Opened::Mcap(source) } else { Opened::Csv(source) })
}

/// A source whose bytes are hashed as they are read. What is left when it is dropped is hashed too.
struct Hashing {
    source: Box<dyn Read>,
    hash: SharedHash,
}

impl Read for Hashing {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.source.read(buffer)?;
        self.hash.borrow_mut().update(&buffer[..read]);
        Ok(read)
    }
}

impl Drop for Hashing {
    fn drop(&mut self) {
        let mut rest = [0; 1 << 13];
        while self.read(&mut rest).is_ok_and(|read| read > 0) {}
    }
}

/// Puts the pieces of a recording in order: `first` reads what tells when a piece begins, `None` from an empty one, and `times` makes times
/// of that, the same way for all pieces. Pieces without a time come first; without any, the order is the one that was given.
pub fn in_order<T>(
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
    // Stable, and `None` is before any time.
    pieces.sort_by_key(|(time, _)| *time);
    Ok(pieces.into_iter().map(|(_, path)| path.clone()).collect())
}

/// A wanted column by which pieces are put in order, if they have it.
pub fn time_column(name: &str) -> WantedColumn {
    WantedColumn { optional: true, ..WantedColumn::number(name) }
}
