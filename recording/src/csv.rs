//! Rows of a comma-separated text, with line numbers for messages. Other separators are detected on request.

use crate::columns::{BINARY_FORMATS, hex};
use crate::error::RecordingError;
use core::str::FromStr;
use std::borrow::Cow;
use std::cell::RefCell;
use std::io::{BufRead, BufReader, Read};

mod checksum;
mod numbers;

pub use checksum::Checksum;
pub use numbers::{DecimalMark, Separator, looks_like_number};

/// Bytes read at a time.
const BUFFER: usize = 1 << 16;
/// The first bytes of a text in UTF-16.
const UTF_16: [&[u8]; 2] = [b"\xff\xfe", b"\xfe\xff"];
/// Longest line \[bytes\].
const MAX_LINE: u64 = 1 << 16;

thread_local! {
    /// The parsers of rows with quotation marks, in the order of [`Separator::ALL`]. They are made once, since that
    /// takes as long as to parse hundreds of rows. None is copied: csv-core's copies lack a part.
    static PARSERS: RefCell<[csv_core::Reader; Separator::ALL.len()]> = RefCell::new(
        Separator::ALL.map(|separator| csv_core::ReaderBuilder::new().delimiter(separator.byte()).build())
    );
}

/// A column: its name and its index in a row.
#[derive(Clone, Debug, Default, Eq, PartialEq)]
pub struct CsvColumn(String, usize);

impl CsvColumn {
    /// The column with this index, from 0. `name` stands for it in messages.
    #[must_use]
    pub const fn new(name: String, index: usize) -> Self {
        Self(name, index)
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0
    }

    /// Its index in a row, from 0.
    #[must_use]
    pub const fn index(&self) -> usize {
        self.1
    }
}

/// The rows of a CSV text, one per line, with their line numbers. Blank lines are skipped.
pub struct Rows<R> {
    source: BufReader<R>,
    separator: Separator,
    text: Vec<u8>,
    line: u64,
    /// The unquoted fields of a row with quotation marks, one after the other, and the end of each, as csv-core returns
    /// them.
    unquoted: Vec<u8>,
    ends: Vec<usize>,
    /// Whether the current row has quotation marks. Fields are in `unquoted` then, otherwise in `text`.
    quoted: bool,
    /// Begin and end of each field of the current row.
    fields: Vec<(usize, usize)>,
    /// Whether the checksums at the ends of lines are cut off.
    without_checksums: bool,
}

impl<R: Read> Rows<R> {
    /// Reads from `source`.
    pub fn new(source: R) -> Self {
        Self::starting_at(source, 0)
    }

    /// Reads from `source`, which begins behind so many lines of its text.
    pub fn starting_at(source: R, lines: u64) -> Self {
        Self {
            source: BufReader::with_capacity(BUFFER, source),
            separator: Separator::Comma,
            text: Vec::new(),
            line: lines,
            unquoted: Vec::new(),
            ends: Vec::new(),
            quoted: false,
            fields: Vec::new(),
            without_checksums: false,
        }
    }

    /// Takes no [`Checksum`] at the end of a line for a part of the last field, from the next row on.
    pub const fn cut_checksums(&mut self) {
        self.without_checksums = true;
    }

    /// Parses the next row; false at the end.
    ///
    /// # Errors
    /// If the source cannot be read, a quotation mark is not closed, a lone carriage return is inside a row or a line
    /// is too long. Behind the error of a row the next call goes on.
    pub fn next_row(&mut self) -> Result<bool, RecordingError> {
        // There is no current row after the last one.
        self.fields.clear();
        loop {
            // The rest of a line that is too long is on the same line.
            self.line += u64::from(self.text.len() as u64 != MAX_LINE || self.text.ends_with(b"\n"));
            self.text.clear();
            if (&mut self.source).take(MAX_LINE).read_until(b'\n', &mut self.text)? == 0 {
                return Ok(false);
            }
            if self.line == 1
                && let Some((_, format)) = BINARY_FORMATS.iter().find(|(magic, _)| self.text.starts_with(magic))
            {
                return Err(self.error(format!("a recording in {format}, not comma-separated text")));
            }
            if self.line == 1 && UTF_16.iter().any(|mark| self.text.starts_with(mark)) {
                return Err(self.error("a text in UTF-16; save it as UTF-8".to_owned()));
            }
            if self.text.len() as u64 == MAX_LINE {
                return Err(
                    self.error(format!("over {MAX_LINE} bytes without a line end; this is not a table of numbers"))
                );
            }
            if self.line == 1 && self.text.starts_with(b"\xef\xbb\xbf") {
                self.text.drain(..3);
            }
            if !self.text.trim_ascii().is_empty() {
                break;
            }
        }
        self.split().map(|()| true)
    }

