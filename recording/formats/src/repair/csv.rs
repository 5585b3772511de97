//! The rows of a damaged recording in CSV that are whole.
//!
//! With checks these say it. Without, a row is whole if it has all its fields and each is of its kind. Then one wrong
//! sequence is known by those around it: a row from which the next does not rise, though it does from the row before.

use super::account::{Account, Fate, Keys};
use super::report::{RecordingFormat, RepairError, RepairReport, RowTime};
use isotherm_recording::columns::{Column, ColumnKind, INCREMENT, RAW, SEQUENCE, SESSION, TIMESTAMP_NS, columns};
use isotherm_recording::csv::{CsvColumn, Rows};
use isotherm_recording::{CHECK, RecordingError, layouts, stream_of, with_field};
use isotherm_shared::names::StreamKind;
use isotherm_shared::wire::Flags;
use isotherm_support::source::{DataSource, ReadSeek};
use std::io::{BufWriter, Write};

/// What is known of the columns.
struct CsvHeader {
    stream: StreamKind,
    names: Vec<String>,
    has_checks: bool,
    /// Whether the first line is damaged, and is written anew.
    is_renewed: bool,
}

/// The columns that identify a row, and those whose values are looked at.
struct WantedColumns {
    session: Option<CsvColumn>,
    sequence: CsvColumn,
    timestamp_ns: CsvColumn,
    /// Without checks: all that are known.
    values: Vec<(ColumnKind, CsvColumn)>,
}

/// A row that is whole.
struct CsvRow {
    line: u64,
    key: RowTime,
    text: Vec<u8>,
}

pub(super) fn repair(source: &DataSource, sink: &mut dyn Write) -> Result<RepairReport, RepairError> {
    let open = || source.open().map_err(RepairError::Read);
    let header = CsvHeader::find(|| open().map(Rows::new))?;
    let mut repair = CsvRepair::begin(header, BufWriter::new(sink))?;
    let mut rows = Rows::new(open()?);
    if !repair.header.is_renewed {
        next(&mut rows)?.map_err(RepairError::Nothing)?;
        rows.find_checks().map_err(|error| RepairError::Nothing(error.to_string()))?;
    } else if repair.header.has_checks {
        rows.expect_checks(repair.header.names.len() - 1);
    }
    loop {
        match next(&mut rows)?.and_then(|more| if more { repair.row(&rows).map(Some) } else { Ok(None) }) {
            Ok(Some(row)) => repair.take(row)?,
            Ok(None) => break,
            Err(cause) => repair.hole(rows.line(), &cause)?,
        }
    }
    repair.end()
}

/// The next row; false at the end. The inner error is that of a row.
fn next(rows: &mut Rows<Box<dyn ReadSeek>>) -> Result<Result<bool, String>, RepairError> {
    match rows.next_row() {
        Ok(more) => Ok(Ok(more)),
        Err(RecordingError::Io(error)) => Err(RepairError::Read(error)),
        Err(error) => Ok(Err(cause(&error))),
    }
}

/// What is wrong, without the line.
fn cause(error: &RecordingError) -> String {
    match error {
        RecordingError::Data { message, .. } | RecordingError::Place { message, .. } => message.clone(),
        error => error.to_string(),
    }
}

impl CsvHeader {
    /// Reads the header. One that is damaged is that of the recorder's files whose rows have as many columns, and their
    /// checks.
    fn find(open: impl Fn() -> Result<Rows<Box<dyn ReadSeek>>, RepairError>) -> Result<Self, RepairError> {
        let mut rows = open()?;
        let mut whole = None;
        if next(&mut rows)? == Ok(true) {
            let names: Vec<_> = rows.names().collect();
            let stream = stream_of(&names);
            let is_whole = rows.find_checks().is_ok();
            if let Some(stream) = stream.filter(|_| is_whole) {
                let header = Self { stream, names, has_checks: rows.has_checks(), is_renewed: false };
                if header.has_checks || !rows.may_have_checks() {
                    return Ok(header);
                }
                whole = Some(header);
            }
        }
        loop {
            match next(&mut rows)? {
                Ok(true) if rows.ends_with_check() => {
                    let of_width =
                        |(stream, layout)| Some(columns(stream, layout)).filter(|all| all.len() + 1 == rows.len());
                    let found = layouts().find_map(|(stream, layout)| Some((stream, of_width((stream, layout))?)));
                    if let Some((stream, columns)) = found {
                        let names =
                            columns.iter().map(|column| column.name).chain([CHECK]).map(str::to_owned).collect();
                        return Ok(Self { stream, names, has_checks: true, is_renewed: true });
                    }
                }
                Ok(false) => break,
                _ => {}
            }
        }
        let message = "the first line does not name the columns of a recording, and without checks the rows do not \
                       show them; write it again";
        whole.ok_or_else(|| RepairError::Nothing(message.to_owned()))
    }

    fn column(&self, name: &str) -> Option<CsvColumn> {
        let index = self.names.iter().position(|other| other == name)?;
        Some(CsvColumn::new(name.to_owned(), index))
    }

    fn wanted(&self) -> Result<WantedColumns, RepairError> {
        let all: &[Column] = match self.stream {
            StreamKind::Raw => &RAW,
            StreamKind::Increment => &INCREMENT,
        };
        let needed = |index: usize| {
            let name = all[index].name;
            self.column(name).ok_or_else(|| RepairError::Nothing(format!("missing columns: {name}")))
        };
        let known = all.iter().filter(|_| !self.has_checks);
        Ok(WantedColumns {
            session: self.column(all[SESSION].name),
            sequence: needed(SEQUENCE)?,
            timestamp_ns: needed(TIMESTAMP_NS)?,
            values: known.filter_map(|column| Some((column.kind, self.column(column.name)?))).collect(),
        })
    }
}

