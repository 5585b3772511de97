//! Rows as messages in an MCAP file, in the channels `isotherm/<imu>/raw` and `isotherm/<imu>/increment`. The file
//! contains their schemas.

use super::growing::Appender;
use super::publication::PublicationClock;
use crate::protobuf;
use isotherm_recording::columns::{Layout, columns};
use isotherm_recording::rows::RecordedRow;
use isotherm_shared::names::{ImuId, StreamKind};
use isotherm_support::storage::Storage;
use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;
use std::rc::Rc;

/// An MCAP file that is being written. Every flush ends a chunk, so readers can read all flushed messages of an
/// unfinished file.
///
/// All channels come before the first message, so that a reader knows which IMUs there are before it chooses one.
pub(super) struct McapFile {
    writer: mcap::Writer<NoSeek<MemorySink>>,
    memory: MemorySink,
    file: Appender,
    streams: Vec<FileStream>,
    message: Vec<u8>,
}

/// A stream that is written into a file.
struct FileStream {
    /// Index into the recorder's list of IMUs, and name of the IMU.
    imu: (usize, ImuId),
    kind: StreamKind,
    /// The channel, and the layout of its messages.
    channel: u16,
    layout: Layout,
    clock: PublicationClock,
}

/// The sink of the library. It is in memory, so that an error of the disk never leaves the library in an undefined
/// state.
#[derive(Clone, Default)]
pub(super) struct MemorySink(Rc<RefCell<Vec<u8>>>);

impl MemorySink {
    /// Takes what has been written.
    pub(super) fn take(&self) -> Vec<u8> {
        self.0.take()
    }

    /// Number of bytes that have been written and not taken.
    pub(super) fn len(&self) -> usize {
        self.0.borrow().len()
    }
}

impl Write for MemorySink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().extend_from_slice(bytes);
        Ok(bytes.len())
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl McapFile {
    /// Creates a file with a channel for each of `streams`: index in the lists `imus` and `layouts`, and kind of the
    /// stream.
    ///
    /// # Errors
    /// If it exists or cannot be written.
    pub(super) fn create(
        storage: &dyn Storage,
        path: &Path,
        imus: &[ImuId],
        streams: &[(usize, StreamKind)],
        layouts: &[Layout],
    ) -> io::Result<Self> {
        let memory = MemorySink::default();
        let mut writer = begin(&memory)?;
        let streams = streams.iter().map(|&(imu, kind)| {
            let mut stream = FileStream::new((imu, imus[imu].clone()), kind, layouts[imu]);
            stream.add_channel(&mut writer)?;
            Ok(stream)
        });
        let streams = streams.collect::<io::Result<_>>()?;
        writer.flush().map_err(io_error)?;
        let file = Appender::create(storage, path, &memory.take())?;
        Ok(Self { writer, memory, file, streams, message: Vec::new() })
    }

    /// Gives the channels of a file without messages other layouts, at the next flush.
    ///
    /// # Errors
    /// If the library refuses them.
    pub(super) fn change_layouts(&mut self, layouts: &[Layout]) -> io::Result<()> {
        let layout_of = |stream: &FileStream| layouts[stream.imu.0].of_stream(stream.kind);
        if self.streams.iter().all(|stream| stream.layout == layout_of(stream)) {
            return Ok(());
        }
        self.memory = MemorySink::default();
        self.writer = begin(&self.memory)?;
        self.file.restart(Vec::new());
        for stream in &mut self.streams {
            stream.layout = layout_of(stream);
            stream.add_channel(&mut self.writer)?;
        }
        Ok(())
    }

    /// Adds a message. If the stream's channel has another layout, it gets a second channel.
    ///
    /// # Errors
    /// If the library refuses it.
    pub(super) fn write(&mut self, row: &RecordedRow, layout: Layout) -> io::Result<()> {
        let of_row = |stream: &&mut FileStream| (stream.imu.0, stream.kind) == (row.imu, row.stream());
        let Some(stream) = self.streams.iter_mut().find(of_row) else { return Ok(()) };
        let layout = layout.of_stream(stream.kind);
        if stream.layout != layout {
            stream.layout = layout;
            stream.add_channel(&mut self.writer)?;
        }
        stream.write(&mut self.writer, row, &mut self.message)
    }

    /// Ends the chunk and appends it to the file.
    ///
    /// # Errors
    /// If the file cannot be written. The call can be repeated.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        self.writer.flush().map_err(io_error)?;
        self.append()
    }

    /// Writes summary and footer. The call can be repeated after an error.
    ///
    /// # Errors
    /// As [`flush`](Self::flush).
    pub(super) fn finish(&mut self) -> io::Result<()> {
        self.writer.finish().map_err(io_error)?;
        self.append()
    }

    fn append(&mut self) -> io::Result<()> {
        self.file.pending.append(&mut self.memory.take());
        self.file.flush()
    }

    /// Size without the open chunk \[bytes\].
    pub(super) fn size(&self) -> u64 {
        self.file.size() + self.memory.len() as u64
    }
}

