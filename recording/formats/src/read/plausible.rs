//! Which records can be at a place of an MCAP file: what no writer writes there is damage.

use crate::protobuf::begins_with;
use mcap::parse_record;
use mcap::records::{Header, Record, op};

/// The begin of the library that the header of an MCAP file names, if the recorder wrote it.
pub(crate) const CREATOR: &str = "isotherm ";

/// Why no writer writes such a record into a chunk.
pub(crate) fn foreign_to_chunk(opcode: u8) -> Option<&'static str> {
    (!matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE)).then_some("a record that no chunk has")
}

/// Whether the recorder wrote the file, and rows into it: ROS messages are none.
pub(crate) fn is_own(header: &Header) -> bool {
    header.library.starts_with(CREATOR) && header.profile.is_empty()
}

/// Why no writer writes such a record at this place.
pub(crate) fn impossible(opcode: u8, data: &[u8], data_ended: bool) -> Option<&'static str> {
    match opcode {
        op::HEADER | op::SCHEMA | op::CHANNEL if !texts_fit(opcode, data) => {
            Some("a text that is longer than its record")
        }
        op::MESSAGE_INDEX if !is_index(data) => Some("an index that is none"),
        op::FOOTER
        | op::CHUNK_INDEX
        | op::ATTACHMENT_INDEX
        | op::STATISTICS
        | op::METADATA_INDEX
        | op::SUMMARY_OFFSET
            if !data_ended =>
        {
            Some("a record of the summary among the data")
        }
        0 | 0x10..=0x7f => Some("a record of no known kind"),
        _ => None,
    }
}

/// Why the recorder does not write such a record.
pub(crate) fn foreign(opcode: u8, data: &[u8]) -> Option<&'static str> {
    match opcode {
        0x80.. => Some("a record of no known kind"),
        // Its first field is the time at which it was recorded, and that is the message's.
        op::MESSAGE => match parse_record(opcode, data) {
            Ok(Record::Message { header, data }) if begins_with(&data, 1, header.log_time) => None,
            _ => Some("a message that is none of the recorder's"),
        },
        _ => None,
    }
}

/// Whether the record is an index of messages: a channel, and times with places up to the end.
fn is_index(record: &[u8]) -> bool {
    let length = record.get(2..).and_then(<[u8]>::first_chunk).map(|length| u32::from_le_bytes(*length));
    length.is_some_and(|length| length % 16 == 0 && record.len() == 6 + length as usize)
}

/// Whether the texts of a header, a schema or a channel end within its record. The library allocates the length that a
/// text claims before it reads the text.
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
        // The numbers of schema and channel, then two names.
        let numbers = match opcode {
            op::CHANNEL => 4,
            op::SCHEMA => 2,
            _ => 0,
        };
        let mut rest = record.get(numbers..)?;
        text(&mut rest)?;
        text(&mut rest)?;
        if opcode == op::CHANNEL {
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
