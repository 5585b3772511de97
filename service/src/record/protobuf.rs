//! Rows as protobuf messages, and the description of the messages: what little of the encoding both need.

use super::columns::{Column, Kind, Row, Stream, Values};
use core::fmt::Display;
use std::io::Write as _;

const VARINT: u64 = 0;
const FIXED_64: u64 = 1;
const BYTES: u64 = 2;

/// The name of a stream's message.
pub const fn message(stream: Stream) -> &'static str {
    match stream {
        Stream::Raw => "isotherm.RawSample",
        Stream::Increment => "isotherm.CompensatedIncrement",
    }
}

/// Encodes a row as its stream's message: each column is the field whose number is the column's place, from 1.
pub fn encode(row: &Row, bytes: &mut Vec<u8>) {
    row.visit(&mut Fields { bytes, number: 0, text: Vec::new() });
}

struct Fields<'a> {
    bytes: &'a mut Vec<u8>,
    number: u64,
    text: Vec<u8>,
}

impl Fields<'_> {
    fn tag(&mut self, wire: u64) {
        self.number += 1;
        varint(self.bytes, self.number << 3 | wire);
    }
}

impl Values for Fields<'_> {
    fn u64(&mut self, value: u64) {
        self.tag(VARINT);
        varint(self.bytes, value);
    }
    fn u32(&mut self, value: u32) {
        self.u64(u64::from(value));
    }
    fn f64(&mut self, value: f64) {
        self.tag(FIXED_64);
        self.bytes.extend_from_slice(&value.to_bits().to_le_bytes());
    }
    fn text(&mut self, value: impl Display) {
        self.tag(BYTES);
        self.text.clear();
        // Writing to memory cannot fail.
        let _ = write!(self.text, "{value}");
        varint(self.bytes, self.text.len() as u64);
        self.bytes.extend_from_slice(&self.text);
    }
}

/// The `google.protobuf.FileDescriptorSet` that describes a stream's message, from which a reader decodes it.
pub fn descriptor(stream: Stream) -> Vec<u8> {
    let (package, name) = message(stream).split_once('.').unwrap_or_default();
    let mut fields = Vec::new();
    for (column, number) in stream.columns().iter().zip(1..) {
        bytes(&mut fields, 2, &field(column, number));
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
fn field(column: &Column, number: u64) -> Vec<u8> {
    const OPTIONAL: u64 = 1;
    let kind = match column.kind {
        Kind::F64 => 1,
        Kind::U64 => 4,
        Kind::Text => 9,
        Kind::U32 => 13,
    };
    let mut field = Vec::new();
    bytes(&mut field, 1, column.name.as_bytes());
    for (key, value) in [(3, number), (4, OPTIONAL), (5, kind)] {
        varint(&mut field, key << 3 | VARINT);
        varint(&mut field, value);
    }
    bytes(&mut field, 10, column.name.as_bytes());
    field
}

fn bytes(out: &mut Vec<u8>, number: u64, value: &[u8]) {
    varint(out, number << 3 | BYTES);
    varint(out, value.len() as u64);
    out.extend_from_slice(value);
}

fn varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

/// The value of a field: what a varint or the bits of a double hold. Text is passed over.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Field {
    /// Of a whole number.
    Varint(u64),
    /// Of a double.
    Fixed64(u64),
}

/// Goes through the fields of a message: `take` gets number and value of each. False if it is no message.
#[must_use]
pub fn decode(mut message: &[u8], mut take: impl FnMut(u64, Field)) -> bool {
    while !message.is_empty() {
        let Some(key) = read_varint(&mut message) else { return false };
        match key & 7 {
            VARINT => match read_varint(&mut message) {
                Some(value) => take(key >> 3, Field::Varint(value)),
                None => return false,
            },
            FIXED_64 => match message.split_first_chunk() {
                Some((bits, rest)) => {
                    take(key >> 3, Field::Fixed64(u64::from_le_bytes(*bits)));
                    message = rest;
                }
                None => return false,
            },
            BYTES => {
                let length = read_varint(&mut message).and_then(|length| usize::try_from(length).ok());
                match length.and_then(|length| message.get(length..)) {
                    Some(rest) => message = rest,
                    None => return false,
                }
            }
            5 => match message.get(4..) {
                Some(rest) => message = rest,
                None => return false,
            },
            _ => return false,
        }
    }
    true
}

fn read_varint(bytes: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        // The tenth byte has one bit left.
        if shift == 63 && byte > 1 {
            return None;
        }
        value |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return Some(value);
        }
    }
    None
}
