//! The records of an MCAP file as they stand in its bytes, and where the next whole chunk is behind damage.

use super::chunk::{Chunk, HEAD, MAX_RECORD, parts};
use super::panics::catch_panic;
use isotherm_recording::columns::MCAP_MAGIC;
use isotherm_recording::steps;
use mcap::records::op;
use std::io::{self, Read};
use std::ops::Range;

/// Bytes that are read at once, and that are kept before the next record.
const BUFFER: usize = 1 << 18;
/// The parts of a chunk before its records: opcode, length, times, size, CRC, a name of up to 4 letters, size.
const CHUNK_HEAD: usize = HEAD + 44;
/// Bytes of candidates that are unpacked, in multiples of what was read, before the search for whole chunks is given
/// up.
const PATIENCE: u64 = 8;
/// Bytes that are looked through in one step of work.
const BYTES_A_STEP: u64 = 16;

/// What comes next in a file.
pub(super) enum Frame {
    /// A record: its kind, and where its content is in [`Frames::bytes`].
    Record(u8, Range<usize>),
    /// No record can begin here, and why.
    Damaged(&'static str),
    /// The file ends within a record.
    Cut,
    End,
}

/// The bytes of a file, of which some are in memory.
pub(super) struct Frames {
    source: Box<dyn Read>,
    buffer: Vec<u8>,
    /// Place in the file of the buffer's first byte.
    begin: u64,
    /// Places in the buffer: of the next record, and of the end of the last whole chunk, from which on records may have
    /// been none.
    next: usize,
    sure: usize,
    /// Whether the source has no more bytes.
    is_all: bool,
    /// The checksum of all bytes before the next record.
    hasher: crc32fast::Hasher,
    /// Bytes of candidates that were unpacked.
    spent: u64,
}

impl Frames {
    pub(super) fn new(source: Box<dyn Read>) -> Self {
        let hasher = crc32fast::Hasher::new();
        Self { source, buffer: Vec::new(), begin: 0, next: 0, sure: 0, is_all: false, hasher, spent: 0 }
    }

    /// Place of the next record in the file.
    pub(super) const fn place(&self) -> u64 {
        self.begin + self.next as u64
    }

    /// Number of bytes read.
    pub(super) const fn read(&self) -> u64 {
        self.begin + self.buffer.len() as u64
    }

    /// The bytes at a range that [`next`](Self::next) has named.
    pub(super) fn bytes(&self, range: Range<usize>) -> &[u8] {
        &self.buffer[range]
    }

    /// The CRC-32 of all bytes before the next record.
    pub(super) fn crc(&self) -> u32 {
        self.hasher.clone().finalize()
    }

    /// What comes next. [`pass`](Self::pass) goes behind it.
    pub(super) fn next(&mut self) -> io::Result<Frame> {
        if self.place() == 0 {
            self.fill(MCAP_MAGIC.len())?;
            if !self.buffer.starts_with(MCAP_MAGIC) {
                return Ok(Frame::Damaged("not the first bytes of an MCAP file"));
            }
            self.pass(MCAP_MAGIC.len());
            self.keep();
        }
        self.fill(HEAD)?;
        let rest = &self.buffer[self.next..];
        if rest.is_empty() || rest == MCAP_MAGIC {
            return Ok(Frame::End);
        }
        let Some((opcode, length)) = parts(rest) else { return Ok(Frame::Cut) };
        let Some(length) = usize::try_from(length).ok().filter(|length| *length <= MAX_RECORD) else {
            return Ok(Frame::Damaged("a record that is longer than there can be"));
        };
        self.fill(HEAD + length)?;
        let content = self.next + HEAD..self.next + HEAD + length;
        Ok(match self.buffer.len() >= content.end {
            true => Frame::Record(opcode, content),
            false if self.is_ended() => Frame::Damaged("a record that is longer than the file"),
            false => Frame::Cut,
        })
    }

    /// Goes on behind so many bytes.
    pub(super) fn pass(&mut self, length: usize) {
        self.hasher.update(&self.buffer[self.next..self.next + length]);
        self.next += length;
    }

    /// Says that all before the next record is whole.
    pub(super) const fn keep(&mut self) {
        self.sure = self.next;
    }

    /// Whether the last bytes of the file are those of one that was ended. Valid when all was read.
    pub(super) fn is_ended(&self) -> bool {
        self.is_all && self.buffer.ends_with(MCAP_MAGIC)
    }

