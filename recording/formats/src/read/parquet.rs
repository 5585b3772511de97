//! The columns of a Parquet file, written by Isotherm or by another program with the same column names.

use super::pages;
use super::panics::catch_panic;
use super::random::RandomAccess;
use super::table::{Absence, ImuChoice, TableReader, ValueKind, WantedColumn, refuse_missing};
use crate::HAS_ZSTD;
use crate::seal::{DAMAGED, FOOTER_SEAL, GroupChecks, checks_in, matches_seal};
use isotherm_recording::columns::{PARQUET_MAGIC, hex};
use isotherm_recording::steps;
use isotherm_recording::{Progress, RecordingError};
use parquet::basic::{Compression, ConvertedType, LogicalType, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::schema::types::SchemaDescriptor;
use std::io;

/// Number of rows that are decoded at once.
const BATCH: usize = 4096;
/// Most bytes of a column that are read at once to check them.
const BUFFER: usize = 1 << 20;
/// Longest footer that is read \[bytes\]. Decoded it takes several times its size in memory.
const MAX_FOOTER: u64 = 16 << 20;

/// Reads the wanted columns of a Parquet file.
pub(super) struct ParquetReader {
    file: RandomAccess,
    reader: SerializedFileReader<RandomAccess>,
    /// The IMU that the metadata name.
    imu: Option<String>,
    /// The checks of the row groups, if the file has any.
    checks: Option<Vec<GroupChecks>>,
    wanted: Vec<WantedColumn>,
    columns: Vec<FoundColumn>,
    /// Index of the next row group, and the columns of the open one.
    group: usize,
    open: Vec<ColumnReader>,
    /// Decoded values, column by column, and the index of the next row in them.
    batch: Vec<Vec<Option<u64>>>,
    next: usize,
    row: u64,
    /// Mean bytes per row, and the bytes that the progress bar does not show yet.
    bytes_per_row: f64,
    unshown: f64,
    bar: Progress,
}

/// A wanted column that the file has.
#[derive(Clone, Copy)]
struct FoundColumn {
    /// Index into the list of wanted columns.
    wanted: usize,
    /// Index into the file's columns.
    index: usize,
    kind: ValueKind,
    absence: Absence,
    /// Whether the file declares its integers as unsigned.
    unsigned: bool,
}

impl FoundColumn {
    /// Converts an integer to the wanted kind; `None` if it does not fit.
    fn convert(self, value: i64) -> Option<u64> {
        let negative = value < 0 && !self.unsigned;
        match self.kind {
            ValueKind::Number if self.unsigned => Some((value.cast_unsigned() as f64).to_bits()),
            ValueKind::Number => Some((value as f64).to_bits()),
            ValueKind::U64 if !negative => Some(value.cast_unsigned()),
            ValueKind::U32 if !negative => u32::try_from(value.cast_unsigned()).ok().map(u64::from),
            _ => None,
        }
    }
}

impl ParquetReader {
    /// Opens a file and finds the columns that `wanted` returns, given the names of all. `bar` advances by the bytes
    /// read.
    ///
    /// # Errors
    /// If it is not a Parquet file, belongs to another IMU than the chosen one, or lacks a column.
    pub(super) fn open(
        file: RandomAccess,
        wanted: impl FnOnce(&[String]) -> Result<Vec<WantedColumn>, String>,
        choice: &ImuChoice,
        bar: &Progress,
    ) -> Result<Self, RecordingError> {
        let size = file.size();
        let is_sealed = check_footer(&file)?;
        let reader = match catch_panic(|| SerializedFileReader::new(file.clone())) {
            Some(Ok(reader)) => reader,
            Some(Err(error)) => {
                return Err(located(cause(error), |error| in_footer(format!("{NOT_VALID}: {error}"))));
            }
            None => return Err(in_footer(NOT_VALID.to_owned())),
        };
        let checks = checks_in(reader.metadata(), is_sealed).map_err(in_footer)?;
        let metadata = reader.metadata().file_metadata();
        let imu = metadata.key_value_metadata().into_iter().flatten().find(|entry| entry.key == "isotherm.imu");
        let imu = imu.and_then(|imu| imu.value.clone());
        if let (ImuChoice::Only(wanted), Some(imu)) = (choice, &imu)
            && imu != wanted.as_str()
        {
            return Err(in_footer(format!("samples of {}, not of {wanted}; choose with --imu", imu.escape_debug())));
        }
        let rows = u64::try_from(metadata.num_rows()).unwrap_or(0);
        let schema = metadata.schema_descr();
        let names: Vec<_> = (0..schema.num_columns()).map(|index| schema.column(index).path().string()).collect();
        let wanted = wanted(&names).map_err(in_footer)?;
        let columns = find(schema, &names, &wanted).map_err(in_footer)?;
        check_compression(&reader, &columns).map_err(in_footer)?;
        Ok(Self {
            file,
            reader,
            imu,
            checks,
            group: 0,
            open: Vec::new(),
            batch: columns.iter().map(|_| Vec::new()).collect(),
            next: 0,
            row: 0,
            bytes_per_row: size as f64 / rows.max(1) as f64,
            unshown: 0.0,
            wanted,
            columns,
            bar: bar.clone(),
        })
    }

    /// Decodes the next rows; returns false at the end.
    fn decode(&mut self) -> Result<bool, RecordingError> {
        self.next = 0;
        self.batch.iter_mut().for_each(Vec::clear);
        if self.open.is_empty() && !self.open_group()? {
            return Ok(false);
        }
        for index in 0..self.columns.len() {
            let (found, values) = (self.columns[index], &mut self.batch[index]);
            let column = &mut self.open[index];
            let decoded = catch_panic(|| match column {
                ColumnReader::Int32ColumnReader(reader) => batch(reader, found, values, |value| {
                    found.convert(if found.unsigned { value.cast_unsigned().into() } else { value.into() })
                }),
                ColumnReader::Int64ColumnReader(reader) => batch(reader, found, values, |value| found.convert(value)),
                ColumnReader::FloatColumnReader(reader) => {
                    batch(reader, found, values, |value| Some(f64::from(value).to_bits()))
                }
                ColumnReader::DoubleColumnReader(reader) => batch(reader, found, values, |value| Some(value.to_bits())),
                ColumnReader::ByteArrayColumnReader(reader) => batch(reader, found, values, |value| hex(value.data())),
                _ => Err(io::Error::other("not of its type")),
            });
            let decoded = decoded.unwrap_or_else(|| Err(io::Error::other("a page that cannot be read")));
            decoded.map_err(|error| {
                // The first row that could not be decoded.
                let place = format!("row {}", self.row + 1 + self.batch[index].len() as u64);
                let message = |error| format!("{}: {error}", self.name(index));
                located(error, |error| RecordingError::Place { place, message: message(error) })
            })?;
        }
        let rows = self.batch[0].len();
        if let Some(other) = self.batch.iter().position(|values| values.len() != rows) {
            return Err(self.error(format!("{} has not as many values as the other columns", self.name(other))));
        }
        if rows == 0 {
            self.open.clear();
        }
        self.unshown += rows as f64 * self.bytes_per_row;
        self.bar.advance(self.unshown as u64);
        self.unshown = self.unshown.fract();
        Ok(true)
    }

    /// Opens the columns of the next row group; returns false if there is none.
    fn open_group(&mut self) -> Result<bool, RecordingError> {
        if self.group == self.reader.num_row_groups() {
            return Ok(false);
        }
        let (reader, file, number) = (&self.reader, &self.file, self.group);
        let checks = self.checks.as_ref().and_then(|checks| checks.get(number));
        let opened = catch_panic(|| {
            let group = reader.get_row_group(number).map_err(|error| (None, cause(error)))?;
            let open = self.columns.iter().enumerate().map(|(index, column)| {
                steps::count(1);
                let chunk = group.metadata().column(column.index);
                let (begin, length) = chunk.byte_range();
                if let Some(check) = checks.and_then(|checks| checks.get(column.index)) {
                    verify(file, begin, length, *check).map_err(|error| (Some(index), error))?;
                }
                pages::check(file, begin, length).map_err(|error| (Some(index), error))?;
                group.get_column_reader(column.index).map_err(|error| (Some(index), cause(error)))
            });
            open.collect::<Result<Vec<_>, (Option<usize>, io::Error)>>()
        });
        let opened = opened.unwrap_or_else(|| Err((None, io::Error::other("a row group that cannot be read"))));
        self.open = opened.map_err(|(column, error)| {
            let name = column.map(|column| format!(", {}", self.name(column))).unwrap_or_default();
            let place = format!("row group {} from row {} on{name}", number + 1, self.row + 1);
            located(error, |error| RecordingError::Place { place, message: error.to_string() })
        })?;
        self.group += 1;
        Ok(true)
    }

    fn name(&self, column: usize) -> &str {
        &self.wanted[self.columns[column].wanted].name
    }
}

impl TableReader for ParquetReader {
    fn imu(&self) -> Option<&str> {
        self.imu.as_deref()
    }

    fn read(&mut self, values: &mut Vec<Option<u64>>) -> Result<bool, RecordingError> {
        while self.next == self.batch[0].len() {
            if !self.decode()? {
                return Ok(false);
            }
        }
        values.clear();
        values.resize(self.wanted.len(), None);
        for (column, decoded) in self.columns.iter().zip(&self.batch) {
            values[column.wanted] = decoded[self.next];
        }
        self.next += 1;
        self.row += 1;
        Ok(true)
    }

    fn row(&self) -> u64 {
        self.row
    }

    fn unit(&self) -> &'static str {
        "row"
    }

    fn error(&self, message: String) -> RecordingError {
        RecordingError::Place { place: format!("row {}", self.row), message }
    }
}

