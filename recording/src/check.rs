//! The checks of rows in CSV, by which a reader finds damage: `record` and `acquire --record` write them.
//!
//! The last column, `check`, has the CRC-32 of a row's text up to the comma before it, in 8 hexadecimal digits. A
//! header has no check. So a header with this column is one that the recorder writes, name by name; and where the last
//! column has a name that nobody knows, no row may have its own check there.

use crate::columns::{Column, ColumnSet, INCREMENT, Layout, RAW, columns};
use isotherm_shared::names::StreamKind;
use std::io::Write as _;

/// The name of the column.
pub const CHECK: &str = "check";
/// Digits of a check.
const DIGITS: usize = 8;
/// Columns of a recording by which a text is one, though others may be missing.
const FEW: usize = 3;

/// What a text has to check its rows by, as its header says.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub(crate) enum RowChecks {
    /// Nothing.
    #[default]
    Absent,
    /// The column with this index.
    Column(usize),
    /// Nothing, but nobody knows the last column, and that may be the one, with a damaged name.
    Suspected,
}

/// The layouts of a recorder's files: every choice of columns.
pub fn layouts() -> impl Iterator<Item = (StreamKind, Layout)> {
    let of = |bits: u8| {
        let [device, gyroscopes, lag, unix_offset] = [1, 2, 4, 8].map(|bit| bits & bit != 0);
        Layout { device, gyroscopes, lag, unix_offset }
    };
    let raw = (0..16).map(move |bits| (StreamKind::Raw, of(bits)));
    raw.chain([0, 2, 8, 10].map(move |bits| (StreamKind::Increment, of(bits))))
}

/// Appends the check of the row that begins at `begin`: a comma and 8 digits.
pub(crate) fn append(text: &mut Vec<u8>, begin: usize) {
    let check = crc32fast::hash(text.get(begin..).unwrap_or_default());
    // Writing to memory cannot fail.
    let _ = write!(text, ",{check:08x}");
}

/// Whether `digits` are the check of `row`.
pub(crate) fn matches(row: &[u8], digits: &[u8]) -> bool {
    let value = |digit: &u8| match digit {
        b'0'..=b'9' => Some(u32::from(digit - b'0')),
        b'a'..=b'f' => Some(u32::from(digit - b'a') + 10),
        _ => None,
    };
    let check = digits.iter().try_fold(0_u32, |check, digit| Some(check << 4 | value(digit)?));
    digits.len() == DIGITS && check.is_some_and(|check| check == crc32fast::hash(row))
}

/// A line with another number in one of its fields, and with the check that it then has, if there is a column of
/// checks.
#[must_use]
pub fn with_field(line: &[u8], field: usize, number: u64, check: Option<usize>) -> Vec<u8> {
    let content = line.trim_ascii_end();
    let mut text = Vec::with_capacity(line.len() + DIGITS);
    for (index, old) in content.split(|byte| *byte == b',').enumerate() {
        if check == Some(index) {
            append(&mut text, 0);
            continue;
        }
        if index > 0 {
            text.push(b',');
        }
        match index == field {
            // Writing to memory cannot fail.
            true => drop(write!(text, "{number}")),
            false => text.extend_from_slice(old),
        }
    }
    text.extend_from_slice(line.get(content.len()..).unwrap_or_default());
    text
}

/// What a text with this header has to check its rows by.
///
/// # Errors
/// If the header is damaged.
pub(crate) fn of_header(names: &[String]) -> Result<RowChecks, String> {
    if names.iter().filter(|name| is_known(name)).count() < FEW {
        // Another program's text, and its own meaning of the word.
        return Ok(RowChecks::Absent);
    }
    let Some(place) = names.iter().position(|name| name == CHECK) else {
        let is_last_known = names.last().is_none_or(|last| is_known(last));
        return Ok(if is_last_known { RowChecks::Absent } else { RowChecks::Suspected });
    };
    let before = &names[..place];
    match layouts().any(|(stream, layout)| columns(stream, layout).iter().map(|column| column.name).eq(before)) {
        true => Ok(RowChecks::Column(place)),
        false => Err(format!(
            "the header has a column {CHECK}, but not the columns that `isotherm record` writes before it: \
             {DAMAGED}"
        )),
    }
}

