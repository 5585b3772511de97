//! The schemas, channels and messages of an MCAP file, from beginning to end.
//!
//! A chunk whose index says that all of its messages are of unwanted channels is not unpacked. A chunk has a CRC, and
//! one that does not match it is left out and counted. What is outside of chunks has a CRC at the end of a file that
//! was ended. Where it was not, a record of another kind than it was written as must not be taken for rows, nor hide
//! any.

use super::chunk::{Chunk, ChunkBuffer, HEAD};
use super::frames::{Frame, Frames, unpacked};
use super::panics::catch_panic;
use super::plausible::{foreign, foreign_to_chunk, impossible, is_own};
use super::skip::{ChannelFilter, ChunkIndex};
use isotherm_recording::steps;
use isotherm_recording::{DamagedPlaces, RecordingError, RowsBefore};
use isotherm_support::finding::Finding;
use mcap::parse_record;
use mcap::records::{Record, op};
use std::collections::VecDeque;
use std::io::{self, Read};

/// Time and place of a message in an index \[bytes\].
const INDEX_ENTRY: usize = 16;

/// Reads the records of an MCAP file. An unfinished file is read up to its last complete record, and what is damaged is
/// left out.
pub(crate) struct Records {
    frames: Frames,
    /// The chunk that is read, and its place in the file.
    chunk: Option<(Chunk, u64)>,
    /// The channels whose messages are not wanted, and the chunk whose index is being read, with its place.
    unwanted: ChannelFilter,
    indexed: Option<(ChunkIndex, u64)>,
    /// The schemas and channels of the summary, which are given once something is damaged.
    described: VecDeque<Record<'static>>,
    /// Messages that have been passed over.
    skipped: u64,
    unpacked: ChunkBuffer,
    before: RowsBefore,
    damaged: DamagedPlaces,
    /// Whether the file ends within a record.
    truncated: bool,
    /// Whether the end of the data was read: what follows repeats them, and is not used.
    data_ended: bool,
    /// The library that wrote the file, and whether it is the recorder.
    library: String,
    is_own: bool,
}

/// Why there is no next record.
pub(crate) enum RecordsError {
    /// The source cannot be read.
    Io(io::Error),
    /// The file must not be read.
    Invalid(String),
}

impl RecordsError {
    /// The error of a reader: `invalid` names where the file is not valid.
    pub(crate) fn located(self, invalid: impl FnOnce(String) -> RecordingError) -> RecordingError {
        match self {
            Self::Io(error) => error.into(),
            Self::Invalid(message) => invalid(message),
        }
    }
}

impl Records {
    /// Reads all of `source`.
    pub(crate) fn new(source: Box<dyn Read>) -> Self {
        Self::without(source, ChannelFilter::default())
    }

    /// Reads from `source` what is not only of unwanted channels.
    pub(crate) fn without(source: Box<dyn Read>, unwanted: ChannelFilter) -> Self {
        Self {
            frames: Frames::new(source),
            chunk: None,
            unwanted,
            indexed: None,
            described: VecDeque::new(),
            skipped: 0,
            unpacked: ChunkBuffer::default(),
            before: RowsBefore::default(),
            damaged: DamagedPlaces::of("message"),
            truncated: false,
            data_ended: false,
            library: String::new(),
            is_own: false,
        }
    }

