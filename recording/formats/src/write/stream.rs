//! Rows of one stream that become one file from beginning to end, in any format.

use super::mcap::McapWriter;
use isotherm_recording::rows::RecordedRow;
use isotherm_recording::{IncrementCsvWriter, Layout, RawCsvWriter};
use isotherm_shared::names::{ImuId, StreamKind};
use isotherm_shared::wire::StreamSample;
use std::io::{self, Write};

/// Writes the rows of one stream into a sink. Nothing can be read before it is finished.
pub struct RowWriter<W: Write>(FormatStream<W>);

enum FormatStream<W: Write> {
    Raw(Box<RawCsvWriter<W>>),
    Increments(Box<IncrementCsvWriter<W>>),
    Mcap(Box<McapWriter<W>>, Layout),
}

/// Text of raw samples.
impl<W: Write> From<RawCsvWriter<W>> for RowWriter<W> {
    fn from(writer: RawCsvWriter<W>) -> Self {
        Self(FormatStream::Raw(Box::new(writer)))
    }
}

/// Text of increments.
impl<W: Write> From<IncrementCsvWriter<W>> for RowWriter<W> {
    fn from(writer: IncrementCsvWriter<W>) -> Self {
        Self(FormatStream::Increments(Box::new(writer)))
    }
}

impl<W: Write> RowWriter<W> {
    /// Begins a file of MCAP.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn mcap(sink: W, imu: &ImuId, stream: StreamKind, layout: Layout) -> io::Result<Self> {
        let writer = McapWriter::new(sink, std::slice::from_ref(imu), &[(0, stream)], &[layout])?;
        Ok(Self(FormatStream::Mcap(Box::new(writer), layout)))
    }

    /// Adds a sample. One of another stream is left out. Nobody has recorded it: its time of recording is that of the
    /// acquisition, by which other programs show it.
    ///
    /// # Errors
    /// Those of the sink and of the library.
    pub fn write(&mut self, sample: StreamSample) -> io::Result<()> {
        let mut row = RecordedRow::new(0, 0, sample);
        row.recorded_ns = row.timestamp_ns();
        match (&mut self.0, &row.sample) {
            (FormatStream::Raw(writer), StreamSample::Raw(raw)) => writer.write("", raw),
            (FormatStream::Increments(writer), StreamSample::Increment(increment)) => writer.write(increment),
            (FormatStream::Raw(_) | FormatStream::Increments(_), _) => Ok(()),
            (FormatStream::Mcap(writer, layout), _) => writer.write(&row, *layout),
        }
    }

    /// Ends the file, and returns the sink.
    ///
    /// # Errors
    /// Those of the sink and of the library.
    pub fn finish(self) -> io::Result<W> {
        match self.0 {
            FormatStream::Raw(writer) => writer.finish(),
            FormatStream::Increments(writer) => writer.finish(),
            FormatStream::Mcap(mut writer, _) => {
                writer.finish()?;
                Ok(writer.into_sink())
            }
        }
    }
}
