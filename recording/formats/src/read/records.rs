//! The schemas, channels and messages of an MCAP file, from beginning to end, without its index.
//!
//! A chunk has a CRC. What is outside of chunks has one at the end of a file that was ended. Where it was not, a record
//! of another kind than it was written as must not be taken for rows, nor hide any.

use super::panics::catch_panic;
use crate::protobuf::begins_with;
use crate::seal::{CREATOR, DAMAGED};
use isotherm_recording::RecordingError;
use isotherm_recording::columns::MCAP_MAGIC;
use mcap::records::{Header, Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, parse_record};
use std::io::{self, Read};

/// Longest record or chunk that is read \[bytes\]. Common writers make chunks of about 1 MB.
pub(crate) const MAX_RECORD: usize = 64 << 20;
/// Most bytes that are read at once.
const BUFFER: usize = 1 << 20;

/// Reads the records of an MCAP file. An unfinished file is read up to its last complete record.
pub(crate) struct Records {
    source: Box<dyn Read>,
    reader: LinearReader,
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
    /// The error of a reader: `invalid` tells where the file is not valid.
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
    DataEnd,
    Footer,
    /// A record that cannot be there, and why.
    Impossible(&'static str),
    Other,
}

impl Records {
    /// Reads from `source`.
    pub(crate) fn new(source: Box<dyn Read>) -> Self {
        // The checksum of a chunk is verified before any of its content is used.
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_validate_data_section_crc(true)
            .with_record_length_limit(MAX_RECORD);
        let reader = LinearReader::new_with_options(options);
        Self {
            source,
            reader,
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
            match self.event()? {
                Some(McapEvent::Read(need)) => {
                    let buffer = self.reader.insert(need.clamp(1, BUFFER));
                    let read = self.source.read(buffer).map_err(RecordsError::Io)?;
                    let last = read.min(self.tail.len());
                    self.tail.rotate_left(last);
                    let place = self.tail.len() - last;
                    self.tail[place..].copy_from_slice(&buffer[read - last..read]);
                    self.bytes += read as u64;
                    self.reader.notify_read(read);
                }
                Some(McapEvent::Header(header)) => self.is_own = is_own(&header),
                Some(McapEvent::DataEnd) => self.data_ended = true,
                Some(McapEvent::Footer) => self.finished = true,
                Some(McapEvent::Other | McapEvent::Impossible(_)) => {}
                Some(McapEvent::Record(record)) => return Ok(Some(record)),
                None if self.truncated && self.tail == *MCAP_MAGIC => {
                    return Err(RecordsError::Invalid(format!("a record that is longer than the file; {DAMAGED}")));
                }
                None => return Ok(None),
            }
        }
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

    /// The library's next event; `None` at the end.
    fn event(&mut self) -> Result<Option<McapEvent>, RecordsError> {
        let invalid = |message: String| Err(RecordsError::Invalid(message));
        let (data_ended, is_own) = (self.data_ended, self.is_own);
        let event = catch_panic(|| {
            Some(match self.reader.next_event()? {
                Ok(LinearReadEvent::ReadRequest(need)) => Ok(McapEvent::Read(need)),
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    match impossible(opcode, data, data_ended).or_else(|| foreign(opcode, data).filter(|_| is_own)) {
                        Some(what) => Ok(McapEvent::Impossible(what)),
                        None => event_of(opcode, data),
                    }
                }
                Err(error) => Err(error),
            })
        });
        match event {
            None => invalid("a record that cannot be read".to_owned()),
            Some(None) => Ok(None),
            Some(Some(Ok(McapEvent::Impossible(what)))) => invalid(what.to_owned()),
            Some(Some(Ok(event))) => Ok(Some(event)),
            // The file ends within a record.
            Some(Some(Err(McapError::UnexpectedEof))) => {
                self.truncated = true;
                Ok(None)
            }
            Some(Some(Err(McapError::BadDataCrc { .. }))) => {
                invalid(format!("outside of its chunks the file does not match its check; {DAMAGED}"))
            }
            Some(Some(Err(McapError::BadChunkCrc { .. }))) => {
                invalid(format!("the chunk does not match its check; {DAMAGED}"))
            }
            Some(Some(Err(error))) => invalid(format!("not a valid MCAP file: {error}; {DAMAGED}")),
        }
    }
}

fn event_of(opcode: u8, data: &[u8]) -> Result<McapEvent, McapError> {
    Ok(match opcode {
        op::DATA_END => McapEvent::DataEnd,
        op::FOOTER => McapEvent::Footer,
        op::HEADER | op::SCHEMA | op::CHANNEL | op::MESSAGE => match parse_record(opcode, data)?.into_owned() {
            Record::Header(header) => McapEvent::Header(header),
            record => McapEvent::Record(record),
        },
        _ => McapEvent::Other,
    })
}

/// Passes each record of a part of an MCAP file, which is in memory, to `take`: its kind, and its content. The records
/// of a chunk come if it matches its check. With `begins`, the part is the begin of a file.
///
/// # Errors
/// Those of `take`, or what is wrong with the part.
pub(crate) fn each_record(
    mut part: &[u8],
    begins: bool,
    mut take: impl FnMut(u8, &[u8]) -> Result<(), String>,
) -> Result<(), String> {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(!begins)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(MAX_RECORD);
    let mut reader = LinearReader::new_with_options(options);
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
                Some(Ok(LinearReadEvent::Record { opcode, data })) => take(opcode, data)?,
                Some(Err(McapError::BadChunkCrc { .. })) => {
                    return Err("the chunk does not match its check".to_owned());
                }
                Some(Err(error)) => return Err(error.to_string()),
            }
        }
    };
    catch_panic(read).unwrap_or_else(|| Err("a record that cannot be read".to_owned()))
}

