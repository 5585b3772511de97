//! Raw samples out of a Parquet file: ours, or one that another program has made with the same columns.

use super::Pick;
use super::contained::contained;
use super::pages;
use crate::record::columns::{Kind, RAW, set};
use isotherm_client::RawSample;
use isotherm_shared::recording::{RecordingError, Rising};
use parquet::basic::{ConvertedType, LogicalType, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use std::fs::File;
use std::os::unix::fs::FileExt as _;

/// Rows that are decoded at once.
const BATCH: usize = 4096;
/// Longest directory that is read: what it describes takes several times its size in memory.
const DIRECTORY: u64 = 16 << 20;
/// Columns of raw samples that may be missing.
const OPTIONAL: [&str; 4] = ["recorded_ns", "session", "sent_ns", "telemetry_ns"];

/// An iterator over the samples that ends at the first error.
pub struct ParquetSamples {
    file: File,
    size: u64,
    reader: SerializedFileReader<File>,
    rows: u64,
    columns: Vec<Source>,
    group: usize,
    open: Vec<ColumnReader>,
    /// Decoded values, column by column, the bits of doubles; and which row is the next.
    batch: Vec<Vec<u64>>,
    next: usize,
    row: u64,
    rising: Rising,
}

/// A column that is read.
#[derive(Clone, Copy)]
struct Source {
    /// Its place in [`RAW`].
    place: usize,
    /// Its place in the file.
    index: usize,
    /// Whether its numbers have no sign.
    unsigned: bool,
}

impl Source {
    const fn name(self) -> &'static str {
        RAW[self.place].name
    }

    /// The value of a whole number, if it fits.
    fn whole(self, value: i64) -> Option<u64> {
        if value < 0 && !self.unsigned {
            return None;
        }
        let value = value.cast_unsigned();
        (RAW[self.place].kind == Kind::U64 || u32::try_from(value).is_ok()).then_some(value)
    }
}

impl ParquetSamples {
    pub fn open(file: File, pick: Pick<'_>) -> Result<Self, RecordingError> {
        let wrong = |message: String| RecordingError::Place { place: "directory".to_owned(), message };
        let size = file.metadata()?.len();
        let mut tail = [0; 8];
        file.read_exact_at(&mut tail, size.saturating_sub(8))?;
        let [length @ .., _, _, _, _] = tail;
        let length = u64::from(u32::from_le_bytes(length));
        if !tail.ends_with(b"PAR1") || length > size {
            return Err(wrong("the end of the Parquet file is missing; is it cut?".to_owned()));
        }
        if length > DIRECTORY {
            return Err(wrong(format!("{length} bytes; at most {DIRECTORY} are read: make larger row groups")));
        }
        let opened = contained(|| file.try_clone().map(SerializedFileReader::new));
        let reader = match opened {
            Some(Ok(Ok(reader))) => reader,
            Some(Ok(Err(error))) => return Err(wrong(format!("not a valid Parquet file: {error}"))),
            Some(Err(error)) => return Err(error.into()),
            None => return Err(wrong("not a valid Parquet file".to_owned())),
        };
        let metadata = reader.metadata().file_metadata();
        let imu = metadata.key_value_metadata().into_iter().flatten().find(|entry| entry.key == "isotherm.imu");
        if let (Pick::Only(wanted), Some(imu)) = (pick, imu.and_then(|imu| imu.value.as_deref()))
            && imu != wanted.as_str()
        {
            return Err(wrong(format!("samples of {imu}, not of {wanted}; choose with --imu")));
        }
        let columns = columns(&reader).map_err(wrong)?;
        let batch = columns.iter().map(|_| Vec::new()).collect();
        let rows = u64::try_from(metadata.num_rows()).unwrap_or(0);
        let (open, rising) = (Vec::new(), Rising::default());
        Ok(Self { file, size, reader, rows, columns, group: 0, open, batch, next: 0, row: 0, rising })
    }

    /// Bytes read, about.
    pub fn bytes_read(&self) -> u64 {
        let done = self.row as f64 / self.rows.max(1) as f64;
        (self.size as f64 * done) as u64
    }

    pub fn read(&mut self) -> Result<Option<RawSample>, RecordingError> {
        while self.next == self.batch[0].len() {
            if !self.decode()? {
                return Ok(None);
            }
        }
        let mut sample = RawSample::default();
        for (column, values) in self.columns.iter().zip(&self.batch) {
            set(&mut sample, column.place, values[self.next]);
        }
        self.next += 1;
        self.row += 1;
        self.rising.check(&sample).map_err(|message| self.error(message))?;
        Ok(Some(sample))
    }