const NOT_VALID: &str = "not a valid Parquet file";

fn in_footer(message: String) -> RecordingError {
    RecordingError::Place { place: "footer".to_owned(), message }
}

/// Checks that a file has a footer that the library can read. Returns whether the footer matches its seal;
/// `None` if it has none.
pub(crate) fn check_footer(file: &RandomAccess) -> Result<Option<bool>, RecordingError> {
    let cut = || in_footer("the end of the Parquet file is missing; is it cut?".to_owned());
    let (mut tail, size) = ([0; 8], file.size());
    file.read_exact_at(&mut tail, size.checked_sub(8).ok_or_else(cut)?)?;
    let [length @ .., _, _, _, _] = tail;
    let length = u64::from(u32::from_le_bytes(length));
    if !tail.ends_with(PARQUET_MAGIC) || length > size {
        return Err(cut());
    }
    if length > MAX_FOOTER {
        return Err(in_footer(format!("{length} bytes; at most {MAX_FOOTER} are read: make larger row groups")));
    }
    // Seal, footer, length.
    let begin = (size - 8).checked_sub(length).ok_or_else(cut)?;
    let seal = FOOTER_SEAL.min(begin as usize);
    let mut bytes = vec![0; seal + length as usize + 4];
    file.read_exact_at(&mut bytes, begin - seal as u64)?;
    let (seal, footer) = bytes.split_at(seal);
    let is_sealed = matches_seal(footer, seal);
    if is_sealed == Some(false) {
        return Err(in_footer(format!("does not match its check; {DAMAGED}")));
    }
    if pages::is_footer(&footer[..length as usize]) { Ok(is_sealed) } else { Err(in_footer(NOT_VALID.to_owned())) }
}