    /// Skips lines without looking at them: what a program writes above the header.
    ///
    /// # Errors
    /// If the source cannot be read, or has fewer lines.
    pub fn skip_lines(&mut self, count: u64) -> Result<(), RecordingError> {
        for _ in 0..count {
            self.line += 1;
            if self.source.skip_until(b'\n')? == 0 {
                return Err(self.error(format!("the text ends here; {count} lines were to be skipped")));
            }
        }
        Ok(())
    }

    /// Finds the fields of the current line.
    fn split(&mut self) -> Result<(), RecordingError> {
        self.fields.clear();
        let content = self.text.strip_suffix(b"\n").unwrap_or(&self.text);
        let mut content = content.strip_suffix(b"\r").unwrap_or(content);
        if self.without_checksums
            && let Some(checksum) = Checksum::of(content)
        {
            content = &content[..checksum.at];
        }
        if memchr::memchr(b'\r', content).is_some() {
            return Err(
                self.error("a carriage return inside a row; save the file with LF or CR LF line ends".to_owned())
            );
        }
        self.quoted = memchr::memchr(b'"', content).is_some();
        if self.quoted {
            return self.parse_quoted();
        }
        let mut begin = 0;
        let mut field = |end: usize| {
            self.fields.push((begin, end));
            begin = end + 1;
        };
        match self.separator {
            Separator::Spaces => memchr::memchr2_iter(b' ', b'\t', content).for_each(&mut field),
            separator => memchr::memchr_iter(separator.byte(), content).for_each(&mut field),
        }
        field(content.len());
        self.drop_blanks();
        Ok(())
    }

    /// Several spaces are one separator, so there are no empty fields between them.
    fn drop_blanks(&mut self) {
        if self.separator == Separator::Spaces {
            self.fields.retain(|(begin, end)| begin < end);
        }
    }

    fn parse_quoted(&mut self) -> Result<(), RecordingError> {
        // No line needs more room than this, so one call parses it.
        self.unquoted.resize(self.text.len() + 1, 0);
        self.ends.resize(self.text.len() + 1, 0);
        if !self.text.ends_with(b"\n") {
            self.text.push(b'\n');
        }
        let index = Separator::ALL.iter().position(|separator| *separator == self.separator).unwrap_or_default();
        let (result, _, _, count) = PARSERS.with_borrow_mut(|parsers| {
            let parser = &mut parsers[index];
            parser.reset();
            parser.read_record(&self.text, &mut self.unquoted, &mut self.ends)
        });
        let mut begin = 0;
        for &end in &self.ends[..count] {
            self.fields.push((begin, end));
            begin = end;
        }
        self.drop_blanks();
        match result {
            csv_core::ReadRecordResult::Record => Ok(()),
            _ => Err(self.error("a quotation mark is not closed; a field may not span lines".to_owned())),
        }
    }

    /// Chooses the separator by the header, which must be the current row: the first with which `has_columns` is true
    /// of the names, otherwise the one that gives the most columns. Without this, commas separate.
    ///
    /// # Errors
    /// If a quotation mark is not closed.
    pub fn detect_separator(&mut self, has_columns: impl Fn(&[String]) -> bool) -> Result<Separator, RecordingError> {
        let mut most = (0, Separator::Comma);
        for separator in Separator::ALL {
            self.separate_by(separator)?;
            let names: Vec<_> = self.names().collect();
            if has_columns(&names) {
                return Ok(separator);
            }
            if names.len() > most.0 {
                most = (names.len(), separator);
            }
        }
        self.separate_by(most.1)?;
        Ok(most.1)
    }

