//! Rows as messages in an MCAP file: `isotherm/<imu>/raw` and `isotherm/<imu>/increment`, described in the file itself.

use super::growing::Growing;
use crate::protobuf;
use isotherm_recording::rows::{RecordedRow, columns};
use isotherm_shared::stream::{ImuId, StreamKind};
use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;
use std::rc::Rc;

/// An MCAP file that is being written. Every flush ends a chunk, so that what has been flushed can be read without what follows.
pub struct McapFile {
    writer: mcap::Writer<NoSeek<Memory>>,
    memory: Memory,
    file: Growing,
    /// By IMU and stream.
    channels: Vec<[Option<u16>; 2]>,
    message: Vec<u8>,
}

/// Where the library writes to: what the disk does is no matter to it.
#[derive(Clone, Default)]
struct Memory(Rc<RefCell<Vec<u8>>>);

impl Write for Memory {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().extend_from_slice(bytes);
        Ok(bytes.len())
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl McapFile {
    /// A new file with a channel for each of `streams`: place in the list `imus`, and which of its streams.
    ///
    /// # Errors
    /// If it exists or cannot be written.
    pub fn create(path: &Path, imus: &[ImuId], streams: &[(usize, StreamKind)]) -> io::Result<Self> {
        let memory = Memory::default();
        let library = concat!("isotherm ", env!("CARGO_PKG_VERSION"));
        // Compressed in this thread; all in memory, in order.
        let options = WriteOptions::new().library(library).disable_seeking(true);
        let options = options.compression_level(1).compression_threads(0);
        let mut writer = options.create(NoSeek::new(memory.clone())).map_err(other)?;
        let mut channels = vec![[None; 2]; imus.len()];
        for &(imu, stream) in streams {
            let schema = protobuf::descriptor(stream);
            let schema = writer.add_schema(protobuf::message(stream), "protobuf", &schema).map_err(other)?;
            let units = columns(stream).iter().map(|column| (column.name.to_owned(), column.unit.to_owned()));
            let mut metadata: BTreeMap<_, _> = units.collect();
            metadata.insert("imu".to_owned(), imus[imu].to_string());
            let topic = format!("isotherm/{}/{}", imus[imu], stream.name());
            let channel = writer.add_channel(schema, &topic, "protobuf", &metadata).map_err(other)?;
            channels[imu][stream as usize] = Some(channel);
        }
        writer.flush().map_err(other)?;
        let file = Growing::create(path, &memory.0.take())?;
        Ok(Self { writer, memory, file, channels, message: Vec::new() })
    }

    /// Adds a message.
    ///
    /// # Errors
    /// If the library refuses it.
    pub fn write(&mut self, row: &RecordedRow) -> io::Result<()> {
        let Some(channel_id) = self.channels[row.imu][row.stream() as usize] else { return Ok(()) };
        self.message.clear();
        protobuf::encode(row, &mut self.message);
        let header = MessageHeader {
            channel_id,
            sequence: row.key().1 as u32,
            log_time: row.recorded_ns,
            publish_time: row.timestamp_ns(),
        };
        self.writer.write_to_known_channel(&header, &self.message).map_err(other)
    }

    /// Ends the chunk and appends it.
    ///
    /// # Errors
    /// If the file cannot take it; it can be tried again.
    pub fn flush(&mut self) -> io::Result<()> {
        self.writer.flush().map_err(other)?;
        self.append()
    }

    /// Writes summary and footer; can be tried again too.
    ///
    /// # Errors
    /// As [`flush`](Self::flush).
    pub fn finish(&mut self) -> io::Result<()> {
        self.writer.finish().map_err(other)?;
        self.append()
    }

    fn append(&mut self) -> io::Result<()> {
        self.file.pending.append(&mut self.memory.0.borrow_mut());
        self.file.flush()
    }

    /// Bytes, but for the chunk that is being filled.
    pub fn size(&self) -> u64 {
        self.file.size() + self.memory.0.borrow().len() as u64
    }
}

fn other(error: McapError) -> io::Error {
    io::Error::other(error)
}
