//! Reads the pieces of a recording as one, in every format.

use super::borders::Borders;
use super::converted::ConversionEnds;
use super::input::Input;
use super::open::{SharedHash, open_source};
use super::order::SessionOrder;
use super::part::{Clip, RowPlace};
use super::piece::{Piece, RowKind, WaitingPiece};
use super::pieces::Pieces;
use super::places::Places;
use crate::convert::{Conversion, Foreign, Scale};
use isotherm_recording::foreign::{LeftOutRows, VehicleState};
use isotherm_recording::{CampaignRow, Layout, LogImu, Progress, RecordingError, SequenceRule};
use isotherm_shared::lag::{LagCompletion, ReadingLimits};
use isotherm_shared::names::ImuId;
use isotherm_shared::table::{Nominal, PulseScale};
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::finding::{Finding, Location};
use isotherm_support::source::DataSource;
use sha2::Digest as _;
use std::path::{Path, PathBuf};

/// An iterator over the rows of a recording that ends at the first error. [`failure`](Self::failure) turns that error
/// into a [`Failure`] with file and place.
///
/// The `line` of a row counts over all pieces; [`places`](Self::places) gives its file and the line or row in it.
pub struct Recording {
    kind: RowKind,
    input: Input,
    bar: Progress,
    /// Pieces that are not open yet, in reverse order.
    waiting: Vec<WaitingPiece>,
    /// Whether the recording ends before a piece that does not go on.
    is_one: bool,
    current: Piece,
    borders: Borders,
    places: Places,
    hash: Option<SharedHash>,
    lag: LagCompletion,
    /// Number of pieces that have been opened.
    opened: u64,
    /// The sessions so far, of the rows that name one.
    sessions: SessionOrder,
    /// What the pieces that have ended were.
    converted: ConversionEnds,
    /// What is damaged in them, and whether the end of one is missing.
    damage: Vec<Finding>,
    clip: Clip,
    /// Whether a row of the current piece is within the part that is read.
    is_within: bool,
    /// The first device that rows name, or 0.
    device: u64,
    ended: bool,
}

impl Pieces {
    /// Opens the first of the recordings that the pieces are. It ends before the first piece that does not go on;
    /// [`Recording::others`] are left then.
    ///
    /// # Errors
    /// If there is no piece, or if the first one cannot be opened.
    pub fn first_recording(self, bar: &Progress) -> Result<Recording, Failure> {
        Recording::of_pieces(self, bar, None, true)
    }

    /// As [`first_recording`](Self::first_recording), and computes the SHA-256 of all its bytes.
    ///
    /// # Errors
    /// As [`first_recording`](Self::first_recording).
    pub fn first_recording_hashed(self, bar: &Progress) -> Result<Recording, Failure> {
        Recording::of_pieces(self, bar, Some(SharedHash::default()), true)
    }
}

impl Recording {
    /// Opens the pieces of a recording, named in any order; the folder of a bag of ROS stands for its files. `-` is
    /// stdin, which must be the only piece. A piece of raw samples that names no session, and begins its sequences
    /// anew, goes on with the piece before where its time does, and otherwise is a session of its own. `bar` advances
    /// by the bytes read.
    ///
    /// # Errors
    /// If a piece cannot be opened, is named twice, or has an invalid beginning.
    pub fn open(
        sources: &[DataSource],
        kind: RowKind,
        input: impl Into<Input>,
        bar: &Progress,
    ) -> Result<Self, Failure> {
        Self::open_with(sources, kind, input.into(), bar, None)
    }

