//! The bytes of a Parquet file of one stream: row groups, then the footer. With checks or without.

use crate::HAS_ZSTD;
use crate::seal::{FileParts, GroupChecks, KEY, MAGIC, checks_of, footer, footer_seal, group_seal};
use isotherm_recording::columns::{Column, ColumnKind, Layout, columns};
use isotherm_recording::rows::{RecordedRow, append_value};
use isotherm_shared::names::{ImuId, StreamKind};
use parquet::basic::{Compression, ConvertedType, Encoding, LogicalType, Repetition, Type as Physical, ZstdLevel};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int32Type, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::{KeyValue, RowGroupMetaData};
use parquet::file::properties::{EnabledStatistics, WriterProperties, WriterPropertiesPtr};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{ColumnPath, Type};
use std::io;
use std::sync::Arc;

/// Rows of a full row group. Larger groups are read faster, but the open group is written again at every flush.
pub(super) const ROW_GROUP: usize = 1 << 16;

/// Whether a file has checks.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum Checks {
    /// As [`seal`](crate::seal) has them.
    Written,
    /// None: nothing but Parquet.
    Absent,
}

/// Makes the bytes of a file of one stream.
pub(super) struct Encoder {
    pub(super) layout: Layout,
    properties: WriterPropertiesPtr,
    open: OpenGroup,
    file: FileEncoder,
    /// Rows of a full row group: [`ROW_GROUP`], fewer in tests, and more in a long file that is not flushed.
    pub(super) group_rows: usize,
    /// Length of the last footer \[bytes\].
    pub(super) footer: usize,
}

impl Encoder {
    pub(super) fn new(imu: &ImuId, stream: StreamKind, layout: Layout, checks: Checks) -> io::Result<Self> {
        let columns = columns(stream, layout);
        let schema = Arc::new(schema(&columns).map_err(io_error)?);
        let properties = Arc::new(properties(&columns).map_err(io_error)?);
        let created_by = Some(properties.created_by().to_owned());
        let parts = FileParts { schema, created_by, metadata: metadata(&columns, imu, stream) };
        let file = FileEncoder::new(parts, checks);
        Ok(Self { layout, properties, open: OpenGroup::new(&columns), file, group_rows: ROW_GROUP, footer: 0 })
    }

    /// Adds a row to the open row group. Returns whether the group is full.
    pub(super) fn push(&mut self, row: &RecordedRow) -> bool {
        self.open.push(row, self.layout);
        self.open.rows >= self.group_rows
    }

    /// Whether rows are in the open row group.
    pub(super) const fn has_open(&self) -> bool {
        self.open.rows > 0
    }

    /// Ends the open row group, which begins at `offset`. Returns its bytes.
    pub(super) fn end_group(&mut self, offset: u64) -> io::Result<Vec<u8>> {
        let bytes = self.encode(offset)?;
        self.open.clear();
        Ok(bytes)
    }

    /// The bytes of the end of a file in which the open row group begins at `offset`: this group, and the footer.
    pub(super) fn tail(&mut self, offset: u64) -> io::Result<Vec<u8>> {
        let has_open = self.has_open();
        let mut bytes = if has_open { self.encode(offset)? } else { Vec::new() };
        let footer = self.file.footer();
        if has_open {
            self.file.remove_last();
        }
        let mut footer = footer.map_err(io_error)?;
        self.footer = footer.len();
        bytes.append(&mut footer);
        Ok(bytes)
    }

    /// The number of full row groups.
    pub(super) const fn groups(&self) -> usize {
        self.file.groups.len()
    }

    /// Adds the open row group to the file. Returns its bytes.
    fn encode(&mut self, offset: u64) -> io::Result<Vec<u8>> {
        let (mut bytes, group) = encode(&self.file.parts, &self.properties, &self.open).map_err(io_error)?;
        let mut seal = self.file.add(&bytes, &group, offset).map_err(io_error)?;
        bytes.append(&mut seal);
        Ok(bytes)
    }
}

/// Makes the bytes of a file of encoded row groups.
pub(crate) struct FileEncoder {
    parts: FileParts,
    groups: Vec<RowGroupMetaData>,
    /// Of a file with checks: those of each row group.
    checks: Option<Vec<GroupChecks>>,
}

impl FileEncoder {
    pub(crate) fn new(mut parts: FileParts, checks: Checks) -> Self {
        parts.metadata.retain(|entry| entry.key != KEY);
        Self { parts, groups: Vec::new(), checks: (checks == Checks::Written).then(Vec::new) }
    }

