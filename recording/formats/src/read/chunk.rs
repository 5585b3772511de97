//! The records of a chunk of an MCAP file, unpacked within bounds.
//!
//! What a chunk unpacks to is refused by its header, before anything of it is unpacked; the library then unpacks no
//! more than the header says. Zeros that are packed a thousand times over would take hours.

use isotherm_recording::steps;
use mcap::McapError;
use mcap::records::op;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

/// Longest record or chunk that is read, packed and unpacked \[bytes\]. Common writers make chunks of about 1 MB.
pub(crate) const MAX_RECORD: usize = 64 << 20;
/// What the chunks of a file may unpack to \[bytes\]: so much, and beyond it so many times the length of the file.
/// Samples of an IMU unpack to 2 to 20 times their size.
const FREE: u64 = 8 << 20;
const MOST_TIMES: u64 = 64;
/// Unpacked bytes that are one step of work.
const BYTES_A_STEP: u64 = 16;
/// Opcode and length of a record.
const HEAD: usize = 9;

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
    // Its times are before.
    let size = chunk.get(16..24).and_then(<[u8]>::first_chunk).map(|size| u64::from_le_bytes(*size));
    let size = size.ok_or("a chunk without its header")?;
    if size > MAX_RECORD as u64 {
        let most = MAX_RECORD >> 20;
        return Err(format!("a chunk that unpacks to {size} bytes; at most {most} MiB are read, write smaller chunks"));
    }
    Ok(size)
}

/// A chunk that is read.
pub(super) struct Chunk(LinearReader);

impl Chunk {
    /// Of its content.
    pub(super) fn new(content: &[u8]) -> Self {
        // The checksum is verified before anything of the content is used.
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(MAX_RECORD);
        let mut reader = LinearReader::new_with_options(options);
        let length = HEAD + content.len();
        let buffer = reader.insert(length);
        buffer[0] = op::CHUNK;
        buffer[1..HEAD].copy_from_slice(&(content.len() as u64).to_le_bytes());
        buffer[HEAD..length].copy_from_slice(content);
        reader.notify_read(length);
        Self(reader)
    }

    /// What `take` makes of the kind and the content of the next record; `None` at the end.
    pub(super) fn next<T>(&mut self, take: impl FnOnce(u8, &[u8]) -> T) -> Result<Option<T>, McapError> {
        match self.0.next_event() {
            None => return Ok(None),
            Some(Err(error)) => return Err(error),
            Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                steps::count(1);
                return Ok(Some(take(opcode, data)));
            }
            Some(Ok(LinearReadEvent::ReadRequest(_))) => self.0.notify_read(0),
        }
        // The library asks for more at the end of the chunk. If there is none, it reports whether that is its end.
        match self.0.next_event() {
            None => Ok(None),
            Some(Err(McapError::UnexpectedEof)) => Err(McapError::UnexpectedEoc),
            Some(Err(error)) => Err(error),
            Some(Ok(_)) => Err(McapError::UnexpectedEoc),
        }
    }
}
