//! One piece of a recording: a file of Isotherm in any format, or foreign data.

use super::input::Input;
use super::mcap::McapReader;
use super::open::{SharedHash, SourceContent, open_source};
use super::recognise::{first_line, is_recording};
use super::table::{TableReader, sample_columns};
use crate::convert::{Conversion, Foreign, is_bag};
use isotherm_recording::Progress;
use isotherm_recording::columns::{GYROSCOPES, LAG_NS, RAW, store};
use isotherm_recording::{CampaignCsvReader, CampaignRow, POSITION, RecordingError, SET_POINT, SequenceRule};
use isotherm_shared::table::PulseScale;
use isotherm_shared::wire::{RawSample, Triad};
use isotherm_support::failure::Failure;
use isotherm_support::finding::{Finding, name};
use isotherm_support::source::DataSource;
use std::io::{BufReader, Cursor, Read};
use std::path::PathBuf;

/// The kind of rows that are read from a recording.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum RowKind {
    /// Raw samples. Set points are 0, and there are no positions.
    Sample,
    /// Raw samples of a campaign, with set point and position.
    Campaign,
}

/// The piece that is being read.
pub(super) struct Piece {
    pub(super) path: PathBuf,
    pub(super) source: PieceSource,
}

/// A piece that has not been opened.
pub(super) struct WaitingPiece {
    pub(super) source: DataSource,
    /// Its first row, unless it is empty or the only piece.
    pub(super) first: Option<RawSample>,
}

pub(super) enum PieceSource {
    Csv(Box<CampaignCsvReader<Box<dyn Read>>>),
    Table(Box<dyn TableReader>, Box<SequenceRule>, Vec<Option<u64>>),
    /// Foreign data, with the place of the last row.
    Foreign(Box<Conversion>, Box<SequenceRule>, u64),
}

impl Piece {
    pub(super) fn open(
        of: &DataSource,
        kind: RowKind,
        input: &Input,
        bar: &Progress,
        hash: Option<&SharedHash>,
    ) -> Result<Self, Failure> {
        let failed = |error: RecordingError| error.failure(of.name());
        let columns = || sample_columns(kind == RowKind::Campaign);
        let opened = open_source(of, bar, hash)?;
        // Foreign data have neither set points nor positions.
        let foreign = input.foreign.clone().filter(|_| kind == RowKind::Sample);
        let foreign = foreign.map(|mut foreign| {
            foreign.settings.progress = bar.clone();
            foreign
        });
        let opened = match (&foreign, opened) {
            (Some(foreign), SourceContent::Csv(source)) => recognised(of, source, foreign)?,
            (Some(foreign), SourceContent::Mcap(source)) if is_bag(of) => PieceContent::foreign(of, source, foreign)?,
            (_, opened) => PieceContent::Recording(opened),
        };
        let source = match opened {
            PieceContent::Foreign(conversion) => PieceSource::Foreign(conversion, Box::default(), 0),
            PieceContent::Recording(SourceContent::Csv(source)) => {
                let reader = match kind {
                    RowKind::Sample => CampaignCsvReader::of_samples(source),
                    RowKind::Campaign => CampaignCsvReader::new(source),
                };
                PieceSource::Csv(Box::new(reader.map_err(failed)?))
            }
            PieceContent::Recording(SourceContent::Mcap(source)) => {
                table_source(McapReader::new(of, source, columns(), input.imu.clone(), true))
            }
        };
        Ok(Self { path: of.name().to_owned(), source })
    }

    /// The next row, with its line or row number in this piece. `rule` has the state after the previous sample.
    pub(super) fn next(&mut self, rule: SequenceRule) -> Result<Option<CampaignRow>, RecordingError> {
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
            PieceSource::Foreign(conversion, own_rule, place) => {
                let Some((line, mut sample)) = conversion.next_row()? else { return Ok(None) };
                (*place, **own_rule) = (line, rule);
                // Sessions that are not given are those of all pieces.
                if conversion.is_unnamed() {
                    sample.session = 0;
                    if conversion.begins_session() {
                        own_rule.begin_session();
                    }
                }
                let row = own_rule.take(&mut sample).map(|()| row_of_sample(line, sample));
                row.map(Some).map_err(|message| conversion.error(line, message))
            }
        }
    }
}

/// A file that was recognised.
enum PieceContent {
    Recording(SourceContent),
    Foreign(Box<Conversion>),
}

impl PieceContent {
    fn foreign(of: &DataSource, source: Box<dyn Read>, foreign: &Foreign) -> Result<Self, Failure> {
        Conversion::of_source(of, source, foreign).map(Box::new).map(Self::Foreign)
    }
}

