//! Recordings in CSV: raw samples in, increments out. Reads and writes whatever it is given; opening files is the
//! caller's.
//!
//! Columns are found by name, in any order; others are ignored:
//! ```text
//! raw:        sequence,timestamp_ns,interval_ns,a1_positive,a1_negative,a1_head,a1_board,a2_..,a3_..   [session, telemetry_ns]
//! increments: sequence,timestamp_ns,interval_ns,a1_dv,a2_dv,a3_dv,table,flags                         [delivery]
//! ```

use crate::wire::{AXES, CompensatedIncrement, Flags, RawSample};
use core::str::FromStr;
use std::io::{self, BufRead, BufReader, Read, Write};

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

/// Reads raw samples one by one; an [`Iterator`] that ends at the first error.
pub struct RawReader<R> {
    rows: Rows<R>,
    columns: Columns,
    previous: Option<(u64, u64)>,
    failed: bool,
}

/// A column of the recording: its name and its place in a row.
type Column = (String, usize);

struct Columns {
    count: usize,
    sequence: Column,
    timestamp_ns: Column,
    interval_ns: Column,
    positive: [Column; AXES],
    negative: [Column; AXES],
    head: [Column; AXES],
    board: [Column; AXES],
    session: Option<Column>,
    telemetry_ns: Option<Column>,
}

impl<R: Read> RawReader<R> {
    /// Reads the header row.
    ///
    /// # Errors
    /// [`RecordingError::Data`] if a column is missing or there twice.
    pub fn new(source: R) -> Result<Self, RecordingError> {
        let mut rows = Rows::new(source);
        rows.next_row()?;
        let columns = Columns::find(&rows)?;
        Ok(Self { rows, columns, previous: None, failed: false })
    }

    fn read(&mut self) -> Result<Option<RawSample>, RecordingError> {
        if !self.rows.next_row()? {
            return Ok(None);
        }
        let (row, columns) = (&self.rows, &self.columns);
        if row.len() != columns.count {
            return Err(row.error(format!(
                "{} fields, but the header has {}; is the row cut?",
                row.len(),
                columns.count
            )));
        }
        let optional = |column: &Option<Column>| column.as_ref().map_or(Ok(0), |column| row.integer(column));
        let mut sample = RawSample {
            session: optional(&columns.session)?,
            sequence: row.integer(&columns.sequence)?,
            timestamp_ns: row.integer(&columns.timestamp_ns)?,
            interval_ns: row.integer(&columns.interval_ns)?,
            telemetry_ns: optional(&columns.telemetry_ns)?,
            ..RawSample::default()
        };
        for axis in 0..AXES {
            sample.positive_pulses[axis] = row.integer(&columns.positive[axis])?;
            sample.negative_pulses[axis] = row.integer(&columns.negative[axis])?;
            sample.head_temperature[axis] = row.float(&columns.head[axis])?;
            sample.board_temperature[axis] = row.float(&columns.board[axis])?;
        }
        if let Some((session, sequence)) = self.previous
            && session == sample.session
            && sequence >= sample.sequence
        {
            return Err(
                row.error(format!("sequence {} after {sequence}; it must rise from row to row", sample.sequence))
            );
        }
        self.previous = Some((sample.session, sample.sequence));
        Ok(Some(sample))
    }
}

impl<R: Read> Iterator for RawReader<R> {
    type Item = Result<RawSample, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let item = self.read().transpose();
        self.failed = matches!(item, Some(Err(_)));
        item
    }
}

impl Columns {
    fn find<R: Read>(header: &Rows<R>) -> Result<Self, RecordingError> {
        let names: Vec<_> = (0..header.len()).map(|index| header.field(index)).collect();
        let optional = |name: String| {
            let mut places = (0..names.len()).filter(|&index| names[index] == name.as_bytes());
            match (places.next(), places.next()) {
                (_, Some(_)) => Err(header.error(format!("the column {name} is there twice"))),
                (place, None) => Ok(place.map(|place| (name, place))),
            }
        };
        let mut missing = Vec::new();
        let mut required = |name: &str| -> Result<Column, RecordingError> {
            Ok(optional(name.to_owned())?.unwrap_or_else(|| {
                missing.push(name.to_owned());
                Column::default()
            }))
        };
        let (sequence, timestamp_ns) = (required("sequence")?, required("timestamp_ns")?);
        let interval_ns = required("interval_ns")?;
        let mut triple = |name: &str| -> Result<[Column; AXES], RecordingError> {
            Ok([required(&format!("a1_{name}"))?, required(&format!("a2_{name}"))?, required(&format!("a3_{name}"))?])
        };
        let (positive, negative) = (triple("positive")?, triple("negative")?);
        let (head, board) = (triple("head")?, triple("board")?);
        let (session, telemetry_ns) = (optional("session".to_owned())?, optional("telemetry_ns".to_owned())?);
        if !missing.is_empty() {
            let hint = "is this a comma-separated recording of raw samples with a header row?";
            return Err(header.error(format!("missing columns: {}; {hint}", missing.join(", "))));
        }
        let count = names.len();
        Ok(Self { count, sequence, timestamp_ns, interval_ns, positive, negative, head, board, session, telemetry_ns })
    }
}

