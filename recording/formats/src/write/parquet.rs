//! Rows in a Parquet file that is complete at every instant.
//!
//! A Parquet file has its footer at the end, so it cannot simply grow. Two files take turns, a visible one under the
//! name and a hidden one. At a flush the hidden file gets the full row groups that it lacks, then the open row group,
//! then the footer. Then the two files exchange their names in one step. A reader that opens the name, also after a
//! crash, gets all rows up to the last flush.
//!
//! Over 400 lines: the file that grows and the stream that does not share how a row group and a footer are encoded.

use super::growing::{create, staged_file};
use isotherm_files::{exchange, sync_folder};
use isotherm_recording::columns::{Column, ColumnKind, Layout};
use isotherm_recording::rows::{RecordedRow, append_value, columns};
use isotherm_shared::stream::{ImuId, StreamKind};
use parquet::basic::{Compression, ConvertedType, Encoding, LogicalType, Repetition, Type as Physical, ZstdLevel};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int32Type, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::{FileMetaData, KeyValue, ParquetMetaData, ParquetMetaDataWriter, RowGroupMetaData};
use parquet::file::properties::{EnabledStatistics, WriterProperties, WriterPropertiesPtr};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{ColumnPath, SchemaDescriptor, Type, TypePtr};
use std::fs::{self, File};
use std::io;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::NamedTempFile;

/// Rows of a full row group. Larger groups are read faster, but the open group is written again at every flush.
const ROW_GROUP: usize = 1 << 16;
const MAGIC: &[u8] = b"PAR1";

/// A Parquet file of one stream that is being written.
pub(super) struct ParquetFile {
    path: PathBuf,
    encoder: Encoder,
    /// Length of the body: magic number and full row groups \[bytes\].
    body: u64,
    /// The end of the body: the bytes that are not yet in both files.
    recent: Vec<u8>,
    /// The file under the name, and how much of the body it has \[bytes\].
    visible: (File, u64),
    /// The hidden file, in the same way; `None` before the first flush, and always between flushes if names cannot be
    /// exchanged.
    hidden: Option<(NamedTempFile, u64)>,
    /// Length of open row group and footer at the last flush \[bytes\].
    tail: u64,
    /// Whether the file system can exchange two names; true until it refuses.
    exchanges: bool,
}

impl ParquetFile {
    /// Creates a file without rows.
    ///
    /// # Errors
    /// If it exists or cannot be written.
    pub(super) fn create(path: &Path, imu: &ImuId, stream: StreamKind, layout: Layout) -> io::Result<Self> {
        let mut encoder = Encoder::new(imu, stream, layout)?;
        let mut bytes = MAGIC.to_vec();
        bytes.append(&mut encoder.footer(None)?);
        let (visible, body) = (create(path, &bytes)?, MAGIC.len() as u64);
        Ok(Self {
            path: path.to_owned(),
            encoder,
            body,
            recent: Vec::new(),
            visible: (visible, body),
            hidden: None,
            tail: 0,
            exchanges: true,
        })
    }

    /// Gives a file without rows another layout, at the next flush.
    ///
    /// # Errors
    /// If the library refuses it.
    pub(super) fn change_layout(&mut self, imu: &ImuId, stream: StreamKind, layout: Layout) -> io::Result<()> {
        if layout != self.encoder.layout {
            self.encoder = Encoder::new(imu, stream, layout)?;
        }
        Ok(())
    }

    /// Adds a row.
    ///
    /// # Errors
    /// If the library refuses it.
    pub(super) fn write(&mut self, row: &RecordedRow) -> io::Result<()> {
        if self.encoder.push(row) {
            let mut bytes = self.encoder.end_group(self.body)?;
            self.body += bytes.len() as u64;
            self.recent.append(&mut bytes);
        }
        Ok(())
    }

