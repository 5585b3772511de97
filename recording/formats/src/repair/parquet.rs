//! The row groups of a damaged Parquet file that are whole.
//!
//! With checks a group is whole if all its columns match theirs. It is found by the footer, and where that is damaged,
//! or the group is not where the footer says, by its seal. Without checks a group is whole if all of it can be decoded.

use super::account::{Account, Fate, Keys};
use super::report::{RecordingFormat, RepairError, RepairReport, RowTime};
use crate::read::pages;
use crate::read::panics::catch_panic;
use crate::read::parquet::{cause, check_footer};
use crate::read::random::RandomAccess;
use crate::seal::{
    CREATOR, FileParts, GroupChecks, MAGIC, SealedGroup, checks_in, checks_of, chunk_range, group_range,
    is_footer_sealed_at, sealed_groups,
};
use crate::write::parquet::encode::{Checks, FileEncoder, IMU, SINGLE, metadata, moved};
use isotherm_recording::columns::{RAW, SEQUENCE, SESSION, TIMESTAMP_NS, columns};
use isotherm_recording::{layouts, stream_of};
use isotherm_shared::names::{ImuId, StreamKind};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl, get_column_reader};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::metadata::{FileMetaData, ParquetMetaData, ParquetMetaDataReader, RowGroupMetaData};
use parquet::file::serialized_reader::SerializedPageReader;
use std::io::{self, Write};
use std::sync::Arc;

/// Rows that are decoded at once.
const BATCH: usize = 1 << 14;
/// Longest row group that is taken \[bytes\]. Common writers make groups of 128 MB.
const MAX_GROUP: u64 = 1 << 30;

/// A row group of the file.
struct Group {
    /// Its number in the file, from 0.
    ordinal: usize,
    begin: u64,
    length: u64,
    /// Its entry in the footer, with its place in this file.
    metadata: RowGroupMetaData,
    /// Of a file with checks.
    checks: Option<GroupChecks>,
    /// What is wrong with it.
    damage: Option<String>,
    bytes: Vec<u8>,
}

pub(super) fn repair(file: RandomAccess, sink: &mut dyn Write) -> Result<RepairReport, RepairError> {
    let size = file.size();
    let sealed = sealed_groups(&file).map_err(RepairError::Read)?;
    let footer = footer(&file)?;
    let about = match (&footer, sealed.first()) {
        (Ok((footer, _)), _) => footer.file_metadata(),
        (Err(_), Some(group)) => group.metadata.file_metadata(),
        (Err(cause), None) => {
            return Err(RepairError::Nothing(format!("footer: {cause}; nothing else says where its rows are")));
        }
    };
    let names: Vec<_> = (0..about.schema_descr().num_columns())
        .map(|column| about.schema_descr().column(column).path().string())
        .collect();
    let stream = stream_of(&names).ok_or_else(|| RepairError::Nothing("not a recording: other columns".to_owned()))?;
    let has_checks = !sealed.is_empty() || matches!(&footer, Ok((_, Some(_))));
    let parts = parts(about, &names, stream, footer.is_ok());
    let name = imu(about).map_or_else(|| stream.name().to_owned(), |imu| format!("{imu} {}", stream.name()));
    let mut account = Account::default();
    let keys = match (stream, names.iter().any(|name| name == RAW[SESSION].name)) {
        (StreamKind::Increment, _) => Keys::Unordered,
        // A row group is taken as it is: none of its rows can get another session.
        (StreamKind::Raw, _) => Keys::RisingUnnamed,
    };
    let stream = account.stream(&name, keys);
    let mut magic = [0; MAGIC.len()];
    file.read_exact_at(&mut magic, 0).map_err(RepairError::Read)?;
    if magic != MAGIC {
        account.hole("byte", 0, "not the first bytes of a Parquet file", Some(0));
    }
    let mut repair = ParquetRepair {
        file: file.clone(),
        sink,
        length: 0,
        encoder: FileEncoder::new(parts, if has_checks { Checks::Written } else { Checks::Absent }),
        account,
        stream,
        names,
    };
    repair.write(MAGIC)?;
    let last = sealed.last().map(|group| group.end);
    let known = footer.as_ref().ok().map(|(footer, checks)| (footer, checks.as_ref()));
    repair.groups(known, sealed)?;
    if let Err(cause) = &footer {
        // A seal of the footer behind the last group says that no group is missing.
        let ended = last.map_or(Ok(false), |end| is_footer_sealed_at(&file, end)).map_err(RepairError::Read)?;
        repair.account.hole("byte", size, format!("footer: {cause}"), ended.then_some(0));
    }
    repair.end(has_checks)
}