/// The rows of a CSV text, one a line, blank lines left out, with the number of their line.
struct Rows<R> {
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
    fn new(source: R) -> Self {
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
    fn next_row(&mut self) -> Result<bool, RecordingError> {
        self.count = 0;
        loop {
            self.text.clear();
            self.line += 1;
            if self.source.read_until(b'\n', &mut self.text)? == 0 {
                return Ok(false);
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

    const fn len(&self) -> usize {
        self.count
    }

    fn field(&self, index: usize) -> &[u8] {
        let start = if index == 0 { 0 } else { self.ends[index - 1] };
        self.fields[start..self.ends[index]].trim_ascii()
    }

    fn error(&self, message: String) -> RecordingError {
        RecordingError::Data { line: self.line, message }
    }

    fn parse<T>(
        &self,
        (name, index): &Column,
        right: &str,
        parse: impl Fn(&str) -> Option<T>,
    ) -> Result<T, RecordingError> {
        let field = self.field(*index);
        core::str::from_utf8(field).ok().and_then(parse).ok_or_else(|| {
            let shown: String = String::from_utf8_lossy(field).chars().take(40).collect();
            self.error(format!("{name} is {shown:?}, give {right}"))
        })
    }

    fn integer<T: FromStr>(&self, column: &Column) -> Result<T, RecordingError> {
        const RIGHT: [&str; 2] =
            ["a whole number from 0 to 4294967295", "a whole number from 0 to 18446744073709551615"];
        self.parse(column, RIGHT[size_of::<T>() / 8], |text| text.parse().ok())
    }

    /// NaN and infinities are telemetry too, if they are written as such; a number that overflows is a slip.
    fn float(&self, column: &Column) -> Result<f64, RecordingError> {
        self.parse(column, "a number", |text| {
            text.parse().ok().filter(|value: &f64| !value.is_infinite() || !text.contains(|c: char| c.is_ascii_digit()))
        })
    }
}

/// Writes increments as CSV, floats in the shortest form that reads back to the same double.
pub struct IncrementWriter<W> {
    sink: W,
    delivery: bool,
}

impl<W: Write> IncrementWriter<W> {
    /// Writes the header row, with a column for the delivery flags if asked.
    ///
    /// # Errors
    /// As the sink gives them.
    pub fn new(mut sink: W, delivery: bool) -> io::Result<Self> {
        let last = if delivery { ",delivery" } else { "" };
        writeln!(sink, "sequence,timestamp_ns,interval_ns,a1_dv,a2_dv,a3_dv,table,flags{last}")?;
        Ok(Self { sink, delivery })
    }

    /// Writes one row.
    ///
    /// # Errors
    /// As the sink gives them.
    pub fn write(&mut self, increment: &CompensatedIncrement) -> io::Result<()> {
        let CompensatedIncrement { sequence, timestamp_ns, interval_ns, table, .. } = increment;
        let [a1, a2, a3] = increment.velocity_increment;
        let flags = Flags(increment.flags);
        let sample = flags.only(Flags::SAMPLE);
        write!(self.sink, "{sequence},{timestamp_ns},{interval_ns},{a1:?},{a2:?},{a3:?},{table:016x},{sample}")?;
        if self.delivery {
            write!(self.sink, ",{}", flags.only(Flags::DELIVERY))?;
        }
        self.sink.write_all(b"\n")
    }

    /// Hands on what has been written so far.
    ///
    /// # Errors
    /// As the sink gives them.
    pub fn flush(&mut self) -> io::Result<()> {
        self.sink.flush()
    }

    /// The sink, flushed.
    ///
    /// # Errors
    /// As the sink gives them.
    pub fn finish(mut self) -> io::Result<W> {
        self.sink.flush()?;
        Ok(self.sink)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "a3_board,a3_head,a3_negative,a3_positive,a2_board,a2_head,a2_negative,a2_positive,a1_board,a1_head,a1_negative,a1_positive,extra,interval_ns,timestamp_ns,sequence";

    fn read(text: &str) -> Result<Vec<RawSample>, String> {
        let reader = RawReader::new(text.as_bytes()).map_err(|error| error.to_string())?;
        reader.collect::<Result<_, _>>().map_err(|error| error.to_string())
    }

    #[test]
    fn columns_are_found_by_name() {
        let text = format!("\u{feff}{HEADER}\n3.5,NaN,32,31,2.5,-inf,22,21,1.5,1e-3,12,11,ignored,400,300,7\n");
        let samples = read(&text).unwrap();
        assert_eq!(samples.len(), 1);
        assert_eq!((samples[0].sequence, samples[0].timestamp_ns, samples[0].interval_ns), (7, 300, 400));
        assert_eq!((samples[0].positive_pulses, samples[0].negative_pulses), ([11, 21, 31], [12, 22, 32]));
        assert_eq!(samples[0].board_temperature, [1.5, 2.5, 3.5]);
        assert_eq!(samples[0].head_temperature[..2], [1e-3, f64::NEG_INFINITY]);
        assert!(samples[0].head_temperature[2].is_nan());
        assert_eq!((samples[0].session, samples[0].telemetry_ns), (0, 0));
    }

    #[test]
    fn errors_name_the_line() {
        let row = |sequence: &str, pulses: &str, head: &str| {
            format!("1,1,0,0,1,1,0,0,1,{head},0,{pulses},x,1,1,{sequence}\n")
        };
        let good = row("5", "0", "1");
        let read_rows = |rows: &[String]| read(&format!("{HEADER}\n{}", rows.concat())).unwrap_err();
        assert!(read_rows(&[good.clone(), good.clone()]).starts_with("line 3: sequence 5 after 5"));
        assert!(read_rows(&[good.clone(), row("4", "0", "1")]).starts_with("line 3: sequence 4 after 5"));
        assert!(read_rows(&[good.clone(), row("6", "-1", "1")]).starts_with("line 3: a1_positive is \"-1\""));
        assert!(read_rows(&[good.clone(), row("6", "1.5", "1")]).starts_with("line 3: a1_positive"));
        assert!(read_rows(&[good.clone(), row("6", "4294967296", "1")]).starts_with("line 3: a1_positive"));
        assert!(read_rows(&[good.clone(), row("6", "0", "warm")]).starts_with("line 3: a1_head is \"warm\""));
        assert!(read_rows(&[good.clone(), row("6", "0", "1e999")]).starts_with("line 3: a1_head"));
        assert!(read_rows(&[row("", "0", "1")]).starts_with("line 2: sequence is \"\""));
        assert!(read_rows(&[good.clone(), "1,2\n".to_owned()]).starts_with("line 3: 2 fields, but the header has 16"));
        assert!(read_rows(&[good.clone(), "\n\n  \n".to_owned(), good.clone()]).starts_with("line 6: sequence 5"));
        assert!(read_rows(&[good.clone(), "\"1".to_owned()]).starts_with("line 3: a quotation mark"));
        let windows = format!("{HEADER}\n{good}{good}").replace('\n', "\r\n");
        assert!(read(&windows).unwrap_err().starts_with("line 3: sequence 5 after 5"));
        let old_mac = format!("{HEADER}\n{}", [good.clone(), good.clone()].concat().replacen('\n', "\r", 1));
        assert!(read(&old_mac).unwrap_err().starts_with("line 2: a carriage return"));
        assert!(read("").unwrap_err().starts_with("line 1: missing columns: sequence, "));
        assert!(read(&HEADER.replace(",a1_positive", "")).unwrap_err().contains("missing columns: a1_positive;"));
        assert!(read(&format!("{HEADER},a1_head")).unwrap_err().contains("a1_head is there twice"));
    }

    #[test]
    fn quoted_fields_windows_lines_and_a_missing_last_line_end_are_read() {
        let quoted = HEADER.split(',').map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(",");
        let text =
            format!("{quoted}\r\n1,1,0,0,1,1,0,0,1,1,0,7, x ,1,1, 3 \r\n\r\n1,1,0,0,1,1,0,0,1,1,0,8,x,1,1,\"4\"");
        let samples = read(&text).unwrap();
        assert_eq!(samples.iter().map(|s| (s.sequence, s.positive_pulses[0])).collect::<Vec<_>>(), [(3, 7), (4, 8)]);
    }

    #[test]
    fn increments_are_written_in_their_shortest_form() {
        let mut writer = IncrementWriter::new(Vec::new(), true).unwrap();
        let increment = CompensatedIncrement {
            sequence: 1,
            timestamp_ns: 2,
            interval_ns: 3,
            velocity_increment: [0.1 + 0.2, f64::NAN, -1e-7],
            table: 0xabc,
            flags: (Flags::not_finite(1) | Flags::GAP).0,
            ..CompensatedIncrement::default()
        };
        writer.write(&increment).unwrap();
        assert_eq!(
            String::from_utf8(writer.finish().unwrap()).unwrap(),
            "sequence,timestamp_ns,interval_ns,a1_dv,a2_dv,a3_dv,table,flags,delivery\n\
             1,2,3,0.30000000000000004,NaN,-1e-7,0000000000000abc,a2-not-finite,gap\n"
        );
    }
}
