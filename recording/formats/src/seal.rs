//! What a Parquet file of the recorder has in addition to Parquet, to find damage and to take what is whole. Parquet's
//! own checks are those of pages; the library writes none, and they leave the footer out.
//!
//! ```text
//! PAR1
//! row group, seal of the row group     as often as there are groups
//! seal of the footer
//! footer, its length, PAR1
//! ```
//!
//! Other readers find row groups by the footer, and do not look between them. The footer's metadata have, under
//! `isotherm.check`, the CRC-32 of each column of each row group: 8 hexadecimal digits, `,` between columns, `;`
//! between groups.
//!
//! The seal of a row group has the footer of a file with this one group, so that the group can be read wherever it
//! is, without the rest of the file. That of the footer is a mark and a CRC-32.

use crate::read::pages::is_footer;
use crate::read::panics::catch_panic;
use crate::read::random::RandomAccess;
use memchr::memmem;
use parquet::errors::ParquetError;
use parquet::file::metadata::{
    FileMetaData, KeyValue, ParquetMetaData, ParquetMetaDataReader, ParquetMetaDataWriter, RowGroupMetaData,
};
use parquet::schema::types::{SchemaDescriptor, TypePtr};
use std::io;
use std::sync::Arc;

/// The key of the checks in a footer's metadata.
pub(crate) const KEY: &str = "isotherm.check";
/// First and last bytes of a Parquet file.
pub(crate) const MAGIC: &[u8] = b"PAR1";
/// The begin of a file's [`created_by`](FileMetaData::created_by), if the recorder wrote it.
pub(crate) const CREATOR: &str = "isotherm ";
/// Length of the seal of a footer, which is right before it.
pub(crate) const FOOTER_SEAL: usize = 8;
/// The begin of the seal of a footer.
const FOOTER_MARK: &[u8; 4] = b"ISOF";
/// The begin of the seal of a row group.
const GROUP_MARK: &[u8; 8] = b"\x89ISOG\r\n\x1a";
/// Mark, length of the group, length of the footer.
const GROUP_HEAD: usize = 20;
const CRC: usize = 4;
/// Longest footer in the seal of a row group; that of the recorder's widest files has 6 kB.
const MAX_GROUP_FOOTER: usize = 1 << 16;

/// The checks of the columns of a row group.
pub(crate) type GroupChecks = Vec<u32>;

/// What is common to the row groups of a file.
pub(crate) struct FileParts {
    pub(crate) schema: TypePtr,
    pub(crate) created_by: Option<String>,
    pub(crate) metadata: Vec<KeyValue>,
}

/// The checks as text.
fn text(groups: &[GroupChecks]) -> String {
    let group = |group: &GroupChecks| group.iter().map(|check| format!("{check:08x}")).collect::<Vec<_>>().join(",");
    groups.iter().map(group).collect::<Vec<_>>().join(";")
}

/// What to do about a file that does not match its checks.
pub(crate) const DAMAGED: &str = "the file is damaged, and `isotherm repair` takes what is whole";

/// The checks of a file's row groups, if it has any. `is_sealed`: what [`matches_seal`] says of its footer.
///
/// Programs that make one file of another take the metadata along, and the checks with them, but not the seal.
///
/// # Errors
/// If the footer is damaged.
pub(crate) fn checks_in(
    metadata: &ParquetMetaData,
    is_sealed: Option<bool>,
) -> Result<Option<Vec<GroupChecks>>, String> {
    let file = metadata.file_metadata();
    let entry = file.key_value_metadata().into_iter().flatten().find(|entry| entry.key == KEY);
    let is_own = file.created_by().is_some_and(|by| by.starts_with(CREATOR));
    let columns = file.schema_descr().num_columns();
    match (is_sealed, entry.and_then(|entry| entry.value.as_deref())) {
        (None, None) => Ok(None),
        (None, Some(_)) if !is_own => Ok(None),
        (Some(true), Some(text)) => parse(text, metadata.num_row_groups(), columns).map(Some).ok_or(UNMATCHED),
        (None, Some(_)) | (Some(_), _) => Err(UNMATCHED),
    }
    .map_err(|what| format!("{what}; {DAMAGED}"))
}