/// Whether the recorder wrote the file, and rows into it: ROS messages are none.
pub(crate) fn is_own(header: &Header) -> bool {
    header.library.starts_with(CREATOR) && header.profile.is_empty()
}

/// Why no writer writes such a record at this place.
pub(crate) fn impossible(opcode: u8, data: &[u8], data_ended: bool) -> Option<&'static str> {
    match opcode {
        op::HEADER | op::SCHEMA | op::CHANNEL if !texts_fit(opcode, data) => {
            Some("a text that is longer than its record")
        }
        op::MESSAGE_INDEX if !is_index(data) => Some("an index that is none"),
        op::FOOTER
        | op::CHUNK_INDEX
        | op::ATTACHMENT_INDEX
        | op::STATISTICS
        | op::METADATA_INDEX
        | op::SUMMARY_OFFSET
            if !data_ended =>
        {
            Some("a record of the summary among the data")
        }
        0 | 0x10..=0x7f => Some("a record of no known kind"),
        _ => None,
    }
}

/// Why the recorder does not write such a record.
pub(crate) fn foreign(opcode: u8, data: &[u8]) -> Option<&'static str> {
    match opcode {
        0x80.. => Some("a record of no known kind"),
        // Its first field is the time at which it was recorded, and that is the message's.
        op::MESSAGE => match parse_record(opcode, data) {
            Ok(Record::Message { header, data }) if begins_with(&data, 1, header.log_time) => None,
            _ => Some("a message that is none of the recorder's"),
        },
        _ => None,
    }
}

/// Whether the record is an index of messages: a channel, and times with places up to the end.
fn is_index(record: &[u8]) -> bool {
    let length = record.get(2..).and_then(<[u8]>::first_chunk).map(|length| u32::from_le_bytes(*length));
    length.is_some_and(|length| length % 16 == 0 && record.len() == 6 + length as usize)
}

/// Whether the texts of a header, a schema or a channel end within its record. The library allocates the length that a
/// text claims before it reads the text.
fn texts_fit(opcode: u8, record: &[u8]) -> bool {
    fn length(rest: &mut &[u8]) -> Option<usize> {
        let (length, after) = rest.split_first_chunk()?;
        *rest = after;
        usize::try_from(u32::from_le_bytes(*length)).ok()
    }
    fn text(rest: &mut &[u8]) -> Option<()> {
        let length = length(rest)?;
        *rest = rest.get(length..)?;
        Some(())
    }
    let fit = || {
        // The numbers of schema and channel, then two names.
        let numbers = match opcode {
            op::CHANNEL => 4,
            op::SCHEMA => 2,
            _ => 0,
        };
        let mut rest = record.get(numbers..)?;
        text(&mut rest)?;
        text(&mut rest)?;
        if opcode == op::CHANNEL {
            // Keys and values, in this number of bytes.
            let size = length(&mut rest)?;
            let end = rest.len().checked_sub(size)?;
            while rest.len() > end {
                text(&mut rest)?;
                text(&mut rest)?;
            }
        }
        Some(())
    };
    fit().is_some()
}