    /// Adds a row group with these bytes, which are written at `offset`. `group` is its entry in the footer of a file
    /// with this one group. Returns the seal that is written behind it; nothing for a file without checks.
    pub(crate) fn add(&mut self, bytes: &[u8], group: &RowGroupMetaData, offset: u64) -> Result<Vec<u8>, ParquetError> {
        let (ordinal, mut seal) = (self.groups.len(), Vec::new());
        if let Some(checks) = &mut self.checks {
            let own = checks_of(group, bytes, SINGLE)
                .ok_or_else(|| ParquetError::General("a row group without its bytes".to_owned()))?;
            // What is said of the units is in the footer of the file.
            let named = |entry: &&KeyValue| [IMU, STREAM].contains(&entry.key.as_str());
            let parts = FileParts {
                schema: Arc::clone(&self.parts.schema),
                created_by: self.parts.created_by.clone(),
                metadata: self.parts.metadata.iter().filter(named).cloned().collect(),
            };
            let mut single = vec![moved(group, SINGLE, SINGLE, ordinal)?];
            let footer = footer(&parts, &mut single, Some(std::slice::from_ref(&own)))?;
            seal = group_seal(bytes.len() as u64, &footer);
            checks.push(own);
        }
        self.groups.push(moved(group, SINGLE, offset, ordinal)?);
        Ok(seal)
    }

    fn remove_last(&mut self) {
        self.groups.pop();
        self.checks.as_mut().map(Vec::pop);
    }

    /// The footer of a file with these row groups, with its seal.
    pub(crate) fn footer(&mut self) -> Result<Vec<u8>, ParquetError> {
        let footer = footer(&self.parts, &mut self.groups, self.checks.as_deref())?;
        let seal = self.checks.as_ref().map(|_| footer_seal(&footer));
        Ok(seal.into_iter().flatten().chain(footer).collect())
    }
}

/// Where a row group begins in a file with this one group.
pub(crate) const SINGLE: u64 = MAGIC.len() as u64;
/// Keys of the names of IMU and stream in a footer.
pub(crate) const IMU: &str = "isotherm.imu";
pub(crate) const STREAM: &str = "isotherm.stream";

/// Encodes a row group: its bytes, and its entry in the footer of a file with this one group.
fn encode(
    parts: &FileParts,
    properties: &WriterPropertiesPtr,
    columns: &OpenGroup,
) -> Result<(Vec<u8>, RowGroupMetaData), ParquetError> {
    // The library writes a complete file in memory; its magic number and footer are removed.
    let mut file = SerializedFileWriter::new(Vec::new(), Arc::clone(&parts.schema), Arc::clone(properties))?;
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
    Ok((bytes, group.as_ref().clone()))
}

/// The entry of a row group that begins at `to` instead of `from`. It names no index, which is not written.
pub(crate) fn moved(
    group: &RowGroupMetaData,
    from: u64,
    to: u64,
    ordinal: usize,
) -> Result<RowGroupMetaData, ParquetError> {
    let shift = to as i64 - from as i64;
    let columns = group.columns().iter().map(|column| {
        let moved = column.clone().into_builder().set_data_page_offset(column.data_page_offset() + shift);
        let moved = moved.set_dictionary_page_offset(column.dictionary_page_offset().map(|offset| offset + shift));
        let moved = moved.set_index_page_offset(None).set_bloom_filter_offset(None).set_bloom_filter_length(None);
        let moved = moved.set_offset_index_offset(None).set_offset_index_length(None);
        moved.set_column_index_offset(None).set_column_index_length(None).build()
    });
    let columns = columns.collect::<Result<Vec<_>, _>>()?;
    let builder = group.clone().into_builder().set_column_metadata(columns).set_file_offset(to as i64);
    builder.set_ordinal(ordinal as i32).build()
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

pub(crate) fn metadata(columns: &[Column], imu: &ImuId, stream: StreamKind) -> Vec<KeyValue> {
    let named = |key: &str, value: &str| KeyValue::new(key.to_owned(), value.to_owned());
    let mut metadata = vec![named(IMU, imu.as_str()), named(STREAM, stream.name())];
    metadata.extend(columns.iter().map(|column| named(&format!("isotherm.unit.{}", column.name), column.unit)));
    metadata
}

fn properties(columns: &[Column]) -> Result<WriterProperties, ParquetError> {
    let compression = if HAS_ZSTD { Compression::ZSTD(ZstdLevel::try_new(1)?) } else { Compression::SNAPPY };
    let mut properties = WriterProperties::builder()
        .set_created_by(concat!("isotherm ", env!("CARGO_PKG_VERSION")).to_owned())
        .set_compression(compression)
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
struct OpenGroup {
    rows: usize,
    values: Vec<ColumnBuffer>,
}

enum ColumnBuffer {
    U64(Vec<i64>),
    U32(Vec<i32>),
    F64(Vec<f64>),
    Text(Vec<ByteArray>),
}

impl OpenGroup {
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

pub(super) fn io_error(error: ParquetError) -> io::Error {
    io::Error::other(error)
}
