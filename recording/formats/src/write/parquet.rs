//! Rows in a Parquet file: one that is complete at every instant, with checks, and one that is written from beginning
//! to end, without.
//!
//! A Parquet file has its footer at the end, so it cannot simply grow. Two files take turns, a visible one under the
//! name and a hidden one. At a flush the hidden file gets the full row groups that it lacks, then the open row group,
//! then the footer. Then the two files exchange their names in one step. A reader that opens the name, also after a
//! crash, gets all rows up to the last flush.

pub(crate) mod encode;

use super::growing::{create, staged_file};
use crate::seal::MAGIC;
use encode::{Checks, Encoder};
use isotherm_files::{exchange, sync_folder};
use isotherm_recording::columns::Layout;
use isotherm_recording::rows::RecordedRow;
use isotherm_shared::names::{ImuId, StreamKind};
use std::fs::{self, File};
use std::io;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// A file goes on in the next one when its footer has so many bytes, after about a day at 1 kHz: the footer grows with
/// each row group and is written at each flush, and readers keep several times its size in memory.
pub(super) const LONGEST_FOOTER: usize = 4 << 20;
/// So many row groups of a file that is not flushed have the same number of rows; the next ones have twice as many. The
/// footer has over a hundred bytes for each column of a group.
const GROUPS_ALIKE: usize = 1024;

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
    /// [`LONGEST_FOOTER`], and less in tests.
    longest_footer: usize,
}

impl ParquetFile {
    /// Creates a file without rows.
    ///
    /// # Errors
    /// If it exists or cannot be written.
    pub(super) fn create(path: &Path, imu: &ImuId, stream: StreamKind, layout: Layout) -> io::Result<Self> {
        let mut encoder = Encoder::new(imu, stream, layout, Checks::Written)?;
        let mut bytes = MAGIC.to_vec();
        bytes.append(&mut encoder.tail(MAGIC.len() as u64)?);
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
            longest_footer: LONGEST_FOOTER,
        })
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

    /// Whether it has so many row groups that the rows should go on in another file. Exact after a flush.
    pub(super) const fn is_full(&self) -> bool {
        self.encoder.footer >= self.longest_footer
    }

    /// Ends row groups after a row, and the file at a footer of this length.
    #[cfg(test)]
    pub(super) const fn shorten(&mut self, longest_footer: usize) {
        (self.encoder.group_rows, self.longest_footer) = (1, longest_footer);
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
    let mut file = ParquetFile::create(path, imu, stream, layout)?;
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
    use isotherm_shared::wire::{RawSample, StreamSample};
    use parquet::file::reader::{FileReader as _, SerializedFileReader};

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
                file.write(&RecordedRow { imu: 0, recorded_ns: 0, sample }).unwrap();
                *rows += 1;
            }
        }
        assert_eq!(rows, [GROUPS_ALIKE, 2 * GROUPS_ALIKE]);
        let groups = file.encoder.groups();
        let bytes = file.finish().unwrap();
        let footer = u32::from_le_bytes(*bytes[bytes.len() - 8..].first_chunk().unwrap()) as usize;
        assert!(groups == 2 * GROUPS_ALIKE && footer < 4096 * groups, "{groups}, {footer}");
    }

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