    /// Makes all rows so far visible and durable.
    ///
    /// # Errors
    /// If the disk is full, for example. Rows that were visible stay so, and the call can be repeated.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        let (mut tail, open) = match self.encoder.open.rows {
            0 => (Vec::new(), None),
            _ => self.encoder.encode_open(self.body).map(|(bytes, group)| (bytes, Some(group)))?,
        };
        tail.append(&mut self.encoder.footer(open)?);
        let (hidden, has) = match &mut self.hidden {
            Some(hidden) => hidden,
            None => self.hidden.insert((staged_file(&self.path)?, 0)),
        };
        let file = hidden.as_file();
        // First the bytes that only the visible file has, if the hidden one is new; then the bytes in memory; then the
        // tail.
        let recent = self.body - self.recent.len() as u64;
        if *has < recent {
            copy(&self.visible.0, file, *has, recent)?;
            *has = recent;
        }
        file.write_all_at(&self.recent[(*has - recent) as usize..], *has)?;
        *has = self.body;
        file.write_all_at(&tail, self.body)?;
        file.set_len(self.body + tail.len() as u64)?;
        file.sync_data()?;
        self.tail = tail.len() as u64;
        self.exchange()?;
        // Both files have the body up to here.
        let both = self.visible.1.min(self.hidden.as_ref().map_or(self.body, |(_, has)| *has));
        self.recent.drain(..(both.saturating_sub(recent) as usize).min(self.recent.len()));
        Ok(())
    }

    /// Size \[bytes\]; exact after a flush.
    pub(super) const fn size(&self) -> u64 {
        self.body + self.tail
    }

    /// Exchanges the names of the hidden and the visible file.
    fn exchange(&mut self) -> io::Result<()> {
        let Some((hidden, has)) = &mut self.hidden else { return Ok(()) };
        if self.exchanges {
            self.exchanges = exchange(hidden.path(), &self.path)?;
        }
        if self.exchanges {
            std::mem::swap(hidden.as_file_mut(), &mut self.visible.0);
            std::mem::swap(has, &mut self.visible.1);
            return sync_folder(&self.path);
        }
        // The hidden file replaces the visible one, and the next flush makes a new hidden file. If the user has removed
        // the file, this is an error, and the file is not created again.
        fs::metadata(&self.path)?;
        if let Some((hidden, has)) = self.hidden.take() {
            self.visible = (hidden.persist(&self.path).map_err(|error| error.error)?, has);
            sync_folder(&self.path)?;
        }
        Ok(())
    }
}

/// Rows that become one Parquet file from beginning to end, in any sink. Nothing can be read before it is finished.
pub struct ParquetStream<W> {
    sink: W,
    encoder: Encoder,
    /// Bytes written.
    length: u64,
}

impl<W: io::Write> ParquetStream<W> {
    /// Begins a file of a stream.
    ///
    /// # Errors
    /// Those of the sink and of the library.
    pub fn new(mut sink: W, imu: &ImuId, stream: StreamKind, layout: Layout) -> io::Result<Self> {
        let encoder = Encoder::new(imu, stream, layout)?;
        sink.write_all(MAGIC)?;
        Ok(Self { sink, encoder, length: MAGIC.len() as u64 })
    }

    /// Adds a row.
    ///
    /// # Errors
    /// Those of the sink and of the library.
    pub fn write(&mut self, row: &RecordedRow) -> io::Result<()> {
        if self.encoder.push(row) { self.end_group() } else { Ok(()) }
    }

    fn end_group(&mut self) -> io::Result<()> {
        let bytes = self.encoder.end_group(self.length)?;
        self.length += bytes.len() as u64;
        self.sink.write_all(&bytes)
    }

    /// Writes the footer and returns the sink.
    ///
    /// # Errors
    /// Those of the sink and of the library.
    pub fn finish(mut self) -> io::Result<W> {
        if self.encoder.open.rows > 0 {
            self.end_group()?;
        }
        self.sink.write_all(&self.encoder.footer(None)?)?;
        self.sink.flush()?;
        Ok(self.sink)
    }
}