struct CsvRepair<'a> {
    header: CsvHeader,
    wanted: WantedColumns,
    stream: usize,
    account: Account,
    sink: BufWriter<&'a mut dyn Write>,
    /// The last sequence that was taken of the session, and the row behind it, of which it is not known yet whether its
    /// sequence is right.
    last: Option<RowTime>,
    waiting: Option<CsvRow>,
}

impl<'a> CsvRepair<'a> {
    fn begin(header: CsvHeader, mut sink: BufWriter<&'a mut dyn Write>) -> Result<Self, RepairError> {
        writeln!(sink, "{}", header.names.join(",")).map_err(RepairError::Write)?;
        let wanted = header.wanted()?;
        let keys = match (header.stream, &wanted.session) {
            (StreamKind::Raw, Some(_)) => Keys::Rising,
            (StreamKind::Raw, None) => Keys::RisingUnnamed,
            (StreamKind::Increment, _) => Keys::Unordered,
        };
        let mut account = Account::default();
        let stream = account.stream(header.stream.name(), keys);
        if header.is_renewed {
            account.hole("line", 1, "the header is damaged, and is written again", None);
        }
        Ok(Self { header, wanted, stream, account, sink, last: None, waiting: None })
    }

    /// The current row. An error says why it is not whole.
    fn row(&self, rows: &Rows<Box<dyn ReadSeek>>) -> Result<CsvRow, String> {
        let whole = || -> Result<RowTime, RecordingError> {
            rows.verify(self.header.names.len())?;
            for (kind, column) in &self.wanted.values {
                match kind {
                    ColumnKind::U64 => drop(rows.integer::<u64>(column)?),
                    ColumnKind::U32 => drop(rows.integer::<u32>(column)?),
                    ColumnKind::F64 => drop(rows.float(column)?),
                    ColumnKind::Hex => drop(rows.hex(column)?),
                    ColumnKind::Flags => drop(rows.parse(column, "names of flags joined by |", flags)?),
                }
            }
            let session = self.wanted.session.as_ref().map(|column| rows.integer(column)).transpose()?;
            let sequence = rows.integer(&self.wanted.sequence)?;
            let timestamp_ns = rows.integer(&self.wanted.timestamp_ns)?;
            Ok(RowTime { session: session.unwrap_or(0), sequence, timestamp_ns })
        };
        if !rows.is_terminated() && !rows.has_checks() {
            return Err("the line is cut".to_owned());
        }
        let key = whole().map_err(|error| cause(&error))?;
        let mut text = rows.line_text().to_vec();
        if !text.ends_with(b"\n") {
            text.push(b'\n');
        }
        Ok(CsvRow { line: rows.line(), key, text })
    }

    fn hole(&mut self, line: u64, cause: &str) -> Result<(), RepairError> {
        self.take_waiting()?;
        let cause = cause.split(';').next().unwrap_or_default();
        self.account.hole("line", line, cause, None);
        Ok(())
    }

    /// Takes a row. Without checks, and where rows must rise, it waits for the next, which shows whether it does.
    fn take(&mut self, row: CsvRow) -> Result<(), RepairError> {
        if self.header.has_checks || self.header.stream == StreamKind::Increment {
            return self.write(row);
        }
        let follows =
            |row: RowTime, earlier: RowTime| row.session == earlier.session && row.sequence > earlier.sequence;
        if let (Some(waiting), Some(last)) = (&self.waiting, self.last)
            && waiting.key.session == row.key.session
            && follows(row.key, last)
            && !(follows(row.key, waiting.key) && follows(waiting.key, last))
        {
            let (line, sequence) = (waiting.line, waiting.key.sequence);
            let cause = format!("sequence {sequence} between {} and {}", last.sequence, row.key.sequence);
            self.account.hole("line", line, cause, None);
            self.waiting = None;
        }
        self.take_waiting()?;
        self.waiting = Some(row);
        Ok(())
    }

    fn take_waiting(&mut self) -> Result<(), RepairError> {
        let Some(row) = self.waiting.take() else { return Ok(()) };
        self.last = Some(row.key);
        self.write(row)
    }

    fn write(&mut self, row: CsvRow) -> Result<(), RepairError> {
        let check = self.header.has_checks.then(|| self.header.column(CHECK)).flatten();
        match (self.account.take(self.stream, row.key), &self.wanted.session) {
            (Fate::Taken, _) => self.sink.write_all(&row.text),
            (Fate::TakenIn(session), Some(column)) => self.sink.write_all(&with_field(
                &row.text,
                column.index(),
                session,
                check.as_ref().map(CsvColumn::index),
            )),
            (Fate::Repeated, _) => Ok(()),
            (Fate::OutOfOrder | Fate::TakenIn(_), _) => {
                let cause = format!("sequence {} does not rise, and rows have no sessions", row.key.sequence);
                self.account.hole("line", row.line, cause, None);
                Ok(())
            }
        }
        .map_err(RepairError::Write)
    }

    fn end(mut self) -> Result<RepairReport, RepairError> {
        self.take_waiting()?;
        self.sink.flush().map_err(RepairError::Write)?;
        Ok(self.account.end(RecordingFormat::Csv, self.header.has_checks, Vec::new()))
    }
}

fn flags(text: &str) -> Option<()> {
    let is_known = |name: &str| Flags::NAMES.iter().any(|(_, known)| *known == name);
    (text == "-" || text.split('|').all(is_known)).then_some(())
}