    /// The next schema, channel or message; `None` at the end.
    pub(crate) fn next(&mut self) -> Result<Option<Record<'static>>, RecordsError> {
        loop {
            if let Some(record) = self.described.pop_front() {
                return Ok(Some(record));
            }
            if let Some(record) = self.of_chunk() {
                return Ok(Some(record));
            }
            if self.chunk.is_some() {
                continue;
            }
            let frame = self.frames.next().map_err(RecordsError::Io)?;
            if !matches!(frame, Frame::Record(op::MESSAGE_INDEX, _))
                && let Some((chunk, place)) = self.indexed.take()
            {
                self.judge_index(&chunk, place)?;
                continue;
            }
            match frame {
                Frame::Record(opcode, content) => {
                    steps::count(1);
                    if let Some(record) = self.take(opcode, content)? {
                        return Ok(Some(record));
                    }
                }
                Frame::Damaged(cause) => self.leave_out(self.frames.place(), cause.to_owned())?,
                Frame::Cut if self.data_ended => self.truncated = true,
                Frame::Cut => {
                    let place = self.frames.place();
                    self.truncated = !self.frames.resume().map_err(RecordsError::Io)?;
                    if !self.truncated {
                        self.count(place, "a record that is longer than there can be".to_owned());
                    }
                }
                Frame::End => return Ok(None),
            }
            if self.truncated {
                return Ok(None);
            }
        }
    }

    /// Takes a record outside of chunks.
    fn take(&mut self, opcode: u8, content: std::ops::Range<usize>) -> Result<Option<Record<'static>>, RecordsError> {
        let (place, length) = (self.frames.place(), HEAD + content.len());
        let bytes = self.frames.bytes(content);
        let wrong = impossible(opcode, bytes, self.data_ended);
        if let Some(cause) = wrong.or_else(|| foreign(opcode, bytes).filter(|_| self.is_own)) {
            self.leave_out(place, cause.to_owned())?;
            return Ok(None);
        }
        let mut record = None;
        match opcode {
            op::CHUNK => {
                let content = bytes.to_vec();
                if self.unwanted.is_empty() || self.is_own {
                    return self.open(&content, place).map(|()| None);
                }
                self.indexed = Some((ChunkIndex::new(content), place));
            }
            op::MESSAGE_INDEX => {
                // A channel, the bytes of times and places, and these.
                let channel = bytes.first_chunk().map_or(0, |channel| u16::from_le_bytes(*channel));
                let messages = (bytes.len() / INDEX_ENTRY) as u64;
                self.indexed.iter_mut().for_each(|(chunk, _)| chunk.add(channel, messages));
            }
            op::DATA_END => {
                self.data_ended = true;
                let saved = bytes.first_chunk().map_or(0, |saved| u32::from_le_bytes(*saved));
                if saved != 0 && self.damaged.is_empty() && saved != self.frames.crc() {
                    self.count(place, "outside of its chunks the file does not match its check".to_owned());
                }
            }
            op::HEADER | op::SCHEMA | op::CHANNEL | op::MESSAGE => match parsed(opcode, bytes) {
                Some(parsed) => record = self.given(parsed),
                None => {
                    self.leave_out(place, "a record that cannot be read".to_owned())?;
                    return Ok(None);
                }
            },
            _ => {}
        }
        self.frames.pass(length);
        Ok(record)
    }

    /// A record that is given to the caller.
    fn given(&mut self, record: Record<'static>) -> Option<Record<'static>> {
        match record {
            Record::Header(header) => {
                self.is_own = is_own(&header);
                self.library = header.library;
                None
            }
            Record::Message { ref header, .. } => {
                self.before.take(header.log_time);
                Some(record)
            }
            record => Some(record),
        }
    }

    /// The next record of the chunk that is read; `None` behind it. A chunk with what no chunk has is left out from
    /// there on.
    fn of_chunk(&mut self) -> Option<Record<'static>> {
        let (chunk, place) = self.chunk.as_mut()?;
        let (place, is_own) = (*place, self.is_own);
        let judged = match chunk.next() {
            Ok(None) => Ok(None),
            Ok(Some((opcode, data))) => {
                let wrong = foreign_to_chunk(opcode).or_else(|| impossible(opcode, data, false));
                let wrong = wrong.or_else(|| foreign(opcode, data).filter(|_| is_own)).map(str::to_owned);
                wrong.map_or_else(
                    || parsed(opcode, data).ok_or("a record that cannot be read".to_owned()).map(Some),
                    Err,
                )
            }
            Err(cause) => Err(cause),
        };
        match judged {
            Ok(Some(record)) => self.given(record),
            Ok(None) => {
                self.chunk = None;
                None
            }
            Err(cause) => {
                self.chunk = None;
                self.count(place, cause);
                None
            }
        }
    }

    /// Begins to read the chunk at the next record.
    fn open(&mut self, content: &[u8], place: u64) -> Result<(), RecordsError> {
        match self.begin(content)? {
            Ok(chunk) => {
                self.frames.pass(HEAD + content.len());
                self.frames.keep();
                self.chunk = Some((chunk, place));
                Ok(())
            }
            Err(cause) => self.leave_out(place, cause),
        }
    }

    /// Unpacks a chunk: the inner error says what is damaged.
    fn begin(&mut self, content: &[u8]) -> Result<Result<Chunk, String>, RecordsError> {
        self.unpacked.add(content, self.frames.read()).map_err(RecordsError::Invalid)?;
        Ok(unpacked(content))
    }

    /// Decides about a chunk whose index has ended. What stands behind it was read already.
    fn judge_index(&mut self, chunk: &ChunkIndex, place: u64) -> Result<(), RecordsError> {
        if let Some(messages) = chunk.all_unwanted(&self.unwanted) {
            self.skipped += messages;
            return Ok(());
        }
        match self.begin(chunk.chunk())? {
            Ok(chunk) => self.chunk = Some((chunk, place)),
            Err(cause) => self.count(place, cause),
        }
        Ok(())
    }

    /// Leaves out what is damaged at a place, and goes on at the next whole chunk.
    fn leave_out(&mut self, place: u64, cause: String) -> Result<(), RecordsError> {
        self.count(place, cause);
        // The summary repeats what was read.
        if self.data_ended || !self.frames.resume().map_err(RecordsError::Io)? {
            self.data_ended = true;
            self.truncated = !self.frames.skip_to_end().map_err(RecordsError::Io)?;
        }
        Ok(())
    }

    fn count(&mut self, place: u64, cause: String) {
        self.damaged.take(format!("byte {place}"), self.before, cause);
        self.described.extend(self.unwanted.take_described());
    }

    /// Number of bytes read.
    pub(crate) const fn bytes(&self) -> u64 {
        self.frames.read()
    }

    /// The name of the library that wrote the file. Valid after the first record.
    pub(crate) fn library(&self) -> &str {
        &self.library
    }

    /// What is damaged and left out. Valid after the last record.
    pub(crate) fn damage(&self) -> Option<Finding> {
        self.damaged.finding(self.before)
    }

    /// Whether the file ends within a record. Valid after the last record.
    pub(crate) const fn is_cut(&self) -> bool {
        self.truncated
    }

    /// A warning if the end of the file is missing. Valid after the last record.
    pub(crate) fn truncation(&self) -> Option<String> {
        let what = match (self.truncated, self.frames.is_ended()) {
            (true, _) => "its last record is cut and left out",
            (false, false) => "it has no end record",
            _ => return None,
        };
        Some(format!("the recording was not ended properly: {what}; everything before has been read"))
    }

    /// Messages that have been passed over, since their channels are not wanted.
    pub(crate) const fn skipped(&self) -> u64 {
        self.skipped
    }
}

/// A record; `None` if it is damaged. The library panics at some damage.
fn parsed(opcode: u8, content: &[u8]) -> Option<Record<'static>> {
    catch_panic(|| parse_record(opcode, content).ok().map(Record::into_owned)).flatten()
}
