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
use csv::ByteRecord;
use std::io::{self, Read, Write};

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
    reader: csv::Reader<R>,
    columns: Columns,
    record: ByteRecord,
    previous: Option<(u64, u64)>,
    failed: bool,
}

struct Columns {
    sequence: usize,
    timestamp_ns: usize,
    interval_ns: usize,
    positive: [usize; AXES],
    negative: [usize; AXES],
    head: [usize; AXES],
    board: [usize; AXES],
    session: Option<usize>,
    telemetry_ns: Option<usize>,
}

impl<R: Read> RawReader<R> {
    /// Reads the header row.
    ///
    /// # Errors
    /// [`RecordingError::Data`] if a column is missing or there twice.
    pub fn new(source: R) -> Result<Self, RecordingError> {
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(source);
        let columns = Columns::find(reader.byte_headers().map_err(error)?)?;
        Ok(Self { reader, columns, record: ByteRecord::new(), previous: None, failed: false })
    }

    /// The line of the sample that was read last, from 1.
    #[must_use]
    pub fn line(&self) -> u64 {
        self.record.position().map_or(1, csv::Position::line)
    }

    fn read(&mut self) -> Result<Option<RawSample>, RecordingError> {
        if !self.reader.read_byte_record(&mut self.record).map_err(error)? {
            return Ok(None);
        }
        let row = Row { record: &self.record, line: self.line() };
        let columns = &self.columns;
        let mut sample = RawSample {
            session: columns.session.map_or(Ok(0), |column| row.integer(column, "session"))?,
            sequence: row.integer(columns.sequence, "sequence")?,
            timestamp_ns: row.integer(columns.timestamp_ns, "timestamp_ns")?,
            interval_ns: row.integer(columns.interval_ns, "interval_ns")?,
            telemetry_ns: columns.telemetry_ns.map_or(Ok(0), |column| row.integer(column, "telemetry_ns"))?,
            ..RawSample::default()
        };
        for axis in 0..AXES {
            sample.positive_pulses[axis] = row.integer(columns.positive[axis], "positive pulses")?;
            sample.negative_pulses[axis] = row.integer(columns.negative[axis], "negative pulses")?;
            sample.head_temperature[axis] = row.float(columns.head[axis], "head telemetry")?;
            sample.board_temperature[axis] = row.float(columns.board[axis], "board telemetry")?;
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
    fn find(header: &ByteRecord) -> Result<Self, RecordingError> {
        let fail = |message| RecordingError::Data { line: 1, message };
        let optional = |name: &str| {
            let mut places = header.iter().enumerate().filter(|(index, field)| {
                let field = if *index == 0 { field.strip_prefix(b"\xef\xbb\xbf").unwrap_or(field) } else { field };
                field == name.as_bytes()
            });
            match (places.next(), places.next()) {
                (_, Some(_)) => Err(fail(format!("the column {name} is there twice"))),
                (place, None) => Ok(place.map(|(index, _)| index)),
            }
        };
        let mut missing = Vec::new();
        let mut required = |name: String| -> Result<usize, RecordingError> {
            Ok(optional(&name)?.unwrap_or_else(|| {
                missing.push(name);
                usize::MAX
            }))
        };
        let mut triple = |name: &str| -> Result<[usize; AXES], RecordingError> {
            Ok([required(format!("a1_{name}"))?, required(format!("a2_{name}"))?, required(format!("a3_{name}"))?])
        };
        let (positive, negative) = (triple("positive")?, triple("negative")?);
        let (head, board) = (triple("head")?, triple("board")?);
        let columns = Self {
            positive,
            negative,
            head,
            board,
            sequence: required("sequence".to_owned())?,
            timestamp_ns: required("timestamp_ns".to_owned())?,
            interval_ns: required("interval_ns".to_owned())?,
            session: optional("session")?,
            telemetry_ns: optional("telemetry_ns")?,
        };
        if missing.is_empty() { Ok(columns) } else { Err(fail(format!("missing columns: {}", missing.join(", ")))) }
    }
}

struct Row<'a> {
    record: &'a ByteRecord,
    line: u64,
}

impl Row<'_> {
    fn error(&self, message: String) -> RecordingError {
        RecordingError::Data { line: self.line, message }
    }

    fn field<T>(
        &self,
        column: usize,
        what: &str,
        right: &str,
        parse: impl Fn(&str) -> Option<T>,
    ) -> Result<T, RecordingError> {
        let field = self.record.get(column).unwrap_or_default();
        let value = core::str::from_utf8(field).ok().and_then(parse);
        value.ok_or_else(|| self.error(format!("{what} is {:?}, give {right}", String::from_utf8_lossy(field))))
    }

    fn integer<T: FromStr>(&self, column: usize, what: &str) -> Result<T, RecordingError> {
        let right = format!("a whole number from 0 to 2^{}-1", 8 * size_of::<T>());
        self.field(column, what, &right, |text| text.parse().ok())
    }

    /// NaN and infinities are telemetry too, if they are written as such; a number that overflows is a slip.
    fn float(&self, column: usize, what: &str) -> Result<f64, RecordingError> {
        self.field(column, what, "a number", |text| {
            text.parse().ok().filter(|value: &f64| !value.is_infinite() || !text.contains(|c: char| c.is_ascii_digit()))
        })
    }
}

fn error(error: csv::Error) -> RecordingError {
    let line = error.position().map_or(1, csv::Position::line);
    match error.into_kind() {
        csv::ErrorKind::Io(error) => RecordingError::Io(error),
        csv::ErrorKind::UnequalLengths { expected_len, len, pos } => RecordingError::Data {
            line: pos.map_or(line, |pos| pos.line()),
            message: format!("{len} fields, but the header has {expected_len}"),
        },
        other => RecordingError::Data { line, message: format!("not CSV: {other:?}") },
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
        assert!(read_rows(&[good.clone(), row("6", "-1", "1")]).starts_with("line 3: positive pulses is \"-1\""));
        assert!(read_rows(&[good.clone(), row("6", "1.5", "1")]).starts_with("line 3: positive pulses"));
        assert!(read_rows(&[good.clone(), row("6", "4294967296", "1")]).starts_with("line 3: positive pulses"));
        assert!(read_rows(&[good.clone(), row("6", "0", "warm")]).starts_with("line 3: head telemetry is \"warm\""));
        assert!(read_rows(&[good.clone(), row("6", "0", "1e999")]).starts_with("line 3: head telemetry"));
        assert!(read_rows(&[row("", "0", "1")]).starts_with("line 2: sequence is \"\""));
        assert_eq!(read_rows(&[good, "1,2\n".to_owned()]), "line 3: 2 fields, but the header has 16");
        assert_eq!(read("").unwrap_err().split(':').nth(1), Some(" missing columns"));
        assert!(read(&HEADER.replace(",a1_positive", "")).unwrap_err().ends_with("missing columns: a1_positive"));
        assert!(read(&format!("{HEADER},a1_head")).unwrap_err().contains("a1_head is there twice"));
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
