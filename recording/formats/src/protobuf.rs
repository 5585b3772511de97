//! Rows as protobuf messages, and the descriptors of these messages. Only the part of the encoding that recordings
//! need.

use crate::varint;
use isotherm_recording::columns::{Column, ColumnKind, Layout, columns};
use isotherm_recording::rows::{RecordedRow, append_value};
use isotherm_recording::steps;
use isotherm_shared::names::StreamKind;
use std::collections::HashMap;

// Wire types.
const VARINT: u64 = 0;
const FIXED_64: u64 = 1;
const BYTES: u64 = 2;
const FIXED_32: u64 = 5;

/// The name of a stream's message, with the package.
pub(crate) const fn message(stream: StreamKind) -> &'static str {
    match stream {
        StreamKind::Raw => "isotherm.RawSample",
        StreamKind::Increment => "isotherm.CompensatedIncrement",
    }
}

/// Encodes a row as its stream's message, with the fields of a layout.
pub(crate) fn encode(row: &RecordedRow, layout: Layout, message: &mut Vec<u8>) {
    let mut text = Vec::new();
    row.visit(layout, |column, value| {
        let wire_type = match column.kind {
            ColumnKind::U64 | ColumnKind::U32 => VARINT,
            ColumnKind::F64 => FIXED_64,
            ColumnKind::Hex | ColumnKind::Flags => BYTES,
        };
        varint::write(message, column.number << 3 | wire_type);
        match wire_type {
            VARINT => varint::write(message, value),
            FIXED_64 => message.extend_from_slice(&value.to_le_bytes()),
            _ => {
                text.clear();
                append_value(column.kind, value, &mut text);
                varint::write(message, text.len() as u64);
                message.extend_from_slice(&text);
            }
        }
    });
}

/// The `google.protobuf.FileDescriptorSet` that describes a stream's message, so that any reader can decode it.
pub(crate) fn descriptor(stream: StreamKind, layout: Layout) -> Vec<u8> {
    let (package, name) = message(stream).split_once('.').unwrap_or_default();
    let mut fields = Vec::new();
    for column in columns(stream, layout) {
        bytes(&mut fields, 2, &field(&column));
    }
    let mut description = Vec::new();
    bytes(&mut description, 1, name.as_bytes());
    description.extend_from_slice(&fields);
    let mut file = Vec::new();
    bytes(&mut file, 1, format!("{package}/{name}.proto").as_bytes());
    bytes(&mut file, 2, package.as_bytes());
    bytes(&mut file, 4, &description);
    bytes(&mut file, 12, b"proto3");
    let mut set = Vec::new();
    bytes(&mut set, 1, &file);
    set
}

/// A `FieldDescriptorProto`.
fn field(column: &Column) -> Vec<u8> {
    const OPTIONAL: u64 = 1;
    let kind = match column.kind {
        ColumnKind::F64 => 1,
        ColumnKind::U64 => 4,
        ColumnKind::Hex | ColumnKind::Flags => 9,
        ColumnKind::U32 => 13,
    };
    let mut field = Vec::new();
    bytes(&mut field, 1, column.name.as_bytes());
    for (key, value) in [(3, column.number), (4, OPTIONAL), (5, kind)] {
        varint::write(&mut field, key << 3 | VARINT);
        varint::write(&mut field, value);
    }
    bytes(&mut field, 10, column.name.as_bytes());
    field
}

fn bytes(out: &mut Vec<u8>, number: u64, value: &[u8]) {
    varint::write(out, number << 3 | BYTES);
    varint::write(out, value.len() as u64);
    out.extend_from_slice(value);
}

/// The value of a field, by wire type.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum FieldValue<'a> {
    /// An integer.
    Varint(u64),
    /// The bits of a double.
    Fixed64(u64),
    /// The bits of a float.
    Fixed32(u32),
    /// A text, or an embedded message.
    Bytes(&'a [u8]),
}

/// Calls `take` with number and value of each field of a message. Returns false if the bytes are not a valid message.
#[must_use]
pub(crate) fn decode<'a>(mut message: &'a [u8], mut take: impl FnMut(u64, FieldValue<'a>)) -> bool {
    while !message.is_empty() {
        if next_field(&mut message, &mut take).is_none() {
            return false;
        }
    }
    true
}

/// Whether a message begins with the field `number`, an integer of this value.
pub(crate) fn begins_with(mut message: &[u8], number: u64, value: u64) -> bool {
    varint::read(&mut message) == Some(number << 3 | VARINT) && varint::read(&mut message) == Some(value)
}

fn next_field<'a>(message: &mut &'a [u8], take: &mut impl FnMut(u64, FieldValue<'a>)) -> Option<()> {
    steps::count(1);
    let key = varint::read(message)?;
    let value = match key & 7 {
        VARINT => FieldValue::Varint(varint::read(message)?),
        FIXED_64 => {
            let (bits, rest) = message.split_first_chunk()?;
            *message = rest;
            FieldValue::Fixed64(u64::from_le_bytes(*bits))
        }
        BYTES => {
            let length = usize::try_from(varint::read(message)?).ok()?;
            let (bytes, rest) = message.split_at_checked(length)?;
            *message = rest;
            FieldValue::Bytes(bytes)
        }
        FIXED_32 => {
            let (bits, rest) = message.split_first_chunk()?;
            *message = rest;
            FieldValue::Fixed32(u32::from_le_bytes(*bits))
        }
        _ => return None,
    };
    take(key >> 3, value);
    Some(())
}

/// Number and type of a field, from a descriptor in a file.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) struct FieldNumber {
    /// Number of the field.
    pub number: u64,
    /// Its type, as numbered in `google.protobuf.FieldDescriptorProto`.
    pub kind: u64,
}

/// The fields of the message `name` (with package) in a `google.protobuf.FileDescriptorSet`; `None` if the set does not
/// describe it.
#[must_use]
pub(crate) fn fields(set: &[u8], name: &str) -> Option<HashMap<String, FieldNumber>> {
    let mut found = None;
    each(set, 1, &mut |file| {
        let package = text(file, 2);
        each(file, 4, &mut |message| {
            let own = text(message, 1);
            let full = if package.is_empty() { own } else { format!("{package}.{own}") };
            if full == name && found.is_none() {
                let mut fields = HashMap::new();
                each(message, 2, &mut |field| {
                    let number = FieldNumber { number: integer(field, 3), kind: integer(field, 5) };
                    fields.insert(text(field, 1), number);
                });
                found = Some(fields);
            }
        });
    });
    found
}

/// Calls `take` with each value of the field `number`, which has texts or embedded messages.
fn each<'a>(message: &'a [u8], number: u64, take: &mut dyn FnMut(&'a [u8])) {
    // An invalid message is read up to the first error.
    let _ = decode(message, |own, value| {
        if let (true, FieldValue::Bytes(bytes)) = (own == number, value) {
            take(bytes);
        }
    });
}

fn text(message: &[u8], number: u64) -> String {
    let mut text = String::new();
    each(message, number, &mut |bytes| text = String::from_utf8_lossy(bytes).into_owned());
    text
}

fn integer(message: &[u8], number: u64) -> u64 {
    let mut found = 0;
    let _ = decode(message, |own, value| {
        if let (true, FieldValue::Varint(value)) = (own == number, value) {
            found = value;
        }
    });
    found
}