/// The footer and its checks. The inner error says what is wrong with it.
type Footer = Result<(ParquetMetaData, Option<Vec<GroupChecks>>), String>;

fn footer(file: &RandomAccess) -> Result<Footer, RepairError> {
    let invalid = || "not a valid Parquet file".to_owned();
    let is_sealed = match check_footer(file) {
        Ok(is_sealed) => is_sealed,
        Err(isotherm_recording::RecordingError::Io(error)) => return Err(RepairError::Read(error)),
        Err(error) => {
            let message = error.to_string();
            let message = message.trim_start_matches("footer: ");
            return Ok(Err(message.split(';').next().unwrap_or_default().to_owned()));
        }
    };
    let parsed = catch_panic(|| ParquetMetaDataReader::new().parse_and_finish(file));
    let Some(Ok(metadata)) = parsed else { return Ok(Err(invalid())) };
    Ok(match checks_in(&metadata, is_sealed) {
        Ok(checks) => Ok((metadata, checks)),
        Err(message) => Err(message.split(';').next().unwrap_or_default().to_owned()),
    })
}

fn imu(about: &FileMetaData) -> Option<&str> {
    about.key_value_metadata()?.iter().find(|entry| entry.key == IMU)?.value.as_deref()
}

/// What the new file says of itself. A seal has no units: they are those of the recorder's columns.
fn parts(about: &FileMetaData, names: &[String], stream: StreamKind, is_whole: bool) -> FileParts {
    let mut entries = about.key_value_metadata().cloned().unwrap_or_default();
    if let Some(imu) = imu(about).and_then(|imu| imu.parse::<ImuId>().ok()).filter(|_| !is_whole) {
        let own = layouts().filter(|(kind, _)| *kind == stream).map(|(kind, layout)| columns(kind, layout));
        let own = own.into_iter().find(|columns| columns.iter().map(|column| column.name).eq(names.iter()));
        entries = own.map_or(entries, |columns| metadata(&columns, &imu, stream));
    }
    let created_by = about.created_by().map_or_else(|| format!("{CREATOR}repair"), str::to_owned);
    FileParts { schema: about.schema_descr().root_schema_ptr(), created_by: Some(created_by), metadata: entries }
}

struct ParquetRepair<'a> {
    file: RandomAccess,
    sink: &'a mut dyn Write,
    /// Bytes written.
    length: u64,
    encoder: FileEncoder,
    account: Account,
    stream: usize,
    names: Vec<String>,
}