    /// Separates the current row, if there is one, and all further ones by this.
    ///
    /// # Errors
    /// If a quotation mark is not closed.
    pub fn separate_by(&mut self, separator: Separator) -> Result<(), RecordingError> {
        self.separator = separator;
        if self.text.is_empty() { Ok(()) } else { self.split() }
    }

    /// Whether the current row has `count` fields, or one more that is empty: a separator at its end.
    #[inline]
    #[must_use]
    pub fn fits(&self, count: usize) -> bool {
        self.len() == count || self.len() == count + 1 && self.field(count).is_empty()
    }

    /// Number of fields of the current row.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.fields.len()
    }

    /// Whether there is no current row.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.fields.is_empty()
    }

    /// Line of the current row, from 1.
    #[must_use]
    pub const fn line(&self) -> u64 {
        self.line
    }

    /// Finds the columns `names` in the header, which must be the current row. `hint` ends the message about missing
    /// columns.
    ///
    /// # Errors
    /// If columns are missing, with the names of those and of all columns that were found, or if a column occurs twice.
    pub fn columns(&self, names: &[&str], hint: &str) -> Result<Vec<CsvColumn>, RecordingError> {
        let found = names.iter().map(|name| self.optional_column(name)).collect::<Result<Vec<_>, _>>()?;
        let missing: Vec<_> = names.iter().zip(&found).filter(|(_, c)| c.is_none()).map(|(name, _)| *name).collect();
        if missing.is_empty() {
            Ok(found.into_iter().flatten().collect())
        } else {
            Err(self.error(missing_columns(&missing, self.names(), hint)))
        }
    }

    /// The names of the columns of the header, which must be the current row.
    pub fn names(&self) -> impl Iterator<Item = String> {
        (0..self.len()).map(|index| String::from_utf8_lossy(self.field(index)).into_owned())
    }

    /// Finds a column in the header, which must be the current row.
    ///
    /// # Errors
    /// If it occurs twice.
    pub fn optional_column(&self, name: &str) -> Result<Option<CsvColumn>, RecordingError> {
        let mut indices = (0..self.len()).filter(|&index| self.field(index) == name.as_bytes());
        match (indices.next(), indices.next()) {
            (_, Some(_)) => Err(self.error(format!("the column {name} is there twice"))),
            (index, None) => Ok(index.map(|index| CsvColumn(name.to_owned(), index))),
        }
    }

    /// Checks that the current row has `count` fields.
    ///
    /// # Errors
    /// If it has another number.
    pub fn verify(&self, count: usize) -> Result<(), RecordingError> {
        if self.len() == count {
            return Ok(());
        }
        Err(self.error(format!("{} fields, but the header has {count}; is the row cut?", self.len())))
    }

    /// The current line, as it is in the text.
    #[must_use]
    pub fn line_text(&self) -> &[u8] {
        &self.text
    }

    /// A field of the current row, without outer blanks and quotation marks.
    ///
    /// # Panics
    /// If the row has no field with this index.
    #[must_use]
    pub fn field(&self, index: usize) -> &[u8] {
        let (begin, end) = self.fields[index];
        let row = if self.quoted { &self.unquoted } else { &self.text };
        row[begin..end].trim_ascii()
    }

    /// Whether the current line has a line end. Only the last line of a text can lack it.
    #[must_use]
    pub fn is_terminated(&self) -> bool {
        self.text.ends_with(b"\n")
    }

    /// An error about the current row.
    #[must_use]
    pub fn error(&self, message: String) -> RecordingError {
        RecordingError::Data { line: self.line, message }
    }

    /// Parses the field of `column`. `expected` describes a valid value in the message.
    ///
    /// # Errors
    /// If `parse` returns `None`.
    pub fn parse<T>(
        &self,
        column: &CsvColumn,
        expected: &str,
        parse: impl Fn(&str) -> Option<T>,
    ) -> Result<T, RecordingError> {
        self.parse_or(column, |text| parse(text).ok_or(Cow::Borrowed(expected)))
    }

    /// Parses the field of `column`. An error of `parse` describes a valid value.
    ///
    /// # Errors
    /// If `parse` returns an error, or the field is not UTF-8.
    pub fn parse_or<'r, T>(
        &self,
        CsvColumn(name, index): &CsvColumn,
        parse: impl FnOnce(&str) -> Result<T, Cow<'r, str>>,
    ) -> Result<T, RecordingError> {
        let field = self.field(*index);
        core::str::from_utf8(field).map_err(|_| Cow::Borrowed("text in UTF-8")).and_then(parse).map_err(|expected| {
            let shown: String = String::from_utf8_lossy(field).chars().take(40).collect();
            self.error(format!("{name} is {shown:?}, give {expected}"))
        })
    }

    /// Parses an unsigned integer of 32 or 64 bits.
    ///
    /// # Errors
    /// If the field is not one.
    pub fn integer<T: FromStr + TryFrom<u64>>(&self, column: &CsvColumn) -> Result<T, RecordingError> {
        const EXPECTED: [&str; 2] =
            ["a whole number from 0 to 4294967295", "a whole number from 0 to 18446744073709551615"];
        if let Some((0, mantissa, 0)) = digits(self.field(column.1))
            && let Ok(value) = T::try_from(mantissa)
        {
            return Ok(value);
        }
        self.parse(column, EXPECTED[size_of::<T>() / 8], |text| text.parse().ok())
    }

    /// Parses a number in 16 hexadecimal digits; an empty field is 0.
    ///
    /// # Errors
    /// If the field is neither.
    pub fn hex(&self, column: &CsvColumn) -> Result<u64, RecordingError> {
        self.parse(column, "16 hexadecimal digits", |text| hex(text.as_bytes()))
    }

    /// Parses a number. Temperature may be NaN or infinite if the text says so; a decimal number that overflows is an
    /// error.
    ///
    /// # Errors
    /// If the field is not a number.
    pub fn float(&self, column: &CsvColumn) -> Result<f64, RecordingError> {
        if let Some(value) = decimal(self.field(column.1)) {
            return Ok(value);
        }
        self.parse(column, "a number", |text| {
            text.parse().ok().filter(|value: &f64| !value.is_infinite() || !text.contains(|c: char| c.is_ascii_digit()))
        })
    }
}