/// Rows of one stream that become one MCAP file from beginning to end, in any sink.
pub(super) struct McapStream<W: Write> {
    writer: mcap::Writer<NoSeek<W>>,
    stream: FileStream,
    message: Vec<u8>,
}

impl<W: Write> McapStream<W> {
    /// Begins a file of a stream.
    ///
    /// # Errors
    /// Those of the sink and of the library.
    pub(super) fn new(sink: W, imu: &ImuId, kind: StreamKind, layout: Layout) -> io::Result<Self> {
        let mut writer = options().create(NoSeek::new(sink)).map_err(io_error)?;
        let mut stream = FileStream::new((0, imu.clone()), kind, layout);
        stream.add_channel(&mut writer)?;
        Ok(Self { writer, stream, message: Vec::new() })
    }

    /// Adds a message.
    ///
    /// # Errors
    /// Those of the sink and of the library.
    pub(super) fn write(&mut self, row: &RecordedRow) -> io::Result<()> {
        self.stream.write(&mut self.writer, row, &mut self.message)
    }

    /// Writes summary and footer, and returns the sink.
    ///
    /// # Errors
    /// Those of the sink.
    pub(super) fn finish(mut self) -> io::Result<W> {
        self.writer.finish().map_err(io_error)?;
        Ok(self.writer.into_inner().into_inner())
    }
}

/// A file in memory.
fn begin(memory: &MemorySink) -> io::Result<mcap::Writer<NoSeek<MemorySink>>> {
    options().create(NoSeek::new(memory.clone())).map_err(io_error)
}

/// How all MCAP files are written.
pub(crate) fn options() -> WriteOptions {
    let library = concat!("isotherm ", env!("CARGO_PKG_VERSION"));
    // The sink cannot seek.
    let options = WriteOptions::new().library(library).disable_seeking(true);
    // Compression runs in this thread. Without zstd there is none.
    #[cfg(not(target_family = "wasm"))]
    let options = options.compression_level(1).compression_threads(0);
    options
}

impl FileStream {
    /// A stream without a channel.
    fn new(imu: (usize, ImuId), kind: StreamKind, layout: Layout) -> Self {
        Self { imu, kind, channel: 0, layout: layout.of_stream(kind), clock: PublicationClock::default() }
    }

    /// Adds a message, which is encoded in `message`.
    fn write<W: Write>(
        &mut self,
        writer: &mut mcap::Writer<NoSeek<W>>,
        row: &RecordedRow,
        message: &mut Vec<u8>,
    ) -> io::Result<()> {
        message.clear();
        protobuf::encode(row, self.layout, message);
        let header = MessageHeader {
            channel_id: self.channel,
            sequence: row.period().sequence as u32,
            log_time: row.recorded_ns,
            publish_time: self.clock.time_ns(row, row.timestamp_ns()),
        };
        writer.write_to_known_channel(&header, message).map_err(io_error)
    }

    /// Adds a channel for messages of the stream's layout.
    fn add_channel<W: Write>(&mut self, writer: &mut mcap::Writer<NoSeek<W>>) -> io::Result<()> {
        let (kind, imu, layout) = (self.kind, &self.imu.1, self.layout);
        let schema = protobuf::descriptor(kind, layout);
        let schema = writer.add_schema(protobuf::message(kind), "protobuf", &schema).map_err(io_error)?;
        let units = columns(kind, layout).into_iter().map(|column| (column.name.to_owned(), column.unit.to_owned()));
        let mut metadata: BTreeMap<_, _> = units.collect();
        metadata.insert("imu".to_owned(), imu.to_string());
        let topic = format!("isotherm/{imu}/{}", kind.name());
        self.channel = writer.add_channel(schema, &topic, "protobuf", &metadata).map_err(io_error)?;
        Ok(())
    }
}

/// An error of the library.
pub(super) fn io_error(error: McapError) -> io::Error {
    io::Error::other(error)
}
