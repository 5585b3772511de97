//! The fields of protobuf messages, as wanted columns.

use super::table::{Absence, ValueKind, WantedColumn, refuse_missing};
use crate::protobuf::{self, FieldNumber, FieldValue};
use isotherm_recording::columns::hex;
use isotherm_recording::steps;
use std::collections::HashMap;

/// Highest number of a field that is read.
const MAX_FIELD: u64 = 4096;

/// Field types of numbers, as numbered in `google.protobuf.FieldDescriptorProto`: double, float, int64, uint64, int32,
/// uint32.
const NUMBERS: [u64; 6] = [1, 2, 3, 4, 5, 13];
/// Field type of texts: string.
const TEXTS: [u64; 1] = [9];

/// The fields of a schema that have wanted columns.
pub(super) struct FieldMap {
    /// By field number: index of the wanted column, and the field's type in protobuf.
    columns: Vec<Option<(usize, u64)>>,
    /// The values of the wanted columns in a message without any field.
    absent: Vec<Option<u64>>,
}

/// Maps fields to wanted columns. An error if a column is missing or has an unsuitable type.
///
/// A missing field has the value 0, as defined by proto3; for [`Absence::Kept`] it has none, and neither has one that
/// the schema lacks.
pub(super) fn map_fields(wanted: &[WantedColumn], fields: &HashMap<String, FieldNumber>) -> Result<FieldMap, String> {
    let mut names: Vec<_> = fields.keys().cloned().collect();
    names.sort();
    steps::count(names.len() as u64);
    refuse_missing(wanted, &names, "")?;
    let (mut columns, mut absent) = (Vec::new(), vec![None; wanted.len()]);
    for (wanted_index, column) in wanted.iter().enumerate() {
        let Some(FieldNumber { number, kind }) = fields.get(&column.name) else { continue };
        let readable = if column.kind == ValueKind::Hex { &TEXTS[..] } else { &NUMBERS };
        if !readable.contains(kind) {
            return Err(format!("field {} is of a type that is not read", column.name));
        }
        if *number > MAX_FIELD {
            return Err(format!("the number of field {} is over {MAX_FIELD}", column.name));
        }
        let index = *number as usize;
        if columns.len() <= index {
            columns.resize(index + 1, None);
        }
        columns[index] = Some((wanted_index, *kind));
        absent[wanted_index] = (column.absence == Absence::Refused).then_some(0);
    }
    Ok(FieldMap { columns, absent })
}

/// Reads the values of a message.
pub(super) fn decode(
    message: &[u8],
    wanted: &[WantedColumn],
    fields: &FieldMap,
    values: &mut Vec<Option<u64>>,
) -> Result<(), String> {
    values.clone_from(&fields.absent);
    let mut wrong = None;
    let valid = protobuf::decode(message, |number, value| {
        let field = usize::try_from(number).ok().and_then(|number| fields.columns.get(number).copied().flatten());
        let Some((index, kind)) = field else { return };
        match value_of(wanted[index].kind, kind, value) {
            Some(bits) => values[index] = Some(bits),
            None => wrong = Some(index),
        }
    });
    match wrong {
        None if valid => Ok(()),
        None => Err("a message that is not valid protobuf".to_owned()),
        Some(index) => Err(format!("{} is not {}", wanted[index].name, wanted[index].kind.expected())),
    }
}

/// Converts a field's value to the kind of the wanted column; `kind` is the field's declared type. `None` if it does
/// not fit.
fn value_of(wanted: ValueKind, kind: u64, value: FieldValue<'_>) -> Option<u64> {
    const SIGNED: [u64; 2] = [3, 5];
    match (wanted, value) {
        (ValueKind::U64, FieldValue::Varint(value)) => Some(value),
        (ValueKind::U32, FieldValue::Varint(value)) => u32::try_from(value).ok().map(u64::from),
        (ValueKind::Number, FieldValue::Fixed64(bits)) => Some(bits),
        (ValueKind::Number, FieldValue::Fixed32(bits)) => Some(f64::from(f32::from_bits(bits)).to_bits()),
        (ValueKind::Number, FieldValue::Varint(value)) if SIGNED.contains(&kind) => {
            Some((value.cast_signed() as f64).to_bits())
        }
        (ValueKind::Number, FieldValue::Varint(value)) => Some((value as f64).to_bits()),
        (ValueKind::Hex, FieldValue::Bytes(text)) => hex(text),
        _ => None,
    }
}
