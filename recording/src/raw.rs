//! Raw samples in CSV, read and written.

use crate::columns::{self, RAW};
use crate::csv::{CsvColumn, Rows};
use crate::error::RecordingError;
use core::fmt::Display;
use isotherm_shared::sequence::rises;
use isotherm_shared::wire::{AXES, RawSample};
use std::io::{self, Read, Write};

/// Reads the raw samples of a CSV recording. An [`Iterator`] that ends at the first error.
pub struct RawCsvReader<R> {
    pub(crate) rows: Rows<R>,
    columns: RawColumns,
    sequence_rule: SequenceRule,
    recorded_ns: Option<u64>,
    /// Line of a truncated last row.
    truncated: Option<u64>,
    pub(crate) failed: bool,
}

/// Rule for the raw samples of a recording, in every format and over all its pieces: within a session the sequence
/// [`rises`], as an acquisition sends it. Keeps the session and sequence of the last sample.
#[derive(Clone, Copy, Debug, Default)]
pub struct SequenceRule(Option<(u64, u64)>);

impl SequenceRule {
    /// Checks the next sample.
    ///
    /// # Errors
    /// If its sequence is not above that of the previous sample of the session.
    pub fn check(&mut self, sample: &RawSample) -> Result<(), String> {
        let previous = self.0.replace((sample.session, sample.sequence));
        let last = previous.filter(|(session, _)| *session == sample.session).map(|(_, sequence)| sequence);
        match last {
            Some(last) if !rises(Some(last), sample.sequence) => {
                let remedy = if sample.sequence == last {
                    "remove the row that is there twice, or give both their own sequence"
                } else {
                    "put the rows in order of time; if the acquisition was started again, give its rows another session"
                };
                Err(format!("sequence {} after {last}; it must rise from row to row: {remedy}", sample.sequence))
            }
            _ => Ok(()),
        }
    }
}

/// The columns of raw samples in a CSV text.
struct RawColumns {
    count: usize,
    sequence: CsvColumn,
    timestamp_ns: CsvColumn,
    interval_ns: CsvColumn,
    /// Positive and negative pulses, head and board telemetry of each axis.
    axes: [[CsvColumn; columns::PER_AXIS]; AXES],
    session: Option<CsvColumn>,
    telemetry_ns: Option<CsvColumn>,
    /// Only in files of `isotherm record`.
    recorded_ns: Option<CsvColumn>,
}

impl<R: Read> RawCsvReader<R> {
    /// Reads the header row.
    ///
    /// # Errors
    /// [`RecordingError::Data`] if a column is missing or occurs twice.
    pub fn new(source: R) -> Result<Self, RecordingError> {
        let mut rows = Rows::new(source);
        rows.next_row()?;
        let columns = RawColumns::find(&rows)?;
        let sequence_rule = SequenceRule::default();
        Ok(Self { rows, columns, sequence_rule, recorded_ns: None, truncated: None, failed: false })
    }

    /// Sets the rule's state: that after the last sample of the previous piece of the recording.
    pub const fn set_sequence_rule(&mut self, rule: SequenceRule) {
        self.sequence_rule = rule;
    }

    /// The rule's state after the last sample.
    #[must_use]
    pub const fn sequence_rule(&self) -> SequenceRule {
        self.sequence_rule
    }

    /// When the recorder received the last sample, Unix time \[ns\]; `None` if the file has no column `recorded_ns`.
    #[must_use]
    pub const fn recorded_ns(&self) -> Option<u64> {
        self.recorded_ns
    }

    /// Line of the last sample, from 1.
    #[must_use]
    pub const fn line(&self) -> u64 {
        self.rows.line()
    }

    /// A warning if the last line was truncated. `isotherm record` ends every line, so a last line without an end was truncated
    /// by a crash and is ignored.
    #[must_use]
    pub fn truncation(&self) -> Option<String> {
        self.truncated.map(|line| format!("the recording was not ended properly: line {line} is cut and left out"))
    }

    fn read(&mut self) -> Result<Option<RawSample>, RecordingError> {
        if !self.rows.next_row()? {
            return Ok(None);
        }
        let (row, columns) = (&self.rows, &self.columns);
        // Ignored even if it looks complete: its last number may have been longer.
        if columns.recorded_ns.is_some() && !row.is_terminated() {
            self.truncated = Some(row.line());
            return Ok(None);
        }
        row.expect_len(columns.count)?;
        let optional = |column: &Option<CsvColumn>| column.as_ref().map(|column| row.integer(column)).transpose();
        let mut sample = RawSample {
            session: optional(&columns.session)?.unwrap_or(0),
            sequence: row.integer(&columns.sequence)?,
            timestamp_ns: row.integer(&columns.timestamp_ns)?,
            interval_ns: row.integer(&columns.interval_ns)?,
            telemetry_ns: optional(&columns.telemetry_ns)?.unwrap_or(0),
            ..RawSample::default()
        };
        for (axis, [positive, negative, head, board]) in columns.axes.iter().enumerate() {
            sample.positive_pulses[axis] = row.integer(positive)?;
            sample.negative_pulses[axis] = row.integer(negative)?;
            sample.head_temperature[axis] = row.float(head)?;
            sample.board_temperature[axis] = row.float(board)?;
        }
        self.recorded_ns = optional(&columns.recorded_ns)?;
        self.sequence_rule.check(&sample).map_err(|message| self.rows.error(message))?;
        Ok(Some(sample))
    }
}