impl ParquetRepair<'_> {
    fn write(&mut self, bytes: &[u8]) -> Result<(), RepairError> {
        self.length += bytes.len() as u64;
        self.sink.write_all(bytes).map_err(RepairError::Write)
    }

    /// Takes the row groups that the footer names, and those that seals name.
    fn groups(
        &mut self,
        footer: Option<(&ParquetMetaData, Option<&Vec<GroupChecks>>)>,
        sealed: Vec<SealedGroup>,
    ) -> Result<(), RepairError> {
        let mut sealed: Vec<Vec<SealedGroup>> = {
            let mut by_ordinal = Vec::new();
            for group in sealed {
                let ordinal = ordinal(&group);
                by_ordinal.resize_with(by_ordinal.len().max(ordinal + 1), Vec::new);
                by_ordinal[ordinal].push(group);
            }
            by_ordinal
        };
        let count = footer.map_or(0, |(footer, _)| footer.num_row_groups()).max(sealed.len());
        for number in 0..count {
            let named = footer.and_then(|(footer, checks)| {
                let metadata = footer.row_groups().get(number)?;
                let (begin, length) = group_range(metadata)?;
                let checks = checks.and_then(|checks| checks.get(number)).cloned();
                Some(Group::new(number, (begin, length), metadata.clone(), checks))
            });
            let mut of_number: Vec<Group> = named.into_iter().collect();
            let seals = sealed.get_mut(number).map(std::mem::take).unwrap_or_default();
            let is_sealed = !seals.is_empty();
            of_number.extend(seals.into_iter().filter_map(|seal| Group::of_seal(number, seal)));
            let is_checked = of_number.iter().any(|group| group.checks.is_some());
            // The same group, as the footer and as the seal have it.
            of_number.dedup_by_key(|group| (group.begin, group.length));
            for group in &mut of_number {
                self.verify(group)?;
            }
            self.take(number, of_number)?;
            if is_checked && !is_sealed {
                self.account.hole("row group", number as u64 + 1, "its seal is damaged", Some(0));
            }
        }
        Ok(())
    }

    /// Reads a group and finds out whether it is whole.
    fn verify(&self, group: &mut Group) -> Result<(), RepairError> {
        if group.length > MAX_GROUP {
            group.damage = Some(format!("over {MAX_GROUP} bytes"));
            return Ok(());
        }
        let size = self.file.size();
        if group.begin.checked_add(group.length).is_none_or(|end| end > size) {
            group.damage = Some("the file ends before it".to_owned());
            return Ok(());
        }
        let mut bytes = vec![0; group.length as usize];
        self.file.read_exact_at(&mut bytes, group.begin).map_err(RepairError::Read)?;
        group.damage = match &group.checks {
            Some(checks) => {
                let own = checks_of(&group.metadata, &bytes, group.begin).unwrap_or_default();
                let wrong = (0..checks.len()).find(|column| own.get(*column) != checks.get(*column));
                wrong.map(|column| format!("{} does not match its check", self.name(column)))
            }
            None => (0..group.metadata.num_columns()).find_map(|column| {
                let error = self.values(&group.metadata, column, None).err()?;
                Some(format!("{}: {error}", self.name(column)))
            }),
        };
        group.bytes = bytes;
        Ok(())
    }

    fn name(&self, column: usize) -> &str {
        self.names.get(column).map_or("a column", String::as_str)
    }

    /// Takes those of the groups with this number that are whole.
    fn take(&mut self, number: usize, groups: Vec<Group>) -> Result<(), RepairError> {
        let place = number as u64 + 1;
        if !groups.iter().any(|group| group.damage.is_none()) {
            // The seal is nearer to the rows than the footer.
            let (cause, rows) = match groups.last() {
                Some(group) => (group.damage.as_deref().unwrap_or_default(), group.rows()),
                None => ("damaged", None),
            };
            self.account.hole("row group", place, cause, rows);
        }
        for group in groups.into_iter().filter(|group| group.damage.is_none()) {
            let rows = group.rows();
            let keys = match self.keys(&group.metadata) {
                Ok(keys) => keys,
                Err(error) => {
                    self.account.hole("row group", place, error, rows);
                    continue;
                }
            };
            match keys.first().map(|first| self.account.fate(self.stream, *first)) {
                None | Some(Fate::Taken) => {
                    self.account.take_all(self.stream, &keys);
                    self.copy(&group)?;
                }
                Some(Fate::Repeated) => self.account.take_all(self.stream, &keys),
                Some(_) => {
                    let cause = "its rows are not behind those of the groups before";
                    self.account.hole("row group", place, cause, rows);
                }
            }
        }
        Ok(())
    }

    fn copy(&mut self, group: &Group) -> Result<(), RepairError> {
        let invalid = |error: ParquetError| RepairError::Write(io::Error::other(error));
        let offset = self.length;
        self.write(&group.bytes)?;
        let single = moved(&group.metadata, group.begin, SINGLE, group.ordinal).map_err(invalid)?;
        let seal = self.encoder.add(&group.bytes, &single, offset).map_err(invalid)?;
        self.write(&seal)
    }

    fn end(mut self, has_checks: bool) -> Result<RepairReport, RepairError> {
        let footer = self.encoder.footer().map_err(|error| RepairError::Write(io::Error::other(error)))?;
        self.write(&footer)?;
        self.sink.flush().map_err(RepairError::Write)?;
        Ok(self.account.end(RecordingFormat::Parquet, has_checks, Vec::new()))
    }

    /// Session, sequence and time of the rows of a group.
    fn keys(&self, group: &RowGroupMetaData) -> Result<Vec<RowTime>, String> {
        let mut keys = Vec::new();
        for index in [SESSION, SEQUENCE, TIMESTAMP_NS] {
            let name = RAW[index].name;
            let Some(column) = self.names.iter().position(|other| other == name) else { continue };
            let mut values = Vec::new();
            self.values(group, column, Some(&mut values)).map_err(|error| format!("{name}: {error}"))?;
            // As many as have been decoded, whatever the file claims.
            keys.resize(values.len().max(keys.len()), RowTime::default());
            for (key, value) in keys.iter_mut().zip(values) {
                match index {
                    SESSION => key.session = value,
                    SEQUENCE => key.sequence = value,
                    _ => key.timestamp_ns = value,
                }
            }
        }
        Ok(keys)
    }

    /// Decodes a column. Adds the values of one with integers to `values`.
    fn values(&self, group: &RowGroupMetaData, column: usize, values: Option<&mut Vec<u64>>) -> Result<(), io::Error> {
        let decoded = catch_panic(|| {
            let chunk = group.column(column);
            let rows = usize::try_from(group.num_rows()).unwrap_or(0);
            let (begin, length) = chunk_range(group, column).ok_or_else(|| io::Error::other("its place"))?;
            pages::check(&self.file, begin, length)?;
            let pages = SerializedPageReader::new(Arc::new(self.file.clone()), chunk, rows, None).map_err(cause)?;
            match get_column_reader(chunk.column_descr_ptr(), Box::new(pages)) {
                ColumnReader::Int64ColumnReader(reader) => all(reader, rows, values, i64::cast_unsigned),
                ColumnReader::Int32ColumnReader(reader) => {
                    all(reader, rows, values, |value| i64::from(value).cast_unsigned())
                }
                ColumnReader::FloatColumnReader(reader) => all(reader, rows, None, |_| 0),
                ColumnReader::DoubleColumnReader(reader) => all(reader, rows, None, |_| 0),
                ColumnReader::ByteArrayColumnReader(reader) => all(reader, rows, None, |_| 0),
                ColumnReader::BoolColumnReader(reader) => all(reader, rows, None, |_| 0),
                ColumnReader::Int96ColumnReader(reader) => all(reader, rows, None, |_| 0),
                ColumnReader::FixedLenByteArrayColumnReader(reader) => all(reader, rows, None, |_| 0),
            }
        });
        decoded.unwrap_or_else(|| Err(io::Error::other("a page that cannot be read")))
    }
}