/// What to do about a row or header that is not as the recorder wrote it.
pub(crate) const DAMAGED: &str = "the file is damaged, and `isotherm repair` takes what is whole; if another program \
                                  wrote it, leave the column check out";

fn is_known(name: &str) -> bool {
    let is_it = |column: &Column| column.name == name;
    RAW.iter().chain(&INCREMENT).any(is_it)
}

/// Whether a header with these names can be that of raw samples, or of increments; `None` if it is neither.
#[must_use]
pub fn stream_of(names: &[String]) -> Option<StreamKind> {
    let has = |column: &Column| names.iter().any(|name| name == column.name);
    let of = |all: &[Column], more: &[&str]| {
        let mut needed = all.iter().filter(|column| column.set == ColumnSet::Always && !more.contains(&column.name));
        needed.all(has)
    };
    if of(&RAW, &[]) {
        return Some(StreamKind::Raw);
    }
    // Only the recorder writes these.
    of(&INCREMENT, &["delivery", "flag_bits", "latency_ns"]).then_some(StreamKind::Increment)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(stream: StreamKind, layout: Layout) -> Vec<String> {
        columns(stream, layout).iter().map(|column| column.name.to_owned()).collect()
    }

    /// `zlib.crc32(b"1,2.5,-")` of Python.
    #[test]
    fn a_check_is_the_crc_of_zlib() {
        let mut text = b"0,0\n1,2.5,-".to_vec();
        append(&mut text, 4);
        assert_eq!(text, b"0,0\n1,2.5,-,2654979e");
        assert!(matches(b"1,2.5,-", b"2654979e") && !matches(b"1,2.5,-", b"2654979E"));
        assert!(!matches(b"1,2.5,-", b"2654979") && !matches(b"", b"") && matches(b"", b"00000000"));
    }

    #[test]
    fn a_line_with_another_session_has_another_check() {
        let mut line = b"5,7,0.5".to_vec();
        append(&mut line, 0);
        line.extend_from_slice(b",note\r\n");
        let other = with_field(&line, 1, 123, Some(3));
        let row = b"5,123,0.5";
        assert_eq!(other, [&row[..], format!(",{:08x},note\r\n", crc32fast::hash(row)).as_bytes()].concat());
        assert_eq!(with_field(b"5,7,0.5\n", 0, 6, None), b"6,7,0.5\n");
    }

    /// A header that is damaged by one bit is refused, lacks a column, or has another last column.
    #[test]
    fn a_header_with_a_flipped_bit_is_not_taken_for_another() {
        for (stream, layout) in layouts() {
            let mut names = header(stream, layout);
            assert_eq!(of_header(&names), Ok(RowChecks::Absent));
            names.push(CHECK.to_owned());
            assert_eq!(of_header(&names), Ok(RowChecks::Column(names.len() - 1)));
            assert_eq!(stream_of(&names), Some(stream));
            let text = names.join(",");
            for bit in 0..text.len() * 8 {
                let mut bytes = text.clone().into_bytes();
                bytes[bit / 8] ^= 1 << (bit % 8);
                let damaged: Vec<_> = String::from_utf8_lossy(&bytes).split(',').map(str::to_owned).collect();
                let is_last = bit / 8 >= text.len() - CHECK.len() - 1;
                match of_header(&damaged) {
                    Ok(RowChecks::Suspected) => assert!(is_last, "{damaged:?}"),
                    other => assert!(other.is_err() && !is_last, "{damaged:?}"),
                }
            }
        }
        assert_eq!(of_header(&["check", "x", "y"].map(str::to_owned)), Ok(RowChecks::Absent));
        assert_eq!(of_header(&["x", "y"].map(str::to_owned)), Ok(RowChecks::Absent));
    }

    /// The number of columns identifies the layout, by which a damaged header can be written anew.
    #[test]
    fn no_two_layouts_have_as_many_columns() {
        let mut counts: Vec<_> = layouts().map(|(stream, layout)| columns(stream, layout).len()).collect();
        counts.sort_unstable();
        assert!(counts.windows(2).all(|pair| pair[0] < pair[1]), "{counts:?}");
    }
}
