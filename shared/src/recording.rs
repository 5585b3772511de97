//! Recordings in CSV: raw samples in, increments out. Reads and writes whatever it is given; opening files is the
//! caller's.
//!
//! Columns are found by name, in any order; others are ignored:
//! ```text
//! raw:        sequence,timestamp_ns,interval_ns,a1_positive,a1_negative,a1_head,a1_board,a2_..,a3_..   [session, telemetry_ns]
//! campaign:   set_point_c,position, then the raw columns
//! increments: sequence,timestamp_ns,interval_ns,a1_dv,a2_dv,a3_dv,table,flags                         [delivery]
//! ```

use crate::csv::{Column, Rows};
use crate::wire::{AXES, CompensatedIncrement, Flags, RawSample};
use core::fmt::Display;
use std::io::{self, Read, Write};

pub use crate::csv::RecordingError;

/// Reads raw samples one by one; an [`Iterator`] that ends at the first error.
pub struct RawReader<R> {
    rows: Rows<R>,
    columns: Columns,
    rising: Rising,
    /// Line of the row that was cut off.
    cut: Option<u64>,
    failed: bool,
}

/// The rule that holds for raw samples in any format: within a session the sequence rises.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rising(Option<(u64, u64)>);

impl Rising {
    /// Takes the next sample.
    ///
    /// # Errors
    /// With what is wrong, if it is not behind the one before.
    pub fn check(&mut self, sample: &RawSample) -> Result<(), String> {
        let previous = self.0.replace((sample.session, sample.sequence));
        match previous {
            Some((session, sequence)) if session == sample.session && sequence >= sample.sequence => {
                Err(format!("sequence {} after {sequence}; it must rise from row to row", sample.sequence))
            }
            _ => Ok(()),
        }
    }
}

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
    /// Whether `isotherm record` wrote it.
    recorded: bool,
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
        Ok(Self { rows, columns, rising: Rising::default(), cut: None, failed: false })
    }

    /// What is to be said about the end of the text, if there is something: of a recording by `isotherm record`, which ends every
    /// line, a last line without end is what a crash has cut; it is left out.
    #[must_use]
    pub fn cut(&self) -> Option<String> {
        self.cut.map(|line| format!("the recording was not ended properly: line {line} is cut and left out"))
    }

    fn read(&mut self) -> Result<Option<RawSample>, RecordingError> {
        if !self.rows.next_row()? {
            return Ok(None);
        }
        let (row, columns) = (&self.rows, &self.columns);
        // Whatever it looks like, its last number may have been longer.
        if columns.recorded && !row.is_terminated() {
            self.cut = Some(row.line());
            return Ok(None);
        }
        row.expect_len(columns.count)?;
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
        self.rising.check(&sample).map_err(|message| self.rows.error(message))?;
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
        let axis = |name: &str| [format!("a1_{name}"), format!("a2_{name}"), format!("a3_{name}")];
        let names = [axis("positive"), axis("negative"), axis("head"), axis("board")];
        let mut required = vec!["sequence", "timestamp_ns", "interval_ns"];
        required.extend(names.iter().flatten().map(String::as_str));
        let hint = "is this a comma-separated recording of raw samples with a header row?";
        let mut found = header.columns(&required, hint)?.into_iter();
        // As many come back as were asked for.
        let mut next = || found.next().unwrap_or_default();
        let mut triple = || [next(), next(), next()];
        let [sequence, timestamp_ns, interval_ns] = triple();
        let (positive, negative, head, board) = (triple(), triple(), triple(), triple());
        let (session, telemetry_ns) = (header.optional_column("session")?, header.optional_column("telemetry_ns")?);
        let (count, recorded) = (header.len(), header.optional_column("recorded_ns")?.is_some());
        Ok(Self {
            count,
            sequence,
            timestamp_ns,
            interval_ns,
            positive,
            negative,
            head,
            board,
            session,
            telemetry_ns,
            recorded,
        })
    }
}

/// One row of a campaign.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CampaignRow {
    /// Line in the file, from 1.
    pub line: u64,
    /// What the chamber was set to \[degC\]: a label that tells set points apart.
    pub set_point_c: f64,
    /// Number of the turntable's position; `None` while it moves.
    pub position: Option<u32>,
    /// What the acquisition latched.
    pub sample: RawSample,
}

/// Reads the rows of a campaign: raw samples with the columns `set_point_c` and `position`, which is empty in rows that
/// were taken while the table moved. An [`Iterator`] that ends at the first error.
pub struct CampaignReader<R> {
    samples: RawReader<R>,
    set_point: Column,
    position: Column,
}

impl<R: Read> CampaignReader<R> {
    /// Reads the header row.
    ///
    /// # Errors
    /// [`RecordingError::Data`] if a column is missing or there twice.
    pub fn new(source: R) -> Result<Self, RecordingError> {
        let samples = RawReader::new(source)?;
        let hint = "a campaign's rows are raw samples with the set point and the number of the position";
        let [set_point, position] = samples
            .rows
            .columns(&["set_point_c", "position"], hint)?
            .try_into()
            .unwrap_or_else(|_| [Column::default(), Column::default()]);
        Ok(Self { samples, set_point, position })
    }