/// The message about columns that a file lacks: those `missing`, those `found`, and `hint`. A file of increments where
/// raw samples are wanted is recognised.
pub fn missing_columns(missing: &[&str], found: impl IntoIterator<Item = String>, hint: &str) -> String {
    let found: Vec<_> = found.into_iter().collect();
    let is_increments = found.iter().any(|name| name == "a1_dv") && missing.contains(&"a1_positive");
    let hint = if is_increments { "these are increments; give the file of the raw samples" } else { hint };
    let separator = if hint.is_empty() { "" } else { "; " };
    format!("missing columns: {}; found: {}{separator}{hint}", missing.join(", "), list_columns(found))
}

/// Lists names of columns for a message: a limited number, each shortened if it is long, control characters escaped.
fn list_columns(names: impl IntoIterator<Item = String>) -> String {
    const MAX_NAMES: usize = 40;
    const MAX_LENGTH: usize = 40;
    let mut names: Vec<_> = names.into_iter().collect();
    let more = names.len().saturating_sub(MAX_NAMES);
    names.truncate(MAX_NAMES);
    let shown = names.iter().map(|name| {
        let cut: String = name.chars().take(MAX_LENGTH).collect();
        let dots = if cut.len() < name.len() { ".." } else { "" };
        format!("{}{dots}", cut.escape_debug())
    });
    let shown: Vec<_> = shown.collect();
    match (shown.is_empty() || shown == [""], more) {
        (true, _) => "none".to_owned(),
        (false, 0) => shown.join(", "),
        (false, more) => format!("{} and {more} more", shown.join(", ")),
    }
}

