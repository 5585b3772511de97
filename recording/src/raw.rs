//! Raw samples in CSV, read and written.

use crate::columns::{
    ACCELEROMETERS, ColumnKind, ColumnSet, DEVICE, GYROSCOPES, INCOMPLETE_HINT, INTERVAL_NS, LAG_NS, Layout, RAW,
    RECORDED_NS, SENT_NS, SEQUENCE, SESSION, TELEMETRY_NS, TIMESTAMP_NS, UNIX_OFFSET, incomplete, load, store,
};
use crate::csv::{CsvColumn, Rows, missing_columns};
use crate::damage::{DamagedPlaces, RowsBefore};
use crate::error::RecordingError;
use crate::pieces::SequenceRule;
use crate::rows::append_value;
use core::fmt::Display;
use isotherm_shared::wire::RawSample;
use isotherm_support::finding::Finding;
use std::io::{self, Read, Write};

/// Reads the raw samples of a CSV recording. An [`Iterator`] that ends at the first error. A row that cannot be read is
/// left out, and [`damage`](Self::damage) counts it; it is an error if no row can be read.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_recording::RawCsvReader;
///
/// let text: &[u8] = include_bytes!("../../tests/data/run.csv");
/// let header = text.split_inclusive(|byte| *byte == b'\n').next().ok_or("no header")?;
/// let bad = [header, b"0,1000,1000,4,0,1.1,1.2,0,204,many,1.2,234,0,1.1,1.2\n"].concat();
/// let error = RawCsvReader::new(&bad[..])?.next().and_then(Result::err).ok_or("temperature is a number")?;
/// let message = error.to_string(); // with line and column
/// assert!(message.contains('2') && message.contains("a2_head"), "{message}");
/// # Ok(())
/// # }
/// ```
pub struct RawCsvReader<R> {
    pub(crate) rows: Rows<R>,
    columns: RawColumns,
    sequence_rule: SequenceRule,
    recorded_ns: Option<u64>,
    /// Line of a truncated last row.
    truncated: Option<u64>,
    before: RowsBefore,
    /// The rows before the last one.
    before_last: RowsBefore,
    damaged: DamagedPlaces,
    /// The error of the first row, while none is whole.
    unread: Option<RecordingError>,
    pub(crate) failed: bool,
}

/// The columns of raw samples in a CSV text.
struct RawColumns {
    count: usize,
    /// The columns that are stored in a sample: index in [`RAW`], and the column.
    stored: Vec<(usize, CsvColumn)>,
    /// Only in files of `isotherm record`.
    recorded_ns: Option<CsvColumn>,
    has_lag: bool,
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
        Ok(Self {
            rows,
            columns,
            sequence_rule,
            recorded_ns: None,
            truncated: None,
            before: RowsBefore::default(),
            before_last: RowsBefore::default(),
            damaged: DamagedPlaces::default(),
            unread: None,
            failed: false,
        })
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

    /// Whether the recording has lagged temperature.
    #[must_use]
    pub const fn has_lag(&self) -> bool {
        self.columns.has_lag
    }

    /// A warning if the last line was truncated. `isotherm record` ends every line, so a last line without an end was
    /// truncated by a crash and is ignored.
    #[must_use]
    pub fn truncation(&self) -> Option<String> {
        self.truncated.map(|line| format!("the recording was not ended properly: line {line} is cut and left out"))
    }

    /// The rows that are damaged and left out so far.
    #[must_use]
    pub fn damage(&self) -> Option<Finding> {
        self.damaged.finding(self.before)
    }

    /// Leaves out the row of the last sample, for this error in its other columns.
    pub(crate) fn leave_out_last(&mut self, error: RecordingError) -> Result<(), RecordingError> {
        self.before = self.before_last;
        self.leave_out(error)
    }

    /// Leaves out the current row, for this error.
    fn leave_out(&mut self, error: RecordingError) -> Result<(), RecordingError> {
        let RecordingError::Data { line, message } = &error else { return Err(error) };
        self.damaged.take(format!("line {line}"), self.before, message.clone());
        if self.before.is_empty() {
            self.unread.get_or_insert(error);
        }
        Ok(())
    }