    fn row(&self, sample: RawSample) -> Result<CampaignRow, RecordingError> {
        let rows = &self.samples.rows;
        let finite = |text: &str| text.parse().ok().filter(|value: &f64| value.is_finite());
        let number = |text: &str| if text.is_empty() { Some(None) } else { text.parse().ok().map(Some) };
        Ok(CampaignRow {
            line: rows.line(),
            set_point_c: rows.parse(&self.set_point, "the chamber's set point in degC", finite)?,
            position: rows.parse(
                &self.position,
                "the number of a position, or nothing while the table moves",
                number,
            )?,
            sample,
        })
    }
}

impl<R: Read> Iterator for CampaignReader<R> {
    type Item = Result<CampaignRow, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        let row = self.samples.next()?.and_then(|sample| self.row(sample));
        self.samples.failed |= row.is_err();
        Some(row)
    }
}

/// Writes raw samples as CSV, floats in the shortest form that reads back to the same double. Sessions are not written.
pub struct RawWriter<W> {
    sink: W,
    leading: bool,
    telemetry_ns: bool,
    row: Vec<u8>,
}

impl<W: Write> RawWriter<W> {
    /// Writes the header row: `leading` are the names of columns of the caller's own, comma-separated, which come first;
    /// empty for none. With `telemetry_ns` the time of the telemetry is the last column.
    ///
    /// # Errors
    /// As the sink gives them.
    pub fn new(mut sink: W, leading: &str, telemetry_ns: bool) -> io::Result<Self> {
        let comma = if leading.is_empty() { "" } else { "," };
        write!(sink, "{leading}{comma}sequence,timestamp_ns,interval_ns")?;
        for axis in 1..=AXES {
            write!(sink, ",a{axis}_positive,a{axis}_negative,a{axis}_head,a{axis}_board")?;
        }
        sink.write_all(if telemetry_ns { b",telemetry_ns\n" } else { b"\n" })?;
        Ok(Self { sink, leading: !leading.is_empty(), telemetry_ns, row: Vec::new() })
    }

    /// Goes on with rows below those that are there already, of which the header is one; `leading` says whether it has columns of
    /// the caller's own.
    #[must_use]
    pub const fn resume(sink: W, leading: bool, telemetry_ns: bool) -> Self {
        Self { sink, leading, telemetry_ns, row: Vec::new() }
    }

    /// Writes one row; `leading` are the values of the caller's columns, comma-separated.
    ///
    /// # Errors
    /// As the sink gives them.
    pub fn write(&mut self, leading: impl Display, raw: &RawSample) -> io::Result<()> {
        let row = &mut self.row;
        row.clear();
        if self.leading {
            write!(row, "{leading},")?;
        }
        let RawSample { sequence, timestamp_ns, interval_ns, telemetry_ns, .. } = raw;
        write!(row, "{sequence},{timestamp_ns},{interval_ns}")?;
        for axis in 0..AXES {
            let (positive, negative) = (raw.positive_pulses[axis], raw.negative_pulses[axis]);
            let (head, board) = (raw.head_temperature[axis], raw.board_temperature[axis]);
            write!(row, ",{positive},{negative},{head:?},{board:?}")?;
        }
        if self.telemetry_ns {
            write!(row, ",{telemetry_ns}")?;
        }
        row.push(b'\n');
        self.sink.write_all(row)
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
    fn a_recorders_last_line_without_end_is_left_out() {
        let row = "3.5,1,32,31,2.5,1,22,21,1.5,1,12,11,9,400,300,";
        for (extra, count) in [("extra", 2), ("recorded_ns", 1)] {
            let text = format!("{}\n{row}7\n{row}8", HEADER.replace("extra", extra));
            let mut reader = RawReader::new(text.as_bytes()).unwrap();
            let samples: Vec<_> = (&mut reader).map(Result::unwrap).collect();
            assert_eq!(samples.len(), count, "{extra}");
            assert_eq!(reader.cut().is_some_and(|cut| cut.contains("line 3 is cut")), count == 1);
        }
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
    fn raw_samples_read_back_as_they_were() {
        let first = RawSample {
            sequence: 3,
            timestamp_ns: 20,
            interval_ns: 10,
            telemetry_ns: 15,
            positive_pulses: [1, 2, u32::MAX],
            negative_pulses: [4, 5, 6],
            head_temperature: [0.1 + 0.2, -1e-7, f64::INFINITY],
            board_temperature: [1.0, 1.24155, 3e20],
            ..RawSample::default()
        };
        let second = RawSample { sequence: 4, ..first };
        for (leading, values) in [("", ""), ("set_point_c,position", "-25,1")] {
            for telemetry_ns in [false, true] {
                let mut writer = RawWriter::new(Vec::new(), leading, telemetry_ns).unwrap();
                writer.write(values, &first).and_then(|()| writer.write(values, &second)).unwrap();
                let text = String::from_utf8(writer.finish().unwrap()).unwrap();
                assert_eq!(text.starts_with("set_point_c,position,sequence,"), !leading.is_empty());
                assert_eq!(text.contains("\n-25,1,3,20,10,1,4,0.30000000000000004,1.0,2,5,"), !leading.is_empty());
                let right =
                    [first, second].map(|raw| RawSample { telemetry_ns: if telemetry_ns { 15 } else { 0 }, ..raw });
                assert_eq!(read(&text).unwrap(), right);
            }
        }
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