impl Group {
    fn new(
        ordinal: usize,
        (begin, length): (u64, u64),
        metadata: RowGroupMetaData,
        checks: Option<GroupChecks>,
    ) -> Self {
        Self { ordinal, begin, length, metadata, checks, damage: None, bytes: Vec::new() }
    }

    fn rows(&self) -> Option<u64> {
        u64::try_from(self.metadata.num_rows()).ok()
    }

    fn of_seal(ordinal: usize, seal: SealedGroup) -> Option<Self> {
        let SealedGroup { begin, length, metadata, checks, .. } = seal;
        let metadata = moved(metadata.row_groups().first()?, SINGLE, begin, ordinal).ok()?;
        Some(Self::new(ordinal, (begin, length), metadata, Some(checks)))
    }
}

/// The number of a sealed group in its file; a seal that none of ours has written may claim any.
fn ordinal(group: &SealedGroup) -> usize {
    const MOST: usize = 1 << 16;
    let ordinal = group.metadata.row_groups().first().and_then(RowGroupMetaData::ordinal);
    ordinal.and_then(|ordinal| usize::try_from(ordinal).ok()).map_or(MOST, |ordinal| ordinal.min(MOST))
}

/// Decodes all rows of a column.
fn all<T: DataType>(
    mut reader: ColumnReaderImpl<T>,
    rows: usize,
    mut values: Option<&mut Vec<u64>>,
    value: impl Fn(T::T) -> u64,
) -> io::Result<()> {
    let (mut levels, mut batch, mut read) = (Vec::new(), Vec::new(), 0);
    loop {
        levels.clear();
        batch.clear();
        let (more, ..) = reader.read_records(BATCH, Some(&mut levels), None, &mut batch).map_err(cause)?;
        read += more;
        if let Some(values) = &mut values {
            values.extend(batch.drain(..).map(&value));
        }
        if more == 0 {
            break;
        }
    }
    if read == rows { Ok(()) } else { Err(io::Error::other(format!("{read} rows of {rows}"))) }
}
