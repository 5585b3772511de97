//! The summary at the end of an MCAP file, and single records of a file.

use super::chunk::{HEAD, MAX_RECORD, parts};
use super::panics::catch_panic;
use super::plausible::impossible;
use super::random::RandomAccess;
use isotherm_recording::columns::MCAP_MAGIC;
use mcap::parse_record;
use mcap::records::{Record, op};
use std::io;

/// A footer with its head, and the last bytes of a file.
const END: u64 = 37;
/// Length of the record that says where a group of records of the summary is, and how many groups there can be.
const SUMMARY_OFFSET: u64 = 26;
const GROUPS: u64 = 8;

/// The schemas, channels and statistics of the summary of a file, if that matches its check; and whether
/// the end of the file is as it was written.
pub(crate) fn summary(file: &RandomAccess) -> io::Result<(Vec<Record<'static>>, bool)> {
    let Some(place) = file.size().checked_sub(END) else { return Ok((Vec::new(), false)) };
    let footer = bytes(file, place, END as usize)?;
    let Some(Record::Footer(record)) = footer.get(HEAD..).and_then(|content| parsed(op::FOOTER, content)) else {
        return Ok((Vec::new(), false));
    };
    let is_footer = footer.first() == Some(&op::FOOTER) && footer.ends_with(MCAP_MAGIC);
    if !is_footer || record.summary_start == 0 || record.summary_crc == 0 {
        return Ok((Vec::new(), is_footer));
    }
    // Where it begins, and if bytes are missing or more before it, its length: that of its parts.
    let groups = record.summary_offset_start.checked_sub(record.summary_start);
    let shifted = (0..=GROUPS).filter_map(|count| Some(groups? + count * SUMMARY_OFFSET));
    let lengths = place.checked_sub(record.summary_start).into_iter().chain(shifted);
    let mut found = None;
    for length in lengths.filter(|length| *length <= place.min(MAX_RECORD as u64)) {
        let bytes = bytes(file, place - length, length as usize)?;
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&bytes);
        hasher.update(&footer[..HEAD + 16]);
        if hasher.finalize() == record.summary_crc {
            found = Some(bytes);
            break;
        }
    }
    let Some(bytes) = found else { return Ok((Vec::new(), false)) };
    let (mut rest, mut records) = (&bytes[..], Vec::new());
    while let Some((opcode, length)) = parts(rest) {
        let content = usize::try_from(length).ok().and_then(|length| rest.get(HEAD..HEAD.checked_add(length)?));
        let Some(content) = content else { break };
        if matches!(opcode, op::SCHEMA | op::CHANNEL | op::STATISTICS) {
            records.extend(parsed(opcode, content));
        }
        rest = &rest[HEAD + content.len()..];
    }
    Ok((records, true))
}

/// A record outside of chunks; `None` if it is damaged.
pub(crate) fn parsed(opcode: u8, content: &[u8]) -> Option<Record<'static>> {
    if impossible(opcode, content, true).is_some() {
        return None;
    }
    catch_panic(|| parse_record(opcode, content).ok().map(Record::into_owned)).flatten()
}

/// Up to so many bytes of a file from a place on.
pub(crate) fn bytes(file: &RandomAccess, at: u64, length: usize) -> io::Result<Vec<u8>> {
    let there = usize::try_from(file.size().saturating_sub(at)).unwrap_or(usize::MAX);
    let mut bytes = vec![0; length.min(there)];
    file.read_exact_at(&mut bytes, at)?;
    Ok(bytes)
}
