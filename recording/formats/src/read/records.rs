//! The schemas, channels and messages of an MCAP file, from beginning to end, without its index.

use super::panics::catch_panic;
use isotherm_recording::RecordingError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, parse_record};
use std::io::{self, Read};

/// Longest record or chunk that is read \[bytes\]. Common writers make chunks of about 1 MB.
const MAX_RECORD: usize = 64 << 20;
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
    Footer,
    /// A schema or channel whose texts are longer than its record.
    TooLong,
    Other,
}

impl Records {
    /// Reads from `source`.
    pub(crate) fn new(source: Box<dyn Read>) -> Self {
        // The checksum of a chunk is verified before any of its content is used.
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(MAX_RECORD);
        let reader = LinearReader::new_with_options(options);
        Self { source, reader, bytes: 0, finished: false, truncated: false }
    }

    /// The next schema, channel or message; `None` at the end.
    pub(crate) fn next(&mut self) -> Result<Option<Record<'static>>, RecordsError> {
        loop {
            match self.event()? {
                Some(McapEvent::Read(need)) => {
                    let read = self.source.read(self.reader.insert(need.clamp(1, BUFFER)));
                    let read = read.map_err(RecordsError::Io)?;
                    self.bytes += read as u64;
                    self.reader.notify_read(read);
                }
                Some(McapEvent::Footer) => self.finished = true,
                Some(McapEvent::Other | McapEvent::TooLong) => {}
                Some(McapEvent::Record(record)) => return Ok(Some(record)),
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
        let event = catch_panic(|| {
            Some(match self.reader.next_event()? {
                Ok(LinearReadEvent::ReadRequest(need)) => Ok(McapEvent::Read(need)),
                Ok(LinearReadEvent::Record { opcode: op::FOOTER, .. }) => Ok(McapEvent::Footer),
                Ok(LinearReadEvent::Record { opcode: opcode @ (op::SCHEMA | op::CHANNEL), data })
                    if !texts_fit(opcode, data) =>
                {
                    Ok(McapEvent::TooLong)
                }
                Ok(LinearReadEvent::Record { opcode: opcode @ (op::SCHEMA | op::CHANNEL | op::MESSAGE), data }) => {
                    parse_record(opcode, data).map(|record| McapEvent::Record(record.into_owned()))
                }
                Ok(LinearReadEvent::Record { .. }) => Ok(McapEvent::Other),
                Err(error) => Err(error),
            })
        });
        match event {
            None => invalid("a record that cannot be read".to_owned()),
            Some(None) => Ok(None),
            Some(Some(Ok(McapEvent::TooLong))) => invalid("a text that is longer than its record".to_owned()),
            Some(Some(Ok(event))) => Ok(Some(event)),
            // The file ends within a record.
            Some(Some(Err(McapError::UnexpectedEof))) => {
                self.truncated = true;
                Ok(None)
            }
            Some(Some(Err(error))) => invalid(format!("not a valid MCAP file: {error}")),
        }
    }
}

/// Whether the texts of a schema or a channel end within its record. The library allocates the length that a text
/// claims before it reads the text.
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
        let channel = opcode == op::CHANNEL;
        // The numbers of schema and channel, then two names.
        let mut rest = record.get(if channel { 4 } else { 2 }..)?;
        text(&mut rest)?;
        text(&mut rest)?;
        if channel {
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