/// Checks the bytes of a column.
fn verify(file: &RandomAccess, begin: u64, length: u64, check: u32) -> io::Result<()> {
    let mut buffer = vec![0; BUFFER.min(length as usize)];
    let (mut hasher, mut at, end) = (crc32fast::Hasher::new(), begin, begin.saturating_add(length));
    while at < end {
        let most = buffer.len().min((end - at) as usize);
        file.read_exact_at(&mut buffer[..most], at)?;
        hasher.update(&buffer[..most]);
        at += most as u64;
    }
    if hasher.finalize() == check {
        return Ok(());
    }
    Err(io::Error::other(format!("does not match its check; {DAMAGED}")))
}

/// The operating system's error in an error of the library; otherwise the library's message, in an error without a
/// code.
pub(crate) fn cause(error: ParquetError) -> io::Error {
    match error {
        ParquetError::External(source) => source.downcast::<io::Error>().map_or_else(io::Error::other, |error| *error),
        error => io::Error::other(error.to_string()),
    }
}

/// An error of the operating system as it is; for any other error, which is one of the data, the result of `refuse`.
fn located(error: io::Error, refuse: impl FnOnce(io::Error) -> RecordingError) -> RecordingError {
    if error.raw_os_error().is_some() { RecordingError::Io(error) } else { refuse(error) }
}

