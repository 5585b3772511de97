//! The schemas, channels and messages of an MCAP file, from beginning to end.
//!
//! A chunk whose index says that all of its messages are of unwanted channels is not unpacked.
//! A chunk has a CRC. What is outside of chunks has one at the end of a file that was ended. Where it was not, a record
//! of another kind than it was written as must not be taken for rows, nor hide any.

use super::chunk::{Chunk, ChunkBuffer, MAX_RECORD};
use super::panics::catch_panic;
use super::plausible::{foreign, foreign_to_chunk, impossible, is_own};
use super::skip::{ChannelFilter, ChunkIndex};
use isotherm_recording::RecordingError;
use isotherm_recording::columns::MCAP_MAGIC;
use isotherm_recording::steps;
use mcap::records::{Header, Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, parse_record};
use std::io::{self, Read};

/// What is said of a file that no writer writes.
const DAMAGED: &str = "the file is damaged";
/// Time and place of a message in an index \[bytes\].
const INDEX_ENTRY: u64 = 16;
/// Most bytes that are read at once.
const BUFFER: usize = 1 << 20;

/// Reads the records of an MCAP file. An unfinished file is read up to its last complete record.
pub(crate) struct Records {
    source: Box<dyn Read>,
    reader: LinearReader,
    /// The chunk that is read.
    chunk: Option<Chunk>,
    /// The channels whose messages are not wanted, and the chunk whose index is being read.
    unwanted: ChannelFilter,
    indexed: Option<ChunkIndex>,
    /// What came behind that index.
    after_index: Option<Option<McapEvent>>,
    /// Messages that have been passed over.
    skipped: u64,
    unpacked: ChunkBuffer,
    bytes: u64,
    /// Whether the footer was read.
    finished: bool,
    /// Whether the file ends within a record.
    truncated: bool,
    /// Whether the end of the data was read: what follows repeats them, and is not used.
    data_ended: bool,
    /// Whether the recorder wrote the file.
    is_own: bool,
    /// The last bytes that were read.
    tail: [u8; MCAP_MAGIC.len()],
}

