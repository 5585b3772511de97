//! Rows of text in a stream of bytes: what sketches and loggers print.

use crate::frames::{DecodedFrame, FrameArrival, MAX_FRAME};
use crate::number::Value;
use crate::tally::{Cause, SkippedBytes};

/// What a line looks like.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Line {
    /// What separates the columns; `None`: any number of spaces and tabs.
    pub(crate) separator: Option<u8>,
    /// Number of columns; `None`: as many as there are, but all of [`used`](Self::used).
    pub(crate) count: Option<usize>,
    /// The columns that are used, from 0.
    pub(crate) used: Vec<usize>,
    /// The beginning of lines that count, which is no column.
    pub(crate) prefix: Vec<u8>,
    /// Whether `*hh` ends a line: the exclusive or of the bytes between `$`, if the line begins with it, and `*`.
    pub(crate) checksum: bool,
}

/// Finds lines, and reads their columns.
pub(crate) struct LineDecoder {
    line: Line,
    /// The line so far.
    text: Vec<u8>,
    /// Bytes of a line that is too long.
    too_long: u64,
    row: Vec<Value>,
    damaged: u64,
    skipped: SkippedBytes,
}

impl LineDecoder {
    /// A decoder at the beginning of a stream.
    #[must_use]
    pub(crate) fn new(line: Line) -> Self {
        let row = vec![Value::ABSENT; line.used.len()];
        Self {
            row,
            text: Vec::with_capacity(MAX_FRAME),
            too_long: 0,
            damaged: 0,
            skipped: SkippedBytes::default(),
            line,
        }
    }

    /// Takes the next bytes of the stream, and gives each line that is complete to `sink`.
    pub(crate) fn push(&mut self, mut bytes: &[u8], arrival: FrameArrival, sink: &mut impl FnMut(DecodedFrame<'_>)) {
        while let Some(end) = memchr::memchr(b'\n', bytes) {
            let (line, rest) = bytes.split_at(end);
            self.add(line);
            self.complete(arrival, sink);
            bytes = rest.get(1..).unwrap_or_default();
        }
        self.add(bytes);
    }

    /// Ends the stream: what is left is no line.
    pub(crate) fn end(&mut self) {
        self.skipped.add(Cause::Cut, self.too_long + self.text.len() as u64);
        self.text.clear();
        self.too_long = 0;
    }

    /// Bytes that were no row, by cause.
    #[must_use]
    pub(crate) const fn skipped(&self) -> &SkippedBytes {
        &self.skipped
    }

    fn add(&mut self, bytes: &[u8]) {
        if self.too_long > 0 || self.text.len() + bytes.len() > MAX_FRAME {
            self.too_long += (self.text.len() + bytes.len()) as u64;
            self.text.clear();
        } else {
            self.text.extend_from_slice(bytes);
        }
    }

    fn complete(&mut self, arrival: FrameArrival, sink: &mut impl FnMut(DecodedFrame<'_>)) {
        let bytes = self.text.len() as u64 + self.too_long + 1;
        let read = match self.too_long {
            0 => self.line.read(&self.text, &mut self.row),
            _ => Err(Cause::Length),
        };
        self.text.clear();
        self.too_long = 0;
        match read {
            Ok(()) => {
                let damaged = std::mem::take(&mut self.damaged);
                sink(DecodedFrame { row: &self.row, arrival, bytes: bytes as usize, damaged });
            }
            Err(cause) => {
                let is_damaged = cause != Cause::Noise;
                self.damaged += u64::from(is_damaged);
                self.skipped.damaged += u64::from(is_damaged);
                self.skipped.add(cause, bytes);
            }
        }
    }
}

impl Line {
    /// Reads the columns of a line without its end.
    fn read(&self, line: &[u8], row: &mut [Value]) -> Result<(), Cause> {
        let line = line.trim_ascii();
        if line.is_empty() || !line.starts_with(&self.prefix) {
            return Err(Cause::Noise);
        }
        let text = if self.checksum { self.sealed(line)? } else { line };
        let mut columns = text.strip_prefix(self.prefix.as_slice()).ok_or(Cause::Columns)?;
        if let (false, Some(separator)) = (self.prefix.is_empty(), self.separator) {
            columns = columns.strip_prefix(&[separator]).unwrap_or(columns);
        }
        row.fill(Value::ABSENT);
        let mut count = 0;
        let mut take = |field: &[u8]| {
            for (value, used) in row.iter_mut().zip(&self.used) {
                if *used == count {
                    *value = number(field).ok_or(Cause::Columns)?;
                }
            }
            count += 1;
            Ok(())
        };
        match self.separator {
            Some(separator) => columns.split(|byte| *byte == separator).try_for_each(&mut take)?,
            None => {
                let words = columns.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
                words.into_iter().try_for_each(&mut take)?;
            }
        }
        let least = self.used.iter().map(|used| used + 1).max().unwrap_or(0);
        if self.count.map_or(count >= least, |right| count == right) { Ok(()) } else { Err(Cause::Columns) }
    }

    /// The line without its checksum, if that is right.
    fn sealed<'a>(&self, line: &'a [u8]) -> Result<&'a [u8], Cause> {
        let at = line.iter().rposition(|byte| *byte == b'*').ok_or(Cause::Checksum)?;
        let stated = std::str::from_utf8(&line[at + 1..]).ok().filter(|digits| digits.len() == 2);
        let stated = stated.and_then(|digits| u8::from_str_radix(digits, 16).ok());
        let text = &line[..at];
        let summed = text.strip_prefix(b"$").unwrap_or(text).iter().fold(0, |sum, byte| sum ^ byte);
        if stated == Some(summed) { Ok(text) } else { Err(Cause::Checksum) }
    }
}

