//! The records of a chunk of an MCAP file, unpacked within bounds.
//!
//! What a chunk unpacks to is refused by its header, before anything of it is unpacked; then no more is unpacked than
//! the header says. Zeros that are packed a thousand times over would take hours.

use isotherm_recording::steps;
use std::error::Error;
use std::io::Read;

/// Opcode and length of a record.
pub(crate) const HEAD: usize = 9;
/// Longest record or chunk that is read, packed and unpacked \[bytes\]. Common writers make chunks of about 1 MB.
pub(crate) const MAX_RECORD: usize = 64 << 20;
/// What the chunks of a file may unpack to \[bytes\]: so much, and beyond it so many times the length of the file.
/// Samples of an IMU unpack to 2 to 20 times their size.
const FREE: u64 = 8 << 20;
const MOST_TIMES: u64 = 64;
/// Unpacked bytes that are one step of work.
const BYTES_A_STEP: u64 = 16;
/// Largest window of zstd, unless the chunk itself is larger \[bytes\]: what a reader should support (RFC 8878).
const ZSTD_WINDOW: usize = 8 << 20;
/// What is said of a chunk that does not match its checksum.
const UNMATCHED: &str = "the chunk does not match its check";

/// Opcode and length of a record.
pub(crate) fn parts(bytes: &[u8]) -> Option<(u8, u64)> {
    let (opcode, rest) = bytes.split_first()?;
    Some((*opcode, u64::from_le_bytes(*rest.first_chunk()?)))
}

/// What a file unpacks to.
#[derive(Default)]
pub(crate) struct ChunkBuffer(u64);

impl ChunkBuffer {
    /// Counts the chunk with this content, of a file of which `bytes` have been read.
    ///
    /// # Errors
    /// Why it must not be unpacked.
    pub(crate) fn add(&mut self, chunk: &[u8], bytes: u64) -> Result<(), String> {
        let size = size(chunk)?;
        self.0 = self.0.saturating_add(size);
        if self.0 > FREE.saturating_add(MOST_TIMES.saturating_mul(bytes)) {
            return Err(format!(
                "its chunks unpack to over {MOST_TIMES} times their size, which samples do not; write the wanted \
                 topics into a file of their own"
            ));
        }
        steps::count(size / BYTES_A_STEP);
        Ok(())
    }
}

/// The bytes that the chunk with this content says it unpacks to.
fn size(chunk: &[u8]) -> Result<u64, String> {
    let size = ChunkParts::of(chunk).ok_or("a chunk whose parts do not fit")?.size;
    if size > MAX_RECORD as u64 {
        let most = MAX_RECORD >> 20;
        return Err(format!("a chunk that unpacks to {size} bytes; at most {most} MiB are read, write smaller chunks"));
    }
    Ok(size)
}

/// The parts of a chunk's content.
struct ChunkParts<'a> {
    /// Length of the records \[bytes\], and their checksum; 0 if there is none.
    size: u64,
    crc: u32,
    /// The name of the compression; empty without one.
    compression: &'a [u8],
    packed: &'a [u8],
}

impl<'a> ChunkParts<'a> {
    fn of(chunk: &'a [u8]) -> Option<Self> {
        // Its times are before.
        let (size, rest) = chunk.get(16..)?.split_first_chunk()?;
        let (crc, rest) = rest.split_first_chunk()?;
        let (length, rest) = rest.split_first_chunk()?;
        let (compression, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
        let (length, rest) = rest.split_first_chunk()?;
        // Zeros over a head would be a chunk of nothing.
        let packed = Some(rest).filter(|packed| packed.len() as u64 == u64::from_le_bytes(*length))?;
        Some(Self { size: u64::from_le_bytes(*size), crc: u32::from_le_bytes(*crc), compression, packed })
    }

    fn unpacked(&self) -> Result<Vec<u8>, String> {
        let size = usize::try_from(self.size).map_err(|_| "a chunk that is too large")?;
        match self.compression {
            b"" => Ok(self.packed.to_vec()),
            b"zstd" => unpack_zstd(self.packed, size),
            b"lz4" => unpack_lz4(self.packed, size),
            name => {
                Err(format!("a chunk packed with {:?}, which is neither zstd nor lz4", name.escape_ascii().to_string()))
            }
        }
    }
}

/// Unpacks at most so many bytes, and refuses more.
fn unpack_zstd(packed: &[u8], size: usize) -> Result<Vec<u8>, String> {
    let mut decoder = ruzstd::decoding::FrameDecoder::new();
    // So much is unpacked before the decoder looks at how much there may be.
    decoder.set_max_window_size(size.max(ZSTD_WINDOW) as u64);
    let mut unpacked = vec![0; size];
    let length = decoder.decode_all(packed, &mut unpacked).map_err(|error| undone(&error))?;
    unpacked.truncate(length);
    match decoder.get_checksum_from_data() {
        Some(saved) if decoder.get_calculated_checksum() != Some(saved) => Err(UNMATCHED.to_owned()),
        _ => Ok(unpacked),
    }
}

/// Unpacks at most one byte more than so many, so that the length shows that there are more.
fn unpack_lz4(packed: &[u8], size: usize) -> Result<Vec<u8>, String> {
    let mut unpacked = Vec::with_capacity(size);
    let decoder = lz4_flex::frame::FrameDecoder::new(packed);
    decoder.take(size as u64 + 1).read_to_end(&mut unpacked).map_err(|error| undone(&error))?;
    Ok(unpacked)
}

fn undone(error: &dyn Error) -> String {
    format!("a chunk that cannot be unpacked: {error}")
}

/// A chunk that is read.
pub(super) struct Chunk {
    records: Vec<u8>,
    /// The place of the next record.
    at: usize,
}

impl Chunk {
    /// Unpacks the records of a chunk with this content, which [`ChunkBuffer::add`] has counted. They match their
    /// checksum, if there is one.
    ///
    /// # Errors
    /// What is wrong with the chunk.
    pub(super) fn new(content: &[u8]) -> Result<Self, String> {
        let parts = ChunkParts::of(content).ok_or("a chunk whose parts do not fit")?;
        let records = parts.unpacked()?;
        if records.len() as u64 != parts.size {
            return Err("a chunk that does not unpack to the length that it says".to_owned());
        }
        if parts.crc != 0 && parts.crc != crc32fast::hash(&records) {
            return Err(UNMATCHED.to_owned());
        }
        Ok(Self { records, at: 0 })
    }

    /// The kind and the content of the next record; `None` at the end.
    ///
    /// # Errors
    /// If the last record is cut.
    pub(super) fn next(&mut self) -> Result<Option<(u8, &[u8])>, String> {
        let rest = &self.records[self.at..];
        if rest.is_empty() {
            return Ok(None);
        }
        steps::count(1);
        let record = || {
            let (opcode, length) = parts(rest)?;
            Some((opcode, rest.get(HEAD..HEAD.checked_add(usize::try_from(length).ok()?)?)?))
        };
        let (opcode, content) = record().ok_or("a chunk whose last record is cut")?;
        self.at += HEAD + content.len();
        Ok(Some((opcode, content)))
    }
}
