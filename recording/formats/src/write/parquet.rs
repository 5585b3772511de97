//! Rows in a Parquet file: one that is complete at every instant, with checks, and one that is written from beginning
//! to end, without.
//!
//! A Parquet file has its footer at the end, so it cannot simply grow. At a flush the full row groups are kept, and the
//! open row group and the footer are the end behind them until the next flush.

pub(crate) mod encode;

use super::vacant::has_no_rows;
use crate::seal::MAGIC;
use encode::{Checks, Encoder};
use isotherm_recording::columns::Layout;
use isotherm_recording::rows::RecordedRow;
use isotherm_shared::names::{ImuId, StreamKind};
use isotherm_support::storage::{GrowingFile, Storage};
use std::io;
use std::path::Path;

/// A file goes on in the next one when its footer has so many bytes, after about a day at 1 kHz: the footer grows with
/// each row group and is written at each flush, and readers keep several times its size in memory.
pub(super) const LONGEST_FOOTER: usize = 4 << 20;
/// So many row groups of a file that is not flushed have the same number of rows; the next ones have twice as many. The
/// footer has over a hundred bytes for each column of a group.
const GROUPS_ALIKE: usize = 1024;

/// A Parquet file of one stream that is being written.
pub(super) struct ParquetFile {
    file: Box<dyn GrowingFile>,
    encoder: Encoder,
    /// Length of the body: magic number and full row groups \[bytes\].
    body: u64,
    /// The end of the body: the bytes that are not yet in the file.
    recent: Vec<u8>,
    /// Length of open row group and footer at the last flush \[bytes\].
    tail: u64,
    /// [`LONGEST_FOOTER`], and less in tests.
    longest_footer: usize,
}

impl ParquetFile {
    /// Creates a file without rows.
    ///
    /// # Errors
    /// If it exists or cannot be written.
    pub(super) fn create(
        storage: &dyn Storage,
        path: &Path,
        imu: &ImuId,
        stream: StreamKind,
        layout: Layout,
    ) -> io::Result<Self> {
        let mut encoder = Encoder::new(imu, stream, layout, Checks::Written)?;
        let body = MAGIC.len() as u64;
        let file = storage.create(path, MAGIC, &encoder.tail(body)?, has_no_rows)?;
        Ok(Self { file, encoder, body, recent: Vec::new(), tail: 0, longest_footer: LONGEST_FOOTER })
    }

    /// Gives a file without rows another layout, at the next flush.
    ///
    /// # Errors
    /// If the library refuses it.
    pub(super) fn change_layout(&mut self, imu: &ImuId, stream: StreamKind, layout: Layout) -> io::Result<()> {
        if layout != self.encoder.layout {
            self.encoder = Encoder::new(imu, stream, layout, Checks::Written)?;
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
        let tail = self.encoder.tail(self.body)?;
        self.file.grow(&self.recent, &tail)?;
        self.recent.clear();
        self.tail = tail.len() as u64;
        Ok(())
    }

    /// Size \[bytes\]; exact after a flush.
    pub(super) const fn size(&self) -> u64 {
        self.body + self.tail
    }

    /// Whether it has so many row groups that the rows should go on in another file. Exact after a flush.
    pub(super) const fn is_full(&self) -> bool {
        self.encoder.footer >= self.longest_footer
    }

    /// Ends row groups after a row, and the file at a footer of this length.
    #[cfg(test)]
    pub(super) const fn shorten(&mut self, longest_footer: usize) {
        (self.encoder.group_rows, self.longest_footer) = (1, longest_footer);
    }
}

/// Rows that become one Parquet file from beginning to end, in any sink. Nothing can be read before it is finished. It
/// has no checks.
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
        let encoder = Encoder::new(imu, stream, layout, Checks::Absent)?;
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
        if self.encoder.groups().is_multiple_of(GROUPS_ALIKE) {
            self.encoder.group_rows *= 2;
        }
        self.sink.write_all(&bytes)
    }

    /// Writes the footer and returns the sink.
    ///
    /// # Errors
    /// Those of the sink and of the library.
    pub fn finish(mut self) -> io::Result<W> {
        if self.encoder.has_open() {
            self.end_group()?;
        }
        self.sink.write_all(&self.encoder.tail(self.length)?)?;
        self.sink.flush()?;
        Ok(self.sink)
    }
}

/// Writes rows as the recorder does, with smaller row groups.
#[cfg(test)]
pub(crate) fn write_groups(
    path: &Path,
    imu: &ImuId,
    stream: StreamKind,
    layout: Layout,
    group_rows: usize,
    rows: &[RecordedRow],
) -> io::Result<()> {
    let mut file = ParquetFile::create(&isotherm_files::Disk, path, imu, stream, layout)?;
    file.encoder.group_rows = group_rows;
    for chunk in rows.chunks(group_rows * 2 / 3) {
        chunk.iter().try_for_each(|row| file.write(row))?;
        file.flush()?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::encode::ROW_GROUP;
    use super::*;
    use isotherm_files::Disk;
    use isotherm_shared::wire::{RawSample, StreamSample};
    use parquet::file::reader::{FileReader as _, SerializedFileReader};
    use std::fs::{self, File};

    /// A file that is not flushed has fewer row groups than rows: eight doublings have 255 times as many rows as groups
    /// of the first size.
    #[test]
    fn row_groups_of_a_long_file_grow() {
        let imu = "imu-a".parse().unwrap();
        let mut file = ParquetStream::new(Vec::new(), &imu, StreamKind::Increment, Layout::default()).unwrap();
        file.encoder.group_rows = 1;
        let mut rows = [0, 0];
        for (doublings, rows) in rows.iter_mut().enumerate() {
            while file.encoder.group_rows < 2 << doublings {
                let sample = StreamSample::Increment(isotherm_shared::wire::CompensatedIncrement::default());
                file.write(&RecordedRow::new(0, 0, sample)).unwrap();
                *rows += 1;
            }
        }
        assert_eq!(rows, [GROUPS_ALIKE, 2 * GROUPS_ALIKE]);
        let groups = file.encoder.groups();
        let bytes = file.finish().unwrap();
        let footer = u32::from_le_bytes(*bytes[bytes.len() - 8..].first_chunk().unwrap()) as usize;
        assert!(groups == 2 * GROUPS_ALIKE && footer < 4096 * groups, "{groups}, {footer}");
    }

    /// After every flush the file has all rows.
    #[test]
    fn every_flush_leaves_a_complete_file() {
        {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("r.parquet");
            let mut file =
                ParquetFile::create(&Disk, &path, &"imu-a".parse().unwrap(), StreamKind::Raw, Layout::default())
                    .unwrap();
            let mut rows = 0;
            // Within a row group, beyond its end, two groups at once, exactly up to its end, and none.
            for more in [0, 1, 10, ROW_GROUP, 2 * ROW_GROUP, ROW_GROUP - 11, 0, 5] {
                for _ in 0..more {
                    let raw = RawSample { sequence: rows, ..RawSample::default() };
                    file.write(&RecordedRow::new(0, 0, StreamSample::Raw(raw))).unwrap();
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
                assert!(sequences.eq(0..rows as i64), "{rows}");
                assert_eq!(fs::metadata(&path).unwrap().len(), file.size());
            }
            drop(file);
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left next to it");
        }
    }
}