/// Makes the bytes of a file of one stream: row groups, then the footer.
struct Encoder {
    layout: Layout,
    schema: TypePtr,
    properties: WriterPropertiesPtr,
    /// The full row groups so far.
    groups: Vec<RowGroupMetaData>,
    open: ParquetColumns,
}

impl Encoder {
    fn new(imu: &ImuId, stream: StreamKind, layout: Layout) -> io::Result<Self> {
        let columns = columns(stream, layout);
        let schema = Arc::new(schema(&columns).map_err(io_error)?);
        let properties = Arc::new(properties(&columns, imu, stream).map_err(io_error)?);
        Ok(Self { layout, schema, properties, groups: Vec::new(), open: ParquetColumns::new(&columns) })
    }

    /// Adds a row to the open row group. Returns whether the group is full.
    fn push(&mut self, row: &RecordedRow) -> bool {
        self.open.push(row, self.layout);
        self.open.rows >= ROW_GROUP
    }

    /// Ends the open row group, which begins at `offset`. Returns its bytes.
    fn end_group(&mut self, offset: u64) -> io::Result<Vec<u8>> {
        let (bytes, group) = self.encode_open(offset)?;
        self.open.clear();
        self.groups.push(group);
        Ok(bytes)
    }

    /// The bytes of the open row group, and its entry in the footer of a file in which it begins at `offset`.
    fn encode_open(&self, offset: u64) -> io::Result<(Vec<u8>, RowGroupMetaData)> {
        encode(&self.schema, &self.properties, &self.open, offset, self.groups.len()).map_err(io_error)
    }

    /// The footer of a file with the full row groups, and then `open`.
    fn footer(&mut self, open: Option<RowGroupMetaData>) -> io::Result<Vec<u8>> {
        footer(&self.schema, &self.properties, &mut self.groups, open).map_err(io_error)
    }
}

fn copy(from: &File, to: &File, begin: u64, end: u64) -> io::Result<()> {
    let mut buffer = vec![0; 1 << 20];
    let mut at = begin;
    while at < end {
        let length = buffer.len().min((end - at) as usize);
        from.read_exact_at(&mut buffer[..length], at)?;
        to.write_all_at(&buffer[..length], at)?;
        at += length as u64;
    }
    Ok(())
}

/// Encodes a row group: its bytes, and its entry in the footer of a file in which it begins at `offset`.
fn encode(
    schema: &TypePtr,
    properties: &WriterPropertiesPtr,
    columns: &ParquetColumns,
    offset: u64,
    ordinal: usize,
) -> Result<(Vec<u8>, RowGroupMetaData), ParquetError> {
    // The library writes a complete file in memory; its magic number and footer are removed.
    let mut file = SerializedFileWriter::new(Vec::new(), Arc::clone(schema), Arc::clone(properties))?;
    let mut group = file.next_row_group()?;
    for values in &columns.values {
        let Some(mut column) = group.next_column()? else { break };
        match values {
            ColumnBuffer::U64(values) => column.typed::<Int64Type>().write_batch(values, None, None)?,
            ColumnBuffer::U32(values) => column.typed::<Int32Type>().write_batch(values, None, None)?,
            ColumnBuffer::F64(values) => column.typed::<DoubleType>().write_batch(values, None, None)?,
            ColumnBuffer::Text(values) => column.typed::<ByteArrayType>().write_batch(values, None, None)?,
        };
        column.close()?;
    }
    let group = group.close()?;
    let end = file.bytes_written();
    let mut bytes = file.into_inner()?;
    bytes.truncate(end);
    bytes.drain(..MAGIC.len());

    Ok((bytes, moved(&group, offset, ordinal)?))
}