/// Splits a plain decimal with a point, as [`digits_with`].
#[inline]
fn digits(field: &[u8]) -> Option<(usize, u64, usize)> {
    digits_with(field, b'.')
}

/// Splits a plain decimal (at most one minus sign, at most one decimal mark, up to 18 digits): 1 if it is negative,
/// otherwise 0; its digits as one integer; the number of digits after the mark. `None` for any other field, which the
/// standard library then parses.
#[inline]
#[must_use]
pub fn digits_with(field: &[u8], mark: u8) -> Option<(usize, u64, usize)> {
    let (negative, unsigned) = match field.split_first() {
        Some((b'-', rest)) => (1, rest),
        _ => (0, field),
    };
    let (mut mantissa, mut count, mut point) = (0_u64, 0, None);
    for (index, byte) in unsigned.iter().enumerate() {
        match byte {
            b'0'..=b'9' => {
                mantissa = mantissa.wrapping_mul(10).wrapping_add(u64::from(byte - b'0'));
                count += 1;
            }
            byte if *byte == mark && point.is_none() => point = Some(index + 1),
            _ => return None,
        }
    }
    // A field that ends with the mark is left to the standard library. 18 digits cannot overflow.
    let after = point.map_or(0, |point| unsigned.len() - point);
    ((1..=18).contains(&count) && (point.is_none() || after > 0)).then_some((negative, mantissa, after))
}

/// Powers of ten that are exact doubles.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20,
    1e21, 1e22,
];

/// Parses a decimal whose digits and power of ten are exact doubles. One division then rounds only once, to the nearest
/// double (Clinger, 1990).
#[inline]
fn decimal(field: &[u8]) -> Option<f64> {
    digits(field).and_then(nearest_double)
}