    fn read(&mut self) -> Result<Option<RawSample>, RecordingError> {
        loop {
            match self.row() {
                Ok(Some(mut sample)) => {
                    self.sequence_rule.take(&mut sample).map_err(|message| self.rows.error(message))?;
                    self.before_last = self.before;
                    self.before.take(sample.timestamp_ns);
                    return Ok(Some(sample));
                }
                Ok(None) => return self.unread.take().filter(|_| self.before.is_empty()).map_or(Ok(None), Err),
                Err(error) => self.leave_out(error)?,
            }
        }
    }

    /// The next row, before its sequence is judged.
    fn row(&mut self) -> Result<Option<RawSample>, RecordingError> {
        if !self.rows.next_row()? {
            return Ok(None);
        }
        let (row, columns) = (&self.rows, &self.columns);
        // It is ignored even if it looks complete: its last number may have been longer.
        if columns.recorded_ns.is_some() && !row.is_terminated() {
            self.truncated = Some(row.line());
            return Ok(None);
        }
        row.verify(columns.count)?;
        let mut sample = RawSample::default();
        for (index, column) in &columns.stored {
            let value = match RAW[*index].kind {
                ColumnKind::U64 => row.integer(column)?,
                ColumnKind::U32 => row.integer::<u32>(column)?.into(),
                ColumnKind::F64 => row.float(column)?.to_bits(),
                ColumnKind::Hex | ColumnKind::Flags => row.hex(column)?,
            };
            store(&mut sample, *index, value);
        }
        self.recorded_ns = columns.recorded_ns.as_ref().map(|column| row.integer(column)).transpose()?;
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
        let required = RAW.iter().filter(|column| column.set == ColumnSet::Always).map(|column| column.name);
        header.columns(&required.collect::<Vec<_>>(), hint)?;
        let (mut stored, mut recorded_ns) = (Vec::new(), None);
        for (index, column) in RAW.iter().enumerate() {
            match (index, header.optional_column(column.name)?) {
                (RECORDED_NS, found) => recorded_ns = found,
                // It says nothing about the sample.
                (SENT_NS | UNIX_OFFSET.., _) | (_, None) => {}
                (_, Some(found)) => stored.push((index, found)),
            }
        }
        let is_found = |name: &str| stored.iter().any(|(index, _)| RAW[*index].name == name);
        let missing = incomplete(RAW.iter().map(|column| (column.name, column.set)), is_found);
        if !missing.is_empty() {
            return Err(header.error(missing_columns(&missing, header.names(), INCOMPLETE_HINT)));
        }
        let (has_lag, has_gyroscopes) = (is_found(RAW[LAG_NS].name), is_found(RAW[GYROSCOPES].name));
        stored.retain(|(index, _)| has_gyroscopes || RAW[*index].set != ColumnSet::LaggedGyroscopes);
        Ok(Self { count: header.len(), stored, recorded_ns, has_lag })
    }
}

/// Writes raw samples as CSV. Floats have the shortest form that reads back as the same double. Sessions are written by
/// [`of_sessions`](RawCsvWriter::of_sessions) only.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_recording::{RawCsvReader, RawCsvWriter};
/// use isotherm_shared::wire::RawSample;
///
/// let mut raw = RawSample { sequence: 7, timestamp_ns: 5_000_000, interval_ns: 2_500_000, ..RawSample::default() };
/// raw.accelerometers.head_temperature = [0.1, 0.2, 0.3];
/// let mut writer = RawCsvWriter::new(Vec::new(), "", false)?;
/// writer.write("", &raw)?;
/// let text = writer.finish()?;
/// assert_eq!(RawCsvReader::new(&text[..])?.next().transpose()?, Some(raw));
/// # Ok(())
/// # }
/// ```
pub struct RawCsvWriter<W> {
    sink: W,
    leading: bool,
    /// The columns, by their index in [`RAW`].
    columns: Vec<usize>,
    plain: bool,
    /// The bits of the last double, and its text: all temperature of a row is often the same.
    last: (u64, Vec<u8>),
    row: Vec<u8>,
}

