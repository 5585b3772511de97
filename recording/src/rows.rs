//! Rows as a recorder receives them, and their form in CSV.

use crate::columns::{Column, ColumnKind, ColumnSet, Layout, RECORDED_NS, UNIX_OFFSET_NS, all, load, load_increment};
use isotherm_shared::names::StreamKind;
use isotherm_shared::sequence::Period;
use isotherm_shared::wire::{Flags, StreamSample};
use std::io::Write as _;

/// How far Unix time was ahead of `CLOCK_MONOTONIC` when a recorder received a sample.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct RecordedOffset {
    offset_ns: u64,
    uncertainty_ns: u64,
}

impl RecordedOffset {
    /// An offset that lies within this uncertainty \[ns\]; `None` for a clock that is set to a time before 1970.
    #[must_use]
    pub fn new(offset_ns: i64, uncertainty_ns: u64) -> Option<Self> {
        // Where 0 means unknown, the narrowest bound is 1.
        u64::try_from(offset_ns).ok().map(|offset_ns| Self { offset_ns, uncertainty_ns: uncertainty_ns.max(1) })
    }

    /// The Unix time at this time of `CLOCK_MONOTONIC` \[ns\].
    #[must_use]
    pub const fn unix_ns(self, monotonic_ns: u64) -> u64 {
        self.offset_ns.saturating_add(monotonic_ns)
    }
}

/// A sample as a recorder received it.
#[derive(Clone, Copy, Debug)]
pub struct RecordedRow {
    /// Index into the recorder's list of IMUs.
    pub imu: usize,
    /// When the recorder received it, Unix time \[ns\].
    pub recorded_ns: u64,
    /// The offset of Unix time then, where the recorder measures it.
    pub unix_offset: Option<RecordedOffset>,
    /// The sample.
    pub sample: StreamSample,
}

impl RecordedRow {
    /// A row without an offset of Unix time.
    #[must_use]
    pub const fn new(imu: usize, recorded_ns: u64, sample: StreamSample) -> Self {
        Self { imu, recorded_ns, unix_offset: None, sample }
    }

    /// The columns that the row needs.
    #[must_use]
    pub fn layout(&self) -> Layout {
        Layout { unix_offset: self.unix_offset.is_some(), ..Layout::of(&self.sample) }
    }

    /// The stream that the sample came from.
    pub const fn stream(&self) -> StreamKind {
        match self.sample {
            StreamSample::Raw(_) => StreamKind::Raw,
            StreamSample::Increment(_) => StreamKind::Increment,
        }
    }

    /// Session, sequence and times.
    #[must_use]
    pub fn period(&self) -> Period {
        match &self.sample {
            StreamSample::Raw(raw) => raw.into(),
            StreamSample::Increment(increment) => increment.into(),
        }
    }

    /// Time of the acquisition's clock \[ns\].
    pub const fn timestamp_ns(&self) -> u64 {
        match &self.sample {
            StreamSample::Raw(raw) => raw.timestamp_ns,
            StreamSample::Increment(increment) => increment.timestamp_ns,
        }
    }

    /// Passes each column of a file with this layout and its value to `take`: an integer, the bits of a double or those
    /// of flags.
    pub fn visit(&self, layout: Layout, mut take: impl FnMut(&Column, u64)) {
        for (index, column) in all(self.stream()).iter().enumerate() {
            if layout.has(column) {
                let value = match &self.sample {
                    _ if index == RECORDED_NS => self.recorded_ns,
                    _ if column.set == ColumnSet::UnixOffset => self.unix_offset.map_or(0, |offset| {
                        if column.name == UNIX_OFFSET_NS { offset.offset_ns } else { offset.uncertainty_ns }
                    }),
                    StreamSample::Raw(raw) => load(raw, index),
                    StreamSample::Increment(increment) => load_increment(increment, index),
                };
                take(column, value);
            }
        }
    }
}

/// Appends a value as text: floats in the shortest form that reads back as the same double.
pub fn append_value(kind: ColumnKind, value: u64, text: &mut Vec<u8>) {
    // Writing to memory cannot fail, so the results are dropped.
    let _ = match kind {
        // As most pulses of the channel that does not count.
        ColumnKind::U64 | ColumnKind::U32 if value < 10 => {
            text.push(b'0' + value as u8);
            Ok(())
        }
        ColumnKind::U64 | ColumnKind::U32 => write!(text, "{value}"),
        ColumnKind::F64 => write!(text, "{:?}", f64::from_bits(value)),
        ColumnKind::Hex => write!(text, "{value:016x}"),
        ColumnKind::Flags => write!(text, "{}", Flags(value)),
    };
}

/// The header line of a CSV recording.
pub fn header(columns: &[Column]) -> Vec<u8> {
    let names: Vec<_> = columns.iter().map(|column| column.name).collect();
    (names.join(",") + "\n").into_bytes()
}

/// Appends a row as a line of CSV.
pub fn append(row: &RecordedRow, layout: Layout, text: &mut Vec<u8>) {
    row.visit(layout, |column, value| {
        append_value(column.kind, value, text);
        text.push(b',');
    });
    // Replaces the comma after the last value.
    text.pop();
    text.push(b'\n');
}
