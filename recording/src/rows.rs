//! Rows as a recorder receives them, and their form in CSV.

use crate::columns::{Column, INCREMENT, RAW};
use core::fmt::Display;
use isotherm_shared::stream::StreamKind;
use isotherm_shared::wire::{AXES, Flags, StreamSample};
use std::io::Write as _;

/// A sample as a recorder received it.
#[derive(Clone, Copy, Debug)]
pub struct RecordedRow {
    /// Index into the recorder's list of IMUs.
    pub imu: usize,
    /// When the recorder received it, Unix time \[ns\].
    pub recorded_ns: u64,
    /// The sample.
    pub sample: StreamSample,
}

/// Columns of a stream's recording.
#[must_use]
pub const fn columns(stream: StreamKind) -> &'static [Column] {
    match stream {
        StreamKind::Raw => &RAW,
        StreamKind::Increment => &INCREMENT,
    }
}

impl RecordedRow {
    /// The stream that the sample came from.
    pub const fn stream(&self) -> StreamKind {
        match self.sample {
            StreamSample::Raw(_) => StreamKind::Raw,
            StreamSample::Increment(_) => StreamKind::Increment,
        }
    }

    /// Session and sequence.
    pub const fn key(&self) -> (u64, u64) {
        match &self.sample {
            StreamSample::Raw(raw) => (raw.session, raw.sequence),
            StreamSample::Increment(increment) => (increment.session, increment.sequence),
        }
    }

    /// Time of the acquisition's clock \[ns\].
    pub const fn timestamp_ns(&self) -> u64 {
        match &self.sample {
            StreamSample::Raw(raw) => raw.timestamp_ns,
            StreamSample::Increment(increment) => increment.timestamp_ns,
        }
    }

    /// Passes the values to `values`, in the order of the columns.
    pub fn visit(&self, values: &mut impl ValueVisitor) {
        let (session, sequence) = self.key();
        values.u64(self.recorded_ns);
        values.u64(session);
        values.u64(sequence);
        values.u64(self.timestamp_ns());
        match &self.sample {
            StreamSample::Raw(raw) => {
                values.u64(raw.interval_ns);
                values.u64(raw.sent_ns);
                values.u64(raw.telemetry_ns);
                for axis in 0..AXES {
                    values.u32(raw.positive_pulses[axis]);
                    values.u32(raw.negative_pulses[axis]);
                    values.f64(raw.head_temperature[axis]);
                    values.f64(raw.board_temperature[axis]);
                }
            }
            StreamSample::Increment(increment) => {
                let flags = Flags(increment.flags);
                values.u64(increment.interval_ns);
                increment.velocity_increment.iter().for_each(|dv| values.f64(*dv));
                values.text(format_args!("{:016x}", increment.table));
                values.text(flags.only(Flags::SAMPLE));
                values.text(flags.only(Flags::DELIVERY));
                values.u32(flags.0);
                values.u32(increment.latency_ns);
            }
        }
    }
}

/// Receives the values of a row, one column after the other.
pub trait ValueVisitor {
    /// A value of a [`ColumnKind::U64`](crate::columns::ColumnKind::U64) column.
    fn u64(&mut self, value: u64);
    /// A value of a [`ColumnKind::U32`](crate::columns::ColumnKind::U32) column.
    fn u32(&mut self, value: u32);
    /// A value of a [`ColumnKind::F64`](crate::columns::ColumnKind::F64) column.
    fn f64(&mut self, value: f64);
    /// A value of a [`ColumnKind::Text`](crate::columns::ColumnKind::Text) column.
    fn text(&mut self, value: impl Display);
}

/// The header line of a CSV recording.
pub fn header(columns: &[Column]) -> Vec<u8> {
    let names: Vec<_> = columns.iter().map(|column| column.name).collect();
    (names.join(",") + "\n").into_bytes()
}

/// Appends a row as a line of CSV. Floats have the shortest form that reads back as the same double.
pub fn append(row: &RecordedRow, text: &mut Vec<u8>) {
    row.visit(&mut CsvLine(text));
    // Replaces the comma after the last value.
    if let Some(last) = text.last_mut() {
        *last = b'\n';
    }
}

struct CsvLine<'a>(&'a mut Vec<u8>);

// Writing to memory cannot fail, so the results are dropped.
impl ValueVisitor for CsvLine<'_> {
    fn u64(&mut self, value: u64) {
        let _ = write!(self.0, "{value},");
    }
    fn u32(&mut self, value: u32) {
        let _ = write!(self.0, "{value},");
    }
    fn f64(&mut self, value: f64) {
        let _ = write!(self.0, "{value:?},");
    }
    fn text(&mut self, value: impl Display) {
        let _ = write!(self.0, "{value},");
    }
}
