//! Rows as messages in an MCAP file, in the channels `isotherm/<imu>/raw` and `isotherm/<imu>/increment`. The file contains their
//! schemas.

use super::growing::GrowingFile;
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

/// An MCAP file that is being written. Every flush ends a chunk, so readers can read all flushed messages of an unfinished file.
pub struct McapFile {
    writer: mcap::Writer<NoSeek<Memory>>,
    memory: Memory,
    file: GrowingFile,
    /// Channel ids by IMU and stream.
    channels: Vec<[Option<u16>; 2]>,
    message: Vec<u8>,
}

/// The sink of the library. It is in memory, so that an error of the disk never leaves the library in an undefined state.
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
    /// Creates a file with a channel for each of `streams`: index in the list `imus`, and kind of the stream.
    ///
    /// # Errors
    /// If it exists or cannot be written.
    pub fn create(path: &Path, imus: &[ImuId], streams: &[(usize, StreamKind)]) -> io::Result<Self> {
        let memory = Memory::default();
        let library = concat!("isotherm ", env!("CARGO_PKG_VERSION"));
        // Compression runs in this thread. The sink cannot seek.
        let options = WriteOptions::new().library(library).disable_seeking(true);
        let options = options.compression_level(1).compression_threads(0);
        let mut writer = options.create(NoSeek::new(memory.clone())).map_err(io_error)?;
        let mut channels = vec![[None; 2]; imus.len()];
        for &(imu, stream) in streams {
            let schema = protobuf::descriptor(stream);
            let schema = writer.add_schema(protobuf::message(stream), "protobuf", &schema).map_err(io_error)?;
            let units = columns(stream).iter().map(|column| (column.name.to_owned(), column.unit.to_owned()));
            let mut metadata: BTreeMap<_, _> = units.collect();
            metadata.insert("imu".to_owned(), imus[imu].to_string());
            let topic = format!("isotherm/{}/{}", imus[imu], stream.name());
            let channel = writer.add_channel(schema, &topic, "protobuf", &metadata).map_err(io_error)?;
            channels[imu][stream as usize] = Some(channel);
        }
        writer.flush().map_err(io_error)?;
        let file = GrowingFile::create(path, &memory.0.take())?;
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
        self.writer.write_to_known_channel(&header, &self.message).map_err(io_error)
    }

    /// Ends the chunk and appends it to the file.
    ///
    /// # Errors
    /// If the file cannot be written. The call can be repeated.
    pub fn flush(&mut self) -> io::Result<()> {
        self.writer.flush().map_err(io_error)?;
        self.append()
    }

    /// Writes summary and footer. The call can be repeated after an error.
    ///
    /// # Errors
    /// As [`flush`](Self::flush).
    pub fn finish(&mut self) -> io::Result<()> {
        self.writer.finish().map_err(io_error)?;
        self.append()
    }

    fn append(&mut self) -> io::Result<()> {
        self.file.pending.append(&mut self.memory.0.borrow_mut());
        self.file.flush()
    }

    /// Size without the open chunk \[bytes\].
    pub fn size(&self) -> u64 {
        self.file.size() + self.memory.0.borrow().len() as u64
    }
}

fn io_error(error: McapError) -> io::Error {
    io::Error::other(error)
}
