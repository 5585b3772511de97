//! The numbers of a text, with the decimal mark that it has.

use super::super::decimal::{decimal_ns, scaled};
use super::super::mapping::Decimal;
use isotherm_recording::RecordingError;
use isotherm_recording::csv::{CsvColumn, DecimalMark, Rows, Separator, digits_with, nearest_double};
use std::borrow::Cow;
use std::io::Read;

/// The decimal mark of the text.
pub(super) struct ColumnMarks {
    given: Option<Decimal>,
    found: DecimalMark,
    /// The mark that every further number must have, once it is known.
    settled: Option<u8>,
}

/// A number of a field.
#[derive(Clone, Copy)]
pub(super) struct Number {
    pub(super) value: f64,
    pub(super) is_whole: bool,
}

impl ColumnMarks {
    /// Of a text with this separator, and the decimal mark that the mapping gives.
    pub(super) fn new(separator: Separator, given: Option<Decimal>) -> Self {
        Self { given, found: DecimalMark::new(separator), settled: given.map(Decimal::byte) }
    }

    /// Refuses a text of which it is not known whether its commas are decimal marks. Valid after the last row.
    pub(super) fn check(&self) -> Result<(), RecordingError> {
        let commas = self.found.has_commas();
        commas.map(|_| ()).map_err(|(line, message)| RecordingError::Data { line, message })
    }

    /// The number of a field with a decimal point; in most texts the field itself.
    fn with_point<'a>(&mut self, line: u64, text: &'a str) -> Result<Cow<'a, str>, Cow<'static, str>> {
        let (comma, point) = (text.contains(','), text.contains('.'));
        match self.given {
            None => {
                let result = self.found.with_point(line, text).map_err(Cow::Owned)?;
                if point {
                    self.settled = Some(b'.');
                } else if comma && self.found.has_commas() == Ok(true) {
                    self.settled = Some(b',');
                }
                Ok(result)
            }
            Some(Decimal::Comma) if point => Err("a number with a decimal comma, as the mapping says".into()),
            Some(Decimal::Comma) => Ok(text.replace(',', ".").into()),
            Some(Decimal::Point) if comma => Err("a number with a decimal point, as the mapping says".into()),
            Some(Decimal::Point) => Ok(Cow::Borrowed(text)),
        }
    }

    /// The digits of a plain decimal that needs no look at the decimal mark: it has none, or the one that is known.
    #[inline]
    fn plain(&self, field: &[u8]) -> Option<(usize, u64, usize)> {
        let split = digits_with(field, self.settled.unwrap_or(b'.'))?;
        (split.2 == 0 || self.settled.is_some()).then_some(split)
    }

    /// The number of a field.
    #[inline]
    pub(super) fn number(&mut self, rows: &Rows<Box<dyn Read>>, column: &CsvColumn) -> Result<Number, RecordingError> {
        if let Some(decimal) = self.plain(rows.field(column.index()))
            && let Some(value) = nearest_double(decimal)
        {
            return Ok(Number { value, is_whole: decimal.2 == 0 });
        }
        let line = rows.line();
        rows.parse_or(column, |text| {
            // Corrupt rows show nothing of the decimal mark.
            if !text.bytes().all(|byte| byte.is_ascii_digit() || b"+-.,eE".contains(&byte)) {
                return Err(Cow::Borrowed("a number"));
            }
            let text = self.with_point(line, text)?;
            let value = text.parse::<f64>().ok().filter(|value| value.is_finite()).ok_or(Cow::Borrowed("a number"))?;
            Ok(Number { value, is_whole: !text.contains(['.', 'e', 'E']) })
        })
    }

    /// The time of a field \[ns\], exactly: never by way of a floating-point number; and whether it is a whole number.
    #[inline]
    pub(super) fn time(
        &mut self,
        rows: &Rows<Box<dyn Read>>,
        column: &CsvColumn,
        power: u32,
    ) -> Result<(u64, bool), RecordingError> {
        let line = rows.line();
        if let Some((0, mantissa, after)) = self.plain(rows.field(column.index()))
            && let Some(ns) = scaled(mantissa.into(), power as i32 - after as i32)
        {
            return Ok((ns, after == 0));
        }
        rows.parse_or(column, |text| {
            let text = self.with_point(line, text)?;
            let is_whole = !text.contains(['.', 'e', 'E']);
            let ns = decimal_ns(&text, power).ok_or(Cow::Borrowed("a time from 0 on, up to 2^64 ns"))?;
            Ok::<_, Cow<'static, str>>((ns, is_whole))
        })
    }
}