impl<R: Read> Iterator for RawCsvReader<R> {
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

impl RawColumns {
    fn find<R: Read>(header: &Rows<R>) -> Result<Self, RecordingError> {
        let hint = "is this a comma-separated recording of raw samples with a header row?";
        let required = RAW.map(|column| column.name).into_iter().filter(|name| !columns::OPTIONAL.contains(name));
        let required: Vec<_> = required.collect();
        let found = header.columns(&required, hint)?;
        let column = |index: usize| {
            let position = required.iter().position(|name| *name == RAW[index].name);
            // Always found: it is called for required columns only.
            position.and_then(|position| found.get(position).cloned()).unwrap_or_default()
        };
        let axis =
            |axis: usize| core::array::from_fn(|part| column(columns::FIRST_AXIS + axis * columns::PER_AXIS + part));
        Ok(Self {
            count: header.len(),
            sequence: column(columns::SEQUENCE),
            timestamp_ns: column(columns::TIMESTAMP_NS),
            interval_ns: column(columns::INTERVAL_NS),
            axes: core::array::from_fn(axis),
            session: header.optional_column(RAW[columns::SESSION].name)?,
            telemetry_ns: header.optional_column(RAW[columns::TELEMETRY_NS].name)?,
            recorded_ns: header.optional_column(columns::RECORDED_NS)?,
        })
    }
}

/// Writes raw samples as CSV. Floats have the shortest form that reads back as the same double. Sessions are not written.
pub struct RawCsvWriter<W> {
    sink: W,
    leading: bool,
    telemetry_ns: bool,
    row: Vec<u8>,
}

impl<W: Write> RawCsvWriter<W> {
    /// Writes the header row. `leading` has the comma-separated names of the caller's own columns, which come first; it is empty
    /// if there are none. With `telemetry_ns`, the time of the telemetry is the last column.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn new(mut sink: W, leading: &str, telemetry_ns: bool) -> io::Result<Self> {
        let comma = if leading.is_empty() { "" } else { "," };
        write!(sink, "{leading}{comma}{}", RAW[columns::SEQUENCE].name)?;
        let rest =
            [&RAW[columns::TIMESTAMP_NS], &RAW[columns::INTERVAL_NS]].into_iter().chain(&RAW[columns::FIRST_AXIS..]);
        for column in rest.chain(telemetry_ns.then_some(&RAW[columns::TELEMETRY_NS])) {
            write!(sink, ",{}", column.name)?;
        }
        sink.write_all(b"\n")?;
        Ok(Self { sink, leading: !leading.is_empty(), telemetry_ns, row: Vec::new() })
    }

    /// Appends rows to a file that already has a header. `leading` says whether the file has the caller's own columns.
    #[must_use]
    pub const fn resume(sink: W, leading: bool, telemetry_ns: bool) -> Self {
        Self { sink, leading, telemetry_ns, row: Vec::new() }
    }

    /// Writes one row. `leading` has the comma-separated values of the caller's own columns.
    ///
    /// # Errors
    /// Those of the sink.
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

    /// Flushes the sink and returns it.
    ///
    /// # Errors
    /// Those of the sink.
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
        let reader = RawCsvReader::new(text.as_bytes()).map_err(|error| error.to_string())?;
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
    fn a_recorders_last_line_without_end_is_ignored() {
        let row = "3.5,1,32,31,2.5,1,22,21,1.5,1,12,11,9,400,300,";
        for (extra, count) in [("extra", 2), ("recorded_ns", 1)] {
            let text = format!("{}\n{row}7\n{row}8", HEADER.replace("extra", extra));
            let mut reader = RawCsvReader::new(text.as_bytes()).unwrap();
            let samples: Vec<_> = (&mut reader).map(Result::unwrap).collect();
            assert_eq!(samples.len(), count, "{extra}");
            assert_eq!(reader.truncation().is_some_and(|warning| warning.contains("line 3 is cut")), count == 1);
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
        let highest = u64::MAX.to_string();
        let rising = [row("18446744073709551614", "0", "1"), row(&highest, "0", "1")].concat();
        assert_eq!(read(&format!("{HEADER}\n{rising}")).unwrap()[1].sequence, u64::MAX);
        assert!(read_rows(&[row(&highest, "0", "1"), row("0", "0", "1")]).starts_with("line 3: sequence 0 after 1844"));
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
                let mut writer = RawCsvWriter::new(Vec::new(), leading, telemetry_ns).unwrap();
                writer.write(values, &first).and_then(|()| writer.write(values, &second)).unwrap();
                let text = String::from_utf8(writer.finish().unwrap()).unwrap();
                assert_eq!(text.starts_with("set_point_c,position,sequence,"), !leading.is_empty());
                assert_eq!(text.contains("\n-25,1,3,20,10,1,4,0.30000000000000004,1.0,2,5,"), !leading.is_empty());
                let expected =
                    [first, second].map(|raw| RawSample { telemetry_ns: if telemetry_ns { 15 } else { 0 }, ..raw });
                assert_eq!(read(&text).unwrap(), expected);
            }
        }
    }
}
