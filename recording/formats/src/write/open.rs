//! A file of a recording that is being written, in its format.

use super::growing::Appender;
use super::mcap::McapFile;
use super::ros::{RosFile, RosTable};
use isotherm_recording::columns::{Layout, columns};
use isotherm_recording::rows::{self, RecordedRow};
use isotherm_shared::names::{ImuId, StreamKind};
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::storage::Storage;
use std::io;
use std::path::{Path, PathBuf};

/// An error of the operating system, and the file.
pub struct FileError(pub PathBuf, pub io::Error);

impl From<FileError> for Failure {
    fn from(FileError(path, error): FileError) -> Self {
        if error.kind() == io::ErrorKind::AlreadyExists {
            let path = shown(&path);
            let remedy = "a recording is never replaced: name another, or rotate, which numbers the files";
            return Self::new(Exit::Io, format!("{path} exists; {remedy}"));
        }
        Self::io("writing", &path, &error)
    }
}

impl FileError {
    /// Whether the disk, or what this user may have of it, is full: there may be room again.
    #[must_use]
    pub fn is_full(&self) -> bool {
        matches!(self.1.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded)
    }
}

/// A file that is being written.
pub(super) struct OpenFile {
    pub(super) path: PathBuf,
    writer: FormatWriter,
}

enum FormatWriter {
    Csv(Appender, Layout),
    Mcap(Box<McapFile>),
    Ros(Box<RosFile>),
}

impl OpenFile {
    fn new(path: &Path, writer: FormatWriter) -> Self {
        Self { path: path.to_owned(), writer }
    }

    /// Creates a file of a stream as text; `-` is the standard output.
    pub(super) fn csv(storage: &dyn Storage, path: &Path, stream: StreamKind, layout: Layout) -> io::Result<Self> {
        let file = Appender::create(storage, path, &rows::header(&columns(stream, layout)))?;
        Ok(Self::new(path, FormatWriter::Csv(file, layout)))
    }

    /// Creates a file of all streams.
    pub(super) fn mcap(
        storage: &dyn Storage,
        path: &Path,
        imus: &[ImuId],
        streams: &[(usize, StreamKind)],
        layouts: &[Layout],
    ) -> io::Result<Self> {
        let file = McapFile::create(storage, path, imus, streams, layouts)?;
        Ok(Self::new(path, FormatWriter::Mcap(Box::new(file))))
    }

    /// Creates a file of ROS messages.
    pub(super) fn ros(
        storage: &dyn Storage,
        path: &Path,
        imus: &[(usize, &ImuId)],
        tables: &[RosTable],
    ) -> io::Result<Self> {
        let file = RosFile::create(storage, path, imus, tables)?;
        Ok(Self::new(path, FormatWriter::Ros(Box::new(file))))
    }

    fn failed(&self, error: io::Error) -> FileError {
        FileError(self.path.clone(), error)
    }

    /// Gives a file without rows another layout: that of its stream, or those of all IMUs.
    pub(super) fn change_layout(
        &mut self,
        stream: StreamKind,
        layout: Layout,
        all: &[Layout],
    ) -> Result<(), FileError> {
        let result = match &mut self.writer {
            FormatWriter::Csv(file, known) => {
                if *known != layout {
                    file.restart(rows::header(&columns(stream, layout)));
                    *known = layout;
                }
                Ok(())
            }
            FormatWriter::Mcap(file) => file.change_layouts(all),
            FormatWriter::Ros(_) => Ok(()),
        };
        result.map_err(|error| self.failed(error))
    }

    /// Encodes a row. `layout` is that of its IMU, which matters to a file of all streams.
    pub(super) fn write(&mut self, row: &RecordedRow, layout: Layout) -> Result<(), FileError> {
        let result = match &mut self.writer {
            FormatWriter::Csv(file, layout) => {
                rows::append(row, *layout, &mut file.pending);
                Ok(())
            }
            FormatWriter::Mcap(file) => file.write(row, layout),
            FormatWriter::Ros(file) => file.write(row),
        };
        result.map_err(|error| self.failed(error))
    }

    /// Makes what has been encoded visible and durable.
    pub(super) fn flush(&mut self) -> Result<(), FileError> {
        let result = match &mut self.writer {
            FormatWriter::Csv(file, _) => file.flush(),
            FormatWriter::Mcap(file) => file.flush(),
            FormatWriter::Ros(file) => file.flush(),
        };
        result.map_err(|error| self.failed(error))
    }

    /// As [`flush`](Self::flush), and ends the file.
    pub(super) fn finish(&mut self) -> Result<(), FileError> {
        let result = match &mut self.writer {
            FormatWriter::Csv(..) => return self.flush(),
            FormatWriter::Mcap(file) => file.finish(),
            FormatWriter::Ros(file) => file.end(),
        };
        result.map_err(|error| self.failed(error))
    }

    /// How much of the disk the next flush takes at most \[bytes\], with so many rows that are not written.
    pub(super) fn needs(&self, rows: u64) -> u64 {
        /// More than a row takes that is no text.
        const ROW: u64 = 512;
        match &self.writer {
            FormatWriter::Csv(file, _) => file.pending.len() as u64,
            _ => rows.saturating_mul(ROW),
        }
    }

    /// Size \[bytes\].
    pub(super) fn size(&self) -> u64 {
        match &self.writer {
            FormatWriter::Csv(file, _) => file.size(),
            FormatWriter::Mcap(file) => file.size(),
            FormatWriter::Ros(file) => file.size(),
        }
    }
}
