//! Rows as lines of text.

use super::columns::{Column, Row, Values};
use core::fmt::Display;
use std::io::Write as _;

/// The header line.
pub fn header(columns: &[Column]) -> Vec<u8> {
    let names: Vec<_> = columns.iter().map(|column| column.name).collect();
    (names.join(",") + "\n").into_bytes()
}

/// Appends a row's line; floats in the shortest form that reads back to the same double.
pub fn append(row: &Row, text: &mut Vec<u8>) {
    row.visit(&mut Line(text));
    // In the place of the last comma.
    if let Some(last) = text.last_mut() {
        *last = b'\n';
    }
}

struct Line<'a>(&'a mut Vec<u8>);

// Writing to memory cannot fail.
impl Values for Line<'_> {
    fn u64(&mut self, value: u64) {
        let _ = write!(self.0, "{value},");
    }
    fn u32(&mut self, value: u32) {
        let _ = write!(self.0, "{value},");
    }
    fn f64(&mut self, value: f64) {
        let _ = write!(self.0, "{value:?},");
    }
    fn text(&mut self, value: impl Display) {
        let _ = write!(self.0, "{value},");
    }
}
