//! Rows as messages in an MCAP file, in the channels `isotherm/<imu>/raw` and `isotherm/<imu>/increment`. The file
//! contains their schemas.

use super::container::McapContainer;
use super::growing::Appender;
use super::publication::PublicationClock;
use crate::protobuf;
use isotherm_recording::columns::{Layout, columns};
use isotherm_recording::rows::RecordedRow;
use isotherm_shared::names::{ImuId, StreamKind};
use isotherm_support::storage::Storage;
use mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

/// Rows of streams that become an MCAP file in a sink.
///
/// All channels come before the first message, so that a reader knows which IMUs there are before it chooses one.
pub(super) struct McapWriter<W: Write> {
    container: McapContainer,
    sink: W,
    streams: Vec<FileStream>,
    message: Vec<u8>,
}

/// An MCAP file that grows. Every flush ends a chunk, so readers can read all flushed messages of an unfinished file.
pub(super) type McapFile = McapWriter<Appender>;

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

impl<W: Write> McapWriter<W> {
    /// Begins a file with a channel for each of `streams`: index in the lists `imus` and `layouts`, and kind of the
    /// stream.
    ///
    /// # Errors
    /// Those of the sink.
    pub(super) fn new(
        sink: W,
        imus: &[ImuId],
        streams: &[(usize, StreamKind)],
        layouts: &[Layout],
    ) -> io::Result<Self> {
        let stream = |&(imu, kind): &(usize, StreamKind)| FileStream::new((imu, imus[imu].clone()), kind, layouts[imu]);
        let streams = streams.iter().map(stream).collect();
        let mut writer = Self { container: McapContainer::default(), sink, streams, message: Vec::new() };
        writer.begin()?;
        Ok(writer)
    }

    /// Begins the file, and its first chunk with the channels of all streams.
    fn begin(&mut self) -> io::Result<()> {
        self.container = McapContainer::new("");
        self.streams.iter_mut().try_for_each(|stream| stream.add_channel(&mut self.container))?;
        self.pass_on()
    }

    /// Adds a message, unless it is of no stream. If the stream's channel has another layout, it gets a second channel.
    ///
    /// # Errors
    /// Those of the sink.
    pub(super) fn write(&mut self, row: &RecordedRow, layout: Layout) -> io::Result<()> {
        let of_row = |stream: &&mut FileStream| (stream.imu.0, stream.kind) == (row.imu, row.stream());
        let Some(stream) = self.streams.iter_mut().find(of_row) else { return Ok(()) };
        let layout = layout.of_stream(stream.kind);
        if stream.layout != layout {
            stream.layout = layout;
            stream.add_channel(&mut self.container)?;
        }
        stream.write(&mut self.container, row, &mut self.message);
        self.pass_on()
    }

    /// Ends the chunk.
    ///
    /// # Errors
    /// Those of the sink. With an [`Appender`] the call can be repeated.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        self.container.end_chunk();
        self.pass_on()?;
        self.sink.flush()
    }

    /// Writes summary and footer.
    ///
    /// # Errors
    /// As [`flush`](Self::flush).
    pub(super) fn finish(&mut self) -> io::Result<()> {
        self.container.finish();
        self.pass_on()?;
        self.sink.flush()
    }

    /// The sink, for a file that is finished.
    pub(super) fn into_sink(self) -> W {
        self.sink
    }

    fn pass_on(&mut self) -> io::Result<()> {
        self.sink.write_all(&self.container.take())
    }
}

impl McapFile {
    /// Creates a file, as [`new`](Self::new).
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
        let mut begun = McapWriter::new(Vec::new(), imus, streams, layouts)?;
        begun.flush()?;
        let sink = Appender::create(storage, path, &begun.sink)?;
        Ok(Self { container: begun.container, sink, streams: begun.streams, message: Vec::new() })
    }

    /// Gives the channels of a file without messages other layouts, at the next flush.
    ///
    /// # Errors
    /// If there are too many channels.
    pub(super) fn change_layouts(&mut self, layouts: &[Layout]) -> io::Result<()> {
        let layout_of = |stream: &FileStream| layouts[stream.imu.0].of_stream(stream.kind);
        if self.streams.iter().all(|stream| stream.layout == layout_of(stream)) {
            return Ok(());
        }
        self.streams.iter_mut().for_each(|stream| stream.layout = layout_of(stream));
        self.sink.restart(Vec::new());
        self.begin()
    }

    /// Size without the open chunk \[bytes\].
    pub(super) fn size(&self) -> u64 {
        self.sink.size()
    }
}

impl FileStream {
    /// A stream without a channel.
    fn new(imu: (usize, ImuId), kind: StreamKind, layout: Layout) -> Self {
        Self { imu, kind, channel: 0, layout: layout.of_stream(kind), clock: PublicationClock::default() }
    }

    /// Adds a message, which is encoded in `message`.
    fn write(&mut self, container: &mut McapContainer, row: &RecordedRow, message: &mut Vec<u8>) {
        message.clear();
        protobuf::encode(row, self.layout, message);
        let header = MessageHeader {
            channel_id: self.channel,
            sequence: row.period().sequence as u32,
            log_time: row.recorded_ns,
            publish_time: self.clock.time_ns(row, row.timestamp_ns()),
        };
        container.write(&header, message);
    }

    /// Adds a channel for messages of the stream's layout.
    fn add_channel(&mut self, container: &mut McapContainer) -> io::Result<()> {
        let (kind, imu, layout) = (self.kind, &self.imu.1, self.layout);
        let schema = protobuf::descriptor(kind, layout);
        let schema = container.add_schema(protobuf::message(kind), "protobuf", &schema)?;
        let units = columns(kind, layout).into_iter().map(|column| (column.name.to_owned(), column.unit.to_owned()));
        let mut metadata: BTreeMap<_, _> = units.collect();
        metadata.insert("imu".to_owned(), imu.to_string());
        let topic = format!("isotherm/{imu}/{}", kind.name());
        self.channel = container.add_channel(schema, &topic, "protobuf", &metadata)?;
        Ok(())
    }
}