/// The entry of a row group that begins at `offset`, and not behind the magic number.
fn moved(group: &RowGroupMetaData, offset: u64, ordinal: usize) -> Result<RowGroupMetaData, ParquetError> {
    let shift = offset as i64 - MAGIC.len() as i64;
    let columns = group.columns().iter().map(|column| {
        let moved = column.clone().into_builder().set_data_page_offset(column.data_page_offset() + shift);
        moved.set_dictionary_page_offset(column.dictionary_page_offset().map(|offset| offset + shift)).build()
    });
    let columns = columns.collect::<Result<Vec<_>, _>>()?;
    let builder = group.clone().into_builder().set_column_metadata(columns).set_file_offset(offset as i64);
    builder.set_ordinal(ordinal as i32).build()
}

/// Encodes the footer of a file with these row groups.
fn footer(
    schema: &TypePtr,
    properties: &WriterPropertiesPtr,
    groups: &mut Vec<RowGroupMetaData>,
    open: Option<RowGroupMetaData>,
) -> Result<Vec<u8>, ParquetError> {
    let full = groups.len();
    groups.extend(open);
    let rows = groups.iter().map(RowGroupMetaData::num_rows).sum();
    let descriptor = Arc::new(SchemaDescriptor::new(Arc::clone(schema)));
    let created_by = Some(properties.created_by().to_owned());
    let file = FileMetaData::new(1, rows, created_by, properties.key_value_metadata().cloned(), descriptor, None);
    let metadata = ParquetMetaData::new(file, std::mem::take(groups));
    let mut bytes = Vec::new();
    let written = ParquetMetaDataWriter::new(&mut bytes, &metadata).finish();
    *groups = metadata.into_builder().take_row_groups();
    groups.truncate(full);
    written.map(|()| bytes)
}

fn schema(columns: &[Column]) -> Result<Type, ParquetError> {
    let fields = columns.iter().map(|column| {
        let (physical, logical) = match column.kind {
            ColumnKind::U64 => (Physical::INT64, Some(LogicalType::integer(64, false))),
            ColumnKind::U32 => (Physical::INT32, Some(LogicalType::integer(32, false))),
            ColumnKind::F64 => (Physical::DOUBLE, None),
            ColumnKind::Hex | ColumnKind::Flags => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let field = Type::primitive_type_builder(column.name, physical).with_repetition(Repetition::REQUIRED);
        field.with_logical_type(logical).with_converted_type(ConvertedType::NONE).build().map(Arc::new)
    });
    Type::group_type_builder("isotherm").with_fields(fields.collect::<Result<_, _>>()?).build()
}

fn properties(columns: &[Column], imu: &ImuId, stream: StreamKind) -> Result<WriterProperties, ParquetError> {
    let named = |key: &str, value: &str| KeyValue::new(key.to_owned(), value.to_owned());
    let mut metadata = vec![named("isotherm.imu", imu.as_str()), named("isotherm.stream", stream.name())];
    metadata.extend(columns.iter().map(|column| named(&format!("isotherm.unit.{}", column.name), column.unit)));
    let mut properties = WriterProperties::builder()
        .set_created_by(concat!("isotherm ", env!("CARGO_PKG_VERSION")).to_owned())
        .set_key_value_metadata(Some(metadata))
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(1)?))
        .set_statistics_enabled(EnabledStatistics::None)
        .set_offset_index_disabled(true);
    for column in columns {
        let path = ColumnPath::from(column.name);
        // Counting columns compress well as differences, doubles when their bytes are stored in separate streams.
        let encoding = match column.kind {
            ColumnKind::U64 | ColumnKind::U32 => Some(Encoding::DELTA_BINARY_PACKED),
            ColumnKind::F64 => Some(Encoding::BYTE_STREAM_SPLIT),
            ColumnKind::Hex | ColumnKind::Flags => None,
        };
        if let Some(encoding) = encoding {
            properties = properties.set_column_dictionary_enabled(path.clone(), false);
            properties = properties.set_column_encoding(path.clone(), encoding);
        }
        if column.name.ends_with("_ns") {
            properties = properties.set_column_statistics_enabled(path, EnabledStatistics::Chunk);
        }
    }
    Ok(properties.build())
}

