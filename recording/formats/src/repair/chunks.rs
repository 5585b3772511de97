//! Finds the whole chunks of an MCAP file, and the damage between them.

use crate::read::chunk::{ChunkBuffer, MAX_RECORD};
use crate::read::plausible::{foreign, impossible, is_own};
use crate::read::random::RandomAccess;
use crate::read::records::each_record;
use crate::read::summary::{HEAD, bytes, parsed, parts, summary};
use isotherm_recording::columns::MCAP_MAGIC;
use mcap::parse_record;
use mcap::records::{Metadata, Record, op};
use std::io;

/// The parts of a chunk before its records: times, size, CRC, a name of up to 4 letters, size.
const CHUNK_HEAD: usize = 44;
/// Bytes that are looked through at once for a chunk.
const WINDOW: usize = 1 << 20;
/// Bytes of the file that are read, in multiples of its size, before the search for whole chunks is given up.
const PATIENCE: u64 = 8;

/// What is found next.
pub(super) enum ScanEvent {
    /// The records of a whole chunk at this byte, or one outside of chunks, which has no check.
    Records { records: Vec<Record<'static>>, is_checked: bool, at: u64 },
    /// A metadata record.
    Metadata(Metadata),
    /// Damage at this byte, with or without rows.
    Damage { at: u64, cause: String, has_rows: bool },
}

/// Reads a file from its beginning.
pub(super) struct ChunkScan<'a> {
    file: &'a RandomAccess,
    size: u64,
    at: u64,
    /// The end of the last chunk: up to here records are where they seem to be.
    sure: u64,
    /// Bytes that have been read to find whole chunks.
    spent: u64,
    unpacked: ChunkBuffer,
    profile: String,
    /// Whether the recorder wrote the file.
    is_own: bool,
    /// Whether the end of the file is as it was written.
    has_end: bool,
    /// Whether nothing is damaged so far.
    is_whole: bool,
    progress: ScanState,
}

#[derive(Clone, Copy, Eq, PartialEq)]
enum ScanState {
    Begun,
    /// At the end of the data, which is at this byte.
    AtEnd(u64),
    Ended,
}

impl<'a> ChunkScan<'a> {
    pub(super) fn new(file: &'a RandomAccess) -> io::Result<Self> {
        let size = file.size();
        let profile = String::new();
        let mut scan = Self {
            file,
            size,
            at: 0,
            sure: MCAP_MAGIC.len() as u64,
            spent: 0,
            unpacked: ChunkBuffer::default(),
            profile,
            is_own: false,
            has_end: false,
            is_whole: true,
            progress: ScanState::Begun,
        };
        let head = scan.bytes(0, MCAP_MAGIC.len() + HEAD)?;
        if head.starts_with(MCAP_MAGIC)
            && let Some((op::HEADER, length)) = parts(&head[MCAP_MAGIC.len()..])
            && length <= WINDOW as u64
        {
            let record = scan.bytes((MCAP_MAGIC.len() + HEAD) as u64, length as usize)?;
            if let Some(Record::Header(header)) = parsed(op::HEADER, &record) {
                scan.is_own = is_own(&header);
                scan.profile = header.profile;
            }
        }
        Ok(scan)
    }

    /// The profile of the file, as far as it is known.
    pub(super) fn profile(&self) -> &str {
        &self.profile
    }

