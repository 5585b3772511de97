//! The summary at the end of an MCAP file.

use super::chunk::{HEAD, MAX_RECORD, parts};
use super::panics::catch_panic;
use super::plausible::impossible;
use isotherm_recording::columns::MCAP_MAGIC;
use isotherm_support::source::ReadSeek;
use mcap::parse_record;
use mcap::records::{Record, op};
use std::io::{self, Read as _, SeekFrom};

/// A footer with its head, and the last bytes of a file.
const END: u64 = 37;
/// Length of the record that says where a group of records of the summary is, and how many groups there can be.
const SUMMARY_OFFSET: u64 = 26;
const GROUPS: u64 = 8;

/// The schemas, channels and statistics of the summary of a file, if that matches its check.
pub(super) fn summary(file: &mut dyn ReadSeek) -> io::Result<Vec<Record<'static>>> {
    let size = file.seek(SeekFrom::End(0))?;
    let Some(place) = size.checked_sub(END) else { return Ok(Vec::new()) };
    let footer = bytes(file, place, END)?;
    let record = footer.get(HEAD..).and_then(|content| parsed(op::FOOTER, content));
    let Some(Record::Footer(record)) = record else { return Ok(Vec::new()) };
    let is_footer = footer.first() == Some(&op::FOOTER) && footer.ends_with(MCAP_MAGIC);
    if !is_footer || record.summary_start == 0 || record.summary_crc == 0 {
        return Ok(Vec::new());
    }
    // Where it begins, and if bytes are missing or more before it, its length: that of its parts.
    let groups = record.summary_offset_start.checked_sub(record.summary_start);
    let shifted = (0..=GROUPS).filter_map(|count| Some(groups? + count * SUMMARY_OFFSET));
    let lengths = place.checked_sub(record.summary_start).into_iter().chain(shifted);
    for length in lengths.filter(|length| *length <= place.min(MAX_RECORD as u64)) {
        let bytes = bytes(file, place - length, length)?;
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&bytes);
        hasher.update(&footer[..HEAD + 16]);
        if hasher.finalize() == record.summary_crc {
            return Ok(records(&bytes));
        }
    }
    Ok(Vec::new())
}

/// The records of a summary that matches its check.
fn records(mut rest: &[u8]) -> Vec<Record<'static>> {
    let mut records = Vec::new();
    while let Some((opcode, length)) = parts(rest) {
        let content = usize::try_from(length).ok().and_then(|length| rest.get(HEAD..HEAD.checked_add(length)?));
        let Some(content) = content else { break };
        if matches!(opcode, op::SCHEMA | op::CHANNEL | op::STATISTICS) {
            records.extend(parsed(opcode, content));
        }
        rest = &rest[HEAD + content.len()..];
    }
    records
}

/// A record outside of chunks; `None` if it is damaged.
fn parsed(opcode: u8, content: &[u8]) -> Option<Record<'static>> {
    if impossible(opcode, content, true).is_some() {
        return None;
    }
    catch_panic(|| parse_record(opcode, content).ok().map(Record::into_owned)).flatten()
}

/// Up to so many bytes of a file from a place on.
fn bytes(file: &mut dyn ReadSeek, at: u64, length: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(at))?;
    file.take(length).read_to_end(&mut bytes)?;
    Ok(bytes)
}