/// A decimal number, or `nan` of a sensor that gives none, with spaces around it.
fn number(field: &[u8]) -> Option<Value> {
    let text = std::str::from_utf8(field).ok()?.trim();
    if text.eq_ignore_ascii_case("nan") {
        return Some(Value::ABSENT);
    }
    // Rust reads words such as "inf", too.
    let is_number = text.bytes().all(|byte| byte.is_ascii_digit() || b"+-.eE".contains(&byte));
    let number: f64 = text.parse().ok().filter(|_| is_number)?;
    let whole = text.parse::<i64>().map(i64::cast_unsigned).or_else(|_| text.parse()).ok();
    Some(Value { number, whole })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(line: &Line, text: &[u8], piece: usize) -> (Vec<Vec<f64>>, SkippedBytes, u64) {
        let (mut rows, mut damaged) = (Vec::new(), 0);
        let mut decoder = LineDecoder::new(line.clone());
        for piece in text.chunks(piece) {
            decoder.push(piece, FrameArrival::default(), &mut |found| {
                damaged += found.damaged;
                rows.push(found.row.iter().map(|value| value.number).collect());
            });
        }
        decoder.end();
        (rows, *decoder.skipped(), damaged)
    }

    #[test]
    fn lines_are_read_and_what_is_none_is_counted_however_the_bytes_come() {
        let line = Line { separator: Some(b','), count: Some(3), used: vec![2, 0], prefix: vec![], checksum: false };
        let text = b"hello\n1,2,3\r\n\n 4, x, -6e1\n7,8\n7,8,inf\n7,8,9,10\n+1,,2\n1,2";
        for piece in 1..text.len() {
            let (rows, skipped, damaged) = rows(&line, text, piece);
            assert_eq!(rows, [[3.0, 1.0], [-60.0, 4.0], [2.0, 1.0]]);
            assert_eq!((skipped.columns, skipped.noise, skipped.cut, skipped.damaged), (6 + 4 + 8 + 9, 1, 3, 4));
            assert_eq!(damaged, 4);
        }
    }

    #[test]
    fn a_number_that_is_none_does_not_spoil_its_line() {
        let line = Line { separator: Some(b','), count: None, used: vec![0, 1], prefix: vec![], checksum: false };
        let (rows, skipped, _) = rows(&line, b"7,nan\n8, NaN\n9,nano\n", 3);
        assert!(rows.len() == 2 && rows.iter().all(|row| row[1].is_nan()), "{rows:?}");
        assert_eq!((rows[1][0], skipped.columns), (8.0, 7));
    }

    #[test]
    fn prefix_checksum_and_spaces() {
        let line =
            Line { separator: Some(b','), count: None, used: vec![0, 1], prefix: b"$IMU".to_vec(), checksum: true };
        let sum = b"IMU,1,-2".iter().fold(0, |sum, byte| sum ^ byte);
        let text = format!("$IMU,1,-2*{sum:02X}\n$IMU,1,-3*{sum:02X}\n$GPS,1,2*00\n$IMU,1,-2\n");
        let (found, skipped, _) = rows(&line, text.as_bytes(), 5);
        assert_eq!(found, [[1.0, -2.0]]);
        assert_eq!((skipped.checksum, skipped.noise), (13 + 10, 12));
        let line = Line { separator: None, count: None, used: vec![1], prefix: vec![], checksum: false };
        assert_eq!(rows(&line, b"  1 \t 18446744073709551615  3\n", 7).0, [[u64::MAX as f64]]);
    }

    #[test]
    fn a_line_without_end_takes_no_memory() {
        let line = Line { separator: None, count: None, used: vec![0], prefix: vec![], checksum: false };
        let mut decoder = LineDecoder::new(line);
        let mut found = 0;
        for _ in 0..1000 {
            decoder.push(&[b'1'; 1000], FrameArrival::default(), &mut |_| found += 1);
            assert!(decoder.text.capacity() <= MAX_FRAME);
        }
        decoder.push(b"\n5\n", FrameArrival::default(), &mut |_| found += 1);
        assert_eq!((found, decoder.skipped().length), (1, 1_000_001));
    }
}