    /// Decodes the next rows; false at the end.
    fn decode(&mut self) -> Result<bool, RecordingError> {
        self.next = 0;
        self.batch.iter_mut().for_each(Vec::clear);
        if self.open.is_empty() && !self.open_group()? {
            return Ok(false);
        }
        for index in 0..self.columns.len() {
            let (source, values) = (self.columns[index], &mut self.batch[index]);
            let column = &mut self.open[index];
            let decoded = contained(|| match column {
                ColumnReader::Int32ColumnReader(reader) => batch(reader, values, |value| {
                    let whole = if source.unsigned { i64::from(value.cast_unsigned()) } else { i64::from(value) };
                    source.whole(whole)
                }),
                ColumnReader::Int64ColumnReader(reader) => batch(reader, values, |value| source.whole(value)),
                ColumnReader::DoubleColumnReader(reader) => batch(reader, values, |value| Some(value.to_bits())),
                _ => Err("not of its type".to_owned()),
            });
            let decoded = decoded.unwrap_or_else(|| Err("a page that cannot be read".to_owned()));
            decoded.map_err(|message| self.error(format!("{}: {message}", source.name())))?;
        }
        let rows = self.batch[0].len();
        if let Some(other) = self.batch.iter().position(|values| values.len() != rows) {
            let name = self.columns[other].name();
            return Err(self.error(format!("{name} has not as many values as the other columns")));
        }
        if rows == 0 {
            self.open.clear();
        }
        Ok(true)
    }

    /// Opens the columns of the next row group; false if there is none.
    fn open_group(&mut self) -> Result<bool, RecordingError> {
        if self.group == self.reader.num_row_groups() {
            return Ok(false);
        }
        let (reader, file, group) = (&self.reader, &self.file, self.group);
        let opened = contained(|| {
            let group = reader.get_row_group(group).map_err(|error| error.to_string())?;
            let open = self.columns.iter().map(|column| {
                let chunk = group.metadata().column(column.index);
                let (begin, length) = chunk.byte_range();
                pages::check(file, begin, length).map_err(|error| format!("{}: {error}", column.name()))?;
                group.get_column_reader(column.index).map_err(|error| error.to_string())
            });
            open.collect::<Result<Vec<_>, String>>()
        });
        let opened = opened.unwrap_or_else(|| Err("a row group that cannot be read".to_owned()));
        self.open = opened.map_err(|message| self.error(message))?;
        self.group += 1;
        Ok(true)
    }

    fn error(&self, message: String) -> RecordingError {
        RecordingError::Place { place: format!("row {}", self.row), message }
    }
}

/// Where the columns are in the file.
fn columns(reader: &SerializedFileReader<File>) -> Result<Vec<Source>, String> {
    let schema = reader.metadata().file_metadata().schema_descr();
    let (mut columns, mut missing) = (Vec::new(), Vec::new());
    for (place, wanted) in RAW.iter().enumerate() {
        let mut found = (0..schema.num_columns()).filter(|&index| schema.column(index).path().string() == wanted.name);
        let Some(index) = found.next() else {
            if !OPTIONAL.contains(&wanted.name) {
                missing.push(wanted.name);
            }
            continue;
        };
        if found.next().is_some() {
            return Err(format!("the column {} is there twice", wanted.name));
        }
        let column = schema.column(index);
        let fits = match wanted.kind {
            Kind::F64 => column.physical_type() == Physical::DOUBLE,
            _ => matches!(column.physical_type(), Physical::INT32 | Physical::INT64),
        };
        if !fits || column.max_rep_level() > 0 {
            let right = if wanted.kind == Kind::F64 { "doubles" } else { "whole numbers of 32 or 64 bits" };
            return Err(format!("{} is of type {}, give {right}", wanted.name, column.physical_type()));
        }
        let unsigned = match (column.logical_type_ref(), column.converted_type()) {
            (Some(LogicalType::Integer(integer)), _) => !integer.is_signed,
            (_, converted) => matches!(converted, ConvertedType::UINT_32 | ConvertedType::UINT_64),
        };
        columns.push(Source { place, index, unsigned });
    }
    match missing.len() {
        0 => Ok(columns),
        _ => Err(format!("missing columns: {}; is this a recording of raw samples?", missing.join(", "))),
    }
}

/// Appends the next values of a column; nothing at its end.
fn batch<T: DataType>(
    reader: &mut ColumnReaderImpl<T>,
    bits: &mut Vec<u64>,
    value: impl Fn(T::T) -> Option<u64>,
) -> Result<(), String> {
    let (mut levels, mut values) = (Vec::new(), Vec::new());
    let read = reader.read_records(BATCH, Some(&mut levels), None, &mut values);
    let (rows, ..) = read.map_err(|error| error.to_string())?;
    let mut values = values.into_iter();
    for row in 0..rows {
        // A column that may have no value somewhere says where it has one.
        let present = levels.get(row).is_none_or(|level| *level > 0);
        let next = if present { values.next().and_then(&value) } else { missing::<T>() };
        bits.push(next.ok_or_else(|| format!("no number, or one that does not fit, {row} rows further"))?);
    }
    Ok(())
}

/// Programs write NaN as no value.
fn missing<T: DataType>() -> Option<u64> {
    (T::get_physical_type() == Physical::DOUBLE).then(|| f64::NAN.to_bits())
}
