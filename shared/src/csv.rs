//! Rows of a comma-separated text, with the number of their line for every message.

use core::str::FromStr;
use std::io::{self, BufRead, BufReader, Read};

/// Why a recording cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// Something in the data is wrong.
    #[error("line {line}: {message}")]
    Data {
        /// Line, from 1.
        line: u64,
        /// What is wrong and what would be right.
        message: String,
    },
    /// The source could not be read.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// Longest line that is read: 64 KiB.
const MAX_LINE: u64 = 1 << 16;

/// A column: its name and its place in a row.
#[derive(Clone, Debug, Default, Eq, PartialEq)]
pub struct Column(String, usize);

/// The rows of a CSV text, one a line, blank lines left out, with the number of their line.
pub struct Rows<R> {
    source: BufReader<R>,
    parser: csv_core::Reader,
    text: Vec<u8>,
    line: u64,
    /// The fields of the row one after the other, and where each ends.
    fields: Vec<u8>,
    ends: Vec<usize>,
    count: usize,
}

impl<R: Read> Rows<R> {
    /// Reads from `source`.
    pub fn new(source: R) -> Self {
        let (fields, ends) = (vec![0; 256], vec![0; 32]);
        Self {
            source: BufReader::new(source),
            parser: csv_core::Reader::new(),
            text: Vec::new(),
            line: 0,
            fields,
            ends,
            count: 0,
        }
    }

    /// Parses the next row; false at the end.
    ///
    /// # Errors
    /// If the source cannot be read, a quotation mark is not closed or a lone carriage return is inside a row.
    pub fn next_row(&mut self) -> Result<bool, RecordingError> {
        self.count = 0;
        loop {
            self.text.clear();
            self.line += 1;
            if (&mut self.source).take(MAX_LINE).read_until(b'\n', &mut self.text)? == 0 {
                return Ok(false);
            }
            if self.text.len() as u64 == MAX_LINE {
                return Err(
                    self.error(format!("over {MAX_LINE} bytes without a line end; this is no table of numbers"))
                );
            }
            if self.line == 1 && self.text.starts_with(b"\xef\xbb\xbf") {
                self.text.drain(..3);
            }
            if !self.text.trim_ascii().is_empty() {
                break;
            }
        }
        let content = self.text.strip_suffix(b"\n").unwrap_or(&self.text);
        if content.strip_suffix(b"\r").unwrap_or(content).contains(&b'\r') {
            return Err(
                self.error("a carriage return inside a row; save the file with LF or CR LF line ends".to_owned())
            );
        }
        // No line needs more room than this, so that parsing it is one call.
        self.fields.resize(self.fields.len().max(self.text.len() + 1), 0);
        self.ends.resize(self.ends.len().max(self.text.len() + 1), 0);
        if !self.text.ends_with(b"\n") {
            self.text.push(b'\n');
        }
        self.parser.reset();
        let (result, _, _, count) = self.parser.read_record(&self.text, &mut self.fields, &mut self.ends);
        self.count = count;
        match result {
            csv_core::ReadRecordResult::Record => Ok(true),
            _ => Err(self.error("a quotation mark is not closed; a field may not span lines".to_owned())),
        }
    }

    /// Number of fields of the row.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.count
    }

    /// Whether there is no row.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Line of the row, from 1.
    #[must_use]
    pub const fn line(&self) -> u64 {
        self.line
    }

    /// Finds the columns `names` in the header, which must be the current row; `hint` ends the message about missing ones.
    ///
    /// # Errors
    /// Naming every column that is missing, or one that is there twice.
    pub fn columns(&self, names: &[&str], hint: &str) -> Result<Vec<Column>, RecordingError> {
        let found = names.iter().map(|name| self.optional_column(name)).collect::<Result<Vec<_>, _>>()?;
        let missing: Vec<_> = names.iter().zip(&found).filter(|(_, c)| c.is_none()).map(|(name, _)| *name).collect();
        if missing.is_empty() {
            Ok(found.into_iter().flatten().collect())
        } else {
            Err(self.error(format!("missing columns: {}; {hint}", missing.join(", "))))
        }
    }

    /// Finds a column in the header, which must be the current row.
    ///
    /// # Errors
    /// If it is there twice.
    pub fn optional_column(&self, name: &str) -> Result<Option<Column>, RecordingError> {
        let mut places = (0..self.len()).filter(|&index| self.field(index) == name.as_bytes());
        match (places.next(), places.next()) {
            (_, Some(_)) => Err(self.error(format!("the column {name} is there twice"))),
            (place, None) => Ok(place.map(|place| Column(name.to_owned(), place))),
        }
    }

    /// Refuses a row that has not `count` fields.
    ///
    /// # Errors
    /// Naming both numbers.
    pub fn expect_len(&self, count: usize) -> Result<(), RecordingError> {
        if self.len() == count {
            return Ok(());
        }
        Err(self.error(format!("{} fields, but the header has {count}; is the row cut?", self.len())))
    }

    fn field(&self, index: usize) -> &[u8] {
        let start = if index == 0 { 0 } else { self.ends[index - 1] };
        self.fields[start..self.ends[index]].trim_ascii()
    }

    /// An error about the current row.
    #[must_use]
    pub fn error(&self, message: String) -> RecordingError {
        RecordingError::Data { line: self.line, message }
    }

    /// The field of `column`, made into a value; `right` says what it should be.
    ///
    /// # Errors
    /// If `parse` returns `None`.
    pub fn parse<T>(
        &self,
        Column(name, index): &Column,
        right: &str,
        parse: impl Fn(&str) -> Option<T>,
    ) -> Result<T, RecordingError> {
        let field = self.field(*index);
        core::str::from_utf8(field).ok().and_then(parse).ok_or_else(|| {
            let shown: String = String::from_utf8_lossy(field).chars().take(40).collect();
            self.error(format!("{name} is {shown:?}, give {right}"))
        })
    }

    /// A whole number of 32 or 64 bits without a sign.
    ///
    /// # Errors
    /// If the field is none.
    pub fn integer<T: FromStr>(&self, column: &Column) -> Result<T, RecordingError> {
        const RIGHT: [&str; 2] =
            ["a whole number from 0 to 4294967295", "a whole number from 0 to 18446744073709551615"];
        self.parse(column, RIGHT[size_of::<T>() / 8], |text| text.parse().ok())
    }

    /// A number. NaN and infinities are telemetry too, if they are written as such; one that overflows is a slip.
    ///
    /// # Errors
    /// If the field is none.
    pub fn float(&self, column: &Column) -> Result<f64, RecordingError> {
        self.parse(column, "a number", |text| {
            text.parse().ok().filter(|value: &f64| !value.is_infinite() || !text.contains(|c: char| c.is_ascii_digit()))
        })
    }
}