    /// The schemas, channels and statistics of the summary, if that matches its check.
    pub(super) fn summary(&mut self) -> io::Result<Vec<Record<'static>>> {
        let (records, has_end) = summary(self.file)?;
        self.has_end = has_end;
        Ok(records)
    }

    /// What comes next; `None` at the end.
    pub(super) fn next(&mut self) -> io::Result<Option<ScanEvent>> {
        if self.at == 0 {
            self.at = MCAP_MAGIC.len() as u64;
            if self.bytes(0, MCAP_MAGIC.len())? != MCAP_MAGIC {
                let cause = "not the first bytes of an MCAP file".to_owned();
                self.is_whole = false;
                return Ok(Some(ScanEvent::Damage { at: 0, cause, has_rows: false }));
            }
        }
        loop {
            match self.progress {
                ScanState::Begun => {}
                ScanState::AtEnd(at) => return self.end(at),
                ScanState::Ended => return Ok(None),
            }
            let at = self.at;
            if at >= self.size {
                // Not ended, as after a crash; all that was flushed is there.
                self.progress = ScanState::Ended;
                return Ok(None);
            }
            let head = self.bytes(at, HEAD)?;
            let Some((opcode, length)) = parts(&head) else { return self.damage(at, "the last record is cut") };
            let end = (at + HEAD as u64).saturating_add(length);
            if end > self.size || length > MAX_RECORD as u64 {
                let has_end =
                    self.bytes(self.size.saturating_sub(MCAP_MAGIC.len() as u64), MCAP_MAGIC.len())? == MCAP_MAGIC;
                let cause =
                    if has_end { "a record that is longer than there can be" } else { "the last record is cut" };
                return self.damage(at, cause);
            }
            if opcode == op::DATA_END {
                self.progress = ScanState::AtEnd(at);
                match self.data_end(at)? {
                    None => continue,
                    found => return Ok(found),
                }
            }
            let content = self.bytes(at + HEAD as u64, length as usize)?;
            let wrong = impossible(opcode, &content, false);
            if let Some(cause) = wrong.or_else(|| foreign(opcode, &content).filter(|_| self.is_own)) {
                return self.damage(at, cause);
            }
            self.at = end;
            match opcode {
                op::CHUNK => {
                    let cause = match self.chunk(&[head, content].concat()) {
                        Ok(found) => {
                            self.sure = end;
                            return Ok(Some(found.at(at)));
                        }
                        Err(cause) => cause,
                    };
                    self.is_whole = false;
                    // Its length may be wrong, too.
                    if !self.is_record(end)? {
                        return self.damage(at, &cause);
                    }
                    self.sure = end;
                    return Ok(Some(ScanEvent::Damage { at, cause, has_rows: true }));
                }
                op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                    let Some(record) = parsed(opcode, &content) else { return self.damage(at, "a damaged record") };
                    return Ok(Some(ScanEvent::Records { records: vec![record], is_checked: false, at }));
                }
                op::METADATA => {
                    let Some(Record::Metadata(record)) = parsed(opcode, &content) else {
                        return self.damage(at, "a damaged record");
                    };
                    return Ok(Some(ScanEvent::Metadata(record)));
                }
                _ => {}
            }
        }
    }

    /// Goes on at the next chunk, or at the end. Records before the damage may have been none, so that it is sought
    /// from the last chunk on.
    fn damage(&mut self, at: u64, cause: &str) -> io::Result<Option<ScanEvent>> {
        self.is_whole = false;
        match self.search(self.sure)? {
            Some(next) => self.at = next,
            None => self.progress = ScanState::Ended,
        }
        Ok(Some(ScanEvent::Damage { at, cause: cause.to_owned(), has_rows: true }))
    }

    /// The end of the data: what is outside of chunks is checked here.
    fn data_end(&self, at: u64) -> io::Result<Option<ScanEvent>> {
        let content = self.bytes(at + HEAD as u64, 4)?;
        let saved = content.first_chunk().map_or(0, |saved| u32::from_le_bytes(*saved));
        if !self.is_whole || saved == 0 {
            return Ok(None);
        }
        let (mut hasher, mut from) = (crc32fast::Hasher::new(), 0);
        while from < at {
            let bytes = self.bytes(from, WINDOW.min((at - from) as usize))?;
            if bytes.is_empty() {
                break;
            }
            hasher.update(&bytes);
            from += bytes.len() as u64;
        }
        let cause = "outside of its chunks the file does not match its check".to_owned();
        // The recorder has no rows there.
        Ok((hasher.finalize() != saved).then_some(ScanEvent::Damage { at, cause, has_rows: !self.is_own }))
    }

    /// What is behind the data, and is not used.
    fn end(&mut self, at: u64) -> io::Result<Option<ScanEvent>> {
        self.progress = ScanState::Ended;
        let cause = "the summary at the end does not match its check".to_owned();
        Ok((!self.has_end).then_some(ScanEvent::Damage { at, cause, has_rows: false }))
    }

    /// The place of the next whole chunk from `from` on, or of the end of the data behind it.
    fn search(&mut self, from: u64) -> io::Result<Option<u64>> {
        let mut at = from;
        while at < self.size {
            let window = self.bytes(at, WINDOW + HEAD + CHUNK_HEAD)?;
            for place in memchr::memchr_iter(op::CHUNK, window.get(..WINDOW.min(window.len())).unwrap_or_default()) {
                let Some(length) = chunk_length(&window[place..]) else { continue };
                let begin = at + place as u64;
                if (begin + HEAD as u64).saturating_add(length) > self.size {
                    continue;
                }
                self.spent += length;
                if self.spent > PATIENCE.saturating_mul(self.size) {
                    return Ok(None);
                }
                if self.chunk(&self.bytes(begin, HEAD + length as usize)?).is_ok() {
                    return Ok(Some(begin));
                }
            }
            at += WINDOW as u64;
        }
        Ok(None)
    }

    /// Whether a record may begin at a place, or the file ends there.
    fn is_record(&self, at: u64) -> io::Result<bool> {
        let head = self.bytes(at, HEAD)?;
        Ok(match parts(&head) {
            None => head.is_empty(),
            Some((opcode, length)) => {
                let fits = (at + HEAD as u64).checked_add(length).is_some_and(|end| end <= self.size);
                fits && matches!(opcode, op::HEADER..=op::DATA_END)
            }
        })
    }

    /// The records of a chunk, if it matches its CRC.
    fn chunk(&mut self, record: &[u8]) -> Result<ScanEvent, String> {
        let crc = record.get(HEAD + 24..HEAD + 28).unwrap_or_default();
        let is_checked = crc.iter().any(|byte| *byte != 0);
        let mut records = Vec::new();
        each_record(record, false, (&mut self.unpacked, self.size), |opcode, data| {
            if let Some(cause) = impossible(opcode, data, false) {
                return Err(cause.to_owned());
            }
            records.push(parse_record(opcode, data).map_err(|error| error.to_string())?.into_owned());
            Ok(())
        })?;
        Ok(ScanEvent::Records { records, is_checked, at: 0 })
    }

    /// Up to so many bytes from a place on.
    fn bytes(&self, at: u64, length: usize) -> io::Result<Vec<u8>> {
        bytes(self.file, at, length)
    }
}

impl ScanEvent {
    fn at(self, place: u64) -> Self {
        match self {
            Self::Records { records, is_checked, .. } => Self::Records { records, is_checked, at: place },
            other => other,
        }
    }
}

/// The length of the content of a chunk that begins here, if its parts agree about it.
fn chunk_length(bytes: &[u8]) -> Option<u64> {
    let (opcode, length) = parts(bytes)?;
    // Times, size and CRC.
    let head = bytes.get(HEAD..)?;
    let name = usize::try_from(u32::from_le_bytes(*head.get(28..)?.first_chunk()?)).ok()?;
    let is_known = [&b""[..], b"zstd", b"lz4"].contains(&head.get(32..32_usize.checked_add(name)?)?);
    let records = u64::from_le_bytes(*head.get(32 + name..)?.first_chunk()?);
    let whole = (40 + name as u64).checked_add(records)?;
    (opcode == op::CHUNK && is_known && whole == length && length <= MAX_RECORD as u64).then_some(length)
}