/// The rows of a row group, column by column.
struct ParquetColumns {
    rows: usize,
    values: Vec<ColumnBuffer>,
}

enum ColumnBuffer {
    U64(Vec<i64>),
    U32(Vec<i32>),
    F64(Vec<f64>),
    Text(Vec<ByteArray>),
}

impl ParquetColumns {
    fn new(columns: &[Column]) -> Self {
        let values = columns.iter().map(|column| match column.kind {
            ColumnKind::U64 => ColumnBuffer::U64(Vec::new()),
            ColumnKind::U32 => ColumnBuffer::U32(Vec::new()),
            ColumnKind::F64 => ColumnBuffer::F64(Vec::new()),
            ColumnKind::Hex | ColumnKind::Flags => ColumnBuffer::Text(Vec::new()),
        });
        Self { rows: 0, values: values.collect() }
    }

    fn push(&mut self, row: &RecordedRow, layout: Layout) {
        let mut buffers = self.values.iter_mut();
        row.visit(layout, |column, value| match buffers.next() {
            Some(ColumnBuffer::U64(values)) => values.push(value.cast_signed()),
            Some(ColumnBuffer::U32(values)) => values.push((value as u32).cast_signed()),
            Some(ColumnBuffer::F64(values)) => values.push(f64::from_bits(value)),
            Some(ColumnBuffer::Text(values)) => {
                let mut text = Vec::new();
                append_value(column.kind, value, &mut text);
                values.push(ByteArray::from(text));
            }
            None => {}
        });
        self.rows += 1;
    }

    fn clear(&mut self) {
        self.rows = 0;
        for values in &mut self.values {
            match values {
                ColumnBuffer::U64(values) => values.clear(),
                ColumnBuffer::U32(values) => values.clear(),
                ColumnBuffer::F64(values) => values.clear(),
                ColumnBuffer::Text(values) => values.clear(),
            }
        }
    }
}

fn io_error(error: ParquetError) -> io::Error {
    io::Error::other(error)
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_shared::wire::{RawSample, StreamSample};
    use parquet::file::reader::{FileReader as _, SerializedFileReader};

    /// After every flush the file has all rows, with and without the exchange of names.
    #[test]
    fn every_flush_leaves_a_complete_file() {
        for exchanges in [true, false] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("r.parquet");
            let mut file =
                ParquetFile::create(&path, &"imu-a".parse().unwrap(), StreamKind::Raw, Layout::default()).unwrap();
            file.exchanges = exchanges;
            let mut rows = 0;
            // Within a row group, beyond its end, two groups at once, exactly up to its end, and none.
            for more in [0, 1, 10, ROW_GROUP, 2 * ROW_GROUP, ROW_GROUP - 11, 0, 5] {
                for _ in 0..more {
                    let raw = RawSample { sequence: rows, ..RawSample::default() };
                    file.write(&RecordedRow { imu: 0, recorded_ns: 0, sample: StreamSample::Raw(raw) }).unwrap();
                    rows += 1;
                }
                file.flush().unwrap();
                let reader = SerializedFileReader::new(File::open(&path).unwrap()).unwrap();
                assert_eq!(reader.metadata().file_metadata().num_rows() as u64, rows);
                let sequences = (0..reader.num_row_groups()).flat_map(|group| {
                    let mut column = reader.get_row_group(group).unwrap().get_column_reader(2).unwrap();
                    let parquet::column::reader::ColumnReader::Int64ColumnReader(column) = &mut column else {
                        return vec![];
                    };
                    let mut values = Vec::new();
                    column.read_records(ROW_GROUP, None, None, &mut values).unwrap();
                    values
                });
                assert!(sequences.eq(0..rows as i64), "{exchanges} {rows}");
                assert_eq!(fs::metadata(&path).unwrap().len(), file.size());
            }
            drop(file);
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left beside it");
        }
    }
}