const UNMATCHED: &str = "does not match its check";

/// The checks of a file with so many row groups and columns, from their text.
fn parse(text: &str, groups: usize, columns: usize) -> Option<Vec<GroupChecks>> {
    let check = |text: &str| u32::from_str_radix(text, 16).ok().filter(|_| text.len() == 8);
    let group = |text: &str| {
        let checks = text.split(',').map(check).collect::<Option<GroupChecks>>()?;
        (checks.len() == columns).then_some(checks)
    };
    let parsed = match text {
        "" => Vec::new(),
        text => text.split(';').map(group).collect::<Option<Vec<_>>>()?,
    };
    (parsed.len() == groups).then_some(parsed)
}

/// Begin and length of a column's bytes in a file.
pub(crate) fn chunk_range(group: &RowGroupMetaData, column: usize) -> Option<(u64, u64)> {
    let chunk = group.columns().get(column)?;
    let begin = chunk.dictionary_page_offset().unwrap_or(chunk.data_page_offset());
    Some((u64::try_from(begin).ok()?, u64::try_from(chunk.compressed_size()).ok()?))
}

/// Begin and end of a row group's bytes in a file.
pub(crate) fn group_range(group: &RowGroupMetaData) -> Option<(u64, u64)> {
    let ranges = (0..group.num_columns()).map(|column| chunk_range(group, column));
    ranges.reduce(|one, other| {
        let ((begin, length), (other, more)) = (one?, other?);
        let end = begin.checked_add(length)?.max(other.checked_add(more)?);
        Some((begin.min(other), end - begin.min(other)))
    })?
}

/// The checks of the columns of a row group. `bytes` are those of the file from `begin` on.
pub(crate) fn checks_of(group: &RowGroupMetaData, bytes: &[u8], begin: u64) -> Option<GroupChecks> {
    let check = |column: usize| {
        let (at, length) = chunk_range(group, column)?;
        let at = usize::try_from(at.checked_sub(begin)?).ok()?;
        Some(crc32fast::hash(bytes.get(at..at.checked_add(usize::try_from(length).ok()?)?)?))
    };
    (0..group.num_columns()).map(check).collect()
}

/// The footer of a file with these row groups, its length and the last bytes of the file; with their checks, if there
/// are any.
pub(crate) fn footer(
    parts: &FileParts,
    groups: &mut Vec<RowGroupMetaData>,
    checks: Option<&[GroupChecks]>,
) -> Result<Vec<u8>, ParquetError> {
    let rows = groups.iter().map(RowGroupMetaData::num_rows).sum();
    let schema = Arc::new(SchemaDescriptor::new(Arc::clone(&parts.schema)));
    let mut metadata = parts.metadata.clone();
    metadata.extend(checks.map(|checks| KeyValue::new(KEY.to_owned(), text(checks))));
    let metadata = Some(metadata).filter(|metadata| !metadata.is_empty());
    let file = FileMetaData::new(1, rows, parts.created_by.clone(), metadata, schema, None);
    let metadata = ParquetMetaData::new(file, std::mem::take(groups));
    let mut bytes = Vec::new();
    let written = ParquetMetaDataWriter::new(&mut bytes, &metadata).finish();
    *groups = metadata.into_builder().take_row_groups();
    written.map(|()| bytes)
}

/// The seal of a footer, to be written before it. The last bytes of the file are not part of it.
pub(crate) fn footer_seal(footer: &[u8]) -> [u8; FOOTER_SEAL] {
    let crc = crc32fast::hash(&footer[..footer.len().saturating_sub(MAGIC.len())]);
    let mut seal = [0; FOOTER_SEAL];
    seal[..CRC].copy_from_slice(FOOTER_MARK);
    seal[CRC..].copy_from_slice(&crc.to_le_bytes());
    seal
}

/// Whether a footer with its length matches the bytes before it; `None` if these are no seal.
pub(crate) fn matches_seal(footer: &[u8], seal: &[u8]) -> Option<bool> {
    let crc = seal.strip_prefix(FOOTER_MARK)?;
    Some(crc == crc32fast::hash(footer).to_le_bytes())
}