/// Recognises a text, or data that are in no format of recordings, by the first line.
fn recognised(of: &DataSource, source: Box<dyn Read>, foreign: &Foreign) -> Result<PieceContent, Failure> {
    let mut source = BufReader::new(source);
    let first = first_line(&mut source).map_err(|error| Failure::io("reading", of.name(), &error))?;
    let is_recording = is_recording(&first, foreign.mapping.is_some() || foreign.settings.mapping.is_some());
    let source = Box::new(Cursor::new(first).chain(source));
    match is_recording {
        true => Ok(PieceContent::Recording(SourceContent::Csv(source))),
        false => PieceContent::foreign(of, source, foreign),
    }
}

const fn row_of_sample(line: u64, sample: RawSample) -> CampaignRow {
    CampaignRow { line, set_point_c: 0.0, position: None, sample }
}

/// The row that the values of a binary format are; `number` is its own. `Err` says what is wrong with it.
fn row_of(values: &[Option<u64>], number: u64, rule: &mut SequenceRule) -> Result<CampaignRow, String> {
    let mut sample = RawSample::default();
    for (index, value) in values.iter().enumerate().take(RAW.len()) {
        value.iter().for_each(|value| store(&mut sample, index, *value));
    }
    // Without gyroscopes the file may still have columns for their lagged temperature.
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
    pub(super) fn sequence_rule(&self) -> SequenceRule {
        match self {
            Self::Csv(reader) => reader.samples().sequence_rule(),
            Self::Table(_, rule, _) | Self::Foreign(_, rule, _) => **rule,
        }
    }

    /// Line or number of the last row.
    pub(super) fn place(&self) -> u64 {
        match self {
            Self::Csv(reader) => reader.samples().line(),
            Self::Table(reader, ..) => reader.row(),
            Self::Foreign(_, _, place) => *place,
        }
    }

    /// The unit that [`place`](Self::place) counts; `None` for lines.
    pub(super) fn unit(&self) -> Option<&'static str> {
        match self {
            Self::Csv(_) => None,
            Self::Table(reader, ..) => Some(reader.unit()),
            Self::Foreign(conversion, ..) => conversion.unit(),
        }
    }

    /// The IMU of the rows, where the piece names it. Valid after the first row.
    pub(super) fn imu(&self) -> Option<&str> {
        match self {
            Self::Csv(_) | Self::Foreign(..) => None,
            Self::Table(reader, ..) => reader.imu(),
        }
    }

    /// When the recorder received the last row, Unix time \[ns\].
    pub(super) fn recorded_ns(&self) -> Option<u64> {
        match self {
            Self::Csv(reader) => reader.samples().recorded_ns(),
            Self::Table(_, _, values) => values.first().copied().flatten().filter(|ns| *ns > 0),
            Self::Foreign(..) => None,
        }
    }

    /// Whether the last row has lagged temperature.
    pub(super) fn has_lag(&self) -> bool {
        match self {
            Self::Csv(reader) => reader.samples().has_lag(),
            Self::Table(_, _, values) => values.get(LAG_NS).is_some_and(Option::is_some),
            Self::Foreign(..) => false,
        }
    }

    /// What was left out of the piece, and whether its end is missing. Nothing of foreign data: it is among what the
    /// conversion found.
    pub(super) fn findings(&self) -> Vec<Finding> {
        let (damage, truncation) = match self {
            Self::Csv(reader) => (reader.samples().damage(), reader.samples().truncation()),
            Self::Table(reader, ..) => (reader.damage(), reader.truncation()),
            Self::Foreign(..) => (None, None),
        };
        damage.into_iter().chain(truncation.map(|text| Finding::warning(name::TRUNCATED, text))).collect()
    }

    /// Takes a row that is not left out.
    pub(super) fn keep(&mut self, sample: &RawSample) {
        if let Self::Foreign(conversion, ..) = self {
            conversion.keep(sample);
        }
    }

    /// Lets rows of foreign data that have no time begin behind this time \[ns\].
    pub(super) fn begin_after(&mut self, last_ns: u64) {
        if let Self::Foreign(conversion, ..) = self {
            conversion.begin_after(last_ns);
        }
    }

    /// Sets the table that rows of foreign data are for.
    pub(super) fn set_table(&mut self, table: Option<PulseScale>) {
        if let Self::Foreign(conversion, ..) = self {
            conversion.set_table(table);
        }
    }

    /// The conversion of foreign data.
    pub(super) fn conversion(&self) -> Option<&Conversion> {
        if let Self::Foreign(conversion, ..) = self { Some(conversion) } else { None }
    }
}