/// Why there is no next record.
pub(crate) enum RecordsError {
    /// The source cannot be read.
    Io(io::Error),
    /// The file is not valid.
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

/// An event of the library's reader.
enum McapEvent {
    Read(usize),
    Record(Record<'static>),
    Header(Header),
    /// The content of a chunk.
    Chunk(Vec<u8>),
    /// The index of messages of a channel in the chunk before, and their number.
    Index(u16, u64),
    DataEnd,
    Footer,
    /// A record that cannot be there, and why.
    Impossible(&'static str),
    Other,
}

impl Records {
    /// Reads from `source` what is not only of unwanted channels.
    pub(crate) fn without(source: Box<dyn Read>, unwanted: ChannelFilter) -> Self {
        let options = options().with_validate_data_section_crc(true);
        Self {
            source,
            reader: LinearReader::new_with_options(options),
            chunk: None,
            unwanted,
            indexed: None,
            after_index: None,
            skipped: 0,
            unpacked: ChunkBuffer::default(),
            bytes: 0,
            finished: false,
            truncated: false,
            data_ended: false,
            is_own: false,
            tail: Default::default(),
        }
    }

    /// The next schema, channel or message; `None` at the end.
    pub(crate) fn next(&mut self) -> Result<Option<Record<'static>>, RecordsError> {
        loop {
            if let Some(event) = self.of_chunk()? {
                if let McapEvent::Record(record) = event {
                    return Ok(Some(record));
                }
                continue;
            }
            let event = self.event()?;
            match event {
                Some(McapEvent::Read(need)) => self.read(need).map_err(RecordsError::Io)?,
                Some(McapEvent::Header(header)) => self.is_own = is_own(&header),
                Some(McapEvent::DataEnd) => self.data_ended = true,
                Some(McapEvent::Footer) => self.finished = true,
                Some(McapEvent::Other | McapEvent::Impossible(_)) => {}
                Some(McapEvent::Chunk(content)) => self.take_chunk(content)?,
                Some(McapEvent::Index(channel, messages)) => {
                    self.indexed.iter_mut().for_each(|indexed| indexed.add(channel, messages));
                }
                Some(McapEvent::Record(record)) => return Ok(Some(record)),
                None if self.truncated && self.tail == *MCAP_MAGIC => {
                    return Err(RecordsError::Invalid(format!("a record that is longer than the file; {DAMAGED}")));
                }
                None => return Ok(None),
            }
        }
    }

    fn read(&mut self, need: usize) -> io::Result<()> {
        let buffer = self.reader.insert(need.clamp(1, BUFFER));
        let read = self.source.read(buffer)?;
        let last = read.min(self.tail.len());
        self.tail.rotate_left(last);
        let place = self.tail.len() - last;
        self.tail[place..].copy_from_slice(&buffer[read - last..read]);
        self.bytes += read as u64;
        self.reader.notify_read(read);
        Ok(())
    }

    /// Number of bytes read.
    pub(crate) const fn bytes(&self) -> u64 {
        self.bytes
    }

    /// A warning if the end of the file is missing. Valid after the last record.
    pub(crate) fn truncation(&self) -> Option<String> {
        let what = match (self.truncated, self.finished) {
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

    /// The next event of the chunk that is read; `None` behind it.
    fn of_chunk(&mut self) -> Result<Option<McapEvent>, RecordsError> {
        let Some(chunk) = &mut self.chunk else { return Ok(None) };
        let Some((opcode, data)) = chunk.next().map_err(damaged)? else {
            self.chunk = None;
            return Ok(None);
        };
        let (data_ended, is_own) = (self.data_ended, self.is_own);
        checked(catch_panic(|| {
            Some(match foreign_to_chunk(opcode) {
                Some(what) => Ok(McapEvent::Impossible(what)),
                None => judged(opcode, data, data_ended, is_own),
            })
        }))
    }

    /// Takes a chunk: one that may have to be read waits for its index.
    fn take_chunk(&mut self, content: Vec<u8>) -> Result<(), RecordsError> {
        if self.unwanted.is_empty() || self.is_own {
            return self.open(&content);
        }
        self.indexed = Some(ChunkIndex::new(content));
        Ok(())
    }

    /// Begins to read a chunk.
    fn open(&mut self, content: &[u8]) -> Result<(), RecordsError> {
        let counted = self.unpacked.add(content, self.bytes);
        counted.map_err(|message| RecordsError::Invalid(format!("{message}; or {DAMAGED}")))?;
        self.chunk = Some(unpacked(content).map_err(damaged)?);
        Ok(())
    }

    /// The library's next event outside of chunks; `None` at the end.
    fn event(&mut self) -> Result<Option<McapEvent>, RecordsError> {
        if let Some(event) = self.after_index.take() {
            return Ok(event);
        }
        steps::count(1);
        let (data_ended, is_own) = (self.data_ended, self.is_own);
        let event = catch_panic(|| {
            Some(match self.reader.next_event()? {
                Ok(LinearReadEvent::ReadRequest(need)) => Ok(McapEvent::Read(need)),
                Ok(LinearReadEvent::Record { opcode, data }) => judged(opcode, data, data_ended, is_own),
                Err(error) => Err(error),
            })
        });
        // The file ends within a record.
        if let Some(Some(Err(McapError::UnexpectedEof))) = event {
            self.truncated = true;
            return self.ended(None);
        }
        let event = checked(event)?;
        match event {
            Some(McapEvent::Read(_) | McapEvent::Index(..)) => Ok(event),
            event => self.ended(event),
        }
    }

    /// Decides about the chunk whose index has ended, before `event`.
    fn ended(&mut self, event: Option<McapEvent>) -> Result<Option<McapEvent>, RecordsError> {
        let Some(indexed) = self.indexed.take() else { return Ok(event) };
        if let Some(messages) = indexed.all_unwanted(&self.unwanted) {
            self.skipped += messages;
            return Ok(event);
        }
        self.after_index = Some(event);
        self.open(indexed.chunk())?;
        Ok(Some(McapEvent::Other))
    }
}

/// How a file, or a part of one, is read.
fn options() -> LinearReaderOptions {
    LinearReaderOptions::default().with_skip_end_magic(true).with_emit_chunks(true).with_record_length_limit(MAX_RECORD)
}

/// What a record is.
fn judged(opcode: u8, data: &[u8], data_ended: bool, is_own: bool) -> Result<McapEvent, McapError> {
    match impossible(opcode, data, data_ended).or_else(|| foreign(opcode, data).filter(|_| is_own)) {
        Some(what) => Ok(McapEvent::Impossible(what)),
        None => event_of(opcode, data),
    }
}

/// The event of a reader: `None` if the library has panicked.
fn checked(event: Option<Option<Result<McapEvent, McapError>>>) -> Result<Option<McapEvent>, RecordsError> {
    let message = match event {
        None => "a record that cannot be read".to_owned(),
        Some(None) => return Ok(None),
        Some(Some(Ok(McapEvent::Impossible(what)))) => what.to_owned(),
        Some(Some(Ok(event))) => return Ok(Some(event)),
        Some(Some(Err(McapError::BadDataCrc { .. }))) => {
            format!("outside of its chunks the file does not match its check; {DAMAGED}")
        }
        Some(Some(Err(error))) => format!("not a valid MCAP file: {error}; {DAMAGED}"),
    };
    Err(RecordsError::Invalid(message))
}

/// The records of a chunk. The libraries that unpack them may panic at some damage.
fn unpacked(content: &[u8]) -> Result<Chunk, String> {
    catch_panic(|| Chunk::new(content)).unwrap_or_else(|| Err("a chunk that cannot be unpacked".to_owned()))
}

/// An error of damage in a chunk.
fn damaged(message: String) -> RecordsError {
    RecordsError::Invalid(format!("{message}; {DAMAGED}"))
}

fn event_of(opcode: u8, data: &[u8]) -> Result<McapEvent, McapError> {
    Ok(match opcode {
        op::DATA_END => McapEvent::DataEnd,
        op::FOOTER => McapEvent::Footer,
        op::CHUNK => McapEvent::Chunk(data.to_vec()),
        op::MESSAGE_INDEX => {
            // A channel, the bytes of times and places, and these.
            let channel = data.first_chunk().map_or(0, |channel| u16::from_le_bytes(*channel));
            McapEvent::Index(channel, data.len() as u64 / INDEX_ENTRY)
        }
        op::HEADER | op::SCHEMA | op::CHANNEL | op::MESSAGE => match parse_record(opcode, data)?.into_owned() {
            Record::Header(header) => McapEvent::Header(header),
            record => McapEvent::Record(record),
        },
        _ => McapEvent::Other,
    })
}

/// Passes each record of a part of an MCAP file, which is in memory, to `take`: its kind, and its content. The records
/// of a chunk come if it matches its check. With `begins`, the part is the begin of a file. `unpacked`: what the chunks
/// of the file, which has `length` bytes, have unpacked to.
///
/// # Errors
/// Those of `take`, or what is wrong with the part.
pub(crate) fn each_record(
    mut part: &[u8],
    begins: bool,
    (unpacked, length): (&mut ChunkBuffer, u64),
    mut take: impl FnMut(u8, &[u8]) -> Result<(), String>,
) -> Result<(), String> {
    let mut reader = LinearReader::new_with_options(options().with_skip_start_magic(!begins));
    let read = || {
        loop {
            match reader.next_event() {
                None => return Ok(()),
                Some(Ok(LinearReadEvent::ReadRequest(need))) => {
                    let (now, rest) = part.split_at(need.min(part.len()));
                    reader.insert(now.len().max(1))[..now.len()].copy_from_slice(now);
                    reader.notify_read(now.len());
                    part = rest;
                }
                Some(Ok(LinearReadEvent::Record { opcode: op::CHUNK, data })) => {
                    unpacked.add(data, length)?;
                    let mut chunk = Chunk::new(data)?;
                    while let Some((opcode, data)) = chunk.next()? {
                        if let Some(what) = foreign_to_chunk(opcode) {
                            return Err(what.to_owned());
                        }
                        take(opcode, data)?;
                    }
                }
                Some(Ok(LinearReadEvent::Record { opcode, data })) => take(opcode, data)?,
                Some(Err(error)) => return Err(error.to_string()),
            }
        }
    };
    catch_panic(read).unwrap_or_else(|| Err("a record that cannot be read".to_owned()))
}