/// The nearest double of a decimal that [`digits_with`] has split; `None` if it has too many digits for one division.
#[inline]
#[must_use]
pub fn nearest_double((negative, mantissa, after): (usize, u64, usize)) -> Option<f64> {
    let size = (mantissa <= 1 << 53).then(|| mantissa as f64 / POWERS[after])?;
    Some(if negative == 1 { -size } else { size })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::io;

    fn row(text: &str) -> Rows<&[u8]> {
        let mut rows = Rows::new(text.as_bytes());
        assert!(rows.next_row().unwrap());
        rows
    }

    #[test]
    fn other_fields_than_plain_decimals_are_left_to_the_standard_library() {
        for text in ["", "-", ".", "1.", "1e3", "+1", "--1", "1.2.3", "1,2", "nan", "inf", "0x1", "1234567890123456789"]
        {
            assert_eq!(digits(text.as_bytes()), None, "{text}");
        }
        assert_eq!(digits(b"-0.50"), Some((1, 50, 2)));
        assert_eq!(decimal(b"-0").map(f64::to_bits), Some((-0.0_f64).to_bits()));
        // Too many digits for one division.
        assert_eq!(decimal(b"9007199254740993"), None);
    }

    #[test]
    fn a_quotation_mark_that_is_not_closed_does_not_reach_into_another_text() {
        for separator in Separator::ALL {
            let mark = char::from(separator.byte());
            let mut open = Rows::new(&b"\"a"[..]);
            assert!(open.next_row().is_err());
            assert!(open.separate_by(separator).is_err());
            let text = format!("\"a{mark}b\"{mark}\"c\"\n");
            let mut rows = row(&text);
            rows.separate_by(separator).unwrap();
            assert_eq!(rows.names().collect::<Vec<_>>(), [&format!("a{mark}b"), "c"], "{separator:?}");
        }
    }

    #[test]
    fn integers_of_each_width_keep_their_limits() {
        let column = |index| CsvColumn(String::from("n"), index);
        let rows = row("4294967295,4294967296,18446744073709551615,18446744073709551616,-1,1.0,+7, 8 \n");
        assert_eq!(rows.integer::<u32>(&column(0)).unwrap(), u32::MAX);
        assert_eq!(rows.integer::<u64>(&column(2)).unwrap(), u64::MAX);
        assert_eq!((rows.integer::<u32>(&column(6)).unwrap(), rows.integer::<u64>(&column(7)).unwrap()), (7, 8));
        for wrong in [1, 4, 5] {
            assert!(rows.integer::<u32>(&column(wrong)).is_err(), "{wrong}");
        }
        assert!(rows.integer::<u64>(&column(3)).is_err());
    }

    #[test]
    fn the_separator_is_the_one_with_which_the_columns_are_found() {
        for (header, separator, names) in [
            ("u,a b;c,y\n", Separator::Comma, vec!["u", "a b;c", "y"]),
            ("u;a,b;y\n", Separator::Semicolon, vec!["u", "a,b", "y"]),
            ("u\ta b\ty\r\n", Separator::Tab, vec!["u", "a b", "y"]),
            ("  u \t a   y \n", Separator::Spaces, vec!["u", "a", "y"]),
            ("\"u\" \"a\"  \"y\"", Separator::Spaces, vec!["u", "a", "y"]),
            ("\"u\";\"a;b\";\"y\"\n", Separator::Semicolon, vec!["u", "a;b", "y"]),
            // Without y, as many columns as possible.
            ("u;v;w x\n", Separator::Semicolon, vec!["u", "v", "w x"]),
            ("z\n", Separator::Comma, vec!["z"]),
        ] {
            let mut rows = row(header);
            let has = |names: &[String]| ["u", "y"].iter().all(|name| names.iter().any(|other| other == name));
            assert_eq!(rows.detect_separator(has).unwrap(), separator, "{header:?}");
            assert_eq!(rows.names().collect::<Vec<_>>(), names);
        }
        let mut rows = Rows::new(&b"u\ty\n\t2\n 1 \t\n"[..]);
        assert!(rows.next_row().unwrap());
        rows.detect_separator(|names| names == ["u", "y"]).unwrap();
        for fields in [["", "2"], ["1", ""]] {
            assert!(rows.next_row().unwrap());
            assert_eq!(rows.names().collect::<Vec<_>>(), fields, "an empty field between tabs is a field");
        }
        let wide = Rows::new(&b"\xff\xfeu\0\n\0"[..]).next_row().unwrap_err().to_string();
        assert_eq!(wide, "line 1: a text in UTF-16; save it as UTF-8");
    }

    #[test]
    fn a_line_without_end_is_refused() {
        let mut rows = Rows::new(io::repeat(b'1'));
        assert!(rows.next_row().unwrap_err().to_string().starts_with("line 1: over 65536 bytes without a line end"));
    }

    proptest! {
        /// Every decimal gives the same bits as the standard library's parser.
        #[test]
        fn decimals_are_the_nearest_doubles(text in "-?[0-9]{0,12}(\\.[0-9]{0,12})?") {
            let expected = text.parse::<f64>().ok();
            if let Some(value) = decimal(text.as_bytes()) {
                prop_assert_eq!(Some(value.to_bits()), expected.map(f64::to_bits), "{}", text);
            }
            let line = format!("{text},\n");
            let rows = row(&line);
            let read = rows.float(&CsvColumn(String::from("x"), 0)).ok();
            prop_assert_eq!(read.map(f64::to_bits), expected.map(f64::to_bits), "{}", text);
        }

        /// Rows with quotation marks are parsed by other code, with the same result.
        #[test]
        fn quoted_rows_are_the_same_rows(fields in prop::collection::vec("[a-z0-9 .]{0,8}", 2..6)) {
            let line = fields.join(",") + "\n";
            let quoted = fields.iter().map(|f| format!("\"{f}\"")).collect::<Vec<_>>().join(",") + "\n";
            let (plain, quoted) = (row(&line), row(&quoted));
            prop_assert_eq!(plain.len(), quoted.len());
            for index in 0..fields.len() {
                prop_assert_eq!(plain.field(index), quoted.field(index));
            }
        }
    }
}
