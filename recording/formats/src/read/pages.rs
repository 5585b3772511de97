//! Checks the structures of a Parquet file before the library reads them: it allocates the size and the number of
//! values of a dictionary that a page header claims, and counts through a list of booleans of any claimed length, which
//! takes no bytes in its opinion.

use super::random::RandomAccess;
use crate::varint;
use isotherm_recording::steps;
use std::io;

/// Longest page, compressed and decompressed \[bytes\]. Common writers make pages of about 1 MB.
const MAX_PAGE: u64 = 16 << 20;
/// Deepest nesting of structures and lists; a footer has 8.
const MAX_DEPTH: u8 = 16;
/// Longest page header \[bytes\].
const MAX_HEADER: usize = 1 << 16;

/// Checks the pages in the `length` bytes from `begin` on.
///
/// # Errors
/// The operating system's error, or one without its code if a page is not valid.
pub(crate) fn check(file: &RandomAccess, begin: u64, length: u64) -> io::Result<()> {
    let end = begin.checked_add(length).ok_or_else(|| io::Error::other("a column's place"))?;
    let (mut at, mut window) = (begin, PageWindow { bytes: vec![0; 2 * MAX_HEADER], begin, length: 0 });
    while at < end {
        steps::count(1);
        let ahead = window.ahead(file, at, end)?;
        let read = ahead.len();
        let mut header = Thrift { bytes: ahead };
        let sizes = header.sizes().ok_or_else(|| io::Error::other(format!("byte {at}: no page header")))?;
        if sizes.decompressed > MAX_PAGE || sizes.compressed > MAX_PAGE {
            let message = format!("byte {at}: a page of over {MAX_PAGE} bytes; write smaller pages");
            return Err(io::Error::other(message));
        }
        // The values that are read have 4 or 8 bytes.
        if sizes.dictionary > sizes.decompressed / 4 {
            return Err(io::Error::other(format!("byte {at}: a dictionary with more values than its page can have")));
        }
        at += (read - header.bytes.len()) as u64 + sizes.compressed;
    }
    Ok(())
}

/// Whether the footer is a structure whose lists end within it.
pub(crate) fn is_footer(bytes: &[u8]) -> bool {
    let mut footer = Thrift { bytes };
    footer.each_field(0, &mut |footer, _, kind| footer.skip(kind, 0)).is_some()
}

/// Bytes of a file: short pages have their headers in one reading.
struct PageWindow {
    bytes: Vec<u8>,
    begin: u64,
    length: usize,
}

impl PageWindow {
    /// The bytes from `at` on that may be a header, up to `end`.
    fn ahead(&mut self, file: &RandomAccess, at: u64, end: u64) -> io::Result<&[u8]> {
        let most = MAX_HEADER.min((end - at) as usize);
        let mut offset = (at - self.begin) as usize;
        if self.length < offset.saturating_add(most) {
            let wanted = self.bytes.len().min((end - at) as usize);
            self.length = file.read_at(&mut self.bytes[..wanted], at)?;
            (self.begin, offset) = (at, 0);
        }
        Ok(&self.bytes[offset..self.length.min(offset + most)])
    }
}

struct Sizes {
    decompressed: u64,
    compressed: u64,
    /// Number of values of a dictionary; 0 for other pages.
    dictionary: u64,
}

/// A page header or a footer: a structure in Thrift's compact protocol.
struct Thrift<'a> {
    bytes: &'a [u8],
}

impl Thrift<'_> {
    /// Reads fields 2 (uncompressed size), 3 (compressed size) and 7 (dictionary) of a `PageHeader`.
    fn sizes(&mut self) -> Option<Sizes> {
        const I32: u8 = 5;
        const STRUCTURE: u8 = 12;
        let (mut decompressed, mut compressed, mut dictionary) = (None, None, 0);
        self.each_field(0, &mut |header, field, kind| match (field, kind) {
            (2, I32) => header.size().map(|size| decompressed = Some(size)),
            (3, I32) => header.size().map(|size| compressed = Some(size)),
            // Its field 1 is the number of values.
            (7, STRUCTURE) => header.each_field(1, &mut |header, field, kind| match (field, kind) {
                (1, I32) => header.size().map(|count| dictionary = count),
                _ => header.skip(kind, 1),
            }),
            _ => header.skip(kind, 0),
        })?;
        Some(Sizes { decompressed: decompressed?, compressed: compressed?, dictionary })
    }

    /// Calls `take` at the beginning of each field's value, with the field's number and type. `take` must consume the
    /// value.
    fn each_field(&mut self, depth: u8, take: &mut dyn FnMut(&mut Self, i64, u8) -> Option<()>) -> Option<()> {
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
            9 | 10 => self.skip_list(depth + 1),
            11 => self.skip_map(depth + 1),
            12 => self.each_field(depth + 1, &mut |header, _, kind| header.skip(kind, depth + 1)),
            _ => None,
        }
    }

    fn skip_list(&mut self, depth: u8) -> Option<()> {
        let head = self.byte()?;
        let count = if head >> 4 == 15 { varint::read(&mut self.bytes)? } else { u64::from(head >> 4) };
        self.skip_elements(count, &[head & 0xf], depth)
    }

    fn skip_map(&mut self, depth: u8) -> Option<()> {
        let count = varint::read(&mut self.bytes)?;
        if count == 0 {
            return Some(());
        }
        let kinds = self.byte()?;
        self.skip_elements(count, &[kinds >> 4, kinds & 0xf], depth)
    }

    /// Skips `count` elements, each with values of these types. Every value takes a byte, except booleans, of which
    /// Parquet has no lists here.
    fn skip_elements(&mut self, count: u64, kinds: &[u8], depth: u8) -> Option<()> {
        if count == 0 {
            return Some(());
        }
        if depth > MAX_DEPTH || count > self.bytes.len() as u64 || kinds.iter().any(|kind| matches!(kind, 1 | 2)) {
            return None;
        }
        (0..count).try_for_each(|_| kinds.iter().try_for_each(|kind| self.skip(*kind, depth)))
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