/// The seal of a row group of this length. `footer` is that of a file with this one group.
pub(crate) fn group_seal(length: u64, footer: &[u8]) -> Vec<u8> {
    let mut seal = GROUP_MARK.to_vec();
    seal.extend(length.to_le_bytes());
    seal.extend((footer.len() as u32).to_le_bytes());
    seal.extend(footer);
    let crc = crc32fast::hash(&seal);
    seal.extend(crc.to_le_bytes());
    seal
}

/// A row group that a seal describes.
pub(crate) struct SealedGroup {
    /// Begin and length of its bytes in the file.
    pub(crate) begin: u64,
    pub(crate) length: u64,
    /// End of the seal in the file.
    pub(crate) end: u64,
    /// The footer of a file with this one group.
    pub(crate) metadata: ParquetMetaData,
    pub(crate) checks: GroupChecks,
}

/// The row groups of all whole seals of a file, in order.
///
/// # Errors
/// Those of the operating system.
pub(crate) fn sealed_groups(file: &RandomAccess) -> io::Result<Vec<SealedGroup>> {
    const WINDOW: usize = 1 << 20;
    let (mut groups, mut at, mut window) = (Vec::new(), 0, vec![0; WINDOW]);
    loop {
        let read = read_most(file, &mut window, at)?;
        for place in memmem::find_iter(&window[..read], GROUP_MARK) {
            groups.extend(sealed_group(file, at + place as u64)?);
        }
        if read < WINDOW {
            return Ok(groups);
        }
        // A mark may be on the border of two windows.
        at += (WINDOW - GROUP_MARK.len() + 1) as u64;
    }
}

/// The row group whose seal begins at `begin`; `None` if there is no whole seal.
fn sealed_group(file: &RandomAccess, begin: u64) -> io::Result<Option<SealedGroup>> {
    let mut seal = vec![0; GROUP_HEAD + MAX_GROUP_FOOTER + CRC];
    let read = read_most(file, &mut seal, begin)?;
    seal.truncate(read);
    let sealed = || {
        let head = seal.get(..GROUP_HEAD)?;
        let length = u64::from_le_bytes(head[8..16].try_into().ok()?);
        let footer = u32::from_le_bytes(head[16..].try_into().ok()?) as usize;
        let end = GROUP_HEAD + Some(footer).filter(|length| *length <= MAX_GROUP_FOOTER)?;
        let crc = seal.get(end..end + CRC)?;
        if crc != crc32fast::hash(&seal[..end]).to_le_bytes() {
            return None;
        }
        // Length and magic number end the footer.
        let footer = seal.get(GROUP_HEAD..end.checked_sub(4 + MAGIC.len())?).filter(|footer| is_footer(footer))?;
        let metadata = ParquetMetaDataReader::decode_metadata(footer).ok()?;
        let checks = checks_in(&metadata, Some(true)).ok()??.pop()?;
        let place = begin.checked_sub(length)?;
        Some(SealedGroup { begin: place, length, end: begin + (end + CRC) as u64, metadata, checks })
    };
    // The library panics at some damage.
    Ok(catch_panic(sealed).flatten())
}

/// Whether the seal of a footer begins at a place.
///
/// # Errors
/// Those of the operating system.
pub(crate) fn is_footer_sealed_at(file: &RandomAccess, place: u64) -> io::Result<bool> {
    let mut mark = [0; FOOTER_MARK.len()];
    let read = read_most(file, &mut mark, place)?;
    Ok(read == mark.len() && mark == *FOOTER_MARK)
}

/// Reads up to the length of `buffer` at a place. Returns how many bytes there are.
fn read_most(file: &RandomAccess, buffer: &mut [u8], at: u64) -> io::Result<usize> {
    let mut read = 0;
    while read < buffer.len() {
        match file.read_at(&mut buffer[read..], at + read as u64)? {
            0 => break,
            more => read += more,
        }
    }
    Ok(read)
}