    /// As [`open`](Self::open), and computes the SHA-256 of all bytes.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_hashed(
        sources: &[DataSource],
        kind: RowKind,
        input: impl Into<Input>,
        bar: &Progress,
    ) -> Result<Self, Failure> {
        Self::open_with(sources, kind, input.into(), bar, Some(SharedHash::default()))
    }

    fn open_with(
        sources: &[DataSource],
        kind: RowKind,
        input: Input,
        bar: &Progress,
        hash: Option<SharedHash>,
    ) -> Result<Self, Failure> {
        Self::of_pieces(Pieces::new(sources, kind, input)?, bar, hash, false)
    }

    /// The recording that these pieces are, or with `is_one` the first one.
    pub(super) fn of_pieces(
        pieces: Pieces,
        bar: &Progress,
        hash: Option<SharedHash>,
        is_one: bool,
    ) -> Result<Self, Failure> {
        let Pieces { kind, input, mut waiting, notes, has_foreign } = pieces;
        let Some(WaitingPiece { source: first, .. }) = waiting.pop() else {
            return Err(Failure::new(Exit::Usage, "no recording is named"));
        };
        let current = Piece::open(&first, kind, &input, bar, hash.as_ref())?;
        if !has_foreign.unwrap_or_else(|| current.source.conversion().is_some()) {
            refuse_needless(&input, first.name())?;
        }
        let mut places = Places::default();
        places.begin(&current.path, current.source.unit(), 0);
        let lag = LagCompletion::default();
        let clip = Clip::new(input.part);
        Ok(Self {
            kind,
            input,
            bar: bar.clone(),
            waiting,
            is_one,
            current,
            borders: Borders::new(notes),
            places,
            hash,
            lag,
            opened: 1,
            sessions: SessionOrder::default(),
            converted: ConversionEnds::default(),
            damage: Vec::new(),
            clip,
            is_within: false,
            device: 0,
            ended: false,
        })
    }

    /// Sets the time constant \[ns\] of the lagged temperature of all further rows, 0 for none. It is computed for
    /// pieces that have no lagged temperature; those that have are read as they are. Each session begins soaked.
    pub const fn set_lag(&mut self, lag_ns: u64) {
        self.lag.set_lag(lag_ns);
    }

    /// Sets which temperatures of all further rows are readings of the lag, by the table.
    pub const fn set_limits(&mut self, limits: Option<ReadingLimits>) {
        self.lag.set_limits(limits);
    }

    /// Sets the table that all rows of readings are for. Call it before the first row.
    pub fn set_table(&mut self, table: Option<PulseScale>) {
        self.current.source.set_table(table);
        if let Some(foreign) = &mut self.input.foreign {
            foreign.settings.table = table;
        }
    }

    /// The next row. At the end of a piece, opens the next one.
    fn advance(&mut self) -> Result<Option<CampaignRow>, RecordingError> {
        let mut rule = self.current.source.sequence_rule();
        // The piece before the current one, while no row of the current one has been read.
        let mut previous: Option<PathBuf> = None;
        loop {
            let row = self.current.next(rule).map_err(|error| match (error, &previous) {
                (RecordingError::Data { line, message }, Some(previous)) => {
                    RecordingError::Data { line, message: behind(previous, &message) }
                }
                (RecordingError::Place { place, message }, Some(previous)) => {
                    RecordingError::Place { place, message: behind(previous, &message) }
                }
                (error, _) => error,
            });
            if let Some(mut row) = row? {
                self.borders.take(&row.sample);
                self.borders.look_for(&row.sample, self.waiting.last());
                let again = self.sessions.take(row.sample.session, row.sample.sequence);
                again.map_err(|message| RecordingError::Data { line: row.line, message })?;
                self.lag.complete(&mut row.sample, self.current.source.has_lag());
                match self.clip.judge(&row.sample) {
                    RowPlace::Before => {
                        (rule, previous) = (self.current.source.sequence_rule(), None);
                        continue;
                    }
                    RowPlace::Within => return Ok(Some(self.keep(row))),
                    RowPlace::After => return self.end(),
                }
            }
            rule = self.current.source.sequence_rule();
            let file = Location::Recording(shown(&self.current.path).to_string());
            self.damage.extend(self.current.source.findings().into_iter().map(|finding| finding.at(file.clone())));
            // The log of an autopilot says by itself when the vehicle was in use.
            let is_log = self.current.source.conversion().is_some_and(|conversion| conversion.log_imu().is_some());
            let goes_on = |next: &WaitingPiece| !self.is_one || !is_log && self.borders.goes_on(next);
            let Some(next) = self.waiting.pop_if(|next| goes_on(next)) else { return self.end() };
            self.end_piece();
            let before = self.places.before() + self.current.source.place();
            self.borders.begin(&next, &self.current.path).map_err(RecordingError::Piece)?;
            let opened = Piece::open(&next.source, self.kind, &self.input, &self.bar, self.hash.as_ref());
            // An error is unlikely: the beginning was already read to sort the pieces.
            let mut opened = opened.map_err(RecordingError::Piece)?;
            if self.is_in_order() {
                opened.source.begin_after(self.borders.last_ns());
            }
            previous = Some(std::mem::replace(&mut self.current, opened).path);
            self.opened += 1;
            if self.kind == RowKind::Sample {
                rule.begin_piece(self.opened);
            }
            self.places.begin(&self.current.path, self.current.source.unit(), before);
        }
    }

    fn is_in_order(&self) -> bool {
        self.input.foreign.as_ref().is_some_and(|foreign| foreign.settings.in_order)
    }

    /// A row that is not left out, whose line counts over all pieces.
    fn keep(&mut self, row: CampaignRow) -> CampaignRow {
        self.current.source.keep(&row.sample);
        self.is_within = true;
        if self.device == 0 {
            self.device = row.sample.device;
        }
        CampaignRow { line: self.places.before() + row.line, ..row }
    }

    /// After the last row of a piece. One that is not within the part does not say what the rows are.
    fn end_piece(&mut self) {
        if core::mem::take(&mut self.is_within) || self.input.part.is_whole() {
            self.converted.take(&self.current);
        }
    }

    /// After the last row.
    fn end(&mut self) -> Result<Option<CampaignRow>, RecordingError> {
        self.end_piece();
        self.clip.check(&self.current.path).map(|()| None).map_err(RecordingError::Piece)
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

    /// The pieces that did not go on with this recording, of [`Pieces::first_recording`]. If a part ends before the
    /// recording does, its rest is passed over. To be called after the last row.
    pub fn others(&mut self) -> Option<Pieces> {
        while self.ended
            && let Some(row) = self.rest()
        {
            self.borders.take(&row);
        }
        let (waiting, input) = (core::mem::take(&mut self.waiting), self.input.clone());
        let others = Pieces { kind: self.kind, input, waiting, notes: Vec::new(), has_foreign: Some(true) };
        (!others.waiting.is_empty()).then_some(others)
    }

    /// The next row behind the part that was read; `None` at the end of the recording, and where it cannot be read.
    fn rest(&mut self) -> Option<RawSample> {
        loop {
            let row = self.current.next(SequenceRule::default());
            if let Ok(Some(row)) = row {
                return Some(row.sample);
            }
            let next = self.waiting.pop_if(|next| row.is_ok() && self.borders.goes_on(next))?;
            self.current = Piece::open(&next.source, self.kind, &self.input, &self.bar, self.hash.as_ref()).ok()?;
        }
    }

    /// Which columns the samples of the piece that is being read need, if it is of another program.
    #[must_use]
    pub fn foreign_layout(&self) -> Option<Layout> {
        self.current.source.conversion().map(Conversion::layout)
    }

    /// The places of the rows that have been read, to find the file and line of a row's `line`.
    #[must_use]
    pub const fn places(&self) -> &Places {
        &self.places
    }

    /// What the operator should know of foreign data, and of a part that is read, a line each. Valid after the last
    /// row.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        self.borders.notes().into_iter().chain(self.converted.notes()).chain(self.clip.note()).collect()
    }

    /// Rows that are left out before the part that is read, and the time from the begin of the recording to its first
    /// row \[s\].
    #[must_use]
    pub const fn left_out(&self) -> (u64, f64) {
        self.clip.left_out()
    }

    /// The rows of foreign data that are left out, since their stamps cannot be right. Valid after the last row.
    #[must_use]
    pub fn left_out_by_stamps(&self) -> LeftOutRows {
        self.converted.left_out_by_stamps()
    }

    /// What was found in the stamps and the format of foreign data, and concerns their worth; of recordings, what is
    /// damaged and left out, and whether the end of a file is missing. Valid after the last row.
    #[must_use]
    pub fn findings(&self) -> Vec<Finding> {
        self.damage.iter().cloned().chain(self.converted.findings()).collect()
    }

    /// What [`nominal_table`](isotherm_shared::table::nominal_table) needs to know of readings: as
    /// [`Conversion::nominal`](crate::convert::Conversion::nominal), of all pieces. Valid after the last row.
    ///
    /// # Errors
    /// If a piece is a recording, or if its unit is not known; if the pieces differ in interval, resolution, gyroscopes
    /// or largest reading.
    pub fn nominal(&self, imu: &ImuId) -> Result<Nominal, Failure> {
        self.converted.nominal(imu)
    }

    /// What the pulses of readings stand for: as [`Conversion::scale`](crate::convert::Conversion::scale), of all
    /// pieces. Valid after the last row.
    ///
    /// # Errors
    /// As [`nominal`](Self::nominal).
    pub fn scale(&self) -> Result<Scale, Failure> {
        self.converted.scale()
    }

    /// Whether all pieces are readings whose pulses were made for the nominal interval of a table. Valid after the last
    /// row.
    #[must_use]
    pub fn fits_table(&self) -> bool {
        self.converted.fits_table()
    }

    /// The IMU, as the logs of an autopilot name it; `None` unless all pieces are logs that name it alike. Valid after
    /// the last row.
    #[must_use]
    pub fn log_imu(&self) -> Option<LogImu> {
        self.converted.log_imu()
    }

    /// The first device that the rows so far name, as samples have it; `None` where they name none.
    #[must_use]
    pub const fn device(&self) -> Option<u64> {
        if self.device == 0 { None } else { Some(self.device) }
    }

    /// When the vehicle was armed and when it flew, where the piece that is being read is the log of an autopilot.
    /// Valid from the opening on.
    #[must_use]
    pub fn vehicle_state(&self) -> VehicleState {
        self.current.source.conversion().map(Conversion::vehicle_state).unwrap_or_default()
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
        // Pieces that are after the part that was read: their bytes are hashed as they are dropped.
        for piece in self.waiting.iter().rev().filter(|_| !self.is_one) {
            drop(open_source(&piece.source, &self.bar, Some(&hash))?);
        }
        if let Some(gyroscopes) = self.input.foreign.as_ref().and_then(|it| it.settings.gyroscope_file.as_ref()) {
            drop(open_source(gyroscopes, &self.bar, Some(&hash))?);
        }
        let digest = hash.try_borrow_mut().map(|mut hash| hash.finalize_reset());
        let digest = digest.map_err(|_| Failure::new(Exit::Failed, format!("hashing {}", shown(&path))))?;
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
    pub fn open(sources: &[DataSource], input: impl Into<Input>, bar: &Progress) -> Result<Self, Failure> {
        Recording::open(sources, RowKind::Sample, input, bar).map(Self)
    }

    /// As [`Recording::open_hashed`].
    ///
    /// # Errors
    /// As [`Recording::open`].
    pub fn open_hashed(sources: &[DataSource], input: impl Into<Input>, bar: &Progress) -> Result<Self, Failure> {
        Recording::open_hashed(sources, RowKind::Sample, input, bar).map(Self)
    }

    /// The recording that the samples are of: [`notes`](Recording::notes), [`findings`](Recording::findings) and
    /// [`nominal`](Recording::nominal) after the last row.
    #[must_use]
    pub const fn recording(&self) -> &Recording {
        &self.0
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

    /// As [`Recording::set_limits`].
    pub const fn set_limits(&mut self, limits: Option<ReadingLimits>) {
        self.0.set_limits(limits);
    }

    /// As [`Recording::set_table`].
    pub fn set_table(&mut self, table: Option<PulseScale>) {
        self.0.set_table(table);
    }

    /// When the recorder received the last sample, Unix time \[ns\]; `None` where the recording does not show it.
    #[must_use]
    pub fn recorded_ns(&self) -> Option<u64> {
        self.0.current.source.recorded_ns()
    }

    /// The IMU of the rows, where the recording names it: MCAP. Valid after the first row.
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

/// What is wrong with the first row of a piece, which the piece `previous` is before. Rows that do not rise are in
/// order already.
fn behind(previous: &Path, message: &str) -> String {
    let previous = shown(previous);
    match message.split_once("; it must rise") {
        Some((what, _)) => format!(
            "{what}; the piece before is {previous}: leave out the rows that are in both, or give those of another \
             start of the acquisition another session"
        ),
        None => format!("{message}; the piece before is {previous}"),
    }
}

/// Refuses what is said of foreign data where all pieces are recordings: it would have no effect.
fn refuse_needless(input: &Input, path: &Path) -> Result<(), Failure> {
    let given = input.foreign.as_ref().map(Foreign::given).unwrap_or_default();
    if given.is_empty() {
        return Ok(());
    }
    let (path, given) = (shown(path), given.join(", "));
    let message =
        format!("{path}: a recording, which has all that is needed; leave out what is for other data: {given}");
    Err(Failure::new(Exit::Usage, message))
}