    /// Reads until so many bytes are there from the next record on, or the source has no more.
    fn fill(&mut self, length: usize) -> io::Result<()> {
        if self.is_all || self.buffer.len() >= self.next + length {
            return Ok(());
        }
        let kept = if self.next - self.sure > BUFFER { self.next } else { self.sure };
        if kept >= BUFFER {
            self.forget(kept);
        }
        self.read_to(self.next + length)
    }

    /// Forgets the bytes before a place in the buffer.
    fn forget(&mut self, place: usize) {
        self.buffer.drain(..place);
        self.begin += place as u64;
        self.next = self.next.saturating_sub(place);
        self.sure = self.sure.saturating_sub(place);
    }

    fn read_to(&mut self, end: usize) -> io::Result<()> {
        while !self.is_all && self.buffer.len() < end {
            let more = (end - self.buffer.len()).max(BUFFER) as u64;
            self.is_all = (&mut self.source).take(more).read_to_end(&mut self.buffer)? == 0;
        }
        Ok(())
    }

    /// Goes on at the next whole chunk; at the end of the file, and false, if there is none.
    pub(super) fn resume(&mut self) -> io::Result<bool> {
        // A chunk that was refused would be found again.
        let is_chunk = self.buffer.get(self.next) == Some(&op::CHUNK);
        let mut from = if is_chunk { self.next + 1 } else { self.sure };
        loop {
            self.read_to(from + BUFFER)?;
            let end = self.buffer.len();
            steps::count((end - from) as u64 / BYTES_A_STEP);
            while let Some(place) = memchr::memchr(op::CHUNK, &self.buffer[from..end]).map(|place| from + place) {
                if !self.is_all && place + CHUNK_HEAD > end {
                    break;
                }
                if self.is_whole_chunk(place)? {
                    (self.next, self.sure) = (place, place);
                    return Ok(true);
                }
                from = place + 1;
            }
            if self.is_all || self.spent > PATIENCE.saturating_mul(self.read()) {
                return self.skip_to_end().map(|_| false);
            }
            from = from.max(end.saturating_sub(CHUNK_HEAD));
            self.forget(from);
            from = 0;
        }
    }

    /// Whether a whole chunk begins at a place in the buffer.
    fn is_whole_chunk(&mut self, place: usize) -> io::Result<bool> {
        let Some(length) = chunk_length(&self.buffer[place..]) else { return Ok(false) };
        self.read_to(place + HEAD + length)?;
        let Some(content) = self.buffer.get(place + HEAD..place + HEAD + length) else { return Ok(false) };
        self.spent += length as u64;
        Ok(self.spent <= PATIENCE.saturating_mul(self.read()) && unpacked(content).is_ok())
    }

    /// Goes to the end of the file. Returns whether it was ended.
    pub(super) fn skip_to_end(&mut self) -> io::Result<bool> {
        while !self.is_all {
            self.forget(self.buffer.len().saturating_sub(MCAP_MAGIC.len()));
            self.read_to(BUFFER)?;
        }
        self.next = self.buffer.len();
        Ok(self.is_ended())
    }
}

/// The records of a chunk with this content. The libraries that unpack them may panic at some damage.
pub(super) fn unpacked(content: &[u8]) -> Result<Chunk, String> {
    catch_panic(|| Chunk::new(content)).unwrap_or_else(|| Err("a chunk that cannot be unpacked".to_owned()))
}

/// The length of the content of a chunk that begins here, if its parts agree about it.
fn chunk_length(bytes: &[u8]) -> Option<usize> {
    let (opcode, length) = parts(bytes)?;
    // Times, size and CRC.
    let head = bytes.get(HEAD..)?;
    let name = usize::try_from(u32::from_le_bytes(*head.get(28..)?.first_chunk()?)).ok()?;
    let is_known = [&b""[..], b"zstd", b"lz4"].contains(&head.get(32..32_usize.checked_add(name)?)?);
    let records = u64::from_le_bytes(*head.get(32 + name..)?.first_chunk()?);
    let whole = (40 + name as u64).checked_add(records)?;
    let length = usize::try_from(length).ok().filter(|length| *length <= MAX_RECORD)?;
    (opcode == op::CHUNK && is_known && whole == length as u64).then_some(length)
}