/// Finds the wanted columns in a file's schema, which has the columns `names`.
fn find(schema: &SchemaDescriptor, names: &[String], wanted: &[WantedColumn]) -> Result<Vec<FoundColumn>, String> {
    refuse_missing(wanted, names, "is this the recording?")?;
    let mut columns = Vec::new();
    for (wanted_index, WantedColumn { name, kind, absence, .. }) in wanted.iter().enumerate() {
        let mut found = (0..names.len()).filter(|&index| names[index] == *name);
        let Some(index) = found.next() else { continue };
        if found.next().is_some() {
            return Err(format!("the column {name} is there twice"));
        }
        let column = schema.column(index);
        let physical = column.physical_type();
        let (fits, expected) = match kind {
            ValueKind::U32 | ValueKind::U64 => {
                (matches!(physical, Physical::INT32 | Physical::INT64), "whole numbers of 32 or 64 bits")
            }
            ValueKind::Number => {
                let numbers = [Physical::INT32, Physical::INT64, Physical::FLOAT, Physical::DOUBLE];
                (numbers.contains(&physical), "numbers")
            }
            ValueKind::Hex => (physical == Physical::BYTE_ARRAY, "texts of 16 hexadecimal digits"),
        };
        if !fits || column.max_rep_level() > 0 {
            return Err(format!("{name} is of type {physical}, give {expected}"));
        }
        let unsigned = match (column.logical_type_ref(), column.converted_type()) {
            (Some(LogicalType::Integer(integer)), _) => !integer.is_signed,
            (_, converted) => matches!(converted, ConvertedType::UINT_32 | ConvertedType::UINT_64),
        };
        columns.push(FoundColumn { wanted: wanted_index, index, kind: *kind, absence: *absence, unsigned });
    }
    Ok(columns)
}

/// Checks that the compression of every wanted column is supported.
fn check_compression(reader: &SerializedFileReader<RandomAccess>, columns: &[FoundColumn]) -> Result<(), String> {
    for group in reader.metadata().row_groups() {
        for column in columns {
            steps::count(1);
            let chunk = group.column(column.index);
            let compression = chunk.compression();
            let is_read = match compression {
                Compression::UNCOMPRESSED | Compression::SNAPPY => true,
                Compression::ZSTD(_) => HAS_ZSTD,
                _ => false,
            };
            if !is_read {
                let name = chunk.column_path().string();
                let compression = compression.to_string();
                let compression = compression.split('(').next().unwrap_or_default();
                let known = if HAS_ZSTD { "with zstd, with snappy or" } else { "with snappy, or" };
                return Err(format!("{name} is compressed with {compression}; write it {known} uncompressed"));
            }
        }
    }
    Ok(())
}

/// Appends the next values of a column; appends nothing at its end.
fn batch<T: DataType>(
    reader: &mut ColumnReaderImpl<T>,
    found: FoundColumn,
    decoded: &mut Vec<Option<u64>>,
    value: impl Fn(T::T) -> Option<u64>,
) -> io::Result<()> {
    let (mut levels, mut values) = (Vec::new(), Vec::new());
    let read = reader.read_records(BATCH, Some(&mut levels), None, &mut values);
    let (rows, ..) = read.map_err(cause)?;
    let missing = match T::get_physical_type() {
        Physical::DOUBLE | Physical::FLOAT => Some(f64::NAN.to_bits()),
        Physical::BYTE_ARRAY => Some(0),
        _ => None,
    };
    let mut values = values.into_iter();
    for row in 0..rows {
        // A column that may lack values has a level for each row: 0 where the value is missing.
        let present = levels.get(row).is_none_or(|level| *level > 0);
        let next = if present { values.next().and_then(&value) } else { missing };
        let is_kept = !present && found.absence == Absence::Kept;
        if !is_kept && next.is_none() {
            return Err(io::Error::other(format!("no value, or not {}", found.kind.expected())));
        }
        decoded.push(next.filter(|_| !is_kept));
    }
    Ok(())
}