impl<W: Write> RawCsvWriter<W> {
    /// Writes the header row of samples of accelerometers. `leading` has the comma-separated names of the caller's own
    /// columns, which come first; it is empty if there are none. With `telemetry_ns`, the time of the temperature is
    /// the last column.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn new(sink: W, leading: &str, telemetry_ns: bool) -> io::Result<Self> {
        Self::with_layout(sink, leading, telemetry_ns, Layout::default())
    }

    /// As [`new`](Self::new), with the columns of a layout: those of the gyroscopes and of the lagged temperature come
    /// behind those of the accelerometers, the device comes last.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn with_layout(sink: W, leading: &str, telemetry_ns: bool, layout: Layout) -> io::Result<Self> {
        Self::with_columns(sink, leading, columns(telemetry_ns, layout))
    }

    /// Writes the header row of samples with their session, which comes first; with `telemetry_ns` as
    /// [`new`](Self::new).
    ///
    /// # Errors
    /// Those of the sink.
    pub fn of_sessions(sink: W, telemetry_ns: bool, layout: Layout) -> io::Result<Self> {
        let all = core::iter::once(SESSION).chain(columns(telemetry_ns, layout)).collect();
        Self::with_columns(sink, "", all)
    }

    fn with_columns(mut sink: W, leading: &str, columns: Vec<usize>) -> io::Result<Self> {
        let comma = if leading.is_empty() { "" } else { "," };
        let names: Vec<_> = columns.iter().map(|index| RAW[*index].name).collect();
        writeln!(sink, "{leading}{comma}{}", names.join(","))?;
        Ok(Self { sink, leading: !leading.is_empty(), columns, plain: false, last: (0, Vec::new()), row: Vec::new() })
    }

    /// Appends rows to a file that already has a header of [`new`](Self::new). `leading` says whether the file has the
    /// caller's own columns.
    #[must_use]
    pub fn resume(sink: W, leading: bool, telemetry_ns: bool) -> Self {
        Self::resume_with_layout(sink, leading, telemetry_ns, Layout::default())
    }

    /// Appends rows to a file that already has a header of [`with_layout`](Self::with_layout).
    #[must_use]
    pub fn resume_with_layout(sink: W, leading: bool, telemetry_ns: bool, layout: Layout) -> Self {
        Self {
            sink,
            leading,
            columns: columns(telemetry_ns, layout),
            plain: false,
            last: (0, Vec::new()),
            row: Vec::new(),
        }
    }

    /// Writes whole temperature without a decimal point, 25 and not 25.0. It reads back as the same double.
    #[must_use]
    pub fn with_plain_whole_numbers(self) -> Self {
        Self { plain: true, last: (0, Vec::new()), ..self }
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
        for index in &self.columns {
            let (kind, value) = (RAW[*index].kind, load(raw, *index));
            if kind == ColumnKind::F64 {
                let (bits, text) = &mut self.last;
                if *bits != value || text.is_empty() {
                    *bits = value;
                    text.clear();
                    match self.plain {
                        true => append_plain(f64::from_bits(value), text),
                        false => append_value(kind, value, text),
                    }
                }
                row.extend_from_slice(text);
            } else {
                append_value(kind, value, row);
            }
            row.push(b',');
        }
        // Replaces the comma after the last value.
        row.pop();
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

/// Appends a double in the shortest form that reads back as the same one.
fn append_plain(value: f64, row: &mut Vec<u8>) {
    /// Up to here every whole double is exact as an integer, and shorter than with an exponent.
    const MOST: f64 = 1e6;
    let is_plain = value.fract() == 0.0 && value.abs() < MOST && (value != 0.0 || value.is_sign_positive());
    if is_plain {
        // Writing to memory cannot fail.
        let _ = write!(row, "{}", value as i64);
    } else {
        append_value(ColumnKind::F64, value.to_bits(), row);
    }
}

/// The columns of a file, by their index in [`RAW`].
fn columns(telemetry_ns: bool, layout: Layout) -> Vec<usize> {
    let sensors = (ACCELEROMETERS..UNIX_OFFSET).filter(|index| *index != DEVICE && layout.has(&RAW[*index]));
    let last = telemetry_ns.then_some(TELEMETRY_NS).into_iter().chain(layout.device.then_some(DEVICE));
    [SEQUENCE, TIMESTAMP_NS, INTERVAL_NS].into_iter().chain(sensors).chain(last).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_shared::wire::Triad;
    use isotherm_support::finding::{Severity, name};
    use std::io::Cursor;

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
        assert_eq!(
            (samples[0].accelerometers.positive_pulses, samples[0].accelerometers.negative_pulses),
            ([11, 21, 31], [12, 22, 32])
        );
        assert_eq!(samples[0].accelerometers.board_temperature, [1.5, 2.5, 3.5]);
        assert_eq!(samples[0].accelerometers.head_temperature[..2], [1e-3, f64::NEG_INFINITY]);
        assert!(samples[0].accelerometers.head_temperature[2].is_nan());
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
        assert!(read_rows(&[row("", "0", "1")]).starts_with("line 2: sequence is \"\""));
        assert!(read_rows(&[good.clone(), "\n\n  \n".to_owned(), good.clone()]).starts_with("line 6: sequence 5"));
        let windows = format!("{HEADER}\n{good}{good}").replace('\n', "\r\n");
        assert!(read(&windows).unwrap_err().starts_with("line 3: sequence 5 after 5"));
        let old_mac = format!("{HEADER}\n{}", [good.clone(), good.clone()].concat().replacen('\n', "\r", 1));
        assert!(read(&old_mac).unwrap_err().starts_with("line 2: a carriage return"));
        assert!(read("").unwrap_err().starts_with("line 1: missing columns: sequence, "));
        assert!(read(&HEADER.replace(",a1_positive", "")).unwrap_err().contains("missing columns: a1_positive;"));
        assert!(read(&format!("{HEADER},a1_head")).unwrap_err().contains("a1_head is there twice"));
    }

    /// Rows that cannot be read, and what is said of the first of them: where it is, behind which row, and why.
    #[test]
    fn a_row_that_cannot_be_read_is_left_out_and_counted() {
        let row = |sequence: u64, pulses: &str, head: &str| {
            format!("1,1,0,0,1,1,0,0,1,{head},0,{pulses},x,1,{},{sequence}\n", sequence * 250_000_000)
        };
        for (bad, cause) in [
            (row(7, "-1", "1"), "a1_positive is \"-1\""),
            (row(7, "1.5", "1"), "a1_positive"),
            (row(7, "4294967296", "1"), "a1_positive"),
            (row(7, "0", "warm"), "a1_head is \"warm\""),
            (row(7, "0", "1e999"), "a1_head"),
            ("1,2\n".to_owned(), "2 fields, but the header has 16"),
            ("\"1\n".to_owned(), "a quotation mark"),
            ("\0\0\0\n".to_owned(), "1 fields, but the header has 16"),
        ] {
            let text = format!("{HEADER}\n{}{}{bad}{}", row(5, "0", "1"), row(6, "0", "1"), row(8, "0", "1"));
            let mut reader = RawCsvReader::new(text.as_bytes()).unwrap();
            let read: Vec<_> = reader.by_ref().map(Result::unwrap).collect();
            // What is behind keeps its own time.
            let times: Vec<_> = read.iter().map(|raw| (raw.sequence, raw.timestamp_ns)).collect();
            assert_eq!(times, [(5, 1_250_000_000), (6, 1_500_000_000), (8, 2_000_000_000)]);
            let finding = reader.damage().unwrap();
            let place = "1 damaged place is left out; the first is line 4, behind row 2, 0.2500 s after the first: ";
            assert!(finding.message.starts_with(&format!("{place}{cause}")), "{finding:?}");
            assert_eq!((finding.name, finding.severity), (name::BAD_ROWS, Severity::Warning));
        }
        let many: String = (0..40).map(|at| if at % 10 == 7 { "?\n".to_owned() } else { row(at, "0", "1") }).collect();
        let mut reader = RawCsvReader::new(Cursor::new(format!("{HEADER}\n{many}"))).unwrap();
        assert_eq!(reader.by_ref().map(Result::unwrap).count(), 36);
        assert_eq!(reader.damage().unwrap().severity, Severity::Fault);
    }

    #[test]
    fn quoted_fields_windows_lines_and_a_missing_last_line_end_are_read() {
        let quoted = HEADER.split(',').map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(",");
        let text =
            format!("{quoted}\r\n1,1,0,0,1,1,0,0,1,1,0,7, x ,1,1, 3 \r\n\r\n1,1,0,0,1,1,0,0,1,1,0,8,x,1,1,\"4\"");
        let samples = read(&text).unwrap();
        assert_eq!(
            samples.iter().map(|s| (s.sequence, s.accelerometers.positive_pulses[0])).collect::<Vec<_>>(),
            [(3, 7), (4, 8)]
        );
    }

    /// A sample with another value in every field that a recording has.
    fn sample() -> RawSample {
        let triad = |first: u32| Triad {
            positive_pulses: [first, 2, u32::MAX],
            negative_pulses: [4, 5, 6],
            head_temperature: [0.1 + 0.2, -1e-7, f64::INFINITY],
            board_temperature: [1.0, 1.24155, 3e20],
            head_lagged: [f64::from(first) + 0.5, -0.0, 5e-324],
        };
        RawSample {
            sequence: 3,
            timestamp_ns: 20,
            interval_ns: 10,
            telemetry_ns: 15,
            lag_ns: 240_000_000_000,
            device: 0x0a7_426e_f29c_c83b,
            accelerometers: triad(1),
            gyroscopes: triad(7),
            ..RawSample::default()
        }
    }

    /// The sample as a file with these columns keeps it.
    fn kept(raw: RawSample, telemetry_ns: bool, layout: Layout) -> RawSample {
        let mut kept = raw;
        if !telemetry_ns {
            kept.telemetry_ns = 0;
        }
        if !layout.device {
            kept.device = 0;
        }
        if !layout.gyroscopes {
            kept.gyroscopes = Triad::ABSENT;
        }
        if !layout.lag {
            kept.lag_ns = 0;
            kept.accelerometers.head_lagged = [0.0; 3];
            kept.gyroscopes.head_lagged = [0.0; 3];
        }
        kept
    }

    #[test]
    fn raw_samples_read_back_as_they_were() {
        let (first, second) = (sample(), RawSample { sequence: 4, ..sample() });
        for (leading, values) in [("", ""), ("set_point_c,position", "-25,1")] {
            for bits in 0..16 {
                let [telemetry_ns, device, gyroscopes, lag] = [1, 2, 4, 8].map(|bit| bits & bit != 0);
                let layout = Layout { device, gyroscopes, lag, unix_offset: false };
                let mut writer = RawCsvWriter::with_layout(Vec::new(), leading, telemetry_ns, layout).unwrap();
                writer.write(values, &first).unwrap();
                let file = writer.finish().unwrap();
                let mut writer = RawCsvWriter::resume_with_layout(file, !leading.is_empty(), telemetry_ns, layout);
                writer.write(values, &second).unwrap();
                let text = String::from_utf8(writer.finish().unwrap()).unwrap();
                assert_eq!(text.starts_with("set_point_c,position,sequence,"), !leading.is_empty());
                assert_eq!(text.contains("\n-25,1,3,20,10,1,4,0.30000000000000004,1.0,2,5,"), !leading.is_empty());
                assert_eq!(text.contains("00a7426ef29cc83b"), device);
                assert_eq!(read(&text).unwrap(), [first, second].map(|raw| kept(raw, telemetry_ns, layout)));
            }
        }
        // Without more columns the file is what it always was.
        let header = String::from_utf8(RawCsvWriter::new(Vec::new(), "", true).unwrap().finish().unwrap()).unwrap();
        assert_eq!(
            header,
            "sequence,timestamp_ns,interval_ns,a1_positive,a1_negative,a1_head,a1_board,a2_positive,a2_negative,a2_head,\
             a2_board,a3_positive,a3_negative,a3_head,a3_board,telemetry_ns\n"
        );
    }

    #[test]
    fn whole_temperature_may_be_written_without_a_decimal_point() {
        let [whole, fraction, zero, negative] = [25.0, 25.125, -0.0, -40.0];
        let accelerometers = Triad {
            head_temperature: [whole, fraction, zero],
            board_temperature: [negative, 1e6, f64::NAN],
            ..Triad::default()
        };
        let raw = RawSample { accelerometers, ..RawSample::default() };
        let mut writer = RawCsvWriter::new(Vec::new(), "", false).unwrap().with_plain_whole_numbers();
        writer.write("", &raw).unwrap();
        let text = String::from_utf8(writer.finish().unwrap()).unwrap();
        assert!(text.ends_with("\n0,0,0,0,0,25,-40,0,0,25.125,1000000.0,0,0,-0.0,NaN\n"), "{text}");
        let back = read(&text).unwrap()[0].accelerometers;
        assert_eq!(back.head_temperature.map(f64::to_bits), accelerometers.head_temperature.map(f64::to_bits));
    }

    /// The header of a file with all columns, without these.
    fn header_without(names: &[&str]) -> String {
        let layout = Layout { device: true, gyroscopes: true, lag: true, unix_offset: false };
        let header = String::from_utf8(RawCsvWriter::with_layout(Vec::new(), "", true, layout).unwrap().sink).unwrap();
        header.trim().split(',').filter(|name| !names.contains(name)).collect::<Vec<_>>().join(",")
    }

    #[test]
    fn a_part_of_the_columns_of_gyroscopes_or_lag_is_refused_by_name() {
        let gyroscopes: Vec<_> = RAW[GYROSCOPES..LAG_NS].iter().map(|column| column.name).collect();
        let lag: Vec<_> = RAW[LAG_NS..UNIX_OFFSET].iter().map(|column| column.name).collect();
        assert_eq!((gyroscopes[0], gyroscopes.len(), lag[0], lag.len()), ("g1_positive", 12, "lag_ns", 7));
        for name in gyroscopes.iter().chain(&lag) {
            let refused = read(&header_without(&[name])).unwrap_err();
            assert!(refused.starts_with(&format!("line 1: missing columns: {name}; found: ")), "{refused}");
            assert!(refused.contains(INCOMPLETE_HINT));
        }
        let refused = read(&header_without(&lag[..4])).unwrap_err();
        assert!(refused.starts_with(&format!("line 1: missing columns: {}; ", lag[..4].join(", "))), "{refused}");
        let refused = read(&header_without(&lag[4..])).unwrap_err();
        assert!(refused.starts_with(&format!("line 1: missing columns: {}; ", lag[4..].join(", "))), "{refused}");
        let without_gyroscopes = [&gyroscopes[..], &lag[4..]].concat();
        // The lagged temperature of gyroscopes that the IMU does not have.
        for whole in [&[][..], &lag, &gyroscopes, &without_gyroscopes, &[&gyroscopes[..], &lag].concat(), &["device"]] {
            assert_eq!(read(&header_without(whole)), Ok(Vec::new()), "{whole:?}");
        }
    }

    #[test]
    fn a_device_is_16_hexadecimal_digits_or_nothing() {
        let of = |device: &str| {
            let row = "1,1,0,0,1,1,0,0,1,1,0,0";
            read(&format!("device,{HEADER}\n{device},{row},,1,1,1\n")).map(|samples| samples[0].device)
        };
        assert_eq!(
            (of("46a7426ef29cc83b"), of("46A7426EF29CC83B")),
            (Ok(0x46a7_426e_f29c_c83b), of("46a7426ef29cc83b"))
        );
        assert_eq!([of(""), of("0"), of("0000000000000000")], [Ok(0), Ok(0), Ok(0)]);
        for wrong in
            ["46a7426ef29cc83", "046a7426ef29cc83b", "+6a7426ef29cc83b", "0x46a7426ef29cc8", "SN 42", "1", "00"]
        {
            assert!(
                of(wrong).unwrap_err().starts_with(&format!("line 2: device is {wrong:?}, give 16 hex")),
                "{wrong}"
            );
        }
    }
}
