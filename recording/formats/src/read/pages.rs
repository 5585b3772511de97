//! Checks the page headers of a Parquet file before the library reads the pages. The library allocates the size that a header
//! claims.

use crate::varint;
use std::fs::File;
use std::os::unix::fs::FileExt as _;

/// Longest page, compressed and decompressed \[bytes\]. Common writers make pages of about 1 MB.
const MAX_PAGE: u64 = 16 << 20;
/// Longest page header \[bytes\].
const MAX_HEADER: usize = 1 << 16;

/// Checks the pages in the `length` bytes from `begin` on.
pub fn check(file: &File, begin: u64, length: u64) -> Result<(), String> {
    let end = begin.checked_add(length).ok_or("a column's place")?;
    let (mut at, mut buffer) = (begin, vec![0; MAX_HEADER]);
    while at < end {
        let most = MAX_HEADER.min((end - at) as usize);
        let read = file.read_at(&mut buffer[..most], at).map_err(|error| error.to_string())?;
        let mut header = Header { bytes: &buffer[..read] };
        let sizes = header.sizes().ok_or_else(|| format!("byte {at}: no page header"))?;
        if sizes.decompressed > MAX_PAGE || sizes.compressed > MAX_PAGE {
            return Err(format!("byte {at}: a page of over {MAX_PAGE} bytes; write smaller pages"));
        }
        at += (read - header.bytes.len()) as u64 + sizes.compressed;
    }
    Ok(())
}

struct Sizes {
    decompressed: u64,
    compressed: u64,
}

/// A page header: a structure in Thrift's compact protocol.
struct Header<'a> {
    bytes: &'a [u8],
}

impl Header<'_> {
    /// Reads fields 2 (uncompressed size) and 3 (compressed size) of a `PageHeader`.
    fn sizes(&mut self) -> Option<Sizes> {
        const I32: u8 = 5;
        let (mut decompressed, mut compressed) = (None, None);
        self.each_field(0, &mut |header, field, kind| match (field, kind) {
            (2, I32) => header.size().map(|size| decompressed = Some(size)),
            (3, I32) => header.size().map(|size| compressed = Some(size)),
            _ => header.skip(kind, 0),
        })?;
        Some(Sizes { decompressed: decompressed?, compressed: compressed? })
    }

    /// Calls `take` at the beginning of each field's value, with the field's number and type. `take` must consume the value.
    fn each_field(&mut self, depth: u8, take: &mut dyn FnMut(&mut Self, i64, u8) -> Option<()>) -> Option<()> {
        const MAX_DEPTH: u8 = 8;
        let mut field = 0;
        loop {
            let head = self.byte()?;
            if head == 0 {
                return Some(());
            }
            if depth > MAX_DEPTH {
                return None;
            }
            field = match head >> 4 {
                0 => signed(varint::read(&mut self.bytes)?),
                step => field + i64::from(step),
            };
            take(self, field, head & 0xf)?;
        }
    }

    fn skip(&mut self, kind: u8, depth: u8) -> Option<()> {
        match kind {
            // The type of a boolean contains its value.
            1 | 2 => Some(()),
            3 => self.byte().map(drop),
            4..=6 => varint::read(&mut self.bytes).map(drop),
            7 => self.take(8),
            8 => varint::read(&mut self.bytes).and_then(|length| self.take(usize::try_from(length).ok()?)),
            12 => self.each_field(depth + 1, &mut |header, _, kind| header.skip(kind, depth + 1)),
            // A page header has no lists.
            _ => None,
        }
    }

    fn size(&mut self) -> Option<u64> {
        u64::try_from(signed(varint::read(&mut self.bytes)?)).ok()
    }

    fn byte(&mut self) -> Option<u8> {
        let (&byte, rest) = self.bytes.split_first()?;
        self.bytes = rest;
        Some(byte)
    }

    fn take(&mut self, length: usize) -> Option<()> {
        self.bytes = self.bytes.get(length..)?;
        Some(())
    }
}

/// Decodes a zigzag integer.
const fn signed(value: u64) -> i64 {
    (value >> 1).cast_signed() ^ -((value & 1).cast_signed())
}
